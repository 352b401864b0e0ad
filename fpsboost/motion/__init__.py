"""Motion between two frames.

`MotionEstimator` is the protocol. Its implementations are `ExhaustiveSearch` (the report's), `CoarseToFine` (the
default), `Dis`, `Farneback` and `TvL1` (OpenCV's optical flow), `BlockMatching` (video coding's), `RenderedMotion` (a
renderer's vectors) and `ZeroMotion` (no motion). Each is a frozen dataclass whose fields are its options; values out of
range raise `OptionError`.

Frames are passed as `FrameCache`, which keeps what an estimator computes of one frame alone (components, pyramids), so
that it is computed once for both of the pairs that the frame belongs to:

>>> import numpy as np
>>> from fpsboost import FrameCache
>>> from fpsboost.motion.nlm import CoarseToFine
>>> noise = np.random.default_rng(1).integers(0, 256, (96, 128, 3), dtype=np.uint8)
>>> image0, image1 = FrameCache(noise), FrameCache(np.roll(noise, (2, 5), axis=(0, 1)))
>>> field01, field10 = CoarseToFine().estimate(image0, image1)
>>> field01.flow.shape, field01.flow[48, 64].tolist()  # (dx, dy) in pixels
((96, 128, 2), [5.0, 2.0])

An estimator that also works on the planes of a video (`YCbCrImage`) without converting them to BGR has a class
attribute ``takes_planes = True`` and reads `FrameCache.pixels`; any other reads `FrameCache.array`.
"""

from typing import Protocol, runtime_checkable

from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField


@runtime_checkable
class MotionEstimator(Protocol):
    """Protocol of estimators of the motion between two frames, in both directions.

    An implementation has no state: it may be called from several threads at once, and the same frames give the same
    bits.
    """

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions.

        Parameters
        ----------
        image0, image1 : FrameCache
            Two frames of one size and type, (H, W, C) uint8, uint16 or float32.

        Returns
        -------
        field01, field10 : MotionField
            Motion from frame 0 to frame 1 and back, in pixels; two independent fields, not each other's inverse.

        Raises
        ------
        InputError
            The frames differ in size or type.
        """


@runtime_checkable
class TakesPlanes(Protocol):
    """Contract: estimator or synthesizer that may take `YCbCrImage`; without it, one takes arrays alone."""

    @property
    def takes_planes(self) -> bool:
        """Whether it does, with the options that it has."""
