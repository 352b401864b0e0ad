"""Filters on eight pixels at once."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from twins import uncompiled

from fpsboost.kernels.lanes import EIGHT, filter_eight


@njit
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
