"""Exposure: the mean of several images, as film or a sensor sums light while the shutter is open.

Light adds up in proportion to radiance. Images of 8 and 16 bits are taken as sRGB (IEC 61966-2-1) and summed as linear
light; float images are linear already.
"""

from functools import cache
from typing import Any

import numpy as np

from fpsboost.colour import has_alpha, srgb_encoded
from fpsboost.image import Image

MIN_ALPHA = np.float32(1e-4)
"""Weight of the colour of fully transparent pixels: it counts only where nothing else does."""


class Exposure:
    """Sum of images, of which the mean is taken.

    Colours of straight alpha are weighted by their alpha, so that transparent pixels do not darken the mean.

    Examples
    --------
    >>> import numpy as np
    >>> exposure = Exposure()
    >>> for level in (0, 255):
    ...     exposure.add(np.full((1, 1, 3), level, np.uint8))
    >>> int(exposure.image()[0, 0, 0])  # half of the light of white
    188
    """

    def __init__(self) -> None:
        self.count = 0
        self._dtype: np.dtype[Any] = np.dtype(np.uint8)
        self._light = np.empty(0, np.float32)
        self._weight = np.empty(0, np.float32)

    def add(self, image: Image) -> None:
        """Add an image, (H, W, C) uint8, uint16 or float32; all must have one shape and type."""
        light, weight = _linear(image)
        if self.count:
            self._light += light
            self._weight += weight
        else:
            self._light = light
            self._weight = weight
            self._dtype = image.dtype
        self.count += 1

    def image(self) -> Image:
        """Return the mean of the images added so far, at least one, in their shape and type."""
        if self._dtype == np.float32:
            return self._light / np.float32(self.count)
        top = np.iinfo(self._dtype).max
        levels = np.rint(srgb_encoded(self._light / self._weight) * top)
        if self._weight.ndim == 3:
            alpha = (self._weight / np.float32(self.count) - MIN_ALPHA).clip(0, 1)
            levels = np.concatenate([levels, np.rint(alpha * top)], axis=2)
        return np.asarray(levels.astype(self._dtype))


def _linear(image: Image) -> tuple[np.ndarray, np.ndarray]:
    """Return the light of an image as float32, and its weight: 1, or (H, W, 1) with straight alpha."""
    if image.dtype == np.float32:
        return image.copy(), np.ones((), np.float32)
    curve = _curve(image.dtype)
    if not has_alpha(image):
        return curve[image], np.ones((), np.float32)
    weight = image[..., -1:].astype(np.float32) / np.float32(np.iinfo(image.dtype).max) + MIN_ALPHA
    return curve[image[..., :-1]] * weight, weight


@cache
def _curve(dtype: np.dtype[Any]) -> np.ndarray:
    """Return the linear light of every level of a type, float32; black is 0 and white is 1."""
    levels = np.linspace(0, 1, np.iinfo(dtype).max + 1)
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4).astype(np.float32)
