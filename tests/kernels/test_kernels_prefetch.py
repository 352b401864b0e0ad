"""Prefetching is a hint and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from fpsboost.kernels.jit import njit
from fpsboost.kernels.prefetch import prefetch


@njit()
def compiled(flat, place):
    """The kernels' own."""
    prefetch(flat, place)


@pytest.mark.parametrize("place", [0, 3, 10**15, 2**64 - 5])
def test_nothing_changes_wherever_it_points(place):
    """Neither the array nor anything else, for places within the array and far beyond it."""
    flat = np.arange(4, dtype=np.float32)
    compiled(flat, np.uint64(place))
    np.testing.assert_array_equal(flat, [0, 1, 2, 3])
