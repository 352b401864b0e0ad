"""Convert decoded pictures to BGR or planes, and back, by the matrix, range and chroma location of their YCbCr.

FFmpeg's scaler alone is off by half a level in full range and by up to 255 of 65535 in deep formats. It therefore only
converts between the chroma subsampling of a picture and 4:4:4; a 3x4 matrix converts 4:4:4 to BGR, and its exact
inverse converts back.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import av
import cv2
import numpy as np
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from fpsboost.colour import Coding, bgr_to_ycc, luma_weights
from fpsboost.frame import Frame
from fpsboost.image import Image, YCbCrImage, view

SMPTE170M, BT709, BT2020, RGB, UNSPECIFIED = 6, 1, 9, 0, 2  # AVColorSpace
FULL_RANGE, LIMITED_RANGE = 2, 1  # AVColorRange

NO_COLOUR_TAG = {"colorspace": (0, 2, 3), "color_primaries": (0, 2, 3), "color_trc": (0, 2, 3), "color_range": (0,)}
"""FFmpeg's numbers of tags that say nothing, by the tag's name in PyAV: of unspecified colours and two reserved ones.

ProRes has 0 for unspecified colours; as the matrix of RGB it is a tag.
"""

SCALER_FLAGS = 0x4 | 0x40000 | 0x2000 | 0x4000
"""Bicubic, accurate rounding, full chroma interpolation and input; without them chroma is off by half a level."""

chroma_locations = {
    (0.0, 0.5): "left",
    (0.5, 0.5): "center",
    (0.0, 0.0): "topleft",
    (0.5, 0.0): "top",
    (0.0, 1.0): "bottomleft",
    (0.5, 1.0): "bottom",
}
"""FFmpeg's names by the offset of a chroma sample to the right of and below the first luma sample, pixels."""

PLANAR_FORMATS = frozenset(
    [f"yuv{chroma}p{depth}" for chroma in (420, 422, 444) for depth in ("", "9le", "10le", "12le", "14le", "16le")]
    + [f"yuvj{chroma}p" for chroma in (420, 422, 444)]
)
"""Pixel formats whose pictures can be processed as planar YCbCr."""


def to_bgr(picture: av.VideoFrame, reformatter: VideoReformatter | None = None, *, keeps_alpha: bool = False) -> Image:
    """Convert a decoded picture by its own colour matrix and range; `from_bgr` is the inverse.

    Samples (H, W, 3), or (H, W, 4) with full-range alpha, are uint8, or uint16 where the format has more than 8 bits.
    The reformatter keeps the scaler's tables from one frame to the next. Raises ValueError where the colour matrix is
    not supported.
    """
    scaler = reformatter or VideoReformatter()
    bits, full = _bits(picture), is_full_range(picture)
    dtype = _sample_type(bits)
    top = np.iinfo(dtype).max
    if picture.format.is_rgb:
        pixel_format = packed_format(dtype, alpha=keeps_alpha)
        packed = scaler.reformat(picture, format=pixel_format, interpolation=SCALER_FLAGS)
        return np.ascontiguousarray(packed.to_ndarray())
    image: Image
    if is_gray(picture.format):
        # not through 4:4:4, where the scaler applies a matrix to gray too and shifts it
        name = full_chroma(bits).replace("yuv444p", "gray")
        is_ready = picture.format.name == name
        gray = picture if is_ready else scaler.reformat(picture, format=name, interpolation=SCALER_FLAGS)
        (levels,), most = plane_arrays(gray), 2 ** _bits(gray) - 1
        image = cv2.merge([levels if top == most else np.rint(levels * (top / most)).astype(dtype)] * 3)
    else:
        planar = reformatted(picture, scaler, full_chroma(bits), full)
        forward = bgr_to_ycc(color_space_of(picture), full, _bits(planar), top)
        inverse = np.linalg.inv(forward[:, :3])
        backward = np.column_stack([inverse, -inverse @ forward[:, 3]])
        image = cv2.transform(cv2.merge(plane_arrays(planar)), backward)
    if not keeps_alpha:
        return image
    planar = reformatted(picture, scaler, full_chroma(bits).replace("yuv", "yuva"), full)
    alpha, most = plane_arrays(planar)[3], 2 ** _bits(planar) - 1
    return np.dstack([image, alpha if top == most else np.rint(alpha * np.float32(top / most)).astype(dtype)])


def packed_format(dtype: np.dtype[Any], *, alpha: bool) -> str:
    """Return FFmpeg's pixel format of a BGR or BGRA array."""
    if dtype == np.uint8:
        return "bgra" if alpha else "bgr24"
    return "bgra64le" if alpha else "bgr48le"


def has_alpha(pixel_format: str) -> bool:
    """Return whether a pixel format of FFmpeg has alpha."""
    return any(component.is_alpha for component in av.VideoFormat(pixel_format).components)


