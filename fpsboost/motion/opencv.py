"""Optical flow of OpenCV as motion estimators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError, check_choice
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, check_pair
from fpsboost.motion.components import gray
from fpsboost.motion.field import MotionField

DIS_PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
MIN_SIDE = 32  # minimum side for a pyramid level of DIS, pixels


@dataclass(frozen=True)
class Dis:
    """Dense inverse search (Kroeger et al. 2016, doi:10.1007/978-3-319-46493-0_29), in OpenCV's implementation.

    Parameters
    ----------
    preset : {'ultrafast', 'fast', 'medium'}
        OpenCV's presets.
    """

    takes_planes: ClassVar[bool] = True

    preset: Literal["ultrafast", "fast", "medium"] = "medium"

    def __post_init__(self) -> None:
        check_choice("preset", self.preset, DIS_PRESETS)

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        gray0, gray1 = _gray_pair(image0, image1)
        flow = cv2.DISOpticalFlow.create(DIS_PRESETS[self.preset])
        flow01, flow10 = (
            flow.calc(a, b, np.zeros((*a.shape, 2), np.float32)) for a, b in ((gray0, gray1), (gray1, gray0))
        )
        return _field(_unpadded(flow01, image0.pixels)), _field(_unpadded(flow10, image0.pixels))


@dataclass(frozen=True)
class Farneback:
    """Polynomial expansion (Farnebäck 2003, doi:10.1007/3-540-45103-X_50), in OpenCV's implementation.

    Parameters
    ----------
    levels : int
        Levels of the pyramid, each half the size of the one before.
    window_size : int
        Side of the averaging window, pixels.
    iterations : int
        Iterations per level.

    Raises
    ------
    OptionError
        A value is below 1.
    """

    takes_planes: ClassVar[bool] = True

    levels: int = 5
    window_size: int = 15
    iterations: int = 3

    def __post_init__(self) -> None:
        for name in ("levels", "window_size", "iterations"):
            if getattr(self, name) < 1:
                raise OptionError(f"{name} must be at least 1, not {getattr(self, name)}.")

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        gray0, gray1 = _gray_pair(image0, image1)
        flow01, flow10 = (self._flow(a, b) for a, b in ((gray0, gray1), (gray1, gray0)))
        return _field(_unpadded(flow01, image0.pixels)), _field(_unpadded(flow10, image0.pixels))

    def _flow(self, gray0: NDArray[Any], gray1: NDArray[Any]) -> NDArray[Any]:
        start = np.zeros((*gray0.shape, 2), np.float32)
        return cv2.calcOpticalFlowFarneback(
            gray0,
            gray1,
            start,
            pyr_scale=0.5,
            levels=self.levels,
            winsize=self.window_size,
            iterations=self.iterations,
            poly_n=5,
            poly_sigma=1.1,
            flags=cv2.OPTFLOW_FARNEBACK_GAUSSIAN,
        )


@dataclass(frozen=True)
class TvL1:
    """Total variation and L1 (Zach et al. 2007, doi:10.1007/978-3-540-74936-3_22), in OpenCV contrib's implementation.

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

    Raises
    ------
    OptionError
        A value is out of range.
    """

    levels: int = 6
    scale_step: float = 0.5
    warps: int = 5
    epsilon: float = 0.05
    inner_iterations: int = 5
    outer_iterations: int = 2

    def __post_init__(self) -> None:
        for name in ("levels", "warps", "inner_iterations", "outer_iterations"):
            if getattr(self, name) < 1:
                raise OptionError(f"{name} must be at least 1, not {getattr(self, name)}.")
        if not 0.1 <= self.scale_step < 1:
            raise OptionError(f"scale_step must be at least 0.1 and below 1, not {self.scale_step}.")
        if not self.epsilon > 0:
            raise OptionError(f"epsilon must be above 0, not {self.epsilon}.")

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        gray0, gray1 = _gray_pair(image0, image1)
        flow = cv2.optflow.DualTVL1OpticalFlow.create(
            nscales=self.levels,
            warps=self.warps,
            epsilon=self.epsilon,
            innnerIterations=self.inner_iterations,
            outerIterations=self.outer_iterations,
            scaleStep=self.scale_step,
        )
        flow01, flow10 = (
            flow.calc(a, b, np.zeros((*a.shape, 2), np.float32)) for a, b in ((gray0, gray1), (gray1, gray0))
        )
        return _field(_unpadded(flow01, image0.pixels)), _field(_unpadded(flow10, image0.pixels))


def _gray_pair(image0: FrameCache, image1: FrameCache) -> tuple[NDArray[Any], NDArray[Any]]:
    check_pair(image0.pixels, image1.pixels)
    first, second = (_padded_gray(image) for image in (image0, image1))
    return first, second


def _padded_gray(image: FrameCache) -> NDArray[Any]:
    eight_bit = image.cached(gray)
    height, width = eight_bit.shape
    below, right = max(0, MIN_SIDE - height), max(0, MIN_SIDE - width)
    return cv2.copyMakeBorder(eight_bit, 0, below, 0, right, cv2.BORDER_REPLICATE)


def _unpadded(flow: NDArray[Any], image: Pixels) -> NDArray[Any]:
    return np.ascontiguousarray(flow[: image.shape[0], : image.shape[1]], np.float32)


def _field(flow: NDArray[Any]) -> MotionField:
    return MotionField(flow, np.ones(flow.shape[:2], np.float32))
