"""Candidate motions of the nodes, their lists and their weights, against slow twins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from twins import collected, listed_by_votes

from fpsboost.kernels.candidates import (
    SUMS_PER_CANDIDATE,
    UNKNOWN,
    VALUES_PER_MOTION,
    Candidates,
    Votes,
    collect_candidates,
    list_candidates,
    no_votes,
)


def no_acceleration(vectors):
    """Every point knows that it has none."""
    return np.dstack([np.ones(vectors.shape[:2], np.float32), np.zeros_like(vectors)])


def collect(
    vectors,
    times,
    size,
    step=4,
    support=16.0,
    tolerance=0.5,
    capacity=12,
    accelerations=(None, None),
    trusts=None,
    gradients=None,
    spacing=16,
):
    """Both frames' motion as the kernel collects it: count, votes and sums."""
    room = spoiled(no_votes(points(size, spacing), capacity, spacing))
    for frame, (each, sign, t) in enumerate(zip(vectors, (1, -1), times, strict=False)):
        changes = no_acceleration(each) if accelerations[frame] is None else accelerations[frame]
        trust = np.ones(each.shape[:2], np.float32) if trusts is None else trusts[frame]
        collect_candidates(
            Votes(
                each,
                np.zeros((*each.shape, 2), np.float32) if gradients is None else gradients[frame],
                changes,
                trust,
            ),
            np.float32(sign),
            np.float32(t),
            step,
            np.float32(support),
            np.float32(tolerance),
            *size,
            room,
        )
    listed = np.arange(capacity) < room.listed[..., None]
    votes, sums = np.zeros(listed.shape, np.float32), np.zeros((*listed.shape, SUMS_PER_CANDIDATE), np.float32)
    votes[listed], sums[listed] = room.votes[listed], room.sums[room.places[listed]]
    assert sorted(room.places[listed]) == list(range(*room.total))
    for untouched in (room.votes[~listed], room.sums[room.total[0] :]):
        assert np.isnan(untouched).all()
    return room.listed, votes, sums


def spoiled(room):
    """What nothing may be read of before it is written: votes and sums that are not numbers, in no place."""
    for values in (room.votes, room.sums):
        values[:] = np.nan
    room.places[:] = -(2**31)
    return room