def straight_16_bit(image: Image) -> Image:
    """Convert a float image to 16 bits, clipped to [0, 1]; premultiplied alpha becomes straight."""
    values = np.nan_to_num(image, nan=0.0, posinf=1.0, neginf=0.0)
    if image.shape[2] in (2, 4):
        alpha = values[..., -1:]
        values = np.concatenate([values[..., :-1] / np.maximum(alpha, np.float32(1e-6)), alpha], axis=-1)
    deep: Image = np.rint(np.clip(values, 0, 1) * np.float32(65535)).astype(np.uint16)
    return deep


def from_bgr(
    image: Image,
    pixel_format: str,
    color_space: int,
    full_range: bool,
    *,
    chroma_location: str = "left",
    reformatter: VideoReformatter | None = None,
) -> av.VideoFrame:
    """Convert an image into a picture for an encoder; `to_bgr` is the inverse.

    The image is (H, W, 1, 3 or 4), gray, BGR or BGRA, uint8, uint16 or float32; alpha is dropped where the format has
    none and opaque where the image has none, and float32 is clipped to [0, 1]. The reformatter keeps the scaler's
    tables from one frame to the next.
    """
    scaler = reformatter or VideoReformatter()
    target, keeps_alpha = av.VideoFormat(pixel_format), has_alpha(pixel_format)
    if image.dtype == np.float32:
        image = straight_16_bit(image if keeps_alpha else image[..., :3])
    white = np.iinfo(image.dtype).max
    colours = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else np.ascontiguousarray(image[..., :3])
    alpha = image[..., 3] if image.shape[2] == 4 else np.full(image.shape[:2], white, image.dtype)
    if target.is_rgb:
        packed = np.dstack([colours, alpha]) if keeps_alpha else colours
        frame = av.VideoFrame.from_ndarray(packed, format=packed_format(image.dtype, alpha=keeps_alpha))
        return scaler.reformat(frame, format=pixel_format, interpolation=SCALER_FLAGS)
    full_range = full_range or is_gray(target)
    if target.components[0].bits > 8 and image.dtype == np.uint8:  # the matrix product keeps the dtype of its input
        colours = colours.astype(np.uint16) * 257
    height, width = image.shape[:2]
    planar = av.VideoFrame(width, height, full_chroma(target.components[0].bits))
    matrix = bgr_to_ycc(color_space, full_range, _bits(planar), np.iinfo(colours.dtype).max)
    most = 2 ** _bits(planar) - 1
    codes = np.minimum(cv2.transform(colours, matrix), most)  # a pure colour in full range exceeds it by one half
    for channel, plane in enumerate(plane_arrays(planar)):
        plane[:] = codes[..., channel]
    planar = with_chroma_location(planar, chroma_location)
    grays = {"ya8": "gray", "ya16le": "gray16le"}
    without_alpha = grays.get(pixel_format) or pixel_format.replace("yuva", "yuv")
    opaque = reformatted(planar, scaler, without_alpha, full_range)
    if not keeps_alpha:
        return opaque
    levels = np.rint(alpha * np.float32((2 ** _bits(opaque) - 1) / white))
    picture = av.VideoFrame(width, height, pixel_format)
    for plane, values in zip(plane_arrays(picture), [*plane_arrays(opaque), levels], strict=True):
        plane[:] = values
    return with_chroma_location(picture, chroma_location)


def with_chroma_location(picture: av.VideoFrame, location: str) -> av.VideoFrame:
    """Tag a picture with its chroma location, which PyAV can do only through a filter; no pixel is copied."""
    graph = graph_of(picture, ("setparams", f"chroma_location={location}"))
    graph.vpush(picture)
    return graph.vpull()


def kind_of_picture(picture: av.VideoFrame) -> tuple[int, int, str, int, int]:
    """Return what a filter is made for: size, pixel format and colour coding."""
    return picture.width, picture.height, picture.format.name, int(picture.colorspace), int(picture.color_range)


