"""Decoded pictures of FFmpeg: pixel format, colour tags and chroma location, and what its filters make of them."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from av import VideoFormat, VideoFrame
from av.filter import Graph
from av.video.reformatter import VideoReformatter

# AVColorSpace
SMPTE170M = 6
BT709 = 1
BT2020 = 9
RGB = 0
UNSPECIFIED = 2

# AVColorRange
FULL_RANGE = 2
LIMITED_RANGE = 1

MATRICES = (1, 4, 5, 6, 7, 9)
"""AVColorSpace of the plain luma-chroma matrices, by which pictures can be converted."""

NO_COLOUR_TAG = {"colorspace": (0, 2, 3), "color_primaries": (0, 2, 3), "color_trc": (0, 2, 3), "color_range": (0,)}
"""FFmpeg's numbers of tags without information, by the tag's name in PyAV: unspecified and two reserved ones.

ProRes has 0 for unspecified colours; as the matrix of RGB it is a tag.
"""

SCALER_FLAGS = 0x4 | 0x40000 | 0x2000 | 0x4000
"""Bicubic, accurate rounding, full chroma interpolation and input; without them chroma is off by half a level."""

chroma_locations = {(0.0, 0.5): "left", (0.5, 0.5): "center", (0.0, 0.0): "topleft", (0.5, 0.0): "top"}
chroma_locations |= {(0.0, 1.0): "bottomleft", (0.5, 1.0): "bottom"}
"""FFmpeg's names by the offset of a chroma sample to the right of and below the first luma sample, pixels."""


def has_alpha(pixel_format: str) -> bool:
    """Return whether a pixel format of FFmpeg has alpha."""
    return any(component.is_alpha for component in VideoFormat(pixel_format).components)


def is_rgb(pixel_format: str) -> bool:
    """Return whether a pixel format of FFmpeg is RGB."""
    return VideoFormat(pixel_format).is_rgb


def with_chroma_location(picture: VideoFrame, location: str) -> VideoFrame:
    """Tag a picture with its chroma location, which PyAV can do only through a filter; no pixel is copied."""
    graph = graph_of(picture, ("setparams", f"chroma_location={location}"))
    graph.vpush(picture)
    return graph.vpull()


def kind_of_picture(picture: VideoFrame) -> tuple[int, int, str, int, int]:
    """Return what a filter is made for: size, pixel format and colour coding."""
    return picture.width, picture.height, picture.format.name, int(picture.colorspace), int(picture.color_range)


def graph_of(picture: VideoFrame, *filters: tuple[str, str], time_base: Fraction = Fraction(1, 1000)) -> Graph:
    """Return a graph of FFmpeg's filters, by their names and options, for pictures like this one."""
    width, height, pixel_format, color_space, color_range = kind_of_picture(picture)
    clock = Fraction(picture.time_base or time_base)
    graph = Graph()
    # The graph needs the colour tags too, so that a conversion to a format of the filter does not change the colours.
    entry = graph.add(
        "buffer",
        f"video_size={width}x{height}:pix_fmt={pixel_format}:time_base={clock.numerator}/{clock.denominator}:"
        f"colorspace={color_space}:range={color_range}",
    )
    nodes = [graph.add(name, options) for name, options in filters]
    graph.link_nodes(entry, *nodes, graph.add("buffersink")).configure()
    return graph


def reformatted(
    picture: VideoFrame,
    reformatter: VideoReformatter,
    pixel_format: str,
    full_range: bool,
    *,
    size: tuple[int, int] | None = None,
) -> VideoFrame:
    """Convert a YCbCr picture to another pixel format, with the same matrix and range, and optionally another size.

    With `full_range`, black is 0 rather than 16 (in 8 bits), before and after; `size` is height and width.
    """
    height, width = size or (None, None)
    limits = FULL_RANGE if full_range else LIMITED_RANGE
    return reformatter.reformat(
        picture, width, height, pixel_format, None, None, SCALER_FLAGS, src_color_range=limits, dst_color_range=limits
    )


