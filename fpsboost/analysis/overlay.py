"""Titles, logos and whatever else stands still in front of a moving picture.

Patches around a thin letter hold more of the background than of the letter, so that its motion is the background's. But
a pixel that keeps its colour over three frames or four, where everything around it moves and the colour would have had
to change, does not move. What is found so is left as it is.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image, Pixels, as_array
from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.overlay import STANDS_OUT, mark_overlay
from fpsboost.motion.colour import gray, normalised
from fpsboost.motion.field import MotionField
from fpsboost.ycbcr import YCbCrImage

SPACING = 32
"""Surroundings are looked at in blocks of this size, pixels."""

AROUND = 5
"""Blocks across whose median is the motion of the surroundings."""

SHORTEST = np.float32(1)
"""Motion below which surroundings count as still, pixels."""

SAME, DIFFERENT = 8, 25
"""What changes by at most so many levels of 255 has stayed, what changes by more has not."""

NEIGHBOURS = 3
"""A pixel of an overlay stands with others: so many at least of the nine around it, itself included."""

STROKE = 3
"""What stays this near to a pixel of an overlay belongs to it, pixels."""


def find_overlay(
    image0: FrameCache, image1: FrameCache, before: FrameCache, after: FrameCache, field01: MotionField
) -> NDArray[Any]:
    """The pixels of a pair that stand still in front of moving surroundings.

    Parameters
    ----------
    image0, image1 : FrameCache
        The pair.
    before, after : FrameCache
        The frames before and after the pair, or the pair's own where there is none.
    field01 : MotionField
        Motion of the pair.

    Returns
    -------
    (H, W) bool
    """
    grays = [image.cached(gray) for image in (image0, image1, before, after)]
    motion, _ = field01.at_points(SPACING)
    surroundings = np.dstack([cv2.medianBlur(np.ascontiguousarray(motion[..., axis]), AROUND) for axis in (0, 1)])
    marks = np.empty_like(grays[0])
    mark_overlay(*grays, surroundings, SPACING, SHORTEST, SAME, DIFFERENT, marks)
    found: NDArray[Any] = marks == STANDS_OUT
    if not found.any():  # nearly always
        return found
    together = found & (cv2.boxFilter(found.astype(np.uint8), cv2.CV_16U, (3, 3), normalize=False) >= NEIGHBOURS)
    near = cv2.dilate(together.astype(np.uint8), np.ones((2 * STROKE + 1, 2 * STROKE + 1), np.uint8))
    overlay: NDArray[Any] = (near > 0) & (marks > 0)
    return overlay


def keep_overlay(image: Pixels, image0: Pixels, image1: Pixels, t: float, overlay: NDArray[Any]) -> None:
    """Give an in-between frame the overlay's own pixels, in place; chroma where half of its pixels are of it."""
    if not overlay.any():
        return
    if isinstance(image, YCbCrImage) and isinstance(image0, YCbCrImage) and isinstance(image1, YCbCrImage):
        rows, columns = image.planes[1].shape
        share = cv2.resize(overlay.astype(np.uint8) * 255, (columns, rows), interpolation=cv2.INTER_AREA)
        chroma = share >= 127
        parts = overlay, chroma, chroma
        for plane, plane0, plane1, part in zip(image.planes, image0.planes, image1.planes, parts, strict=True):
            _keep(plane, plane0, plane1, t, part)
    else:
        _keep(as_array(image), as_array(image0), as_array(image1), t, overlay)


def _keep(image: Image, image0: Image, image1: Image, t: float, overlay: NDArray[Any]) -> None:
    places = np.flatnonzero(overlay)
    pixels, colours0, colours1 = (
        image.reshape(overlay.size, -1),
        *(each.reshape(overlay.size, -1)[places] for each in (image0, image1)),
    )
    if image.dtype == np.float32:
        pixels[places] = normalised(colours0) * (1 - t) + normalised(colours1) * t
    else:
        pixels[places] = np.rint(colours0 * (1 - t) + colours1 * t)
