"""Planes of two frames, in the form that kernels compare."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import FINITE_JIT, njit


class PlanePair(NamedTuple):
    """Component planes of two frames with repeated edges."""

    planes0: NDArray[Any]
    """Frame 0, (3, H + 2 padding, W + 2 padding or more) uint8 or float32."""
    planes1: NDArray[Any]
    """Frame 1, of the same shape."""
    padding: int
    """Width of the repeated edges, pixels."""
    height: int
    """Rows of the frames, H."""
    width: int
    """Columns of the frames, W."""
    max_similarity: int | np.uint8
    """Similarity of two equal pixels: `fpsboost.kernels.levels.truncation` or `fpsboost.kernels.similarity.UNIT`."""


@njit(**FINITE_JIT)
def opposite(pair):
    """Return the pair from frame 1 to frame 0."""
    return PlanePair(pair.planes1, pair.planes0, pair.padding, pair.height, pair.width, pair.max_similarity)
