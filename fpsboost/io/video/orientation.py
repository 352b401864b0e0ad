"""Rotate and flip pictures according to the display matrix of their video."""

from __future__ import annotations

import numpy as np

from fpsboost.frame import Image


def is_on_its_side(matrix: tuple[int, ...] | None) -> bool:
    """Return whether a display matrix exchanges width and height; only quarter turns and flips are considered."""
    return matrix is not None and _is_small(matrix[0], matrix[1]) and _is_small(matrix[4], matrix[3])


def _is_small(value: int, other: int) -> bool:
    """Return whether an element of a matrix differs from 0 by rounding only, beside another one."""
    return 256 * abs(value) <= abs(other)


def turned_upright(image: Image, matrix: tuple[int, ...] | None) -> Image:
    """Rotate and flip a picture according to its display matrix.

    Parameters
    ----------
    image : (H, W, C)
    matrix : tuple of 9 int or None
        Maps (x, y) to (a x + c y, b x + d y), with a, b, c and d at indices 0, 1, 3 and 4. Rotations by other angles
        than quarter turns are not applied.

    Returns
    -------
    (H, W, C) or (W, H, C)
    """
    if matrix is None:
        return image
    if is_on_its_side(matrix):
        image = image.transpose(1, 0, 2)
        left, down = matrix[3], matrix[1]
    elif _is_small(matrix[1], matrix[0]) and _is_small(matrix[3], matrix[4]):
        left, down = matrix[0], matrix[4]
    else:
        return image
    return np.ascontiguousarray(image[:: -1 if down < 0 else 1, :: -1 if left < 0 else 1])
