"""Zero motion, for blending and repeating frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fpsboost.frame import check_pair
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField


@dataclass(frozen=True)
class ZeroMotion:
    """Zero motion of every pixel, as used by `blend` and `nearest`."""

    takes_planes: ClassVar[bool] = True

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Return zero motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.pixels, image1.pixels)
        height, width = image0.pixels.shape[:2]
        nothing, alike = np.zeros((1, 1, 2), np.float32), np.ones((1, 1), np.float32)
        still = MotionField(nothing, alike, spacing=max(height, width), size=(height, width))
        return still, still
