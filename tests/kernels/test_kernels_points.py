"""What the vectors of points say together, against slow twins."""

import numpy as np
import pytest

from fpsboost.kernels.points import (
    FieldLayout,
    RoundTrip,
    find_accelerations,
    find_gradients,
    measure_forward_backward_errors,
)
from fpsboost.motion.field import MotionField, forward_backward_error
from support.truth import frozen
from support.twins import smaller_change, way_there_and_back

HEIGHT, WIDTH = 20, 27
Y, X = frozen(np.array([2, 7, 12, 19])), frozen(np.array([0, 5, 13, 26]))  # as `point_places` has them
CONSISTENT = 1.5


def field(seed, motion=(0, 0), spread=9):
    """Motion of a frame, evenly spread around one motion; some of it leads out of the frame."""
    offsets = np.random.default_rng(seed).uniform(-spread, spread, (HEIGHT, WIDTH, 2))
    return np.float32(offsets + motion)


@pytest.mark.parametrize("seed", range(3))
def test_trips_equal_their_slow_twin(seed):
    """There to the nearest pixel and back, beyond the edges as at them."""
    there, back = field(seed), field(seed + 10)
    vectors = there[np.ix_(Y, X)]
    distance = np.empty((Y.size, X.size), np.float32)
    measure_forward_backward_errors(vectors, Y, X, back, 1, HEIGHT, WIDTH, distance)
    for i, j in np.ndindex(distance.shape):
        expected, _ = way_there_and_back(vectors[i, j], back, Y[i], X[j])
        assert distance[i, j] == np.float32(expected)


def test_fields_may_be_views():
    """What an estimator of one's own returns need not fill its memory in order, nor be of 32 bits."""
    there, back = field(3), field(4)
    views = (np.asfortranarray(each, np.float64) for each in (there, back))
    errors = [
        forward_backward_error(
            vectors[:, ::2], np.arange(HEIGHT), np.arange(0, WIDTH, 2), MotionField(other, other[..., 0])
        )
        for vectors, other in ((there, back), views)
    ]
    np.testing.assert_array_equal(*errors)


@pytest.mark.parametrize("ratio", [1.0, 0.5, 2.0])
def test_accelerations_equal_their_slow_twin(ratio):
    """Where vectors of both pairs lead into the frame and come back, their change; nothing elsewhere."""
    motion = np.array([3.2, -2.1])
    there, away = field(1, motion, 0.7), field(2, -motion, 0.7)
    back, away_back = field(3, -motion, 0.7), field(4, motion, 0.7)
    changes = np.empty((Y.size, X.size, 3), np.float32)
    trips = RoundTrip(there, back), RoundTrip(away, away_back)
    find_accelerations(*trips, FieldLayout(1, HEIGHT, WIDTH), Y, X, ratio, np.float32(CONSISTENT), changes)
    for i, j in np.ndindex(Y.size, X.size):
        onward, elsewhere = there[Y[i], X[j]], away[Y[i], X[j]]
        ways = way_there_and_back(onward, back, Y[i], X[j]), way_there_and_back(elsewhere, away_back, Y[i], X[j])
        known = all(inside and apart <= CONSISTENT for apart, inside in ways)
        expected = (onward * ratio + elsewhere) * 2 / (ratio + ratio**2) if known else (0, 0)
        np.testing.assert_allclose(changes[i, j], [known, *expected], rtol=1e-5, atol=1e-6)
    assert 0 < changes[..., 0].sum() < changes[..., 0].size


@pytest.mark.parametrize("shape", [(5, 7), (2, 3), (1, 4)])
def test_gradients_equal_their_slow_twin(shape):
    """Of both neighbours' differences the smaller one, where they have one sign; none at the ends."""
    vectors = np.random.default_rng(5).normal(0, 3, (*shape, 2)).astype(np.float32)
    gradients = np.empty((*shape, 2, 2), np.float32)
    find_gradients(vectors, np.float32(8), gradients)
    for i, j, axis in np.ndindex(*shape, 2):
        for place, line, n in ((0, vectors[i, :, axis], j), (1, vectors[:, j, axis], i)):
            inner = 0 < n < len(line) - 1
            expected = smaller_change(line[n] - line[n - 1], line[n + 1] - line[n]) / 8 if inner else 0
            np.testing.assert_allclose(gradients[i, j, place, axis], expected, rtol=1e-6)