def graph_of(
    picture: av.VideoFrame, *filters: tuple[str, str], time_base: Fraction = Fraction(1, 1000)
) -> av.filter.Graph:
    """Return a graph of FFmpeg's filters, by their names and options, for pictures like this one."""
    width, height, pixel_format, color_space, color_range = kind_of_picture(picture)
    clock = Fraction(picture.time_base or time_base)
    graph = av.filter.Graph()
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
    picture: av.VideoFrame,
    reformatter: VideoReformatter,
    pixel_format: str,
    full_range: bool,
    *,
    size: tuple[int, int] | None = None,
) -> av.VideoFrame:
    """Convert a YCbCr picture to another pixel format, with the same matrix and range, and optionally another size.

    `full_range` says whether black is 0 rather than 16 (in 8 bits), before and after; `size` is height and width.
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


def plane_arrays(picture: av.VideoFrame) -> list[NDArray[Any]]:
    """Return views of a planar picture's planes, and of gray and alpha, without the padding at the end of every row.

    A negative line size means that the rows lie in memory from the last to the first, as AMV has them.
    """
    dtype = _sample_type(_bits(picture))
    interleaved = 2 if picture.format.name.startswith("ya") else 1
    views: list[NDArray[Any]] = []
    for plane in picture.planes:
        rows = np.frombuffer(memoryview(plane), dtype).reshape(plane.height, -1)[:: -1 if plane.line_size < 0 else 1]
        views += [rows[:, first : interleaved * plane.width : interleaved] for first in range(interleaved)]
    return views


def _bits(picture: av.VideoFrame) -> int:
    return picture.format.components[0].bits


def _sample_type(bits: int) -> np.dtype[Any]:
    return np.dtype(np.uint8 if bits <= 8 else np.uint16)


def color_space_of(picture: av.VideoFrame) -> int:
    """Return the AVColorSpace by tag or size; raise ValueError for no plain luma-chroma matrix (YCgCo, ICtCp)."""
    tag = int(picture.colorspace)
    if picture.format.is_rgb or tag in (0, 2, 3):
        return assumed_color_space(picture.height)
    if tag not in luma_weights:
        raise ValueError(f"colour matrix {tag}")
    return tag


def add_colour_tags(picture: av.VideoFrame, tags: Mapping[str, int]) -> None:
    """Give a picture the colour tags of its container where its own say nothing, as players do."""
    for name, tag in tags.items():
        is_matrix_of_rgb = name == "colorspace" and picture.format.is_rgb
        if getattr(picture, name) in NO_COLOUR_TAG[name] and not is_matrix_of_rgb:
            setattr(picture, name, tag)


def assumed_color_space(height: int) -> int:
    """Return the AVColorSpace of an untagged video with `height` rows."""
    return BT709 if height >= 720 else SMPTE170M


def is_gray(pixel_format: av.VideoFormat) -> bool:
    """Return whether a format has no chroma; the scaler, and so all of FFmpeg, always takes it for full range."""
    return pixel_format.name.startswith(("gray", "ya8", "ya16"))


def is_full_range(picture: av.VideoFrame) -> bool:
    """Return whether code values are full range; untagged YCbCr is limited range."""
    return int(picture.color_range) == FULL_RANGE or picture.format.name.startswith("yuvj") or picture.format.is_rgb


def chroma_location_of(picture: av.VideoFrame, reformatter: VideoReformatter) -> str:
    """Return the chroma location that the scaler assumes for a picture.

    PyAV does not expose the tag, so a ramp is subsampled with the picture's properties, and the location follows from
    the resulting values.
    """
    size, step = 32, 4
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


def in_planes(picture: av.VideoFrame, coding: Coding) -> YCbCrImage:
    """Return the planes of a decoded picture as an image; planes with contiguous rows are not copied."""
    y, cb, cr = (np.ascontiguousarray(plane) for plane in plane_arrays(picture))
    return YCbCrImage((y, cb, cr), coding)


def picture_of(image: YCbCrImage) -> av.VideoFrame:
    """Convert an image into a picture for an encoder; `in_planes` is the inverse."""
    height, width, _ = image.shape
    coding = image.coding
    picture = av.VideoFrame(width, height, coding.pixel_format)
    for plane, values in zip(plane_arrays(picture), image.planes, strict=True):
        plane[:] = values
    picture.colorspace = coding.color_space
    picture.color_range = FULL_RANGE if coding.full_range else LIMITED_RANGE
    return picture


def bgr_of(image: YCbCrImage) -> Image:
    """Convert an image to BGR; see `to_bgr`."""
    return to_bgr(with_chroma_location(picture_of(image), image.coding.chroma_location))


def as_picture(frame: Frame, coding: Coding, reformatter: VideoReformatter, *, keeps_original: bool) -> av.VideoFrame:
    """Convert a frame into a picture of a coding, which may be gray or RGB, from the decoded picture if there is one.

    See `from_bgr`; `keeps_original` says whether the target's colour tags are those of the source.
    """
    image, original = frame.pixels, frame.original
    pixel_format, full_range = coding.pixel_format, coding.full_range
    if original is None and isinstance(image, YCbCrImage):  # else it is converted from BGR below
        original = picture_of(image)
        if image.coding.pixel_format != pixel_format:
            original = with_chroma_location(original, image.coding.chroma_location)
    height, width = image.shape[:2]
    if keeps_original and isinstance(original, av.VideoFrame) and (original.width, original.height) == (width, height):
        if original.format.name == pixel_format:
            return original
        target = av.VideoFormat(pixel_format)
        has_rgb = original.format.is_rgb or target.is_rgb
        # gray is full range whatever its tag says, so that its levels do not stay as they are in limited range
        keeps_levels = full_range or is_gray(original.format) == is_gray(target)
        if not has_rgb and keeps_levels and is_full_range(original) == full_range:
            return reformatted(original, reformatter, pixel_format, full_range)
    return from_bgr(
        view(image).to_bgr(),
        pixel_format,
        coding.color_space,
        full_range,
        chroma_location=coding.chroma_location,
        reformatter=reformatter,
    )
