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
    coefficients = _empty_coefficients(planes)
    find_coefficients(planes, unit, filter_weights(2.0 ** -(bits + 2)), coefficients)
    return Samples(planes, coefficients, unit)


def sharp_and_smooth_samples(planes: Sequence[np.ndarray]) -> Samples:
    """Return float planes twice: with their spline coefficients, and with their values in place of these.

    The spline then smooths, and never overshoots.
    """
    both = np.stack([*planes, *planes])
    coefficients = _empty_coefficients(both)
    count = len(planes)
    find_coefficients(both[:count], 1.0, filter_weights(2.0**-18), coefficients[:count])
    for plane, values in zip(planes, coefficients[count:], strict=True):
        right = values.shape[1] - MARGIN - plane.shape[1]
        cv2.copyMakeBorder(plane, MARGIN, MARGIN, MARGIN, right, cv2.BORDER_REPLICATE, values)
    return Samples(both, coefficients, 1.0)


def _empty_coefficients(planes: np.ndarray) -> np.ndarray:
    """Return room for the coefficients of planes, (C, H, W)."""
    channels, height, width = planes.shape
    return aligned_empty((channels, height + 2 * MARGIN, width + 2 * MARGIN + SPARE), np.float32)
