"""Convert decoded pictures to BGR or planes, and back, by the matrix, range and chroma location of their YCbCr.

FFmpeg's scaler alone is off by half a level in full range and by up to 255 of 65535 in deep formats. It therefore only
converts between the chroma subsampling of a picture and 4:4:4; a 3x4 matrix converts 4:4:4 to BGR, and its exact
inverse converts back.
"""

from typing import Any

import cv2
import numpy as np
from av import VideoFormat, VideoFrame
from av.video.reformatter import VideoReformatter

from fpsboost.colour import Coding, bgr_to_ycc, inverse_affine, luma_weights, normalised
from fpsboost.frame import Frame
from fpsboost.image import Image, Pixels, YCbCrImage, view
from fpsboost.media import (
    FULL_RANGE,
    LIMITED_RANGE,
    SCALER_FLAGS,
    VideoTraits,
    bits_of,
    color_space_of,
    full_chroma,
    has_alpha,
    is_full_range,
    is_gray,
    plane_arrays,
    reformatted,
    sample_type,
    with_chroma_location,
)

PLANAR_FORMATS = frozenset(
    [f"yuv{chroma}p{depth}" for chroma in (420, 422, 444) for depth in ("", "9le", "10le", "12le", "14le", "16le")]
    + [f"yuvj{chroma}p" for chroma in (420, 422, 444)]
)
"""Pixel formats whose pictures can be processed as planar YCbCr."""


def to_bgr(picture: VideoFrame, reformatter: VideoReformatter | None = None, *, keeps_alpha: bool = False) -> Image:
    """Convert a decoded picture by its own colour matrix and range; `from_bgr` is the inverse.

    Samples (H, W, 3), or (H, W, 4) with full-range alpha, are uint8, or uint16 where the format has more than 8 bits.
    The reformatter keeps the scaler's tables from one frame to the next. Raises ValueError where the colour matrix is
    not supported.
    """
    scaler = reformatter or VideoReformatter()
    bits = bits_of(picture)
    full = is_full_range(picture)
    dtype = sample_type(bits)
    top = np.iinfo(dtype).max
    if picture.format.is_rgb:
        packed = scaler.reformat(picture, format=packed_format(dtype, alpha=keeps_alpha), interpolation=SCALER_FLAGS)
        return np.ascontiguousarray(packed.to_ndarray())
    if is_gray(picture.format):
        # not through 4:4:4, where the scaler applies a matrix to gray too and shifts it
        name = full_chroma(bits).replace("yuv444p", "gray")
        is_ready = picture.format.name == name
        gray = picture if is_ready else scaler.reformat(picture, format=name, interpolation=SCALER_FLAGS)
        (levels,) = plane_arrays(gray)
        most = 2 ** bits_of(gray) - 1
        image = cv2.merge([levels if top == most else np.rint(levels * (top / most)).astype(dtype)] * 3)
    else:
        planar = reformatted(picture, scaler, full_chroma(bits), full)
        forward = bgr_to_ycc(color_space_of(picture), full, bits_of(planar), top)
        image = cv2.transform(cv2.merge(plane_arrays(planar)), inverse_affine(forward))
    if not keeps_alpha:
        return image
    planar = reformatted(picture, scaler, full_chroma(bits).replace("yuv", "yuva"), full)
    alpha = plane_arrays(planar)[3]
    most = 2 ** bits_of(planar) - 1
    return np.dstack([image, alpha if top == most else np.rint(alpha * np.float32(top / most)).astype(dtype)])


def packed_format(dtype: np.dtype[Any], *, alpha: bool) -> str:
    """Return FFmpeg's pixel format of a BGR or BGRA array."""
    if dtype == np.uint8:
        return "bgra" if alpha else "bgr24"
    return "bgra64le" if alpha else "bgr48le"


