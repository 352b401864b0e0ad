"""Convert decoded pictures into planar YCbCr images, and frames into pictures for an encoder."""

from __future__ import annotations

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from fpsboost.colour import Coding
from fpsboost.frame import Frame, Image
from fpsboost.image import YCbCrImage, view
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import (
    FULL_RANGE,
    LIMITED_RANGE,
    from_bgr,
    is_full_range,
    plane_arrays,
    reformatted,
    to_bgr,
    with_chroma_location,
)

PLANAR_FORMATS = frozenset(
    [f"yuv{chroma}p{depth}" for chroma in (420, 422, 444) for depth in ("", "9le", "10le", "12le", "14le", "16le")]
    + [f"yuvj{chroma}p" for chroma in (420, 422, 444)]
)
"""Pixel formats whose pictures can be processed as planar YCbCr."""


def coding_of(traits: VideoTraits) -> Coding | None:
    """Return the planar YCbCr coding of a video's pictures, or None if they must be converted to BGR."""
    if traits.pixel_format not in PLANAR_FORMATS:
        return None
    bits = av.VideoFormat(traits.pixel_format).components[0].bits
    location, pixel_format = traits.chroma_location, traits.pixel_format
    return Coding(bits, traits.color_space, traits.full_range, location, pixel_format, bgr_of)


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
    """Convert an image to BGR; see `fpsboost.io.video.ycc.to_bgr`."""
    return to_bgr(with_chroma_location(picture_of(image), image.coding.chroma_location))


def as_picture(
    frame: Frame,
    pixel_format: str,
    color_space: int,
    full_range: bool,
    *,
    chroma_location: str,
    reformatter: VideoReformatter,
    keeps_original: bool,
) -> av.VideoFrame:
    """Convert a frame into a picture of a pixel format, from the decoded picture where there is one.

    Parameters
    ----------
    frame : Frame
    pixel_format, color_space, full_range, chroma_location, reformatter
        See `from_bgr`.
    keeps_original : bool
        Whether the target's colour tags are those of the source.
    """
    image, original = frame.pixels, frame.original
    if original is None and isinstance(image, YCbCrImage):  # else it is converted from BGR below
        original = picture_of(image)
        if image.coding.pixel_format != pixel_format:
            original = with_chroma_location(original, image.coding.chroma_location)
    height, width = image.shape[:2]
    if keeps_original and isinstance(original, av.VideoFrame) and (original.width, original.height) == (width, height):
        if original.format.name == pixel_format:
            return original
        has_rgb = original.format.is_rgb or av.VideoFormat(pixel_format).is_rgb
        if not has_rgb and is_full_range(original) == full_range:
            return reformatted(original, reformatter, pixel_format, full_range)
    return from_bgr(
        view(image).to_bgr(),
        pixel_format,
        color_space,
        full_range,
        chroma_location=chroma_location,
        reformatter=reformatter,
    )
