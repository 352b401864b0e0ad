"""What the motion fields say around the nodes: landings, and agreement between neighbours."""

import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.constants import VALUES_PER_MOTION
from fpsboost.kernels.pair_context import count_landings
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.pair_context import context_at, find_context
from support.truth import moved_waves


def landings_of(points, t):
    """Count the landings of points 8 pixels apart that move by (dx, dy)."""
    rows, columns = points.shape[:2]
    counts = np.empty((rows, columns), np.float32)
    motion = np.dstack([points, np.zeros((rows, columns, 3))]).astype(np.float32)
    count_landings(motion, np.float32(t), 8, counts)
    return counts


def test_every_point_is_met_once_where_all_move_alike():
    """Also by fractions of the distance of points; what comes in at the border is met by none."""
    counts = landings_of(np.full((5, 7, 2), [12.0, 0]), 0.5)
    np.testing.assert_allclose(counts[:, 1:], 1, atol=1e-6)
    np.testing.assert_allclose(counts[:, 0], 0.25, atol=1e-6)


def test_what_is_covered_is_met_twice_and_what_is_uncovered_never():
    """A block moves by two points before what rests."""
    points = np.zeros((1, 9, 2))
    points[0, 2:4, 0] = 16
    np.testing.assert_allclose(landings_of(points, 1)[0], [1, 1, 0, 0, 2, 2, 1, 1, 1])


def support_of(step=8, bandwidth=0.3, sharpness=18.0):
    """Support of the right and of a wrong motion of a texture that moves by 3 pixels; both have as many votes."""
    frames = [FrameCache((255 * moved_waves((96, 96), k, 0, 1, seed=2)).clip(0, 255).astype(np.uint8)) for k in (0, 3)]
    fields = [
        MotionField(np.full((12, 12, 2), [sign * 3, 0], np.float32), np.ones((12, 12), np.float32), None, 8, (96, 96))
        for sign in (1, -1)
    ]
    motions = np.zeros((6, 6, 2, VALUES_PER_MOTION), np.float32)
    motions[..., 0, 0], motions[..., 1, 0] = 3, -11
    candidates = Candidates(np.full((6, 6), 2, np.int32), motions, np.full((6, 6, 2), 0.5, np.float32), 16)
    known = find_context(FramePair(*frames, *fields), step, bandwidth, sharpness)
    return context_at(known, 0.5, candidates).support[1:-1, 1:-1]


def test_neighbours_support_the_motion_that_they_believe_in():
    """In a texture that moves by 3 pixels, a node whose two candidates have equal votes is told which one is right."""
    support = support_of()
    assert (support[..., 0] > 0.9).all()
    assert (support[..., 1] < 0.2).all()


def test_belief_follows_the_sharpness_and_the_bandwidth():
    """Of no sharpness, or a bandwidth at which all is similar, votes alone count; in between, the right one gains."""
    by_votes = 0.5 + 0.5 / 15  # of the own motion, and of one 14 pixels off
    np.testing.assert_allclose(support_of(sharpness=0), by_votes, atol=1e-3)
    np.testing.assert_allclose(support_of(bandwidth=100), by_votes, atol=1e-3)
    right = [support_of(**options)[..., 0].mean() for options in ({}, {"sharpness": 5}, {"bandwidth": 0.9})]
    assert right[0] > max(right[1:]) > min(right[1:]) > by_votes + 0.01
