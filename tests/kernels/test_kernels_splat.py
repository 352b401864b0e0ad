"""Painting forward against a slow twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from twins import landed

from fpsboost.kernels.splat import splat


@st.composite
def fields(draw):
    """Motion in eighths of pixels, so that float32 is exact and half pixels are common; few similarities, so ties."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    largest = draw(st.sampled_from([0, 4, 12, 40, 160]))  # eighths: up to far beyond the frame
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    flow = random.integers(-largest, largest + 1, (height, width, 2)) / 8
    similarity = random.integers(0, draw(st.sampled_from([1, 5])), (height, width)) / 4
    return flow.astype(np.float32), similarity.astype(np.float32)


exact_times = st.sampled_from([0.0, 0.25, 0.5, 0.625, 0.75, 1.0])


def sources(flow, similarity, least, t):
    """Call the kernel."""
    source0, source1 = (np.full(similarity.shape, -99, np.int32) for _ in range(2))
    splat(flow, similarity, np.float32(least), np.float32(t), source0, source1)
    return source0, source1


@given(fields(), exact_times, st.sampled_from([0.0, 0.25, 0.5, 1.0]))
def test_landings_equal_the_slow_twin(field, t, least):
    """The most similar that lands on each place, the first of several, and nothing where nothing usable does."""
    for result, expected in zip(sources(*field, least, t), landed(*field, least, t), strict=True):
        np.testing.assert_array_equal(result, expected)


@pytest.mark.parametrize("value", [1e6, -1e30, np.inf, np.nan])
def test_vast_motion_lands_nowhere(value):
    """Nor does it lead out of the arrays."""
    flow, similarity = np.full((6, 8, 2), value, np.float32), np.ones((6, 8), np.float32)
    for source in sources(flow, similarity, 0, 0.5):
        np.testing.assert_array_equal(source, np.arange(48).reshape(6, 8))


@pytest.mark.parametrize("value", [1e6, -1e6])
def test_what_leaves_the_frame_ends_at_its_edge(value):
    """Just after it set off, it is still where it was, and its other end is the nearest that there is."""
    flow, similarity = np.full((6, 8, 2), value, np.float32), np.ones((6, 8), np.float32)
    source0, source1 = sources(flow, similarity, 0, 1e-9)
    np.testing.assert_array_equal(source0, np.arange(48).reshape(6, 8))
    np.testing.assert_array_equal(source1, 47 if value > 0 else 0)
