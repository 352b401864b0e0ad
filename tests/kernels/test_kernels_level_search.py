"""The search of a level in both directions, against its steps one by one."""

import numpy as np
import pytest

from fpsboost.kernels.level_search import (
    PADDING,
    CoarseMotion,
    LevelSettings,
    OffsetLists,
    Points,
    Proposals,
    choose_labels,
    compare_labels,
    search_level,
    search_tiles,
)
from fpsboost.motion.field import resample_points
from support.planes import plane_pair, points
from support.truth import noise
from support.twins import compared_labels

RADIUS, LABELS, MAX_OFFSET, MOST = 2, 3, 6, np.uint8(200)


def empty_lists(shape):
    """Room for the labels of all points."""
    ends = ((), np.int32), ((LABELS,), np.float32), ((LABELS, 2), np.float32), ((), np.float32)
    return OffsetLists(*(np.empty((*shape, *end), kind) for end, kind in ends))


def searched_in_one_direction(pair, size, proposed, expected, weights, settings):
    """Motion and similarity of the points in one direction, by the three kernels on whole pixels."""
    shape = points(size, settings.step)
    lists = empty_lists(shape)
    whole = (np.rint(each * settings.scale).astype(np.int32) for each in (proposed, expected))
    proposals = Proposals(*whole, settings.spacing)
    row_step = 2 if settings.step >= 8 else 1
    search_tiles(pair, proposals, settings.step, 1, MAX_OFFSET, RADIUS, row_step, lists)
    compare_labels(pair, settings.step, RADIUS, lists)
    shared = np.ascontiguousarray(resample_points(weights, size, settings.spacing, settings.step))
    costs = np.empty((*shape, 8), np.float32)
    flow, chosen = np.empty((*shape, 2), np.float32), np.empty(shape, np.float32)
    count, similarity, offsets, _ = lists
    limits = settings.smoothness, settings.slope
    choose_labels(count, offsets, similarity, shared, *limits, costs, flow, chosen)
    return flow, chosen


@pytest.mark.parametrize(("scale", "spacing", "step"), [(1, 1, 2), (2, 4, 4), (2, 8, 4), (2, 8, 8)])
def test_both_directions_are_searched_like_each_by_itself(scale, spacing, step):
    """Every point has the motion, and the similarity, that rounding, tiles and semi-global matching give one by one."""
    random, size = np.random.default_rng(3), (25, 29)
    images = [noise(*size, 3, np.uint8, seed) for seed in (1, 2)]
    there, back = (plane_pair(*both, PADDING + RADIUS, MOST) for both in (images, images[::-1]))
    places = points(size, spacing)
    proposed, expected = random.uniform(-3, 3, (2, 2, *places, 2)).astype(np.float32)
    weights = random.choice([0.25, 1], (2, *places)).astype(np.float32)
    settings = LevelSettings(
        *(np.float32(scale), spacing, step, MAX_OFFSET, RADIUS, LABELS),
        *(np.float32(0.3), np.float32(0.05)),
    )
    shape = points(size, step)
    found = Points(np.empty((2, *shape, 2), np.float32), np.empty((2, *shape), np.float32))
    search_level(there, CoarseMotion(proposed, expected, weights), settings, found)
    for direction, pair in enumerate((there, back)):
        flow, similarity = searched_in_one_direction(
            pair, size, proposed[direction], expected[direction], weights[direction], settings
        )
        np.testing.assert_array_equal(found.flow[direction], flow)
        np.testing.assert_array_equal(found.similarity[direction], similarity)
    assert len(np.unique(found.flow)) > 3
    onward = Points(np.empty((1, *shape, 2), np.float32), np.empty((1, *shape), np.float32))
    search_level(there, CoarseMotion(proposed, expected, weights), settings, onward)
    np.testing.assert_array_equal(onward.flow, found.flow[:1])


@pytest.mark.parametrize(("period", "angle"), [(3, 0), (5.5, 0.2), (8, 1.4)])
def test_labels_are_compared_as_their_slow_twin_compares_them(period, angle):
    """At their best fraction of a pixel, and alike where the pattern repeats, in front of noise and by themselves."""
    size, step, motion = (40, 45), 4, 0.4
    y, x = np.mgrid[: size[0], : size[1]]
    away = np.float32(x * np.sin(angle) + y * np.cos(angle))
    images = []
    for t in (0, 1):
        waves = 128 + 60 * np.sin(2 * np.pi * (away - t * motion) / period)
        images.append(np.uint8(np.dstack([waves] * 3) + 20 * noise(*size, 3, np.float32, 5 + t)))
    images[1][:, :12] = images[0][:, :12] = np.uint8(255 * noise(size[0], 12, 3, np.float32, 9))
    pair, shape = plane_pair(*images, PADDING + RADIUS, MOST), points(size, step)
    lists, random = empty_lists(shape), np.random.default_rng(4)
    proposed = random.integers(-MAX_OFFSET, MAX_OFFSET + 1, (*points(size, 8), 2), np.int32)
    search_tiles(pair, Proposals(proposed, proposed, 8), step, 1, MAX_OFFSET, RADIUS, 1, lists)
    before = lists.similarity.copy()
    compare_labels(pair, step, RADIUS, lists)
    for row, column in np.ndindex(shape):
        place = row * step + step // 2, column * step + step // 2
        known = lists.listed[row, column]
        labels, similarity = lists.flow[row, column, :known], before[row, column, :known]
        expected, detail = compared_labels(*images, place, RADIUS, int(MOST), labels, similarity)
        np.testing.assert_allclose(lists.similarity[row, column, :known], expected, atol=1e-4)
        np.testing.assert_allclose(lists.detail[row, column], detail, atol=1e-5)
    assert (lists.similarity > before + 0.01).mean() > 0.05
