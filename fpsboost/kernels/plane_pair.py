"""Planes of two frames, in the form that kernels compare."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray


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
    max_similarity: int
    """Similarity of two equal pixels: `fpsboost.kernels.levels.truncation` or `fpsboost.kernels.similarity.UNIT`."""
