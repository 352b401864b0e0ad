"""Planes of an image with the coefficients of their splines, from which in-between frames are sampled."""

import numpy as np

from fpsboost.image import Pixels, view
from fpsboost.kernels.constants import MARGIN, SPARE
from fpsboost.kernels.planes import aligned_empty
from fpsboost.kernels.spline import filter_weights, find_coefficients
from fpsboost.kernels.window_samples import Samples


def spline_samples(image: Pixels) -> tuple[Samples, Samples]:
    """Return the planes of an image with their spline coefficients.

    These are the planes at full resolution, and subsampled chroma at half resolution.
    """
    full, half, unit, bits = view(image).spline_planes()
    return _with_coefficients(full, unit, bits), _with_coefficients(half, unit, bits)


def _with_coefficients(planes: np.ndarray, unit: np.float32, bits: int) -> Samples:
    """Return planes with their spline coefficients, computed to a quarter of a level of the image's `bits`."""
    planes = np.ascontiguousarray(planes)
    channels, height, width = planes.shape
    if not channels:
        return Samples(planes, np.empty(planes.shape, np.float32), 1.0)
    coefficients = aligned_empty((channels, height + 2 * MARGIN, width + 2 * MARGIN + SPARE), np.float32)
    find_coefficients(planes, unit, filter_weights(2.0 ** -(bits + 2)), coefficients)
    return Samples(planes, coefficients, unit)


def values_as_samples(samples: Samples) -> Samples:
    """Return samples with their values as coefficients: the spline then smooths, and never overshoots."""
    _, _, columns = samples.coefficients.shape
    beyond = columns - MARGIN - samples.planes.shape[2]
    values = np.pad(samples.planes, ((0, 0), (MARGIN, MARGIN), (MARGIN, beyond)), "edge")
    return samples._replace(coefficients=values)
