"""How motion changes from pair to pair: exact fields, and fields that were estimated."""

import cv2
import numpy as np
import pytest

from fpsboost import find_method
from fpsboost.motion.field import TWO_SIDED_WEIGHT, MotionField, accelerations_at_points
from fpsboost.motion.nlm import CoarseToFine
from support.truth import accelerating, as_type, moved_waves, prepared

SIZE = (96, 128)
SPACING = 8
MOTIONS = [((4, -2), (2, 1)), ((3, 1), (-2, 1.5)), ((0, 0), (1, -1)), ((4, 2), (0, 0))]
UNEVEN = [(-1, 0, 1, 2), (-2, 0, 1, 1.5), (-0.5, 0, 1, 2.5)]


RATIOS = [1 / 30, 1 / 18, 1 / 8, 1 / 4, 1 / 3, 3, 8, 30]


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


def acceleration_of(motion, motion_before, ratio):
    """The one that is found where everything moves by a motion, and in the pair before by another one."""
    onward, away = ((uniform(*each), uniform(*np.negative(each))) for each in (motion, np.negative(motion_before)))
    return accelerations_at_points(onward, away, ratio, SPACING)[6, 8, 1:]


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("motion", [(12, 0), (2, -3), (0, 1), (-0.25, 0)])
@pytest.mark.parametrize("motion_before", [(12, 0), (-8, 5), (0, 0), (30, -20)])
def test_paths_stay_between_their_ends_beside_a_pair_of_another_duration(motion, motion_before, ratio):
    """Whatever the motion of a much shorter or longer pair, no path turns back along x or along y."""
    acceleration = acceleration_of(motion, motion_before, ratio) * TWO_SIDED_WEIGHT
    assert (np.abs(acceleration) <= 2 * np.abs(motion) + 1e-5).all()


@pytest.mark.parametrize("ratio", RATIOS)
def test_errors_of_vectors_do_not_bend_paths_at_constant_speed(ratio):
    """An error of a tenth of a pixel in the vectors of either pair bends a path by at most half a pixel."""
    acceleration = acceleration_of((11.9, 0), (12 * ratio + 0.1, 0), ratio) * TWO_SIDED_WEIGHT
    assert np.abs(acceleration).max() / 8 <= 0.5


@pytest.mark.parametrize("method", ["nlm", "nlm-fast", "dis"])
@pytest.mark.parametrize("pause", [4, 8, 18, 27])
def test_a_disc_creeps_evenly_while_the_times_of_frames_pause(pause, method):
    """In a pair that lasts many times as long as those around it, nothing is shown beyond its places in both frames."""
    interpolator, times = find_method(method), np.cumsum([0, 1, pause, 1])
    ground = as_type(moved_waves(SIZE) * 0.2, np.uint8)
    images = prepared(*(cv2.circle(ground.copy(), (48 + 4 * k, 48), 15, (80, 80, 240), -1) for k in range(4)))
    before, pair, after = (interpolator.pair(*images[k : k + 2], times[k + 1] - times[k]) for k in range(3))
    moments = np.linspace(0, 1, 9)[1:-1]
    shown = interpolator.images(pair.between(before, after), list(moments))
    places = [np.nonzero(image[..., 2] > 150)[1].mean() for image, _ in shown]
    np.testing.assert_allclose(places, 52 + 4 * moments, atol=0.75)


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
