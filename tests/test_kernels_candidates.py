"""Candidate motions of the cells, against a slow twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from twins import collected

from fpsboost.kernels.candidates import BAND, CELL, collect_candidates


def collect(flows, times, size, step=4, around=16.0, tolerance=0.5, capacity=12, trusts=None):
    """Both frames' motion as the kernel collects it: count, votes, the corners' shares and sums."""
    in_full = np.ones([-(-length // step) for length in size], np.float32)
    cells = -(-size[0] // CELL), -(-size[1] // CELL)
    count = np.zeros(cells, np.int32)
    votes, sums = np.zeros((*cells, capacity), np.float32), np.zeros((*cells, capacity, 2), np.float32)
    corners = np.zeros((*cells, capacity, 2, 2), np.float32)
    limits = np.float32(around), np.float32(tolerance)
    for flow, trust, sign, t in zip(flows, trusts or (in_full, in_full), (1, -1), times, strict=False):
        kinds = np.float32(flow), trust, np.float32(sign), np.float32(t)
        collect_candidates(*kinds, step, *limits, count, votes, corners, sums)
    return count, votes, corners, sums


def steady(size, dx, dy):
    """Everything moves alike."""
    return np.broadcast_to(np.float32([dx, dy]), (*size, 2)).copy()


@settings(max_examples=20)
@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.integers(1, 9),
    st.sampled_from([4, 20, 100]),
    st.sampled_from([2, 5, 30]),
    st.integers(0, 2**32),
)
@example(CELL * (BAND + 1), 20, 9, 20, 5, 1)
@example(39, 7, 1, 100, 2, 1)
def test_candidates_equal_their_slow_twin(height, width, step, largest, capacity, seed):
    """Both directions, also out of the frame and with too little room, give the twin's candidates in its order."""
    random = np.random.default_rng(seed)
    flows = (random.integers(-largest, largest + 1, (2, height, width, 2)) / 8).astype(np.float32)
    trusts = [random.choice(np.float32([0, 0.25, 1]), (-(-height // step), -(-width // step))) for _ in range(2)]
    around, tolerance = 16, 0.5**0.5  # shares are exact, and no difference, a ratio, is on the edge of two answers
    count, votes, corners, sums = collect(
        flows, (0.25, 0.75), (height, width), step, around, tolerance, capacity, trusts
    )
    expected = np.empty(count.shape, object)
    for place in np.ndindex(expected.shape):
        expected[place] = []
    for flow, trust, sign, t in zip(flows, trusts, (1, -1), (0.25, 0.75), strict=True):
        collected(flow, trust, sign, t, step, around, tolerance, expected, capacity=capacity)
    for place in np.ndindex(expected.shape):
        known = count[place]
        assert known == len(expected[place])
        found = np.column_stack([votes[place][:known], sums[place][:known], corners[place][:known].reshape(known, 4)])
        np.testing.assert_allclose(found, np.reshape(expected[place], (known, 7)), rtol=1e-5, atol=1e-5)
        assert not votes[place][known:].any()


def test_one_motion_is_one_candidate_with_all_the_votes():
    """Both frames' vectors agree once their direction is minded, and each is shared by four corners of four cells."""
    size = (80, 80)
    count, votes, corners, sums = collect((steady(size, 2, -1), steady(size, -2, 1)), (0.5, 0.5), size)
    assert (count == 1).all()
    np.testing.assert_allclose(votes[2, 2, 0], 4 * 2 * 4 * 4)  # 4 x 4 points a cell, two frames, four corners
    np.testing.assert_allclose(corners[2, 2, 0], 2 * 4 * 4)
    np.testing.assert_allclose(sums[..., 0, :] / votes[..., :1], np.broadcast_to([2, -1], (5, 5, 2)), rtol=1e-5)


def test_motions_within_the_tolerance_are_one():
    """Their mean, by votes, is the candidate; further apart they are two."""
    size = (16, 16)
    flow = steady(size, 3, 0)
    flow[8:, :, 0] = 3.25
    count, votes, _, sums = collect([flow], [0.0], size)
    assert count[0, 0] == 1
    np.testing.assert_allclose(sums[0, 0, 0] / votes[0, 0, 0], [3.125, 0])
    flow[8:, :, 0] = 4
    count, votes, _, _ = collect([flow], [0.0], size)
    assert count[0, 0] == 2
    assert votes[0, 0, :2].tolist() == [8, 8]


def test_neighbouring_cells_agree_on_the_corners_they_share():
    """Where only few motions are told apart, a corner has the same votes from all sides: no border shows."""
    size = (64, 64)
    flow = steady(size, 0, 0)
    flow[:, 20:45, 0] = 8
    count, votes, corners, sums = collect([flow, -flow], [0.5, 0.5], size)

    def share(row, column, dx, corner):
        known = [
            k for k in range(count[row, column]) if abs(sums[row, column, k, 0] - dx * votes[row, column, k]) < 0.1
        ]
        return sum(corners[row, column, k][corner] for k in known)

    for dx in (0, 8):
        for row, column in np.ndindex(3, 3):
            expected = share(row, column, dx, (1, 1))
            np.testing.assert_allclose(share(row + 1, column, dx, (0, 1)), expected, atol=1e-5)
            np.testing.assert_allclose(share(row, column + 1, dx, (1, 0)), expected, atol=1e-5)
            np.testing.assert_allclose(share(row + 1, column + 1, dx, (0, 0)), expected, atol=1e-5)


@pytest.mark.parametrize(("around", "cells"), [(9, [0, 1, 2]), (16, [0, 1, 2]), (32, [0, 1, 2, 3])])
def test_a_motion_counts_where_it_lands_and_around(around, cells):
    """A vector from the middle of the first cell to that of the second belongs to all whose corners are near enough."""
    flow = np.zeros((16, 80, 2), np.float32)
    flow[:, :16, 0] = 32
    count, _, _, sums = collect([flow], [0.5], (16, 80), step=16, around=around)
    assert [cell for cell in range(5) if (sums[0, cell, : count[0, cell], 0] > 0).any()] == cells


def test_no_more_candidates_than_there_is_room_for():
    """What comes first stays and goes on collecting votes; nothing is written beyond."""
    size = (16, 16)
    flow = np.zeros((*size, 2), np.float32)
    flow[..., 0] = np.arange(256).reshape(size) // 2 * 2
    count, votes, _, sums = collect([flow], [0.0], size, step=1, capacity=5)
    assert count[0, 0] == 5
    np.testing.assert_allclose(sums[0, 0, :, 0] / votes[0, 0], [0, 2, 4, 6, 8], atol=1e-5)
