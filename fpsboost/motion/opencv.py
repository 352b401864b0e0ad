"""Optical flow of OpenCV as motion estimators, which serve as baselines.

They estimate both directions independently on luma of 8 bits, (H, W) uint8; of video, the luma plane is read as it is
stored. OpenCV's functions report no similarity, so that it is 1 everywhere.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar, Literal

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.image_checks import check_pair
from fpsboost.motion.components import gray
from fpsboost.motion.field import MotionField
from fpsboost.options import Checked, PositiveFloat, PositiveInt, Range

DIS_PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
"""OpenCV's presets of DIS by their names here."""
MIN_SIDE = 32  # minimum side for a pyramid level of DIS, pixels


@dataclass(frozen=True)
class Dis(Checked):
    """Dense inverse search (Kroeger et al. 2016), in OpenCV's implementation.

    Parameters
    ----------
    preset : {'ultrafast', 'fast', 'medium'}
        OpenCV's presets, which differ in the finest level, the patch stride and the number of iterations.

    References
    ----------
    T. Kroeger, R. Timofte, D. Dai and L. Van Gool, Fast Optical Flow Using Dense Inverse Search, ECCV 2016,
    doi:10.1007/978-3-319-46493-0_29
    """

    takes_planes: ClassVar[bool] = True

    preset: Literal["ultrafast", "fast", "medium"] = "medium"

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        return _estimate_both(cv2.DISOpticalFlow.create(DIS_PRESETS[self.preset]).calc, image0, image1)


@dataclass(frozen=True)
class Farneback(Checked):
    """Polynomial expansion (Farnebäck 2003), in OpenCV's implementation.

    Parameters
    ----------
    levels : int
        Levels of the pyramid, each half the size of the one before.
    window_size : int
        Side of the averaging window, pixels.
    iterations : int
        Iterations per level.

    References
    ----------
    G. Farnebäck, Two-Frame Motion Estimation Based on Polynomial Expansion, SCIA 2003, doi:10.1007/3-540-45103-X_50
    """

    takes_planes: ClassVar[bool] = True

    levels: PositiveInt = 5
    window_size: Annotated[int, Range(1, unit=" pixel")] = 15
    iterations: PositiveInt = 3

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        flow = partial(
            cv2.calcOpticalFlowFarneback,
            pyr_scale=0.5,
            levels=self.levels,
            winsize=self.window_size,
            iterations=self.iterations,
            poly_n=5,
            poly_sigma=1.1,
            flags=cv2.OPTFLOW_FARNEBACK_GAUSSIAN,
        )
        return _estimate_both(flow, image0, image1)


@dataclass(frozen=True)
class TvL1(Checked):
    """Total variation and L1 (Zach et al. 2007), in OpenCV contrib's implementation.

    Parameters
    ----------
    levels : int
        Levels of the pyramid, at least 1.
    scale_step : float
        Size of each level relative to the one before, at least 0.1, or a level may be empty, and below 1. OpenCV's
        default of 0.8 misses larger motion.
    warps : int
        Number of times that each level is warped by the current estimate, at least 1.
    epsilon : float
        Change below which a level counts as converged; greater is faster.
    inner_iterations, outer_iterations : int
        Iterations between two checks of the change, and number of times that the motion is filtered, at least 1.
        OpenCV's defaults of 30 and 10, and an epsilon of 0.01, take seven times as long and find no better motion.

    References
    ----------
    C. Zach, T. Pock and H. Bischof, A Duality Based Approach for Realtime TV-L1 Optical Flow, DAGM 2007,
    doi:10.1007/978-3-540-74936-3_22
    """

    levels: PositiveInt = 6
    scale_step: Annotated[float, Range(0.1, below=1)] = 0.5
    warps: PositiveInt = 5
    epsilon: PositiveFloat = 0.05
    inner_iterations: PositiveInt = 5
    outer_iterations: PositiveInt = 2

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        flow = cv2.optflow.DualTVL1OpticalFlow.create(
            nscales=self.levels,
            warps=self.warps,
            epsilon=self.epsilon,
            innnerIterations=self.inner_iterations,
            outerIterations=self.outer_iterations,
            scaleStep=self.scale_step,
        )
        return _estimate_both(flow.calc, image0, image1)


def _estimate_both(
    flow: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray], image0: FrameCache, image1: FrameCache
) -> tuple[MotionField, MotionField]:
    """Return the motion in both directions by a function of OpenCV that takes gray images and an initial flow.

    Images with a side below `MIN_SIDE` are extended by repeated edges, and the flow is cropped.
    """
    check_pair(image0.pixels, image1.pixels)
    height, width = image0.pixels.shape[:2]
    below = max(0, MIN_SIDE - height)
    right = max(0, MIN_SIDE - width)
    gray0, gray1 = (
        cv2.copyMakeBorder(image.cached(gray), 0, below, 0, right, cv2.BORDER_REPLICATE) for image in (image0, image1)
    )
    field01, field10 = (
        MotionField(flow(a, b, np.zeros((*a.shape, 2), np.float32))[:height, :width])
        for a, b in ((gray0, gray1), (gray1, gray0))
    )
    return field01, field10
