"""Read HDR mastering display and content light level metadata, and pass it to encoders."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

Point = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class MasteringDisplay:
    """Mastering display of a clip (SMPTE ST 2086).

    Attributes
    ----------
    red, green, blue, white : (Fraction, Fraction) or None
        CIE 1931 x and y; None if only luminance is given.
    brightest, darkest : Fraction or None
        Maximum and minimum luminance, cd/m2; None if only colours are given.
    """

    red: Point | None
    green: Point | None
    blue: Point | None
    white: Point | None
    brightest: Fraction | None
    darkest: Fraction | None


@dataclass(frozen=True)
class LightLevel:
    """Content light levels of a clip (CTA-861.3), cd/m2.

    Attributes
    ----------
    brightest_pixel : int
        MaxCLL, the maximum content light level.
    brightest_frame : int
        MaxFALL, the maximum frame-average light level.
    """

    brightest_pixel: int
    brightest_frame: int


def parse_mastering_display(data: bytes | None) -> MasteringDisplay | None:
    """Parse FFmpeg's AVMasteringDisplayMetadata; return None if it is absent or empty."""
    if data is None or len(data) < 88:
        return None
    *numbers, has_colours, has_luminance = struct.unpack_from("=22i", data)
    values = [Fraction(above, below or 1) for above, below in zip(numbers[::2], numbers[1::2], strict=True)]
    if not has_colours and not has_luminance:
        return None
    red, green, blue, white = ((values[at], values[at + 1]) if has_colours else None for at in (0, 2, 4, 6))
    darkest, brightest = values[8:10] if has_luminance else (None, None)
    return MasteringDisplay(red, green, blue, white, brightest, darkest)


def parse_light_level(data: bytes | None) -> LightLevel | None:
    """Parse FFmpeg's AVContentLightMetadata; return None if it is absent or empty."""
    if data is None or len(data) < 8:
        return None
    levels = LightLevel(*struct.unpack_from("=2I", data))
    return levels if levels != LightLevel(0, 0) else None


def with_hdr(
    options: Mapping[str, str], encoder: str, display: MasteringDisplay | None, light: LightLevel | None
) -> tuple[dict[str, str], bool]:
    """Add the mastering display and the light levels to an encoder's options.

    Parameters
    ----------
    options : mapping of str to str
        The encoder's options; parameters that are already there are kept and take precedence.
    encoder : str
        FFmpeg's name.
    display : MasteringDisplay or None
    light : LightLevel or None

    Returns
    -------
    dict of str to str, bool
        The options, and whether they hold all the metadata.
    """
    if encoder not in _parameters:
        return dict(options), display is None and light is None
    name, name_of_display, name_of_light, whole_units = _parameters[encoder]
    parameters = []
    if display is not None and None not in (display.white, display.brightest):
        parameters.append(f"{name_of_display}={_display_text(display, whole_units)}")
    if light is not None:
        parameters.append(f"{name_of_light}={light.brightest_pixel},{light.brightest_frame}")
    told_all = len(parameters) == (display is not None) + (light is not None)
    if not parameters:
        return dict(options), told_all
    return {**options, name: ":".join([*parameters, *([options[name]] if options.get(name) else [])])}, told_all


_parameters = {
    "libx264": ("x264-params", "mastering-display", "cll", True),
    "libx265": ("x265-params", "master-display", "max-cll", True),
    "libsvtav1": ("svtav1-params", "mastering-display", "content-light", False),
}
"""By encoder: the name of its parameter list, its parameters for display and light level, and whether their unit is
the integer unit of the standard (0.00002 for chromaticities, 0.0001 cd/m2) or a decimal number."""


def _display_text(display: MasteringDisplay, whole_units: bool) -> str:
    """Format a display as ``G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)``."""

    def text(value: Fraction | None, unit: int) -> str:
        assert value is not None
        return str(round(value * unit)) if whole_units else f"{float(value):.6f}"

    pairs = {
        **{letter: point for letter, point in zip("GBR", (display.green, display.blue, display.red), strict=True)},
        "WP": display.white,
    }
    colours = "".join(
        f"{name}({text(point[0], 50_000)},{text(point[1], 50_000)})" for name, point in pairs.items() if point
    )
    return f"{colours}L({text(display.brightest, 10_000)},{text(display.darkest, 10_000)})"
