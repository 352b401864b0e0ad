"""Metrics of visible artefacts in motion: torn shapes, interpolated frames that differ in kind, and uneven motion.

All measure sRGB with 8 bits, as it is displayed. PSNR barely registers these artefacts. A meter takes all frames of a
method in order (see `fpsboost.evaluation.further_metrics.Meter`).
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import as_shown
from fpsboost.evaluation.results import LEVELS, MIN_MSE
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.motion.opencv import Dis

AFAR = 4
"""Factor by which images are reduced, as if they were seen from a distance."""
WRONG_LEVELS = 24
"""Difference that counts as wrong at this size, levels."""

EDGE_REACH = 4
"""Distance within which an edge has a counterpart, pixels at half the size."""
EDGE_RATIO = np.float32(1.25)
"""Ratio to the counterpart from which an edge is too strong."""
EDGE_LEVELS = np.float32(1)
"""Slope that an edge may have in addition to that, levels per pixel."""

PARTS = 4
"""Number of parts along each side of the picture in which flicker is measured separately."""
FINE = 1.0
"""Standard deviation of the Gaussian that separates noise and the finest detail from the rest, pixels."""
COARSE = 4.0
"""Standard deviation of the Gaussian that leaves the coarse picture, pixels."""

MIN_MOTION = 2.0
"""Shortest true path from the frame before to the frame after that counts as motion, pixels."""
MAX_TURN = 0.5
"""Change of the true motion, as a share of its path, above which the estimate of DIS is taken for wrong."""

DIVERGING = 0.01
"""Least divergence of motion that counts, as a share of the largest in the frame."""


class FrameMeter:
    """Meter of a function of an interpolated frame and the true one."""

    def __init__(self, measure: Callable[[Image, Image], float]) -> None:
        self._measure = measure
        self._values: list[float] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Measure the next frame, if it counts."""
        if counts:
            self._values.append(self._measure(truth, image))

    def values(self) -> list[float]:
        """Return the value of each frame that counts."""
        return self._values


