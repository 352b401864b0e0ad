"""What an in-between frame shows where its motion is unsure: the frames themselves, with soft edges."""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.image import Pixels, view

Uncertain = Literal["keep", "blend", "nearest", "hold"]

RAMP = 0.1
"""Difference of confidence from the limit at which a pixel is entirely sure, or entirely unsure."""

SOFTNESS = 1 / 80  # standard deviation of the blur of confidence, as a fraction of the frame's longer side

MAX_UNSURE = 0.2
"""Largest share of unsure pixels of a frame that is not held."""


def measure_doubt(confidence: NDArray[Any], below: float, uncertain: Uncertain) -> NDArray[Any]:
    """Return the weight of the fallback at each pixel, (H, W) float32, 0 to 1: continuous in place and confidence."""
    blurred = cv2.GaussianBlur(confidence, (0, 0), SOFTNESS * max(confidence.shape))
    doubt = ((below + RAMP - blurred) / np.float32(2 * RAMP)).clip(0, 1)
    return doubt if uncertain != "hold" else np.full_like(doubt, doubt.mean() > MAX_UNSURE)


def fall_back(image: Pixels, image0: Pixels, image1: Pixels, t: float, doubt: NDArray[Any], *, mix: bool) -> Pixels:
    """Return an image in which the mix of two frames, or the nearer one, stands to the weight `doubt`."""
    if not doubt.any():
        return image
    nearer = image0 if t <= 0.5 else image1
    other = view(image0).mix(view(image1), t) if mix else nearer

    def mixed(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
        second = second.reshape(first.shape)
        weight = cv2.resize(doubt, first.shape[1::-1], interpolation=cv2.INTER_AREA).reshape(
            *first.shape[:2], *[1] * (first.ndim - 2)
        )
        values = first + weight * (second.astype(np.float32) - first)
        values = values if first.dtype == np.float32 else np.rint(values)
        return np.where(weight > 0, values, first).astype(first.dtype)  # without doubt, to the bit

    return view(image).map(mixed, view(other))
