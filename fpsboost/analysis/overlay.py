"""Detection of overlays: titles, logos and other static content in front of a moving picture.

Patches around a thin letter contain more background than letter, so that the estimated motion is that of the
background. A pixel is an overlay if its colour stays constant over three or four frames while the motion around it
predicts a change. Such pixels are blended without motion. What moves otherwise than its surroundings, such as slats in
perspective, may look alike in all frames by chance: where nearly all such pixels follow the motion found at their own
place, there is no overlay.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import normalised
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, view
from fpsboost.kernels.constants import STATIC_CONTRAST
from fpsboost.kernels.overlay import FourFrames, mark_overlay
from fpsboost.motion.components import CHROMA_WEIGHT, gray, half_chroma
from fpsboost.motion.field import MotionField

BLOCK_SIZE = 32
"""Side of the blocks that share the motion of their surroundings, pixels."""

POINT_SIZE = 8
"""Side of the squares in which pixels may have a motion of their own, pixels."""

MEDIAN_SIZE = 5  # side of the median filter that gives the motion of the surroundings, blocks
MIN_MOTION = 1.0  # motion below which surroundings count as still, pixels

STATIC_THRESHOLD = 8
"""Greatest change of luma of a static pixel, levels of 255; see `CHROMA_WEIGHT` about chroma."""
CHANGE_THRESHOLD = 25
"""Change of luma above which a pixel is not static, levels of 255."""

MIN_NEIGHBOURS = 3
"""Minimum number of overlay pixels in the 3x3 neighbourhood of a pixel of an overlay, itself included."""

DILATION_SIZE = 7
"""Side of the square around an overlay's pixel in which static pixels belong to the overlay, too, pixels."""


def find_overlay(
    image0: FrameCache, image1: FrameCache, before: FrameCache, after: FrameCache, field01: MotionField
) -> np.ndarray | None:
    """Find the pixels of a pair that are static in front of moving surroundings.

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    before, after : FrameCache
        The frames around the pair, or the pair's own where there are none.
    field01 : MotionField
        Motion from frame 0 to frame 1.

    Returns
    -------
    (H, W) bool or None
        None if there are no such pixels, which is usual.
    """
    images = image0, image1, before, after
    level = 1 if view(image0.pixels).luma is None else float(view(image0.pixels).white) / 255
    motion, _ = field01.at_points(BLOCK_SIZE)
    surroundings = cv2.medianBlur(motion, MEDIAN_SIZE)
    points, _ = field01.at_points(POINT_SIZE)
    marks = stands_out = _mark([_luma(image) for image in images], surroundings, points, level, 1)
    for planes in zip(*(image.cached(half_chroma) for image in images), strict=True):
        of_chroma = _mark(planes, surroundings / 2, points / 2, level / CHROMA_WEIGHT, 2)
        if of_chroma.max() == STATIC_CONTRAST:  # letters whose luma is that of the background
            enlarged = cv2.resize(of_chroma, marks.shape[::-1], interpolation=cv2.INTER_NEAREST)
            stands_out = np.maximum(stands_out, enlarged)
    if stands_out.max() < STATIC_CONTRAST:  # the usual case
        return None
    is_static = marks > 0
    found = (stands_out == STATIC_CONTRAST) & is_static
    together = found & (cv2.boxFilter(found.astype(np.uint8), -1, (3, 3), normalize=False) >= MIN_NEIGHBOURS)
    if not together.any():
        return None
    near = cv2.dilate(together.astype(np.uint8), np.ones((DILATION_SIZE, DILATION_SIZE), np.uint8))
    return is_static & (near > 0)


def _mark(
    planes: Sequence[np.ndarray], motion: np.ndarray, points: np.ndarray, level: float, step: int
) -> NDArray[np.uint8]:
    """Return where one plane is static and stands out; see `fpsboost.kernels.overlay.mark_overlay`.

    `motion` is that of the surroundings and `points` that of points, in samples of the plane, of which one comes every
    `step` pixels; `level` is the difference in code values that corresponds to one of 255 levels of luma.
    """
    same = int(STATIC_THRESHOLD * level)
    different = int(CHANGE_THRESHOLD * level)
    frames = FourFrames(*map(np.ascontiguousarray, planes))
    marks = np.empty(frames.image0.shape, np.uint8)
    shortest = MIN_MOTION / step
    mark_overlay(frames, motion, BLOCK_SIZE // step, points, POINT_SIZE // step, shortest, same, different, marks)
    return marks


def _luma(image: FrameCache) -> np.ndarray:
    """Return the luma of an image; that of video is not copied."""
    luma = view(image.pixels).luma
    return image.cached(gray) if luma is None else luma


def keep_overlay(image: Pixels, image0: Pixels, image1: Pixels, t: float, overlay: np.ndarray) -> None:
    """Blend the overlay's pixels into an in-between frame, in place; chroma where half of its pixels belong to it."""
    for plane, plane0, plane1 in zip(*(view(each).arrays() for each in (image, image0, image1)), strict=True):
        part = overlay
        if part.shape != plane.shape[:2]:
            part = cv2.resize(part.astype(np.uint8) * 255, plane.shape[1::-1], interpolation=cv2.INTER_AREA) >= 127
        if plane.dtype == np.float32:
            plane[part] = normalised(plane0[part]) * (1 - t) + normalised(plane1[part]) * t
        else:
            plane[part] = np.rint(plane0[part] * (1 - t) + plane1[part] * t)
