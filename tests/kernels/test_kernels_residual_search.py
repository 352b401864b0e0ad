"""The second look at points that their motion does not explain, against plain loops."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost.kernels.points import measure_forward_backward_errors
from fpsboost.kernels.residual_search import relax_smoothness, search_residuals_bidirectional
from support.planes import plane_pair
from support.truth import noise
from support.twins import level_similarity

PADDING, RADIUS, MOST = 12, 1, np.uint8(255)


def places(size, step):
    """Rows and columns of the points."""
    return [np.minimum(np.arange(0, length, step) + step // 2, length - 1) for length in size]


def patch_similarity(image0, image1, here, there):
    """Mean similarity of two small patches; edges repeat."""
    height, width = image0.shape[:2]
    total = 0.0
    for j in range(-RADIUS, RADIUS + 1):
        for k in range(-RADIUS, RADIUS + 1):
            first = image0[min(max(here[0] + j, 0), height - 1), min(max(here[1] + k, 0), width - 1)]
            second = image1[min(max(there[0] + j, 0), height - 1), min(max(there[1] + k, 0), width - 1)]
            total += level_similarity(first, second, int(MOST))
    return total / (2 * RADIUS + 1) ** 2


def measured(images, step, flow):
    """What the kernel measures in both directions, if every point counts as explained, so that no motion changes."""
    known, kept = np.empty((2, *flow.shape[:3]), np.float32), flow.copy()
    pair = plane_pair(*images, PADDING, MOST)
    search_residuals_bidirectional(pair, step, 5, RADIUS, np.float32(0), np.float32(0), kept, known)
    np.testing.assert_array_equal(kept, flow)
    return known[0]


@settings(max_examples=10)
@given(st.integers(1, 14), st.integers(1, 17), st.integers(2, 5), st.integers(0, 2**32))
def test_points_are_measured_as_by_plain_loops(height, width, step, seed):
    """Similarity of small patches at both ends of any motion; one that leads out of the frame ends at its edge."""
    images = [noise(height, width, 3, np.uint8, seed + k) for k in (0, 1)]
    rows, columns = places((height, width), step)
    flow = np.random.default_rng(seed).uniform(-6, 6, (2, rows.size, columns.size, 2)).astype(np.float32)
    known = measured(images, step, flow)
    for direction, row, column in np.ndindex(known.shape):
        y, x = rows[row], columns[column]
        dx, dy = np.rint(flow[direction, row, column]).astype(int)
        there = min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)
        expected = patch_similarity(*images[:: 1 - 2 * direction], (y, x), there)
        np.testing.assert_allclose(known[direction, row, column], expected, atol=1e-3)


@settings(max_examples=10)
@given(st.integers(3, 14), st.integers(3, 17), st.integers(2, 4), st.integers(0, 2**32))
def test_the_best_unexplained_place_is_found(height, width, step, seed):
    """Among places near unexplained points of the other frame the most similar, if it is that much better."""
    images = [noise(height, width, 3, np.uint8, seed + k) for k in (0, 1)]
    rows, columns = places((height, width), step)
    before = np.random.default_rng(seed).uniform(-3, 3, (2, rows.size, columns.size, 2)).astype(np.float32)
    known = measured(images, step, before)
    lowest = [cv2.erode(each, np.ones((3, 3), np.uint8)) for each in known]
    enough, better, limit = np.float32(np.quantile(known, 0.7)), np.float32(0.02), 5
    flow, unused = before.copy(), np.empty((2, 2, rows.size, columns.size), np.float32)
    search_residuals_bidirectional(
        plane_pair(*images, PADDING, MOST), step, limit, RADIUS, enough, better, flow, unused
    )
    for direction, row, column in np.ndindex(known.shape):
        y, x, elsewhere = rows[row], columns[column], lowest[1 - direction]
        scores = {
            (v, u): patch_similarity(*images[:: 1 - 2 * direction], (y, x), (v, u))
            for v, u in np.ndindex(height, width)
            if abs(v - y) <= limit and abs(u - x) <= limit and elsewhere[v // step, u // step] < enough
        }
        threshold = known[direction, row, column] + better
        most = max(scores.values(), default=0.0)
        if abs(most - threshold) < 2e-3:
            continue  # rounding decides
        if known[direction, row, column] >= enough or most <= threshold:
            np.testing.assert_array_equal(flow[direction, row, column], before[direction, row, column])
        else:
            dx, dy = flow[direction, row, column].astype(int)
            assert scores[y + dy, x + dx] > most - 2e-3


def test_what_the_other_frame_explains_is_no_place_to_look():
    """Points of equal frames that move away keep their motion bit by bit, as every point of the other frame stays."""
    image = noise(20, 24, 3, np.uint8, 1)
    flow = np.zeros((2, 5, 6, 2), np.float32)
    flow[0] = np.random.default_rng(1).uniform(2, 4, (5, 6, 2))
    before = flow.copy()
    limits, unused = (np.float32(0.6), np.float32(0.2)), np.empty((2, 2, 5, 6), np.float32)
    search_residuals_bidirectional(plane_pair(image, image, PADDING, MOST), 4, 6, RADIUS, *limits, flow, unused)
    np.testing.assert_array_equal(flow, before)
    flow[1] = flow[0]
    search_residuals_bidirectional(plane_pair(image, image, PADDING, MOST), 4, 6, RADIUS, *limits, flow, unused)
    assert not flow[:, 1:-1, 1:-1].any()


@settings(max_examples=20)
@given(st.integers(1, 6), st.integers(1, 7), st.integers(1, 4), st.integers(0, 2**32))
def test_ties_are_loose_where_the_other_frame_confirms_new_motion(rows, columns, step, seed):
    """New motion differs by more than a pixel; the way back is that of the point nearest to its end."""
    random = np.random.default_rng(seed)
    before = random.uniform(-4, 4, (2, rows, columns, 2)).astype(np.float32)
    looked = before + random.choice(np.float32([0, 0.5, 2]), before.shape)
    looked[1] = np.where(random.random((rows, columns, 1)) < 0.5, -looked[0], looked[1])
    smoothness_weight = np.empty((2, rows, columns), np.float32)
    relax_smoothness(looked, before, np.float32(step), np.float32(1), np.float32(0.25), smoothness_weight)
    for direction in (0, 1):
        distance = np.empty((rows, columns), np.float32)
        there, back = (looked[each] / np.float32(step) for each in (direction, 1 - direction))
        y, x = np.arange(rows), np.arange(columns)
        measure_forward_backward_errors(there, y, x, back, 1, rows, columns, distance)
        is_new = np.abs(looked[direction] - before[direction]).max(axis=-1) > 1
        expected = np.where(is_new & (distance * np.float32(step) <= 1), np.float32(0.25), np.float32(1))
        np.testing.assert_array_equal(smoothness_weight[direction], expected)
