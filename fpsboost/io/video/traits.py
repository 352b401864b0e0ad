"""Properties of a video's pictures beyond their samples: colour coding, pixel shape, orientation and HDR metadata."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from fpsboost.errors import InputError
from fpsboost.io.video.hdr import LightLevel, MasteringDisplay, parse_light_level, parse_mastering_display
from fpsboost.io.video.pyav import as_fraction, side_data_of
from fpsboost.io.video.ycc import chroma_location_of, color_space_of, is_full_range

DYNAMIC_HDR_SIDE_DATA = {"DYNAMIC_HDR_PLUS", "DYNAMIC_HDR_VIVID", "DOVI_METADATA", "DOVI_RPU_BUFFER"}
"""Types of FFmpeg's side data that hold dynamic HDR metadata."""


@dataclass(frozen=True)
class VideoTraits:
    """Colour coding, pixel shape, orientation and HDR metadata of a video's pictures, which a sink keeps.

    Attributes
    ----------
    pixel_format : str
        FFmpeg's name, ``yuv420p``.
    color_space : int
        AVColorSpace that the pictures are converted with: as tagged, otherwise BT.709 from 720 rows on, BT.601 below.
    tagged_color_space, color_range, color_primaries, color_transfer : int
        The tags as FFmpeg's numbers, 2 (range: 0) for unspecified.
    full_range : bool
        Whether black is 0 rather than 16 (in 8 bits).
    chroma_location : str
        Location of subsampled chroma samples: ``left``, ``center``, ``topleft``...
    tagged_chroma_location : bool
        False if the location is only FFmpeg's guess.
    sample_aspect_ratio : Fraction or None
        Width of a pixel over its height.
    display_matrix : tuple of 9 int or None
        Rotation and flip for display, in 16.16 and 2.30 fixed point.
    mastering_display : MasteringDisplay or None
    light_level : LightLevel or None
    has_dynamic_hdr : bool
        Whether there is metadata of Dolby Vision, HDR10+ or similar, which changes from frame to frame.
    codec : str
        FFmpeg's name of the format that the pictures were coded in; empty if they were not coded. It is ignored when
        traits are compared.
    """

    pixel_format: str
    color_space: int
    tagged_color_space: int
    color_range: int
    color_primaries: int
    color_transfer: int
    full_range: bool
    chroma_location: str
    tagged_chroma_location: bool
    sample_aspect_ratio: Fraction | None
    display_matrix: tuple[int, ...] | None
    mastering_display: MasteringDisplay | None = None
    light_level: LightLevel | None = None
    has_dynamic_hdr: bool = False
    codec: str = field(default="", compare=False)

    @property
    def has_hdr_data(self) -> bool:
        """Whether there is HDR metadata beyond the colour tags."""
        return (self.mastering_display, self.light_level) != (None, None) or self.has_dynamic_hdr


def read_traits(
    picture: av.VideoFrame, stream: av.VideoStream, reformatter: VideoReformatter, name: str
) -> VideoTraits:
    """Return the traits of a stream, read from its first picture.

    Parameters
    ----------
    picture : av.VideoFrame
    stream : av.VideoStream
    reformatter : VideoReformatter
    name : str
        Name of the clip in messages.

    Raises
    ------
    InputError
        The colour matrix is not supported.
    """
    sides = side_data_of(picture)
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
        # FFmpeg takes an untagged location for the centre; only these two formats always have a tag.
        tagged_chroma_location=location != "center" or codec in ("h264", "hevc"),
        sample_aspect_ratio=as_fraction(stream.sample_aspect_ratio),
        display_matrix=tuple(np.frombuffer(matrix, np.int32).tolist()) if matrix else None,
        mastering_display=parse_mastering_display(sides.get("MASTERING_DISPLAY_METADATA")),
        light_level=parse_light_level(sides.get("CONTENT_LIGHT_LEVEL")),
        has_dynamic_hdr=not DYNAMIC_HDR_SIDE_DATA.isdisjoint(sides),
        codec=codec,
    )