def full_chroma(bits: int) -> str:
    """Return the name of the 4:4:4 pixel format that holds `bits` bits per sample."""
    if bits <= 8:
        return "yuv444p"
    return f"yuv444p{bits}le" if bits in (9, 10, 12, 14) else "yuv444p16le"


def plane_arrays(picture: VideoFrame) -> list[np.ndarray]:
    """Return views of a planar picture's planes, and of gray and alpha, without the padding at the end of every row.

    A negative line size means that the rows lie in memory from the last to the first, as AMV has them.
    """
    dtype = sample_type(bits_of(picture))
    interleaved = 2 if picture.format.name.startswith("ya") else 1
    views: list[np.ndarray] = []
    for plane in picture.planes:
        rows = np.frombuffer(memoryview(plane), dtype).reshape(plane.height, -1)[:: -1 if plane.line_size < 0 else 1]
        views += [rows[:, first : interleaved * plane.width : interleaved] for first in range(interleaved)]
    return views


def bits_of(picture: VideoFrame) -> int:
    """Return the bits per sample of luma, or of red."""
    return picture.format.components[0].bits


def sample_type(bits: int) -> np.dtype[Any]:
    """Return the type of arrays of samples with so many bits."""
    return np.dtype(np.uint8 if bits <= 8 else np.uint16)


def color_space_of(picture: VideoFrame) -> int:
    """Return the AVColorSpace by tag or size; raise ValueError for no plain luma-chroma matrix (YCgCo, ICtCp)."""
    tag = int(picture.colorspace)
    if picture.format.is_rgb or tag in (0, 2, 3):
        return assumed_color_space(picture.height)
    if tag not in MATRICES:
        raise ValueError(f"colour matrix {tag}")
    return tag


def add_colour_tags(picture: VideoFrame, tags: Mapping[str, int]) -> None:
    """Give a picture the colour tags of its container where its own are unspecified, as players do."""
    for name, tag in tags.items():
        is_matrix_of_rgb = name == "colorspace" and picture.format.is_rgb
        if getattr(picture, name) in NO_COLOUR_TAG[name] and not is_matrix_of_rgb:
            setattr(picture, name, tag)


def assumed_color_space(height: int) -> int:
    """Return the AVColorSpace of an untagged video with `height` rows."""
    return BT709 if height >= 720 else SMPTE170M


def is_gray(pixel_format: VideoFormat) -> bool:
    """Return whether a format has no chroma; the scaler, and so all of FFmpeg, always takes it for full range."""
    return pixel_format.name.startswith(("gray", "ya8", "ya16"))


def is_full_range(picture: VideoFrame) -> bool:
    """Return whether code values are full range; untagged YCbCr is limited range."""
    return int(picture.color_range) == FULL_RANGE or picture.format.name.startswith("yuvj") or picture.format.is_rgb


def chroma_location_of(picture: VideoFrame, reformatter: VideoReformatter) -> str:
    """Return the chroma location that the scaler assumes for a picture.

    PyAV does not expose the tag, so a ramp is subsampled with the picture's properties, and the location follows from
    the resulting values.
    """
    size = 32
    step = 4
    if picture.format.is_rgb or len(picture.planes) < 2:
        return "left"
    ramp = reformatted(picture, reformatter, "yuv444p", True, size=(size, size))
    if ramp is picture:  # already of this size and format: never write into a decoded picture
        return "left"
    rows, columns = np.mgrid[0:size, 0:size]
    for plane, values in zip(plane_arrays(ramp), (128, 64 + step * columns, 64 + step * rows), strict=True):
        plane[:] = values
    _, across, down = plane_arrays(reformatted(ramp, reformatter, "yuv420p", True))
    place = tuple((float(samples[8, 8]) - 64) / step - 16 for samples in (across, down))
    return min(chroma_locations.items(), key=lambda item: abs(item[0][0] - place[0]) + abs(item[0][1] - place[1]))[1]
