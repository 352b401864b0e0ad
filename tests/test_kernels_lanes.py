"""Eight numbers at once."""

from __future__ import annotations

import numpy as np
import pytest
from twins import uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.lanes import EIGHT, filter_eight, relax_eight


@njit()
def filter_compiled(source, begin, step, weights, out, target):
    """Call the compiled form."""
    filter_eight(source, begin, step, weights[0], weights[1], weights[2], weights[3], out, target)


@pytest.mark.parametrize("step", [1, EIGHT, 13])
def test_eight_pixels_are_filtered_alike_compiled_and_not(step):
    """Four taps, `step` apart; nothing beside the eight is written."""
    random = np.random.default_rng(step)
    source, weights = random.random(80).astype(np.float32), random.random(4).astype(np.float32)
    expected = sum(weights[n] * source[3 + n * step :][:EIGHT] for n in range(4))
    for call in (filter_compiled, uncompiled(filter_compiled)):
        out = np.zeros(20, np.float32)
        call(source, 3, step, weights, out, 5)
        np.testing.assert_allclose(out[5 : 5 + EIGHT], expected, rtol=1e-6)
        assert not out[:5].any()
        assert not out[5 + EIGHT :].any()


@njit()
def relax_compiled(x, y, here, before, costs, numbers, cheapest, at):
    """Call the compiled form."""
    relax_eight(x, y, here, before, costs, numbers[0], numbers[1], numbers[2], cheapest, at)


@pytest.mark.parametrize("seed", range(4))
def test_eight_labels_are_reached_alike_compiled_and_not(seed):
    """From the cheapest of eight others, with a price for the change up to a limit; nothing beside them is written."""
    random = np.random.default_rng(seed)
    x, y = random.integers(-5, 6, (2, 40)).astype(np.float32)
    costs, known = random.random(40).astype(np.float32), random.random(20).astype(np.float32)
    numbers = np.float32([0.1, 0.05, 0.3])  # taken off, by a pixel, at most
    expected = known.copy()
    for k in range(EIGHT):
        changes = np.abs(x[3 + k] - x[20 : 20 + EIGHT]) + np.abs(y[3 + k] - y[20 : 20 + EIGHT])
        reached = costs[20 : 20 + EIGHT] - numbers[0] + np.minimum(numbers[1] * changes, numbers[2])
        expected[5 + k] = min(known[5 + k], reached.min())
    for call in (relax_compiled, uncompiled(relax_compiled)):
        cheapest = known.copy()
        call(x, y, 3, 20, costs, numbers, cheapest, 5)
        np.testing.assert_allclose(cheapest, expected, rtol=1e-6)
