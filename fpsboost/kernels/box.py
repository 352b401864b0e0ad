"""Running sums of similarity over a box, row by row: the same cost for any patch size."""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT, LANES
from fpsboost.kernels.similarity import similarity


@njit(inline="always", **FINITE_JIT)
def slide_box(a0, a1, a2, b0, b1, b2, slot, width, ring, column):
    """Move the column sums of a box down by one row: the new row in, the oldest out."""
    oldest = ring[slot]
    for x in range(width):
        w = np.int32(similarity(a0[x], a1[x], a2[x], b0[x], b1[x], b2[x]))
        column[x] += w - oldest[x]
        oldest[x] = w


@njit(inline="always", **FINITE_JIT)
def sum_box_across(column, size, width, price, partial, total):
    """Sum `size` neighbouring column sums, by way of sums of five, and take a price off."""
    fives, rest = size // 5, size % 5
    reach = (size + LANES - 1) // LANES * LANES
    for x in range(width + reach):
        partial[x] = column[x] + column[x + 1] + column[x + 2] + column[x + 3] + column[x + 4]
    for x in range(width):
        value = -price
        for k in range(fives):
            value += partial[x + 5 * k]
        for k in range(rest):
            value += column[x + 5 * fives + k]
        total[x] = value