def wrong_area(truth: Image, image: Image) -> float:
    """Return the share of the area that is wrong even at a quarter of the size, per mille."""
    height, width = truth.shape[:2]
    size = max(1, width // AFAR), max(1, height // AFAR)
    afar = [
        cv2.resize(as_shown(each).astype(np.float32), size, interpolation=cv2.INTER_AREA) for each in (truth, image)
    ]
    return 1000 * float((cv2.absdiff(*afar).reshape(*size[::-1], -1).max(axis=2) > WRONG_LEVELS).mean())


def spurious_edges(truth: Image, image: Image) -> float:
    """Return the mean strength of edges that have no counterpart in the true frame, hundredths of a level."""
    edges = _edges(image)
    expected = _edges(truth)
    side = 2 * EDGE_REACH + 1
    explained = EDGE_RATIO * cv2.dilate(expected, np.ones((side, side), np.uint8)) + EDGE_LEVELS
    return 100 * float(np.maximum(edges - explained, 0).mean())


def missing_edges(truth: Image, image: Image) -> float:
    """Return the mean strength of true edges that have no counterpart in an image, hundredths of a level."""
    return spurious_edges(image, truth)


def _edges(image: Image) -> NDArray[np.float32]:
    """Return the slope of the luma at half the size, levels a pixel, (h, w)."""
    half = cv2.resize(as_shown(image), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(_luma(half), (3, 3), 0)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return np.hypot(across, down)


def _luma(displayed: np.ndarray) -> NDArray[np.float32]:
    """Return the luma of an sRGB image, (H, W) float32."""
    return cv2.cvtColor(displayed, cv2.COLOR_BGR2GRAY).astype(np.float32)


class FlickerMeter:
    """Meter of pulsation at the rate of the originals, which occurs if interpolated frames differ from them in kind.

    In each part of the picture, the mean luma, the deviation of its finest detail and noise, and that of coarser detail
    are compared with the mean of the two shown frames. Differences of the same sign in all frames pulse; changes of the
    picture cancel out.
    """

    def __init__(self) -> None:
        self._shown: np.ndarray | None = None
        self._between: list[np.ndarray] = []
        self._differences: list[np.ndarray] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame; a shown one, which does not count, closes an interval."""
        kinds = _kinds(image)
        if counts:
            self._between.append(kinds)
            return
        if self._shown is not None:
            self._differences += [each - (self._shown + kinds) / 2 for each in self._between]
        self._shown = kinds
        self._between = []

    def values(self) -> list[float]:
        """Return the difference of every frame in the direction that most frames have, levels, mean over the parts."""
        if not self._differences:
            return []
        differences = np.stack(self._differences)
        signs = np.sign(np.median(differences, axis=0))  # a frame across a cut, which does not count, has no say
        return [float(each) for each in (differences * signs).sum(axis=1).mean(axis=1)]


def _kinds(image: Image) -> np.ndarray:
    """Return brightness, noise with the sharpest detail, and sharpness of each part of an image, (3, parts) levels."""
    luma = _luma(as_shown(image))
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in (FINE, COARSE))
    planes = luma, np.square(luma - fine), np.square(fine - coarse)
    brightness, noise, detail = (
        cv2.resize(each, (PARTS, PARTS), interpolation=cv2.INTER_AREA).ravel() for each in planes
    )
    return np.stack([brightness, np.sqrt(noise), np.sqrt(detail)])


class StepMeter:
    """Meter of uneven motion: steps into a frame and out of it compared with the true ones, percent of the true path.

    Steps are the motion by DIS to the frames before and after. 0 is as even as the truth, 100 a frame that repeats one
    of its neighbours. Only moving areas count, where DIS follows the true frames.
    """

    def __init__(self) -> None:
        self._last: tuple[FrameCache, FrameCache] | None = None
        self._back: list[np.ndarray] | None = None
        self._values: list[float] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame, whose motion to the one before is estimated."""
        frames = FrameCache(truth), FrameCache(image)
        if self._last is not None:
            steps = [Dis().estimate(before, now) for before, now in zip(self._last, frames, strict=True)]
            if self._back is not None:
                self._values.append(_unevenness(self._back, [ahead.flow for ahead, _ in steps]))
            self._back = [back.flow for _, back in steps] if counts else None
        self._last = frames

    def values(self) -> list[float]:
        """Return the value of each frame that counts."""
        return self._values


def _unevenness(back: list[np.ndarray], ahead: list[np.ndarray]) -> float:
    """Return the change of the steps beyond the true change, percent; each step is (true, interpolated), (H, W, 2)."""
    true_change, change = (a + b for a, b in zip(ahead, back, strict=True))
    path = sum(np.linalg.norm(step[0], axis=-1) for step in (back, ahead))
    is_moving = (path > MIN_MOTION) & (np.linalg.norm(true_change, axis=-1) <= MAX_TURN * path)
    if not is_moving.any():
        return 0.0
    excess = np.minimum(np.linalg.norm(change - true_change, axis=-1), path)
    return 100 * float(excess[is_moving].sum() / path[is_moving].sum())


class DivergenceMeter:
    """Meter of PSNR of the luma where the motion of the output diverges or converges, dB: PSNR_DIV.

    Daly, Ramsook and Kokaram 2025 (arXiv:2510.01361): the motion from a frame to the next one starts or ends in one
    place where shapes are torn or doubled. Only pixels count whose divergence is at least a hundredth of the frame's
    largest; without any motion, all count. The motion is that of DIS. The authors' program takes Farneback's, and
    differentiates it along the other axes.
    """

    def __init__(self) -> None:
        self._last: tuple[Image, FrameCache] | None = None
        self._values: list[float] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame, to which the motion of the one before is estimated."""
        frame = FrameCache(image)
        if self._last is not None:
            self._values.append(_psnr_of_diverging(*self._last, Dis().estimate(self._last[1], frame)[0].flow))
        self._last = (truth, frame) if counts else None

    def values(self) -> list[float]:
        """Return the value of each frame that counts."""
        return self._values


def _psnr_of_diverging(truth: Image, frame: FrameCache, flow: np.ndarray) -> float:
    """Return the PSNR of luma where motion, (H, W, 2), diverges, dB; 120 for equal frames, as their PSNR."""
    divergence = np.abs(np.gradient(flow[..., 0], axis=1) + np.gradient(flow[..., 1], axis=0))
    differences = (_luma(as_shown(truth)) - _luma(as_shown(frame.array))) / LEVELS
    error = np.square(differences[divergence >= DIVERGING * divergence.max()]).mean()
    return float(-10 * np.log10(max(error, MIN_MSE)))
