"""Conversion of images to the components on which motion is estimated."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image, Pixels, has_alpha
from fpsboost.kernels.contrast import HIGH_PASS_SIZE, CodeLevels, make_room, split_colours, split_planes
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.levels import level_scale
from fpsboost.kernels.memory import aligned_empty
from fpsboost.kernels.shrink import shrink
from fpsboost.ycbcr import YCbCrImage

Components = NDArray[Any]
"""Components of an image, (H, W, 3) float32."""

HIGHLIGHT_SLOPE = np.float32(0.5)
"""Factor on the logarithm of values above white: twice as bright as white is brighter by 0.35, as is twice as bright as
a middle gray."""

ZERO_LEVEL = np.float32(128)
"""Level of zero difference from the local mean."""

MAX_VALUE = np.float32(1e6)
"""Maximum magnitude of a value in motion estimation, in units of white."""


def colour_components(image: Image) -> Components:
    """Return colours in [0, 1], multiplied by alpha, so that the colour of a transparent pixel has no influence.

    Values above white are compressed; see `compress_highlights`.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32

    Returns
    -------
    (H, W, 3) float32
        Gray images have their value in the first component and zero in the others.
    """
    values = compress_highlights(image)
    if has_alpha(image):
        values = values[..., :-1] * values[..., -1:]
    if values.shape[2] == 1:
        return np.dstack([values, np.zeros_like(values), np.zeros_like(values)])
    return values


def gray(image: Pixels) -> NDArray[Any]:
    """Return the luma in 8 bits.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32, or YCbCrImage

    Returns
    -------
    (H, W) uint8
    """
    if isinstance(image, YCbCrImage):
        black, span, _, _ = image.coding.levels
        if image.dtype == np.uint8:
            of_codes = (np.arange(256) - black) * (255 / span)
            levels: NDArray[Any] = cv2.LUT(image.planes[0], np.rint(of_codes.clip(0, 255)).astype(np.uint8))
            return levels
        above = np.maximum(image.planes[0], image.dtype.type(black))  # because convertScaleAbs takes the absolute value
        levels = cv2.convertScaleAbs(above, alpha=255 / span, beta=-255 / span * black)
        return levels
    if image.dtype == np.uint8 and image.shape[2] == 3:
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    colours = colour_components(image)
    luma = colours[..., 0] if image.shape[2] < 3 else cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    eight_bit: NDArray[Any] = np.clip(luma * 255 + 0.5, 0, 255).astype(np.uint8)
    return eight_bit


def contrast_components(image: Pixels) -> Components:
    """Return half luma, doubled high-pass luma and mean chroma, which are sensitive to low contrast.

    They are also robust to slow brightness changes.

    The report's plain colours are insensitive to low contrast at v = 0.25; these components are not.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32, or YCbCrImage

    Returns
    -------
    (H, W, 3) float32
    """
    luma, chroma = _luma_and_chroma(image)
    high_pass = (luma - cv2.boxFilter(luma, -1, (HIGH_PASS_SIZE, HIGH_PASS_SIZE))) * 2
    return np.dstack([luma * 0.5, high_pass, chroma])


def _luma_and_chroma(image: Pixels) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return luma in [0, 1], and the mean of both colour differences.

    The mean is 0.5 for gray; 0 for images of one channel.
    """
    if isinstance(image, YCbCrImage):
        black, luma_span, neutral, chroma_span = image.coding.levels
        height, width, _ = image.shape
        y, cb, cr = (plane.astype(np.float32) for plane in image.planes)
        chroma = ((cb + cr) * np.float32(0.5) - np.float32(neutral)) / np.float32(chroma_span) + np.float32(0.5)
        return (y - np.float32(black)) / np.float32(luma_span), cv2.resize(chroma, (width, height))
    colours = colour_components(image)
    if image.shape[2] < 3:
        return colours[..., 0], colours[..., 1]
    converted = cv2.cvtColor(colours, cv2.COLOR_BGR2YCrCb)
    return converted[..., 0], (converted[..., 1] + converted[..., 2]) * 0.5