def straight_16_bit(image: Image) -> Image:
    """Convert a float image to 16 bits, clipped to [0, 1]; premultiplied alpha becomes straight."""
    values = normalised(image)
    if image.shape[2] in (2, 4):
        alpha = values[..., -1:]
        values = np.concatenate([values[..., :-1] / np.maximum(alpha, np.float32(1e-6)), alpha], axis=-1)
    values = values.clip(0, 1)
    return cv2.addWeighted(values, 65535, values, 0, 0, dtype=cv2.CV_16U).reshape(image.shape)  # rounded


def from_bgr(
    image: Image,
    pixel_format: str,
    color_space: int,
    full_range: bool,
    *,
    chroma_location: str = "left",
    reformatter: VideoReformatter | None = None,
) -> VideoFrame:
    """Convert an image into a picture for an encoder; `to_bgr` is the inverse.

    The image is (H, W, 1, 3 or 4), gray, BGR or BGRA, uint8, uint16 or float32; alpha is dropped where the format has
    none and opaque where the image has none, and float32 is clipped to [0, 1]. The reformatter keeps the scaler's
    tables from one frame to the next.
    """
    scaler = reformatter or VideoReformatter()
    target = VideoFormat(pixel_format)
    keeps_alpha = has_alpha(pixel_format)
    if image.dtype == np.float32:
        image = straight_16_bit(image if keeps_alpha else image[..., :3])
    white = np.iinfo(image.dtype).max
    colours = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else np.ascontiguousarray(image[..., :3])
    alpha = image[..., 3] if image.shape[2] == 4 else np.full(image.shape[:2], white, image.dtype)
    if target.is_rgb:
        packed = np.dstack([colours, alpha]) if keeps_alpha else colours
        frame = VideoFrame.from_ndarray(packed, format=packed_format(image.dtype, alpha=keeps_alpha))
        return scaler.reformat(frame, format=pixel_format, interpolation=SCALER_FLAGS)
    full_range = full_range or is_gray(target)
    if target.components[0].bits > 8 and image.dtype == np.uint8:  # the matrix product keeps the dtype of its input
        colours = colours.astype(np.uint16) * 257
    height, width = image.shape[:2]
    planar = VideoFrame(width, height, full_chroma(target.components[0].bits))
    matrix = bgr_to_ycc(color_space, full_range, bits_of(planar), np.iinfo(colours.dtype).max)
    # a pure colour in full range exceeds the largest code by one half
    codes = np.minimum(cv2.transform(colours, matrix), 2 ** bits_of(planar) - 1)
    for channel, plane in enumerate(plane_arrays(planar)):
        plane[:] = codes[..., channel]
    without_alpha = {"ya8": "gray", "ya16le": "gray16le"}.get(pixel_format) or pixel_format.replace("yuva", "yuv")
    opaque = reformatted(with_chroma_location(planar, chroma_location), scaler, without_alpha, full_range)
    if not keeps_alpha:
        return opaque
    levels = np.rint(alpha * np.float32((2 ** bits_of(opaque) - 1) / white))
    picture = VideoFrame(width, height, pixel_format)
    for plane, values in zip(plane_arrays(picture), [*plane_arrays(opaque), levels], strict=True):
        plane[:] = values
    return with_chroma_location(picture, chroma_location)


def in_planes(picture: VideoFrame, coding: Coding) -> YCbCrImage:
    """Return the planes of a decoded picture as an image; planes with contiguous rows are not copied."""
    y, cb, cr = (np.ascontiguousarray(plane) for plane in plane_arrays(picture))
    return YCbCrImage((y, cb, cr), coding)


def in_coding(image: Pixels, coding: Coding | None) -> Pixels:
    """Return an image in the planes of a coding, if there is one and it is not in planes already."""
    if coding is None or view(image).coding is not None:
        return image
    tags = coding.pixel_format, coding.color_space, coding.full_range
    return in_planes(from_bgr(view(image).array(), *tags, chroma_location=coding.chroma_location), coding)


