"""Motion between two frames.

`MotionEstimator` is the protocol. Its implementations are `ExhaustiveSearch` (the report's), `CoarseToFine` (the
default), `Dis`, `Farneback` and `TvL1` (OpenCV's optical flow), `BlockMatching` (video coding's),
`RenderedMotion` (a renderer's vectors) and `ZeroMotion` (no motion). Each is a frozen dataclass whose fields are its
options; values out of range raise `OptionError`.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField


@runtime_checkable
class MotionEstimator(Protocol):
    """Protocol of estimators of the motion between two frames, in both directions."""

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions.

        Parameters
        ----------
        image0, image1 : FrameCache
            Two frames of one size and type.

        Returns
        -------
        field01, field10 : MotionField
            Motion from frame 0 to frame 1 and back; two independent fields, not each other's inverse.
        """
