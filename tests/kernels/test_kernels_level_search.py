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
    search_level,
    search_tiles,
)
from fpsboost.motion.field import resample_points
from support.planes import plane_pair, points
from support.truth import noise

RADIUS, LABELS, MAX_OFFSET, MOST = 2, 3, 6, np.uint8(200)


def searched_in_one_direction(pair, size, proposed, expected, weights, settings):
    """Motion and similarity of the points in one direction, by the two kernels on whole pixels."""
    shape = points(size, settings.step)
    lists = OffsetLists(
        np.empty(shape, np.int32), np.empty((*shape, LABELS), np.float32), np.empty((*shape, LABELS, 2), np.float32)
    )
    whole = (np.rint(each * settings.scale).astype(np.int32) for each in (proposed, expected))
    proposals = Proposals(*whole, settings.spacing)
    radii = settings.refine_radius, MAX_OFFSET, RADIUS
    search_tiles(pair, proposals, settings.step, *radii, settings.row_step, lists)
    shared = np.ascontiguousarray(resample_points(weights, size, settings.spacing, settings.step))
    costs = np.empty((*shape, 8), np.float32)
    flow, chosen = np.empty((*shape, 2), np.float32), np.empty(shape, np.float32)
    count, similarity, offsets = lists
    limits = settings.smoothness, settings.slope
    choose_labels(count, offsets, similarity, shared, *limits, costs, flow, chosen)
    return flow, chosen


@pytest.mark.parametrize(
    ("scale", "spacing", "step", "refine_radius", "row_step"),
    [(1, 1, 2, 0, 1), (2, 4, 4, 1, 1), (2, 8, 4, 0, 1), (2, 8, 8, 1, 2)],
)
def test_both_directions_are_searched_like_each_by_itself(scale, spacing, step, refine_radius, row_step):
    """Every point has the motion, and the similarity, that rounding, tiles and semi-global matching give one by one."""
    random, size = np.random.default_rng(3), (25, 29)
    images = [noise(*size, 3, np.uint8, seed) for seed in (1, 2)]
    there, back = (plane_pair(*both, PADDING + RADIUS, MOST) for both in (images, images[::-1]))
    places = points(size, spacing)
    proposed, expected = random.uniform(-3, 3, (2, 2, *places, 2)).astype(np.float32)
    weights = random.choice([0.25, 1], (2, *places)).astype(np.float32)
    settings = LevelSettings(
        *(np.float32(scale), spacing, step, refine_radius, MAX_OFFSET, RADIUS, row_step, LABELS),
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
