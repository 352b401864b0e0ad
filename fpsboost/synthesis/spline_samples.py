"""Planes of an image with the coefficients of their splines, from which in-between frames are sampled."""

from collections.abc import Sequence

import cv2
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
    if not planes.size:
        return Samples(planes, np.empty(planes.shape, np.float32), 1.0)
    coefficients = _empty_coefficients(*planes.shape)
    find_coefficients(planes, unit, filter_weights(2.0 ** -(bits + 2)), coefficients)
    return Samples(planes, coefficients, unit)


def sharp_and_smooth_samples(planes: Sequence[np.ndarray]) -> Samples:
    """Return float planes with two sets of coefficients: those of their splines, and their values in place of these.

    With the second ones, the spline smooths, and never overshoots.
    """
    values = np.stack(planes)
    count, height, width = values.shape
    coefficients = _empty_coefficients(2 * count, height, width)
    find_coefficients(values, 1.0, filter_weights(2.0**-18), coefficients[:count])
    for plane, padded in zip(values, coefficients[count:], strict=True):
        right = padded.shape[1] - MARGIN - width
        cv2.copyMakeBorder(plane, MARGIN, MARGIN, MARGIN, right, cv2.BORDER_REPLICATE, padded)
    return Samples(values, coefficients, 1.0)


def _empty_coefficients(count: int, height: int, width: int) -> np.ndarray:
    """Return room for the coefficients of planes of a size."""
    return aligned_empty((count, height + 2 * MARGIN, width + 2 * MARGIN + SPARE), np.float32)
