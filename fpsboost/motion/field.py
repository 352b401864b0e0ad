"""A motion field: one vector and one similarity a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class MotionField:
    """Motion of every pixel of one frame towards another.

    Attributes
    ----------
    flow : (H, W, 2) float32
        ``(dx, dy)`` in pixels; the direction is in the variable's name (``field01``, ``field10``).
    similarity : (H, W) float32
        How alike the patches at both ends are, in [0, 1]; 1 everywhere where an estimator does not know.
    alternatives : tuple of (H, W, 2) float32
        Other vectors that may hold instead, from none to a few a pixel.
    """

    flow: NDArray[Any]
    similarity: NDArray[Any]
    alternatives: tuple[NDArray[Any], ...] = ()


def at_points(flow: NDArray[Any], spacing: int) -> NDArray[Any]:
    """What the pixels at points `spacing` apart have, the first at spacing / 2 and the last within the frame.

    Parameters
    ----------
    flow : (H, W, 2) or (H, W)
    spacing : int
        Pixels.

    Returns
    -------
    (rows, columns, 2) or (rows, columns)
    """
    height, width = flow.shape[:2]
    y, x = (np.minimum(np.arange(0, length, spacing) + spacing // 2, length - 1) for length in (height, width))
    points: NDArray[Any] = flow[np.ix_(y, x)]
    return points
