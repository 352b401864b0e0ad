"""Best offsets so far and four more, compiled and not."""

from __future__ import annotations

import numpy as np
import pytest
from twins import uncompiled

from fpsboost.kernels.best_offsets import OUTSIDE, hide_outside, keep_best_of_four
from fpsboost.kernels.jit import njit
from fpsboost.kernels.lanes import EIGHT


@njit()
def keep(totals, ranks, best, winners, count):
    """Call the compiled form, and so below."""
    keep_best_of_four(totals, 5, 31, ranks, 2, best, winners, 3, count)


@njit()
def hide(totals, first, last):
    """Hide all but some totals."""
    hide_outside(totals, first, last)


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
@pytest.mark.parametrize("count", [1, EIGHT, 2 * EIGHT + 1])
def test_the_largest_total_stays_with_its_rank_alike_compiled_and_not(dtype, count):
    """Of equal totals, that of the lowest rank stays; of few values, many are equal."""
    random = np.random.default_rng(count)
    totals, best = (random.integers(-1, 4, length).astype(dtype) for length in (130, 40))
    ranks, winners = np.int32([0, 0, 2, 5, 6, 9]), random.integers(0, 12, 40).astype(np.int32)
    written = 3 + np.arange(-(-count // EIGHT) * EIGHT)
    for each in (keep, uncompiled(keep)):
        found, numbers = best.copy(), winners.copy()
        each(totals, ranks, found, numbers, count)
        for place in range(40):
            candidates = [(-best[place], winners[place])]
            if place in written:
                candidates += [(-totals[5 + 31 * which + place - 3], ranks[2 + which]) for which in range(4)]
            assert (-found[place], numbers[place]) == min(candidates)


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
def test_totals_outside_never_win(dtype):
    """Those on either side of the candidates are below all others; the candidates and all farther on stay."""
    for each in (hide, uncompiled(hide)):
        totals = np.arange(60).astype(dtype)
        each(totals, 20, 31)
        expected = np.arange(60)
        expected[20 - OUTSIDE : 20] = expected[31 : 31 + OUTSIDE] = -1
        np.testing.assert_array_equal(totals, expected)
