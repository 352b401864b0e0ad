"""Properties of a video's pictures beyond their samples: colour coding, pixel shape, orientation and HDR metadata."""

import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError
from av.video.reformatter import VideoReformatter

from fpsboost.media.errors import InputError
from fpsboost.media.pixels import (
    BT709,
    LIMITED_RANGE,
    NO_COLOUR_TAG,
    UNSPECIFIED,
    chroma_location_of,
    color_space_of,
    is_full_range,
)
from fpsboost.media.pyav import as_fraction
from fpsboost.media.side_data import MASTERING, described, is_ordinary, side_data_of, stereo_mode_of

matrices = {0: "rgb", 1: "bt709", 4: "fcc", 5: "bt470bg", 6: "smpte170m", 7: "smpte240m", 9: "bt2020nc", 10: "bt2020c"}
primaries = {
    1: "bt709",
    4: "bt470m",
    5: "bt470bg",
    6: "smpte170m",
    7: "smpte240m",
    8: "film",
    9: "bt2020",
    10: "smpte428",
    11: "smpte431",
    12: "smpte432",
}
transfers = {
    1: "bt709",
    4: "gamma22",
    5: "gamma28",
    6: "smpte170m",
    7: "smpte240m",
    8: "linear",
    9: "log100",
    10: "log316",
    11: "iec61966-2-4",
    12: "bt1361e",
    13: "srgb",
    14: "bt2020-10",
    15: "bt2020-12",
    16: "pq",
    17: "smpte428",
    18: "hlg",
}
"""Common names of FFmpeg's colour tags, by number; a tag without a name is shown as its number."""

# transfer functions
LINEAR = 8
SRGB = 13
PQ = 16
HLG = 18
_plain = {BT709, *NO_COLOUR_TAG["color_primaries"]}

