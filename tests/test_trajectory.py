"""How motion changes from pair to pair: exact fields, and fields that were estimated."""

from __future__ import annotations

import numpy as np
import pytest
from truth import accelerating, prepared

from fpsboost.kernels.candidates import CELL
from fpsboost.motion.field import MotionField
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.trajectory import ONE_SIDED, TWO_SIDED, Neighbour, find_acceleration

SIZE = (96, 128)
MOTIONS = [((4, -2), (2, 1)), ((3, 1), (-2, 1.5)), ((0, 0), (1, -1)), ((4, 2), (0, 0))]
UNEVEN = [(-1, 0, 1, 2), (-2, 0, 1, 1.5), (-0.5, 0, 1, 2.5)]


def exact_fields(start, end, velocity, acceleration):
    """Motion of everything from one time to another, and back."""
    way = [(end - start) * v + (end**2 - start**2) * a / 2 for v, a in zip(velocity, acceleration, strict=True)]
    alike = np.ones(SIZE, np.float32)
    return tuple(MotionField(np.full((*SIZE, 2), sign * np.float32(way), np.float32), alike) for sign in (1, -1))


def by_side(fields, times):
    """What the pair before, the pair after and both say, each with the share of it that is believed."""
    before = Neighbour(*fields[0], times[1] - times[0])
    after = Neighbour(*fields[2], times[3] - times[2])
    return [
        (find_acceleration(*fields[1], before, None), ONE_SIDED),
        (find_acceleration(*fields[1], None, after), ONE_SIDED),
        (find_acceleration(*fields[1], before, after), TWO_SIDED),
    ]


def assert_found(fields, times, acceleration, tolerance):
    """Every cell away from the frame's edge has the acceleration, as far as it is believed."""
    for found, share in by_side(fields, times):
        assert found.shape == (SIZE[0] // CELL, SIZE[1] // CELL, 2)
        assert found.dtype == np.float32
        off = np.linalg.norm(found[1:-1, 1:-1] / share - acceleration, axis=-1)
        assert off.max() <= tolerance


@pytest.mark.parametrize("times", UNEVEN)
@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
def test_exact_fields_give_the_acceleration(velocity, acceleration, times):
    """To 15 % from either side and from both, for pairs as long as each other or not; none at constant speed."""
    fields = [exact_fields(*times[k : k + 2], velocity, acceleration) for k in range(3)]
    assert_found(fields, times, acceleration, 0.15 * np.linalg.norm(acceleration) + 1e-5)


@pytest.mark.parametrize("times", UNEVEN)
@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
def test_estimated_fields_give_the_acceleration(velocity, acceleration, times):
    """A smooth texture's, too, to 15 % and what the motion itself is off by at a cell, a fifth of a pixel."""
    at = accelerating(*SIZE, velocity=velocity, acceleration=acceleration)
    images = prepared(*(at(t) for t in times))
    fields = [CoarseToFine().estimate(images[k], images[k + 1]) for k in range(3)]
    assert_found(fields, times, acceleration, 0.15 * np.linalg.norm(acceleration) + 0.2)


def test_without_neighbours_there_is_none():
    """A pair alone tells nothing."""
    assert find_acceleration(*exact_fields(0, 1, (1, 0), (1, 1)), None, None) is None


def test_vectors_that_do_not_come_back_do_not_count():
    """Where the way back leads elsewhere, a cell takes what its neighbours know, and nothing where none does."""
    fields = [exact_fields(k, k + 1, (2, 0), (1, 0)) for k in (-1, 0)]
    lost = fields[1][1].flow.copy()
    lost[:, :64] += 40
    back = MotionField(lost, fields[1][1].similarity)
    found = find_acceleration(fields[1][0], back, Neighbour(*fields[0], 1.0), None) / ONE_SIDED
    np.testing.assert_allclose(found[1:-1, 5:-1], np.broadcast_to([1, 0], (4, 2, 2)), atol=0.15)
    assert not found[:, :3].any()


@pytest.mark.parametrize("size", [(1, 1), (3, 40), (17, 16), (50, 33)])
def test_any_size_has_its_cells(size):
    """One vector for each cell that the frame touches."""
    still = MotionField(np.zeros((*size, 2), np.float32), np.ones(size, np.float32))
    found = find_acceleration(still, still, Neighbour(still, still, 1.0), None)
    assert found.shape == (-(-size[0] // CELL), -(-size[1] // CELL), 2)
    assert not found.any()
