"""How a video is encoded: the encoders and what their options are called, the containers and what they take."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO

import av
from av.codec.codec import UnknownCodecError

from fpsboost.errors import OptionError

containers = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}
"""FFmpeg's name of the container by suffix."""

VIDEO_SUFFIXES = tuple(containers)
"""Suffixes of the video files that can be written."""

CLOCK_OF_MATROSKA = Fraction(1, 1000)
EXACT_CLOCKS = ("mp4", "mov")
"""Containers that count in the ticks asked for; the others count milliseconds."""

x26x_presets = (
    *("ultrafast", "superfast", "veryfast", "faster", "fast"),
    *("medium", "slow", "slower", "veryslow", "placebo"),
)


@dataclass(frozen=True)
class Encoder:
    """What an encoder's quality and speed are called, and which values they take."""

    name: str
    crf: int
    largest_crf: int
    preset: str
    presets: tuple[str, ...]
    preset_option: str
    fixed_options: tuple[tuple[str, str], ...] = ()
    needs_whole_chroma: bool = False
    """An odd width or height cannot be halved for chroma."""


encoders = {
    "h264": Encoder("libx264", 18, 51, "medium", x26x_presets, "preset", needs_whole_chroma=True),
    # x265 prints on its own, past FFmpeg's log.
    "hevc": Encoder(
        "libx265",
        20,
        51,
        "medium",
        x26x_presets,
        "preset",
        (("x265-params", "log-level=none"),),
        needs_whole_chroma=True,
    ),
    "vp9": Encoder(
        *("libvpx-vp9", 30, 63, "4"),
        *(tuple(map(str, range(9))), "cpu-used"),
        (("b", "0"), ("row-mt", "1"), ("deadline", "good")),
    ),
    "av1": Encoder("libsvtav1", 30, 63, "8", tuple(map(str, range(14))), "preset"),
}
"""Encoders by the name people use for the format."""


@dataclass(frozen=True)
class Encoding:
    """How to encode, and what to carry over.

    Parameters
    ----------
    codec : str, optional
        ``h264``, ``hevc``, ``vp9``, ``av1`` or the exact name of an FFmpeg encoder; by default H.264, in .webm VP9.
    crf : int, optional
        Quality, 0 (best) to 51 or 63; by default one that is hard to tell from the source.
    preset : str, optional
        Speed: ``ultrafast`` ... ``placebo`` for h264 and hevc, a number for vp9 (0-8) and av1 (0-13, larger is faster).
    audio, subtitles : bool
        Copy the source's sound and subtitles.
    """

    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    audio: bool = True
    subtitles: bool = True


def choose_encoder(encoding: Encoding, container: str, name: str) -> tuple[str, dict[str, str]]:
    """Find FFmpeg's encoder and its options for what was asked.

    Returns
    -------
    str, dict of str
        Encoder name and options.

    Raises
    ------
    OptionError
        Unknown codec, not allowed in this container, or a quality or preset that it does not know.
    """
    asked = encoding.codec or ("vp9" if container == "webm" else "h264")
    known = encoders.get(asked.lower()) or next((e for e in encoders.values() if e.name == asked), None)
    encoder = known.name if known else asked
    try:
        codec = av.Codec(encoder, "w")
    except UnknownCodecError:
        codec = None
    if codec is None or codec.type != "video" or codec.name != encoder:
        raise OptionError(
            f"--codec {asked} is unknown here; use {', '.join(encoders)}, or the exact name of an FFmpeg video encoder."
        )
    if not holds(container, encoder):
        fitting = [friendly for friendly, e in encoders.items() if holds(container, e.name)]
        others = suffixes_holding([encoder])
        instead = f", or write {' or '.join(others)}" if others else ""
        raise OptionError(f"--codec {asked} cannot go into {name}; use {' or '.join(fitting)}{instead}.")
    if known is None:
        return encoder, _options_of_other(codec, encoding)
    crf = known.crf if encoding.crf is None else encoding.crf
    if not 0 <= crf <= known.largest_crf:
        raise OptionError(f"--crf must be 0 to {known.largest_crf} for {asked}, not {crf}.")
    preset = encoding.preset or known.preset
    if preset not in known.presets:
        raise OptionError(f"--preset {preset} is unknown to {asked}; use one of {', '.join(known.presets)}.")
    return encoder, {"crf": str(crf), known.preset_option: preset, **dict(known.fixed_options)}


def _options_of_other(codec: av.Codec, encoding: Encoding) -> dict[str, str]:
    """Options for an encoder without an entry in the table, if it knows them."""
    known = {option.name for option in codec.create("video").supported_options.private}
    options = {}
    for option, value in (("crf", encoding.crf), ("preset", encoding.preset)):
        if value is None:
            continue
        if option not in known:
            raise OptionError(f"--{option} means nothing to {codec.name}; leave it out.")
        options[option] = str(value)
    return options


def holds(container: str, codec: str) -> bool:
    """Whether a container takes a codec.

    Parameters
    ----------
    container : str
        FFmpeg's name, ``matroska``.
    codec : str
        Name of its encoder or decoder; no container takes an empty one.
    """
    with av.open(BytesIO(), "w", format=container) as probe:
        return codec in probe.supported_codecs


def suffixes_holding(codecs: Collection[str]) -> list[str]:
    """List the suffixes of the containers that take all of these codecs."""
    return [suffix for suffix, container in containers.items() if all(holds(container, codec) for codec in codecs)]
