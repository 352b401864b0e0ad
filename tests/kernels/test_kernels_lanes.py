"""Eight numbers at once."""

from __future__ import annotations

import numpy as np
import pytest
from twins import uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.lanes import EIGHT, extend_paths, filter_eight


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
def extend_compiled(labels, costs, total, here, before, room, prices):
    """Call the compiled form."""
    extend_paths(labels[0], labels[1], labels[2], costs, total, here, before, room, prices[0], prices[1])


@pytest.mark.parametrize("room", [EIGHT, 3 * EIGHT])
@pytest.mark.parametrize("seed", range(3))
def test_paths_are_extended_alike_compiled_and_not(seed, room):
    """From the cheapest label, with a price for the change up to a limit; nothing beside the node is written."""
    random, here, before = np.random.default_rng(seed), 3, 40
    labels = random.integers(-5, 6, (3, 80)).astype(np.float32)
    known, sums = random.random((2, 80)).astype(np.float32)
    prices = np.float32([0.05, 0.3])  # of a pixel, at most
    x, y, energy = labels
    extended = np.empty(room)
    for k in range(room):
        changes = np.abs(x[here + k] - x[before : before + room]) + np.abs(y[here + k] - y[before : before + room])
        reached = known[before : before + room] + np.minimum(prices[0] * changes, prices[1])
        extended[k] = energy[here + k] + reached.min()
    expected_costs, expected_sums = known.copy(), sums.copy()
    expected_costs[here : here + room] = extended - extended.min()
    expected_sums[here : here + room] += extended
    for call in (extend_compiled, uncompiled(extend_compiled)):
        costs, total = known.copy(), sums.copy()
        call(labels, costs, total, here, before, room, prices)
        np.testing.assert_allclose(costs, expected_costs, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(total, expected_sums, rtol=1e-6)
