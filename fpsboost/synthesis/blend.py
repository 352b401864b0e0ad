"""In-between frames along the motion, and the two that need none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image
from fpsboost.kernels.warp import blend_along, splat_motion
from fpsboost.motion.field import MotionField
from fpsboost.synthesis.rounding import rounding_offset, value_range


@dataclass(frozen=True)
class TwoSidedBlend:
    """Carry the motion of both frames to t, keep the most similar vector a pixel, and blend both frames along it.

    Sampling is bicubic at exact positions. Pixels that no vector reaches take the nearest one.
    """

    def synthesize(
        self, image0: Image, image1: Image, field01: MotionField, field10: MotionField, times: Sequence[float]
    ) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`."""
        for t in times:
            motion = motion_at(field01, field10, t)
            out = np.empty_like(image0)
            blend_along(image0, image1, motion, np.float32(t), rounding_offset(image0), *value_range(image0), out)
            yield out


@dataclass(frozen=True)
class Blend:
    """Mix the two frames in time, without motion."""

    def synthesize(
        self, image0: Image, image1: Image, field01: MotionField, field10: MotionField, times: Sequence[float]
    ) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; the fields are not looked at."""
        for t in times:
            mixed = cv2.addWeighted(image0, 1 - t, image1, t, 0)
            yield mixed.reshape(image0.shape)


@dataclass(frozen=True)
class Nearest:
    """Repeat the frame that is nearer in time; the earlier one at the middle."""

    def synthesize(
        self, image0: Image, image1: Image, field01: MotionField, field10: MotionField, times: Sequence[float]
    ) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; the fields are not looked at."""
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()


def motion_at(field01: MotionField, field10: MotionField, t: float) -> NDArray[Any]:
    """Motion from frame 0 to frame 1 through every pixel of the in-between frame.

    Parameters
    ----------
    field01, field10 : MotionField
    t : float
        In (0, 1).

    Returns
    -------
    (H, W, 2) float32
    """
    motion = np.zeros_like(field01.flow)
    score = np.full(motion.shape[:2], -1, np.float32)
    splat_motion(field01.flow, field01.similarity, np.float32(1), np.float32(t), motion, score)
    splat_motion(field10.flow, field10.similarity, np.float32(-1), np.float32(1 - t), motion, score)
    return fill_holes(motion, score < 0)


def fill_holes(motion: NDArray[Any], hole: NDArray[Any]) -> NDArray[Any]:
    """Give every hole the vector of the nearest pixel that has one.

    Parameters
    ----------
    motion : (H, W, 2) float32
    hole : (H, W) bool

    Returns
    -------
    (H, W, 2) float32
    """
    if not hole.any() or hole.all():
        return motion
    _, label = cv2.distanceTransformWithLabels(hole.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    known = np.zeros((label.max() + 1, 2), np.float32)
    known[label[~hole]] = motion[~hole]
    filled: NDArray[Any] = known[label]
    return filled
