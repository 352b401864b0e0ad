"""Conversion of float results to pixels of an image's own type."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import has_alpha
from fpsboost.image import Image, Pixels, view


def rounding_offset(image: Pixels) -> np.float32:
    """Return the offset to add before the conversion to the image's type: 0.5 for integers, 0 for float."""
    return np.float32(0 if image.dtype == np.float32 else 0.5)


def as_image(values: NDArray[Any], image0: Image, image1: Image, t: float) -> Image:
    """Convert float results to an image of the frames' type.

    Parameters
    ----------
    values : (H, W, C) float32
        Values as returned by `fpsboost.colour.premultiplied`; may be modified.
    image0, image1 : (H, W, C)
        The frames.
    t : float
        Time of the result between the frames.
    """
    straight_alpha = has_alpha(image0) and image0.dtype != np.float32
    lowest, highest = view(image0).value_range
    if straight_alpha:
        values[..., :-1] *= highest / np.maximum(values[..., -1:], np.float32(1e-6))
    image: Image = (values + rounding_offset(image0)).clip(lowest, highest).astype(image0.dtype)
    if straight_alpha:
        colour_unseen(image, image0, image1, t)
    return image


def colour_unseen(image: Image, image0: Image, image1: Image, t: float) -> None:
    """Set the colour of fully transparent pixels to that of the blended frames, in place."""
    unseen = image[..., -1] == 0
    image[unseen, :-1] = np.rint(image0[unseen, :-1] * (1 - t) + image1[unseen, :-1] * t)
