"""Distance of an interpolated frame from the true one, in the field's usual figures.

All kinds of images are compared with 1.0 for white, so that a clip scores alike with 8 bits, 16 bits or as float. MSE
and MAE are given in levels of 255, as tables of 8-bit images have them; colours count as far as they are opaque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import mean_squared_error, structural_similarity

from fpsboost.colour import composite_on_black
from fpsboost.errors import InputError
from fpsboost.image import Image

LEVELS = 255
MIN_MSE = 1e-12
"""Smallest MSE: equal images have a PSNR of 120 dB and not of infinity, which has no mean."""

SSIM_WINDOW = 7

LOW_PERCENT = 5
"""Percentile of PSNR over frames that is reported: the worst frames say more about a clip than the mean."""


@dataclass(frozen=True)
class Scores:
    """Scores of an interpolated frame against the true one."""

    mse: float
    """Mean squared error, levels of 255 squared."""
    psnr: float
    """Peak signal-to-noise ratio, dB; at most 120."""
    ssim: float
    """Structural similarity (Wang et al. 2004, doi:10.1109/TIP.2003.819861), mean over the channels."""
    mae: float
    """Mean absolute error, levels of 255: what the Middlebury tables call interpolation error."""


def score(truth: Image, image: Image) -> Scores:
    """Compare an interpolated frame with the true one, both (H, W, C), of one size and type, 7 pixels at least."""
    if min(truth.shape[:2]) < SSIM_WINDOW:
        raise InputError(
            f"Frames of {truth.shape[1]}x{truth.shape[0]} are too small to be compared; take at least "
            f"{SSIM_WINDOW} pixels each way."
        )
    reference, values = (composite_on_black(each).astype(np.float64) for each in (truth, image))
    error = max(float(mean_squared_error(reference, values)), MIN_MSE)
    ssim: Any = structural_similarity
    return Scores(
        mse=error * LEVELS**2,
        psnr=float(-10 * np.log10(error)),
        ssim=float(ssim(reference, values, win_size=SSIM_WINDOW, channel_axis=2, data_range=1)),
        mae=float(np.abs(reference - values).mean() * LEVELS),
    )


def absolute_error(truth: Image, image: Image) -> NDArray[Any]:
    """Return the mean over the channels of the absolute difference, levels of 255, (H, W) float32."""
    error: NDArray[Any] = np.abs(composite_on_black(truth) - composite_on_black(image)).mean(axis=2) * np.float32(
        LEVELS
    )
    return error


def mean_scores(scores: Sequence[Scores]) -> Scores:
    """Return the mean of every figure; PSNR as the mean of decibels, as benchmarks have it."""
    return Scores(**means([asdict(each) for each in scores]))


def mean(values: Sequence[float]) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def low_percentile(values: Sequence[float]) -> float:
    """Return the 5th percentile, interpolated linearly; of fewer than 20 values it lies between the two lowest.

    Examples
    --------
    >>> low_percentile([float(value) for value in range(101)])
    5.0
    """
    return float(np.percentile(values, LOW_PERCENT))


def means(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the `mean` of every figure."""
    return {key: mean([row[key] for row in rows]) for key in rows[0]}
