"""How float results become pixels of an image's own type."""

from __future__ import annotations

import numpy as np

from fpsboost.frame import Image


def rounding_offset(image: Image) -> np.float32:
    """What to add before the conversion to the image's type: 0.5 for integers, 0 for float."""
    return np.float32(0 if image.dtype == np.float32 else 0.5)


def value_range(image: Image) -> tuple[np.float32, np.float32]:
    """The lowest and highest value that images of this type hold."""
    if image.dtype == np.float32:
        return np.finfo(np.float32).min, np.finfo(np.float32).max
    return np.float32(0), np.float32(np.iinfo(image.dtype).max)