UPRIGHT = struct.pack("=9i", 1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
"""Display matrix without rotation or flip, as from EXIF."""

ALWAYS_LOCATED = ("h264", "hevc", "amv", "h263", "mjpeg", "mpeg1video", "theora")
"""Codecs whose decoders always give the chroma location; for others, FFmpeg takes an unknown one for the centre."""

Point = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class MasteringDisplay:
    """Mastering display (SMPTE ST 2086): CIE 1931 x and y of red, green, blue and white, and luminance in cd/m2.

    Either may be None.
    """

    colours: tuple[Point, ...] | None
    brightest: Fraction | None
    darkest: Fraction | None


@dataclass(frozen=True)
class LightLevel:
    """Content light levels of a clip (CTA-861.3), cd/m2: MaxCLL and MaxFALL."""

    brightest_pixel: int
    brightest_frame: int


@dataclass(frozen=True)
class VideoTraits:
    """Colour coding, pixel shape, orientation and HDR metadata of a video's pictures, which a sink keeps.

    Tags are FFmpeg's numbers (ITU-T H.273), 2 for unspecified; the defaults are those of images without any tag.

    Parameters
    ----------
    pixel_format : str
        FFmpeg's name of the pixel format.
    color_space : int
        AVColorSpace by which pictures are converted: the tagged one, otherwise BT.709 from 720 rows on, BT.601 below.
    tagged_color_space : int
        AVColorSpace of the tag.
    color_range : int
        AVColorRange of the tag, 0 for unspecified.
    color_primaries, color_transfer : int
        Tags of primaries and transfer function.
    full_range : bool
        Whether black is at 0 rather than 16 (in 8 bits).
    chroma_location : str
        FFmpeg's name of the place of chroma samples.
    tagged_chroma_location : bool
        Whether that is a tag and not FFmpeg's guess.
    sample_aspect_ratio : Fraction, optional
        Width of a pixel over its height; None if unknown.
    display_matrix : tuple of int, optional
        Nine numbers in 16.16 and 2.30 fixed point; None for upright pictures.
    mastering_display : MasteringDisplay, optional
        Display on which the video was graded.
    light_level : LightLevel, optional
        Content light levels of the clip.
    side_data : Mapping
        Words for further side data, by its type.
    stereo_mode : str
        Matroska's name of how a picture holds two views; empty for one view.
    dolby_vision_only : bool
        Whether only decoders of Dolby Vision know the colours.
    codec : str
        FFmpeg's name of the format that the pictures were coded in; empty if they were not.
    """

    pixel_format: str = "gbrp"
    color_space: int = BT709
    tagged_color_space: int = BT709
    color_range: int = LIMITED_RANGE
    color_primaries: int = UNSPECIFIED
    color_transfer: int = UNSPECIFIED
    full_range: bool = False
    chroma_location: str = "left"
    tagged_chroma_location: bool = True
    sample_aspect_ratio: Fraction | None = None
    display_matrix: tuple[int, ...] | None = None
    mastering_display: MasteringDisplay | None = None
    light_level: LightLevel | None = None
    side_data: Mapping[str, str] = field(default_factory=dict, compare=False)
    stereo_mode: str = field(default="", compare=False)
    dolby_vision_only: bool = field(default=False, compare=False)
    codec: str = field(default="", compare=False)

    @property
    def code_points(self) -> tuple[int, int]:
        """Primaries and transfer function to tag images with; unspecified for BT.709, which needs no tag.

        Most viewers take untagged images for sRGB, and show BT.709 nearly as a player does.
        """
        numbers = self.color_primaries, self.color_transfer
        return (UNSPECIFIED, UNSPECIFIED) if {*numbers} <= _plain else numbers

    def beyond_sdr(self) -> Iterator[str]:
        """Yield in words what a target without colour tags loses; plain SDR looks nearly right without."""
        if self.color_primaries not in {*_plain, 5, 6}:  # 5 and 6 are of BT.601
            yield "colour primaries"
        if self.color_transfer in (LINEAR, PQ, HLG):
            yield "transfer function"
        if self.mastering_display is not None or self.light_level is not None:
            yield MASTERING


def read_traits(
    picture: av.VideoFrame,
    stream: av.VideoStream,
    reformatter: VideoReformatter,
    name: str,
    dolby_vision: tuple[int, int] | None = None,
) -> VideoTraits:
    """Return the traits of a stream, read from its first picture; see `HeaderData` about Dolby Vision."""
    all_sides = side_data_of(picture)
    sides = dict(all_sides)
    matrix = sides.get("DISPLAYMATRIX")
    try:
        color_space = color_space_of(picture)
    except ValueError:
        raise InputError(
            f"{name} uses the colour matrix number {picture.colorspace}, which is not supported; convert it to BT.709 "
            "or BT.2020 first."
        ) from None
    location = chroma_location_of(picture, reformatter)
    codec = stream.codec_context.codec.canonical_name
    return VideoTraits(
        pixel_format=picture.format.name,
        color_space=color_space,
        tagged_color_space=picture.colorspace,
        color_range=picture.color_range,
        color_primaries=picture.color_primaries,
        color_transfer=picture.color_trc,
        full_range=is_full_range(picture),
        chroma_location=location,
        tagged_chroma_location=location != "center" or codec in ALWAYS_LOCATED,
        sample_aspect_ratio=as_fraction(stream.sample_aspect_ratio),
        display_matrix=None if matrix in (None, UPRIGHT) else tuple(np.frombuffer(matrix, np.int32).tolist()),
        mastering_display=parse_mastering_display(sides.get("MASTERING_DISPLAY_METADATA", b"")),
        light_level=parse_light_level(sides.get("CONTENT_LIGHT_LEVEL", b"")),
        side_data=described(all_sides, picture.width),
        stereo_mode=stereo_mode_of(sides),
        dolby_vision_only=not is_ordinary(sides, dolby_vision),
        codec=codec,
    )


def traits_of_png(path: Path) -> VideoTraits:
    """Return the traits of a PNG by FFmpeg's decoder; the defaults if it cannot decode the file."""
    with suppress(FFmpegError), path.open("rb") as file, av.open(file, "r") as container:
        stream = container.streams.video[0]
        return read_traits(next(container.decode(stream)), stream, VideoReformatter(), path.name)
    return VideoTraits()


def parse_mastering_display(data: bytes) -> MasteringDisplay | None:
    """Parse FFmpeg's AVMasteringDisplayMetadata; return None if it is absent or empty."""
    if len(data) < 88:
        return None
    *numbers, has_colours, has_luminance = struct.unpack_from("=22i", data)
    values = [Fraction(above, below or 1) for above, below in zip(numbers[::2], numbers[1::2], strict=True)]
    if not has_colours and not has_luminance:
        return None
    colours = tuple((values[at], values[at + 1]) for at in (0, 2, 4, 6)) if has_colours else None
    darkest, brightest = values[8:10] if has_luminance else (None, None)
    return MasteringDisplay(colours, brightest, darkest)


def parse_light_level(data: bytes) -> LightLevel | None:
    """Parse FFmpeg's AVContentLightMetadata; return None if it is absent or empty."""
    if len(data) < 8:
        return None
    levels = LightLevel(*struct.unpack_from("=2I", data))
    return levels if levels != LightLevel(0, 0) else None


def tag_name(names: dict[int, str], number: int) -> str | None:
    """Return the common name of a colour tag; None if it is unspecified."""
    return None if number == UNSPECIFIED else names.get(number, str(number))