def contrast_planes(image: Pixels, padding: int, bandwidth: float) -> NDArray[Any]:
    """Return the `contrast_components` in bytes for the kernels, computed in a single pass.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32, or YCbCrImage
    padding : int
        Pixels on every side; the right side is padded by a few vectors more.
    bandwidth : float
        Bandwidth of the similarity.

    Returns
    -------
    (3, H + 2 padding, W + 2 padding or more) uint8
        Scaled by `fpsboost.kernels.levels.level_scale`, with repeated edges; contiguous.
    """
    height, width = image.shape[:2]
    scale = np.float32(level_scale(bandwidth))
    planes = np.empty((3, height + 2 * padding, width + 2 * padding + 2 * LANES), np.uint8)
    target = scale, ZERO_LEVEL, padding, make_room(width), planes
    if isinstance(image, YCbCrImage):
        black, luma_span, neutral, chroma_span = image.coding.levels
        code_levels = CodeLevels(*map(np.float32, (black, 1 / luma_span, neutral, 1 / chroma_span)))
        split_planes(*image.planes, code_levels, *target)
    else:
        white = 1 if image.dtype == np.float32 else np.iinfo(image.dtype).max
        colours = compress_highlights(image) if image.dtype == np.float32 else image
        split_colours(colours, np.float32(1 / white), *target)
    return planes


def normalised(image: Image) -> NDArray[Any]:
    """Return the image as float32 with 1.0 for white and unchanged shape; NaN becomes black, infinity white."""
    if image.dtype == np.float32:
        return np.nan_to_num(image, nan=0.0, posinf=1.0, neginf=0.0)
    scale = 1 / np.iinfo(image.dtype).max
    values: NDArray[Any] = image.astype(np.float32) * np.float32(scale)
    return values


def compress_highlights(image: Image) -> NDArray[Any]:
    """Return the `normalised` image with a logarithmic curve above white, where contrast matters, not difference.

    Otherwise the similarity of two frames of a brightly lit scene would be 0, and motion could not be estimated.
    """
    values = _clipped(normalised(image))
    if image.dtype == np.float32 and values.max(initial=0) > 1:
        values = np.where(values > 1, 1 + HIGHLIGHT_SLOPE * np.log(np.maximum(values, 1)), values)
    return values


def small_copy(image: Pixels, longer_side: int) -> NDArray[Any]:
    """Return a thumbnail in gray or BGR, float32 with 1.0 for white.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32, or YCbCrImage
    longer_side : int
        Longer side of the thumbnail, pixels.

    Returns
    -------
    (h, w, C) float32
    """
    height, width = image.shape[:2]
    scale = longer_side / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if isinstance(image, YCbCrImage):
        codes = np.dstack([_shrunk(plane[..., np.newaxis], size) for plane in image.planes])
        return cv2.transform(codes, image.coding.to_bgr()).clip(0, 1)
    small = _shrunk(image, size)
    white = 1 if image.dtype == np.float32 else np.iinfo(image.dtype).max
    return _clipped(normalised(small * np.float32(1 / white)))


def _shrunk(image: Image, size: tuple[int, int]) -> NDArray[Any]:
    """Return the image resized to a width and a height, float32 with its own white.

    It is enlarged where it is smaller.
    """
    height, width, channels = image.shape
    across, down = min(size[0], width), min(size[1], height)
    small = np.empty((down, across, channels), np.float32)
    shrink(np.ascontiguousarray(image).reshape(height, width * channels), small)
    if (across, down) == size:
        return small
    return cv2.resize(small, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], channels)


def _clipped(values: NDArray[Any]) -> NDArray[Any]:
    """Return the values clipped to MAX_VALUE: damaged files hold float32's largest numbers, whose sums overflow."""
    if np.abs(values).max(initial=0) <= MAX_VALUE:
        return values
    return values.clip(-MAX_VALUE, MAX_VALUE)


def padded_planes(
    components: Components, padding: int, extra_left: int, extra_right: int, scale: float
) -> NDArray[Any]:
    """Return planes with repeated edges, as required by the search kernels.

    Parameters
    ----------
    components : (H, W, 3) float32
    padding : int
        Pixels on every side.
    extra_left, extra_right : int
        Additional columns.
    scale : float
        Factor on every value.

    Returns
    -------
    (3, H + 2 padding, W + 2 padding + extra_left + extra_right or more) float32, contiguous
    """
    height, width = components.shape[:2]
    left = padding + extra_left
    planes = aligned_empty((3, height + 2 * padding, left + width + padding + extra_right), np.float32)
    rows = planes[:, padding : padding + height]
    np.multiply(components.transpose(2, 0, 1), np.float32(scale), out=rows[:, :, left : left + width])
    rows[:, :, :left] = rows[:, :, left : left + 1]
    rows[:, :, left + width :] = rows[:, :, left + width - 1 : left + width]
    planes[:, :padding] = planes[:, padding : padding + 1]
    planes[:, padding + height :] = planes[:, padding + height - 1 : padding + height]
    return planes
