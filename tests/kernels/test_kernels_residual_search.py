"""The second look at points that their motion does not explain, against plain loops."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from planes import compiled, plane_pair
from truth import noise
from twins import level_similarity

from fpsboost.kernels.points import measure_forward_backward_errors
from fpsboost.kernels.residual_search import (
    loosen_ties,
    measure_point_similarity,
    search_residuals,
    search_residuals_bidirectional,
)

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


def measured(image0, image1, step, flow):
    """What the kernel measures."""
    known = np.empty(flow.shape[:2], np.float32)
    compiled(measure_point_similarity)(plane_pair(image0, image1, PADDING, MOST), step, RADIUS, flow, known)
    return known


@settings(max_examples=10)
@given(st.integers(1, 14), st.integers(1, 17), st.integers(2, 5), st.integers(0, 2**32))
def test_points_are_measured_as_by_plain_loops(height, width, step, seed):
    """Similarity of small patches at both ends of any motion; one that leads out of the frame ends at its edge."""
    image0, image1 = (noise(height, width, 3, np.uint8, seed + k) for k in (0, 1))
    rows, columns = places((height, width), step)
    flow = np.random.default_rng(seed).uniform(-6, 6, (rows.size, columns.size, 2)).astype(np.float32)
    known = measured(image0, image1, step, flow)
    for row, y in enumerate(rows):
        for column, x in enumerate(columns):
            dx, dy = np.rint(flow[row, column]).astype(int)
            there = min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)
            expected = patch_similarity(image0, image1, (y, x), there)
            np.testing.assert_allclose(known[row, column], expected, atol=1e-3)


@settings(max_examples=10)
@given(st.integers(3, 14), st.integers(3, 17), st.integers(2, 4), st.integers(0, 2**32))
def test_the_best_unexplained_place_is_found(height, width, step, seed):
    """Among places near unexplained points of the other frame the most similar, if it is that much better."""
    random = np.random.default_rng(seed)
    image0, image1 = (noise(height, width, 3, np.uint8, seed + k) for k in (0, 1))
    rows, columns = places((height, width), step)
    shape = rows.size, columns.size
    known, elsewhere = random.random(shape).astype(np.float32), random.random(shape).astype(np.float32)
    flow = np.full((*shape, 2), 99, np.float32)
    enough, better, limit = np.float32(0.6), np.float32(0.02), 5
    pair, known_here = plane_pair(image0, image1, PADDING, MOST), known * np.float32(0.1)
    compiled(search_residuals)(pair, step, limit, RADIUS, known_here, elsewhere, enough, better, flow)
    for row, y in enumerate(rows):
        for column, x in enumerate(columns):
            inside = [
                (v, u)
                for v in range(height)
                for u in range(width)
                if abs(v - y) <= limit and abs(u - x) <= limit and elsewhere[v // step, u // step] < enough
            ]
            scores = {place: patch_similarity(image0, image1, (y, x), place) for place in inside}
            threshold = known[row, column] * 0.1 + better
            most = max(scores.values(), default=0.0)
            if abs(most - threshold) < 2e-3:
                continue  # rounding decides
            if most <= threshold:
                assert (flow[row, column] == 99).all()
            else:
                dx, dy = flow[row, column].astype(int)
                assert scores[y + dy, x + dx] > most - 2e-3


def test_what_is_explained_stays():
    """Points that are similar enough keep their motion bit by bit, and so do all if the other frame is explained."""
    image0, image1 = (noise(20, 24, 3, np.uint8, seed) for seed in (1, 2))
    for known, elsewhere in ((1.0, 0.0), (0.0, 1.0)):
        flow = np.random.default_rng(1).random((5, 6, 2)).astype(np.float32)
        before = flow.copy()
        shares = (np.full((5, 6), share, np.float32) for share in (known, elsewhere))
        limits = np.float32(0.6), np.float32(0.2)
        compiled(search_residuals)(plane_pair(image0, image1, PADDING, MOST), 4, 6, RADIUS, *shares, *limits, flow)
        np.testing.assert_array_equal(flow, before)


@settings(max_examples=10)
@given(st.integers(1, 14), st.integers(1, 17), st.integers(2, 4), st.integers(0, 2**32))
def test_both_frames_are_searched_near_what_the_other_does_not_explain(height, width, step, seed):
    """Each frame like by itself, at the places of the other where any neighbour is not explained."""
    images = [noise(height, width, 3, np.uint8, seed + k) for k in (0, 1)]
    shape = [rows.size for rows in places((height, width), step)]
    before = np.random.default_rng(seed).uniform(-3, 3, (2, *shape, 2)).astype(np.float32)
    enough, better, limit = np.float32(0.4), np.float32(0.02), 5
    looked = before.copy()
    search_residuals_bidirectional(plane_pair(*images, PADDING, MOST), step, limit, RADIUS, enough, better, looked)
    known = [measured(*images, step, before[0]), measured(*images[::-1], step, before[1])]
    around = [cv2.erode(each, np.ones((3, 3), np.uint8)) for each in known]
    for direction, pair in enumerate((plane_pair(*images, PADDING, MOST), plane_pair(*images[::-1], PADDING, MOST))):
        flow = before[direction].copy()
        compiled(search_residuals)(
            pair, step, limit, RADIUS, known[direction], around[1 - direction], enough, better, flow
        )
        np.testing.assert_array_equal(looked[direction], flow)


@settings(max_examples=20)
@given(st.integers(1, 6), st.integers(1, 7), st.integers(1, 4), st.integers(0, 2**32))
def test_ties_are_loose_where_the_other_frame_confirms_new_motion(rows, columns, step, seed):
    """New motion differs by more than a pixel; the way back is that of the point nearest to its end."""
    random = np.random.default_rng(seed)
    before = random.uniform(-4, 4, (2, rows, columns, 2)).astype(np.float32)
    looked = before + random.choice(np.float32([0, 0.5, 2]), before.shape)
    looked[1] = np.where(random.random((rows, columns, 1)) < 0.5, -looked[0], looked[1])
    ties = np.empty((2, rows, columns), np.float32)
    loosen_ties(looked, before, np.float32(step), np.float32(1), np.float32(0.25), ties)
    for direction in (0, 1):
        distance = np.empty((rows, columns), np.float32)
        there, back = (looked[each] / np.float32(step) for each in (direction, 1 - direction))
        y, x = np.arange(rows), np.arange(columns)
        measure_forward_backward_errors(there, y, x, back, 1, rows, columns, distance)
        is_new = np.abs(looked[direction] - before[direction]).max(axis=-1) > 1
        expected = np.where(is_new & (distance * np.float32(step) <= 1), np.float32(0.25), np.float32(1))
        np.testing.assert_array_equal(ties[direction], expected)