def points(size, step):
    """How many points there are, down and across."""
    return tuple(-(-length // step) for length in size)


def steady(size, dx, dy, step=4):
    """Everything moves alike."""
    return np.broadcast_to(np.float32([dx, dy]), (*points(size, step), 2)).copy()


def empty_lists(shape):
    """A list for every node."""
    lists = np.empty(shape, object)
    for place in np.ndindex(shape):
        lists[place] = []
    return lists


@settings(max_examples=20)
@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.integers(1, 9),
    st.sampled_from([4, 20, 100]),
    st.sampled_from([2, 5, 30]),
    st.sampled_from([16, 20, 24, 28]),
    st.integers(0, 2**32),
)
@example(16 * 13, 20, 9, 20, 5, 16, 1)
@example(39, 7, 1, 100, 2, 16, 1)
@example(20 * 5, 53, 9, 20, 5, 20, 1)
@example(29, 70, 5, 20, 5, 28, 1)
def test_candidates_equal_their_slow_twin(height, width, step, largest, capacity, spacing, seed):
    """Both directions, also out of the frame, bent, and with too little room, give the twin's candidates in order."""
    random = np.random.default_rng(seed)
    size, shape = (height, width), points((height, width), step)
    vectors = (random.integers(-largest, largest + 1, (2, *shape, 2)) / 8).astype(np.float32)
    accelerations = random.integers(-16, 17, (2, *shape, 3)).astype(np.float32)
    accelerations[..., 0] = random.integers(0, 2, (2, *shape))
    accelerations[..., 1:] *= accelerations[..., :1]
    gradients = random.choice(np.float32([0, 0, 0, 1 / 16, -1 / 32]), (2, *shape, 2, 2))
    trusts = random.choice(np.float32([0, 0.25, 1]), (2, *shape))
    tolerance = 0.5**0.5  # shares are exact, and no difference, a ratio, is on the edge of two answers
    support = 16 if spacing == 16 else 32
    count, votes, sums = collect(
        vectors, (0.25, 0.75), size, step, support, tolerance, capacity, accelerations, trusts, gradients, spacing
    )
    expected = empty_lists(count.shape)
    for frame, (sign, t) in enumerate(((1, 0.25), (-1, 0.75))):
        collected(
            vectors[frame],
            gradients[frame],
            accelerations[frame],
            trusts[frame],
            expected,
            sign=sign,
            t=t,
            step=step,
            support=support,
            tolerance=tolerance,
            size=size,
            capacity=capacity,
            spacing=spacing,
        )
    for place in np.ndindex(expected.shape):
        known = count[place]
        assert known == len(expected[place])
        found = np.column_stack([votes[place][:known], sums[place][:known]])
        np.testing.assert_allclose(
            found, np.reshape(expected[place], (known, 1 + SUMS_PER_CANDIDATE)), rtol=1e-4, atol=1e-4
        )
        assert not votes[place][known:].any()


def test_one_motion_is_one_candidate_with_all_the_votes():
    """Both frames' vectors agree once their direction is minded; a point's shares at the nodes around add up to 1."""
    size = (80, 80)
    count, votes, sums = collect((steady(size, 2, -1), steady(size, -2, 1)), (0.5, 0.5), size)
    assert (count == 1).all()
    np.testing.assert_allclose(votes[2, 2, 0], 2 * 4 * 4)  # 4 x 4 points a cell, two frames
    np.testing.assert_allclose(sums[..., 0, :2] / votes[..., :1], np.broadcast_to([2, -1], (5, 5, 2)), rtol=1e-5)


def test_a_zoom_is_one_candidate_of_each_node():
    """Where motion changes evenly from point to point, all votes agree on what it is at the node, and exactly so."""
    size, zoom = (80, 80), np.float32(0.125)
    place = np.arange(0, 80, 4) + 2.5
    vectors = np.float32(np.dstack([zoom * np.add.outer(0 * place, place), 0 * np.add.outer(place, place)]))
    gradients = np.zeros((1, 20, 20, 2, 2), np.float32)
    gradients[..., 0, 0] = zoom
    count, votes, sums = collect([vectors], [0.0], size, gradients=gradients)
    assert (count == 1).all()
    middles = np.broadcast_to(zoom * (16 * np.arange(5) + 8), (5, 5))
    np.testing.assert_allclose(sums[..., 0, 0] / votes[..., 0], middles, rtol=1e-5)


def test_motions_within_the_tolerance_are_one():
    """Their mean, by votes, is the candidate; further apart they are two."""
    size = (16, 16)
    vectors = steady(size, 3, 0)
    vectors[2:, :, 0] = 3.25
    count, votes, sums = collect([vectors], [0.0], size)
    assert count[0, 0] == 1
    above, below = (sum(1 - abs(y + 0.5 - 8) / 16 for y in rows) for rows in ((2, 6), (10, 14)))
    np.testing.assert_allclose(sums[0, 0, 0, 0] / votes[0, 0, 0], (3 * above + 3.25 * below) / (above + below))
    vectors[2:, :, 0] = 4
    count, votes, _ = collect([vectors], [0.0], size)
    assert count[0, 0] == 2
    np.testing.assert_allclose(votes[0, 0, 0] / votes[0, 0, 1], above / below, rtol=1e-6)


def test_a_bent_path_lands_beside_a_straight_one():
    """What speeds up is behind the straight path at half of the way, by an eighth of the acceleration."""
    vectors, changes = np.zeros((1, 5, 2), np.float32), np.zeros((1, 5, 3), np.float32)
    vectors[0, 0, 0], changes[0, 0] = 32, (1, 64, 0)
    for accelerations, landing in ((np.zeros_like(changes), 24.5), (changes, 16.5)):
        _, votes, sums = collect([vectors], [0.5], (16, 80), 16, 16, accelerations=[accelerations])
        shares = np.where(sums[0, ..., 0] > 0, votes[0], 0).sum(axis=1)
        np.testing.assert_allclose((shares * (np.arange(5) * 16 + 8)).sum() / shares.sum(), landing, rtol=1e-5)


def test_objects_that_cross_keep_accelerations_of_their_own():
    """Two motions through one node are two candidates, each with the acceleration of its own votes."""
    size = (16, 16)
    vectors, changes = steady(size, 6, 0), np.ones((4, 4, 3), np.float32)
    changes[..., 1:] = 3, 0
    vectors[1::2], changes[1::2, :, 1:] = (-6, 0), (-2, 1)
    changes[:, 0] = 0  # a column of points does not know
    count, votes, sums = collect([vectors], [0.0], size, accelerations=[changes])
    assert count[0, 0] == 2
    for k, acceleration in enumerate([(3, 0), (-2, 1)]):
        known = sums[0, 0, k, 2]
        assert 0 < known < votes[0, 0, k]
        np.testing.assert_allclose(sums[0, 0, k, 3:5] / known, acceleration, rtol=1e-5)
        np.testing.assert_allclose(sums[0, 0, k, 5] / known, np.square(acceleration).sum(), rtol=1e-5)


def listing(candidates, room, still_votes=0.5, spread=20.0, least_share=0.01, least=0.0):
    """One node's candidates, lists as `collected` makes them, as the kernel lists them: count, motions, weights."""
    held = spoiled(no_votes((1, 1), len(candidates) + 2, 16))
    held.listed[:] = len(candidates)
    for k, (vote, *others) in enumerate(candidates):
        place = len(candidates) - k
        held.votes[0, 0, k], held.places[0, 0, k], held.sums[place] = vote, place, others
    motions, weights = (
        np.full((1, 1, room, VALUES_PER_MOTION), np.nan, np.float32),
        np.full((1, 1, room), np.nan, np.float32),
    )
    numbers = np.float32(still_votes), np.float32(spread), np.float32(least_share), np.float32(least)
    listed = np.full((1, 1), -1, np.int32)
    list_candidates(held, *numbers, Candidates(listed, motions, weights, 16))
    return listed[0, 0], motions[0, 0], weights[0, 0]


def candidate(vote, dx, dy, known=0.0, ax=0.0, ay=0.0, variance=0.0, gradient=(0.0, 0.0, 0.0, 0.0)):
    """Sums of votes, of which the share `known` have an acceleration."""
    sure = vote * known
    changes = [vote * change for change in gradient]
    return [vote, vote * dx, vote * dy, sure, sure * ax, sure * ay, sure * (ax * ax + ay * ay + variance), *changes]


@settings(max_examples=25)
@given(
    st.integers(0, 8),
    st.integers(1, 8),
    st.sampled_from([0.1, 1, 30]),
    st.sampled_from([0, 0.02, 0.5]),
    st.integers(0, 2**32),
)
def test_lists_equal_their_slow_twin(number, room, spread, least, seed):
    """Any number of candidates, more or fewer than there is room for; their weights sum to 1."""
    random = np.random.default_rng(seed)
    candidates = [
        candidate(
            vote,
            *random.normal(size=2) * 9,
            *random.choice([0, 0.5, 1], 1),
            *random.normal(size=3) ** 2,
            random.normal(size=4),
        )
        for vote in random.permutation(np.linspace(0.1, 40, 8))[:number]
    ]
    count, motions, weights = listing(candidates, room, spread=spread, least=least)
    expected_motions, expected_weights = listed_by_votes(
        candidates, room, still_votes=0.5, spread=spread, least_share=0.01, least=least, unknown=float(UNKNOWN)
    )
    assert count == len(expected_motions) <= room
    np.testing.assert_allclose(motions[:count], expected_motions, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(weights[:count], expected_weights, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(weights.sum(), 1, rtol=1e-5)


def test_no_motion_is_always_listed():
    """Also where there is no room for anything else and where nobody has voted; all the weight is then its own."""
    for candidates in ([], [candidate(7, 3, 1)]):
        count, motions, weights = listing(candidates, 1)
        assert count == 1
        assert not motions[0].any()
        assert weights[0] == 1


def test_accelerations_that_scatter_are_not_believed():
    """Half is left where their standard deviation is the spread, less beyond it, and all but nothing far beyond."""
    bends = [
        listing([candidate(9, 4, 0, 1, 6, -2, deviation**2)], 2)[1][0, 2:4] / [6, -2] for deviation in (0, 20, 60, 400)
    ]
    np.testing.assert_allclose(np.transpose(bends)[0], np.transpose(bends)[1], rtol=1e-4)
    np.testing.assert_allclose(np.transpose(bends)[0] * (1 + UNKNOWN), [1, 0.5, 0.1, 1 / 401], rtol=1e-3)


def test_a_candidate_fades_out_before_it_is_left_out():
    """Around the threshold, the weight goes to 0 without a jump, so that nothing flickers there."""
    options = {"still_votes": 1e-9, "least_share": 0, "least": 0.02}
    before, at, beyond = (
        listing([candidate(1, 3, 1), candidate(0.02 * (1 + off), 9, 0)], 3, **options)[2][1] for off in (0.01, 0, -0.01)
    )
    assert 0 < before < 3e-4
    assert at == pytest.approx(0, abs=1e-7)
    assert beyond == 0
