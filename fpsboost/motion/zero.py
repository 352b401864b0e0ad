"""No motion: what mixing and repeating start from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fpsboost.frame import check_pair
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField


@dataclass(frozen=True)
class ZeroMotion:
    """Every pixel stays where it is: the motion of `blend` and `nearest`."""

    takes_planes: ClassVar[bool] = True

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.pixels, image1.pixels)
        height, width = image0.pixels.shape[:2]
        nothing, alike = np.zeros((1, 1, 2), np.float32), np.ones((1, 1), np.float32)
        still = MotionField(nothing, alike, spacing=max(height, width), size=(height, width))
        return still, still
