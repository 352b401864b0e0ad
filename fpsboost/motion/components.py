"""Conversion of images to the components on which motion is estimated.

Three components of one scale take the place of the report's plain colours: luma, luma without its local mean (high
pass), and mean chroma. `contrast_components` returns them as float32, `contrast_planes` as bytes for the kernels.
Thumbnails, from which cuts and changes of light are detected, are computed here as well.
"""

from functools import partial

import cv2
import numpy as np

from fpsboost.colour import soft_clipped
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, Pixels, view
from fpsboost.kernels.constants import HIGH_PASS_SIZE, LANES
from fpsboost.kernels.planes import CodeLevels, aligned_empty, level_scale, shrink, split_colours, split_planes

Components = np.ndarray
"""Components of an image, (H, W, 3) float32."""

ZERO_LEVEL = 128.0
"""Level of zero difference from the local mean."""


CHROMA_WEIGHT = 1 / 3
"""Weight of differences in chroma relative to those in luma. The eye sees less there, and encoders of film leave up to
three times as much noise in it: 9 levels in duplicates of one of the clips that `DuplicateDetector` was measured on."""


def gray(image: Pixels) -> np.ndarray:
    """Return the luma of an image, (H, W) uint8, whatever its type."""
    return view(image).gray()


def chroma(image: Pixels) -> list[np.ndarray]:
    """Return the colour differences (blue and red) of an image, two planes; none for gray images.

    They show what two images of equal luma differ in. Planes of a video keep their own size and code values.
    """
    return view(image).chroma()


def half_chroma(image: Pixels) -> list[np.ndarray]:
    """Return the colour differences at half the size, (h, w) uint8; none for gray images.

    Planes of a video keep their own code values and dtype.
    """
    height, width = (-(-length // 2) for length in image.shape[:2])
    # of half the image, not of the whole one: a quarter of the time
    half = partial(cv2.resize, dsize=(width, height), interpolation=cv2.INTER_AREA)
    planes = view(view(image).map(half)).chroma()
    return [each if each.dtype != np.float32 else np.rint(each.clip(0, 255)).astype(np.uint8) for each in planes]


def contrast_components(image: Pixels) -> Components:
    """Return half luma, doubled high-pass luma and mean chroma, (H, W, 3) float32 with 1 for white.

    They are sensitive to low contrast, which the report's plain colours at v = 0.25 are not, and robust to slow
    brightness changes, which the high pass removes. The mean of both colour differences stands for chroma, so that
    there are three components as there are three colours.
    """
    luma, chroma = view(image).luma_and_chroma()
    high_pass = (luma - cv2.boxFilter(luma, -1, (HIGH_PASS_SIZE, HIGH_PASS_SIZE))) * 2
    return np.dstack([luma * 0.5, high_pass, chroma])


def contrast_planes(image: Pixels, padding: int, bandwidth: float) -> np.ndarray:
    """Return the `contrast_components` in bytes for the kernels, computed in a single pass over the image.

    Parameters
    ----------
    image : array or YCbCrImage
        Image of size (H, W).
    padding : int
        Width of the repeated edges, pixels.
    bandwidth : float
        Bandwidth v of the similarity, by which values are scaled; see `fpsboost.kernels.planes.level_scale`.

    Returns
    -------
    (3, H + 2 padding, W + 2 padding + 2 LANES) uint8
        Planes one after the other, as the kernels read them in vectors of LANES bytes. High-pass luma and chroma have
        zero at 128.
    """
    height, width = image.shape[:2]
    planes = np.empty((3, height + 2 * padding, width + 2 * padding + 2 * LANES), np.uint8)
    seen = view(image)
    target = level_scale(bandwidth), ZERO_LEVEL, padding, planes
    if seen.coding is None:
        split_colours(np.ascontiguousarray(soft_clipped(seen.array())), 1 / seen.white, *target)
    else:
        black, luma_span, neutral, chroma_span = seen.coding.levels
        levels = CodeLevels(black, 1 / luma_span, neutral, 1 / chroma_span)
        y, cb, cr = map(np.ascontiguousarray, seen.channels())
        split_planes(y, cb, cr, levels, *target)
    return planes


def small_copy(image: Pixels, longer_side: int) -> np.ndarray:
    """Return a thumbnail with this longer side, pixels: (h, w, C) float32 in gray or BGR, with 1.0 for white."""
    height, width = image.shape[:2]
    scale = longer_side / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return view(image).thumbnail(partial(_shrunk, size))


def small_components(image: FrameCache, longer_side: int) -> Components:
    """Return the `contrast_components` of an image's thumbnail; a function for `FrameCache.derived`."""
    return contrast_components(image.cached(small_copy, longer_side))


def _shrunk(size: tuple[int, int], image: Image) -> np.ndarray:
    """Return the image resized to (width, height), float32 with its own white; enlarged where it is smaller.

    Pixels are averaged over areas: a filter that skips pixels would let noise and fine patterns into thumbnails.
    """
    height, width, channels = image.shape
    across = min(size[0], width)
    down = min(size[1], height)
    small = np.empty((down, across, channels), np.float32)
    rows = np.ascontiguousarray(image).reshape(height, width * channels)
    shrink(rows, small)
    if (across, down) == size:
        return small
    return cv2.resize(small, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], channels)


def padded_planes(components: Components, padding: int, scale: float, extra: int = 0) -> np.ndarray:
    """Return scaled planes with repeated edges for the search kernels.

    They are (3, H + 2 padding, W + 2 padding + 2 extra + 2 LANES) float32: the extra columns on both sides, and those
    of two vectors on the right, let the kernels read whole vectors beyond the edges. `scale` is that of
    `fpsboost.kernels.planes.colour_scale`.
    """
    height, width = components.shape[:2]
    left = padding + extra
    planes = aligned_empty((3, height + 2 * padding, width + 2 * left + 2 * LANES), np.float32)
    right = planes.shape[2] - left - width
    scaled = components * np.float32(scale)
    # NumPy's pad takes longer than all else that is done with a thumbnail
    wide = cv2.copyMakeBorder(scaled, padding, padding, left, right, cv2.BORDER_REPLICATE)
    planes[:] = wide.transpose(2, 0, 1)
    return planes
