"""Errors of change rather than of pictures: a made frame and the output's frame before it, against the true two.

In the output of a conversion, the frame before a made one is the one shown before it or, where several are hidden in a
row, one that was made too.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.metrics import LEVELS, composite_on_black
from fpsboost.frame import Image
from fpsboost.motion.colour import gray


class DifferenceMeter:
    """Meter of dtSSD: how far the change from the frame before is from the true change.

    The root of the mean, over pixels and channels, of ((made - output before) - (truth - truth before))², levels of
    255. Erofeev et al. 2015 ("Perceptually motivated benchmark for video matting", BMVC) take the root of
    the sum over the pixels of an alpha matte; with the mean the figure does not grow with the picture.

    With one frame hidden between two, the frame before is a true one on both sides and drops out: dtSSD is then the
    root of the MSE, frame by frame. It says something of its own from two hidden frames on.
    """

    def __init__(self) -> None:
        self._error: NDArray[Any] | float = 0.0
        self._values: list[dict[str, float]] = []

    def shown(self, image: Image) -> None:
        """Add a frame that passes as it is, which has no error."""
        self._error = 0.0

    def made(self, truth: Image, made: Image) -> None:
        """Add a made frame: the change of the error is the error of the change."""
        error = composite_on_black(made) - composite_on_black(truth)
        change = np.square(error - self._error, dtype=np.float64)
        self._values.append({"dtssd": float(np.sqrt(change.mean())) * LEVELS})
        self._error = error

    def values(self) -> list[dict[str, float]]:
        """Return ``dtssd`` of every made frame."""
        return self._values


class FlowMeter:
    """Meter of tOF: how far the motion that is seen from the frame before is from the true motion.

    The mean over pixels of the distance between two motion vectors, pixels: of the optical flow from the output's frame
    before to the made frame, and of that from the true frame before to the true frame. Chu et al. 2020 ("Learning
    temporal coherence via self-supervision for GAN-based video generation", ACM TOG 39(4),
    doi:10.1145/3386569.3392457) define it as the 1-norm of that difference; as in the implementations in use, the
    flow is Farnebäck's on luma in 8 bits (OpenCV) and the norm of a vector is its length.

    It sees what stands in the wrong place or moves unsteadily, and hardly what is blurred. It is as good as that flow.
    """

    def __init__(self) -> None:
        self._before: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._values: list[dict[str, float]] = []

    def shown(self, image: Image) -> None:
        """Add a frame that passes as it is to both sides."""
        luma = gray(image)
        self._before = luma, luma

    def made(self, truth: Image, made: Image) -> None:
        """Compare the two motions from the frame before."""
        assert self._before is not None, "a frame was made before any was shown"
        now = gray(truth), gray(made)
        true_flow, flow = (_farneback(before, luma) for before, luma in zip(self._before, now, strict=True))
        self._values.append({"tof": float(np.linalg.norm(flow - true_flow, axis=2).mean())})
        self._before = now

    def values(self) -> list[dict[str, float]]:
        """Return ``tof`` of every made frame."""
        return self._values


def _farneback(image0: NDArray[Any], image1: NDArray[Any]) -> NDArray[Any]:
    """Return Farneback's flow with the options of OpenCV's example, as tOF has it; (H, W, 2) float32, pixels."""
    flow: NDArray[Any] = cv2.calcOpticalFlowFarneback(
        image0,
        image1,
        np.zeros((*image0.shape, 2), np.float32),
        pyr_scale=0.5,
        levels=3,
        winsize=15,
        iterations=3,
        poly_n=5,
        poly_sigma=1.2,
        flags=0,
    )
    return flow
