"""Lists of the most similar offsets, eight points at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from twins import listed_offsets, uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.lanes import EIGHT
from fpsboost.kernels.offset_lists import NOTHING, NOWHERE, VALUES_PER_ENTRY, insert_eight


@njit()
def insert(dx, dy, similarities, at, lists, size, capacity):
    """Call the compiled form."""
    insert_eight(dx, dy, similarities, at, lists, size, capacity)


def lists_of(offsets, similarities, at, size, capacity, call):
    """The entries of all points after all offsets, (capacity, VALUES_PER_ENTRY, points)."""
    lists = np.empty((capacity, VALUES_PER_ENTRY, size), np.float32)
    lists[:] = np.float32([NOTHING, NOWHERE, NOWHERE])[:, np.newaxis]
    flat = lists.reshape(-1)
    for (dx, dy), each in zip(np.float32(offsets), similarities, strict=True):
        call(dx, dy, each, at, flat, size, capacity)
    return lists


@settings(max_examples=30)
@given(st.integers(1, 9), st.integers(0, 30), st.integers(1, 6), st.integers(0, 2**32))
def test_lists_are_kept_as_offset_by_offset(capacity, count, largest, seed):
    """The best so many, falling; of neighbours the better, of equal ones the first; and of other points nothing."""
    random, at, size = np.random.default_rng(seed), 4, 20
    offsets = random.integers(-largest, largest + 1, (count, 2))
    similarities = random.integers(-2, 7, (count, size)).astype(np.float32) / 8
    expected = [listed_offsets(offsets, similarities[:, point], capacity) for point in range(size)]
    for call in (insert, uncompiled(insert)):
        lists = lists_of(offsets, similarities, at, size, capacity, call)
        for point in range(size):
            entries = [tuple(entry) for entry in lists[:, :, point].tolist() if entry[0] > NOTHING]
            assert entries == (expected[point] if at <= point < at + EIGHT else [])


@pytest.mark.parametrize("capacity", [1, 8])
def test_what_is_no_better_than_the_last_changes_nothing(capacity):
    """A full list stays as it is."""
    offsets = [(3 * k, 0) for k in range(capacity)]
    similarities = np.tile(np.linspace(1, 0.5, capacity, dtype=np.float32)[:, np.newaxis], EIGHT)
    before = lists_of(offsets, similarities, 0, EIGHT, capacity, insert)
    after = lists_of([*offsets, (-50, 0)], [*similarities, similarities[-1]], 0, EIGHT, capacity, insert)
    np.testing.assert_array_equal(before, after)