def picture_of(image: YCbCrImage) -> VideoFrame:
    """Convert an image into a picture for an encoder; `in_planes` is the inverse."""
    height, width, _ = image.shape
    coding = image.coding
    picture = VideoFrame(width, height, coding.pixel_format)
    for plane, values in zip(plane_arrays(picture), image.planes, strict=True):
        plane[:] = values
    picture.colorspace = coding.color_space
    picture.color_range = FULL_RANGE if coding.full_range else LIMITED_RANGE
    return picture


def bgr_of(image: YCbCrImage) -> Image:
    """Convert an image to BGR; see `to_bgr`."""
    return to_bgr(with_chroma_location(picture_of(image), image.coding.chroma_location))


def as_picture(frame: Frame, coding: Coding, reformatter: VideoReformatter, *, keeps_original: bool) -> VideoFrame:
    """Convert a frame to a picture of a coding, for an encoder.

    Parameters
    ----------
    frame : Frame
        Frame to convert, from its decoded picture if it has one.
    coding : Coding
        Pixel format, matrix, range and chroma location of the result, which may be gray or RGB.
    reformatter : VideoReformatter
        FFmpeg's scaler, which keeps its tables from frame to frame.
    keeps_original : bool
        Whether the target has the colour tags of the source, so that decoded pictures can be used.

    Returns
    -------
    av.VideoFrame
        Picture: the frame's decoded one itself where nothing has to be converted.
    """
    image = frame.pixels
    original = frame.original
    pixel_format = coding.pixel_format
    full_range = coding.full_range
    if original is None and isinstance(image, YCbCrImage):  # else it is converted from BGR below
        original = picture_of(image)
        if image.coding.pixel_format != pixel_format:
            original = with_chroma_location(original, image.coding.chroma_location)
    height, width = image.shape[:2]
    if keeps_original and isinstance(original, VideoFrame) and (original.width, original.height) == (width, height):
        if original.format.name == pixel_format:
            return original
        target = VideoFormat(pixel_format)
        has_rgb = original.format.is_rgb or target.is_rgb
        # gray is full range whatever its tag, so that its levels do not stay as they are in limited range
        keeps_levels = full_range or is_gray(original.format) == is_gray(target)
        if not has_rgb and keeps_levels and is_full_range(original) == full_range:
            return reformatted(original, reformatter, pixel_format, full_range)
    bgr = view(image).to_bgr()
    location = coding.chroma_location
    return from_bgr(
        bgr, pixel_format, coding.color_space, full_range, chroma_location=location, reformatter=reformatter
    )


def coding_of(traits: VideoTraits) -> Coding | None:
    """Return the planar YCbCr coding of a video's pictures, or None if they have none that frames are made in."""
    if traits.pixel_format not in PLANAR_FORMATS or traits.color_space not in luma_weights:
        return None
    bits = VideoFormat(traits.pixel_format).components[0].bits
    return Coding(bits, traits.color_space, traits.full_range, traits.chroma_location, traits.pixel_format, bgr_of)


def is_on_its_side(matrix: tuple[int, ...] | None) -> bool:
    """Return whether a display matrix exchanges width and height; only quarter turns and flips are considered."""
    return matrix is not None and _is_small(matrix[0], matrix[1]) and _is_small(matrix[4], matrix[3])


def _is_small(value: int, other: int) -> bool:
    """Return whether an element of a matrix differs from 0 by rounding only, beside another one."""
    return 256 * abs(value) <= abs(other)


def turned_upright(image: Image, matrix: tuple[int, ...] | None) -> Image:
    """Rotate and flip an image (H, W, C) according to its display matrix.

    The matrix maps (x, y) to (a x + c y, b x + d y), with a, b, c and d at indices 0, 1, 3 and 4. Rotations by other
    angles than quarter turns are not applied.
    """
    if matrix is None:
        return image
    if is_on_its_side(matrix):
        image = image.transpose(1, 0, 2)
        left = matrix[3]
        down = matrix[1]
    elif _is_small(matrix[1], matrix[0]) and _is_small(matrix[3], matrix[4]):
        left = matrix[0]
        down = matrix[4]
    else:
        return image
    return np.ascontiguousarray(image[:: -1 if down < 0 else 1, :: -1 if left < 0 else 1])
