"""Candidate motions of the nodes, their lists and their weights, against slow twins."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fpsboost.kernels.candidates import (
    Votes,
    collect_candidates,
    list_candidates,
    no_votes,
)
from fpsboost.kernels.constants import SUMS_PER_CANDIDATE, UNKNOWN, VALUES_PER_MOTION
from support.planes import points
from support.twins import collected, listed_by_votes


def collect(votes, times, size, *, step=16, support=16.0, tolerance=0.5, capacity=12, spacing=16):
    """What the kernel collects of the points of frame 0, and of frame 1: count, votes and sums."""
    room = spoiled(no_votes(points(size, spacing), capacity, spacing))
    limits = step, np.float32(support), np.float32(tolerance)
    for frame, sign, t in zip(votes, (1, -1), times, strict=False):
        collect_candidates(frame, np.float32(sign), np.float32(t), *limits, *size, room)
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
    frames = [Votes(*frame) for frame in zip(vectors, gradients, accelerations, trusts, strict=True)]
    options = {"step": step, "capacity": capacity, "spacing": spacing, "support": 16 if spacing == 16 else 32}
    options["tolerance"] = 0.5**0.5  # shares are exact, and no difference, a ratio, is on the edge of two answers
    count, votes, sums = collect(frames, (0.25, 0.75), size, **options)
    expected = np.vectorize(lambda _: [], otypes=[object])(count)
    for frame, sign, t in zip(frames, (1, -1), (0.25, 0.75), strict=True):
        collected(*frame, expected, sign=sign, t=t, size=size, **options)
    for place in np.ndindex(expected.shape):
        known = count[place]
        assert known == len(expected[place])
        found = np.column_stack([votes[place][:known], sums[place][:known]])
        np.testing.assert_allclose(
            found, np.reshape(expected[place], (known, 1 + SUMS_PER_CANDIDATE)), rtol=1e-4, atol=1e-4
        )
        assert not votes[place][known:].any()


def test_a_bent_path_lands_beside_a_straight_one():
    """What speeds up is behind the straight path at half of the way, by an eighth of the acceleration."""
    vectors, changes = np.zeros((1, 5, 2), np.float32), np.zeros((1, 5, 3), np.float32)
    vectors[0, 1, 0], changes[0, 1] = 32, (1, 64, 0)
    for accelerations, landing in ((np.zeros_like(changes), 40.5), (changes, 32.5)):
        frame = Votes(vectors, np.zeros((1, 5, 2, 2), np.float32), accelerations, np.ones((1, 5), np.float32))
        _, votes, sums = collect([frame], [0.5], (16, 80))
        shares = np.where(sums[0, ..., 0] > 0, votes[0], 0).sum(axis=1)
        np.testing.assert_allclose((shares * (np.arange(5) * 16 + 8)).sum() / shares.sum(), landing, rtol=1e-5)


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
    list_candidates(held, *numbers, listed, motions, weights)
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
    st.sampled_from([0.5, 1, 30]),  # of a tenth, squares of accelerations leave too few digits
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
        candidates, room, still_votes=0.5, spread=spread, least_share=0.01, least=least, unknown=UNKNOWN
    )
    assert count == len(expected_motions) <= room
    np.testing.assert_allclose(motions[:count], expected_motions, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(weights[:count], expected_weights, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(weights.sum(), 1, rtol=1e-5)
