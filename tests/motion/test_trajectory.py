"""How motion changes from pair to pair: exact fields, and fields that were estimated."""

import numpy as np
import pytest
from truth import accelerating, prepared

from fpsboost.motion.field import MotionField, accelerations_at_points
from fpsboost.motion.nlm import CoarseToFine

SIZE = (96, 128)
SPACING = 8
MOTIONS = [((4, -2), (2, 1)), ((3, 1), (-2, 1.5)), ((0, 0), (1, -1)), ((4, 2), (0, 0))]
UNEVEN = [(-1, 0, 1, 2), (-2, 0, 1, 1.5), (-0.5, 0, 1, 2.5)]


def exact_fields(start, end, velocity, acceleration):
    """Motion of everything from one time to another, and back."""
    way = [(end - start) * v + (end**2 - start**2) * a / 2 for v, a in zip(velocity, acceleration, strict=True)]
    return uniform(*way), uniform(*np.negative(way))


def uniform(dx, dy):
    """The same motion everywhere."""
    return MotionField(np.full((*SIZE, 2), (dx, dy), np.float32), np.ones(SIZE, np.float32))


def assert_found(fields, times, acceleration, tolerance):
    """Every point away from the edge has the acceleration.

    The pair before tells it at the pair's first frame, and the pair after at its last one.
    """
    before, pair, after = fields
    lengths = np.diff(times)
    at_first = accelerations_at_points(pair, before[::-1], lengths[0] / lengths[1], SPACING)
    at_last = accelerations_at_points(pair[::-1], after, lengths[2] / lengths[1], SPACING)
    for found in (at_first, at_last):
        assert found.shape == (SIZE[0] // SPACING, SIZE[1] // SPACING, 3)
        assert found.dtype == np.float32
        inner = found[2:-2, 2:-2]
        assert (inner[..., 0] == 1).mean() > 0.97
        off = np.linalg.norm(inner[..., 1:] - acceleration, axis=-1)[inner[..., 0] == 1]
        assert np.percentile(off, 97) <= tolerance


@pytest.mark.parametrize("times", UNEVEN)
@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
def test_exact_fields_give_the_acceleration(velocity, acceleration, times):
    """From either side, for pairs as long as each other or not; none at constant speed."""
    fields = [exact_fields(*times[k : k + 2], velocity, acceleration) for k in range(3)]
    assert_found(fields, times, acceleration, 1e-4)


@pytest.mark.parametrize("times", UNEVEN)
@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
def test_estimated_fields_give_the_acceleration(velocity, acceleration, times):
    """A smooth texture's, too, to what the motion itself is off by at a point, a quarter of a pixel."""
    at = accelerating(*SIZE, velocity=velocity, acceleration=acceleration)
    images = prepared(*(at(t) for t in times))
    fields = [CoarseToFine().estimate(images[k], images[k + 1]) for k in range(3)]
    assert_found(fields, times, acceleration, 0.25)


def test_without_a_neighbour_there_is_none():
    """A pair alone tells nothing: no point knows an acceleration."""
    found = accelerations_at_points((uniform(3, 1), uniform(3, 1)), None, 1, SPACING)
    assert found.shape == (12, 16, 3)
    assert not found.any()


@pytest.mark.parametrize("lost", ["onward", "away"])
def test_vectors_that_do_not_come_back_do_not_count(lost):
    """Where the way back of either pair leads elsewhere, nothing is known and nothing is said; beside it, all is."""
    fields = {"onward": exact_fields(0, 1, (2, 0), (1, 0)), "away": exact_fields(-1, 0, (2, 0), (1, 0))[::-1]}
    there, back = fields[lost]
    inconsistency = back.flow.copy()
    inconsistency[:, :64] += 40
    fields[lost] = there, MotionField(inconsistency, back.similarity)
    found = accelerations_at_points(fields["onward"], fields["away"], 1, SPACING)
    assert not found[:, 1:7].any()
    np.testing.assert_allclose(found[:, 9:-1], np.broadcast_to([1, 1, 0], (12, 6, 3)), atol=1e-5)
