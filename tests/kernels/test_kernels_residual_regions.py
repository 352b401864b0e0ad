"""Regions that neither frame explains, and their matches, against plain loops."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost.kernels.residual_regions import match_residual_regions
from support.planes import plane_pair, points

PADDING, MOST, STEP, LIMIT = 20, 90, 8, 24
LEAST, LEAD, NEARBY_LEAD, NEARBY = 0.5, 0.3, 0.1, 16


def kinds_of(image0, image1, flow):
    """How each pixel differs from the nine around its place in the other frame, 0 if from one of them by little."""
    height, width = image0.shape[:2]
    padded = np.pad(image1.astype(int), [(PADDING, PADDING)] * 2 + [(0, 0)], "edge")
    kinds = np.zeros((height, width), int)
    for y, x in np.ndindex(height, width):
        dx, dy = np.rint(flow[y // STEP, x // STEP]).astype(int)
        if not (0 <= y + dy < height and 0 <= x + dx < width):
            continue
        around = padded[y + dy + PADDING - 1 :, x + dx + PADDING - 1 :][:3, :3]
        if np.abs(around - image0[y, x].astype(int)).sum(axis=-1).min() < MOST:
            continue
        change = image0[y, x].astype(int) - around[1, 1]
        luma, chroma = change[0] + change[1], change[2]
        kinds[y, x] = (1 if luma > 0 else 2) if abs(luma) >= abs(chroma) else 3 if chroma > 0 else 4
    return kinds


def regions_of(image0, image1, flow):
    """Places, (n, 2), and kind of each region that stands out more than its place in the other frame."""
    height, width = image0.shape[:2]
    kinds, found = kinds_of(image0, image1, flow), []
    y, x = np.indices((height, width))
    dx, dy = np.rint(flow[y // STEP, x // STEP]).astype(int).transpose(2, 0, 1)
    there = image1[(y + dy).clip(0, height - 1), (x + dx).clip(0, width - 1)].astype(float)
    for kind in range(1, 5):
        count, numbers = cv2.connectedComponents((kinds == kind).astype(np.uint8), connectivity=8)
        for number in range(1, count):
            own = numbers == number
            places = np.argwhere(own)
            top, left = (places.min(axis=0) - 2).clip(0)
            bottom, right = places.max(axis=0) + 3
            ring = np.zeros_like(own)
            ring[top:bottom, left:right] = kinds[top:bottom, left:right] == 0
            if not 4 <= len(places) <= 1024 or not ring.any():
                continue
            contrasts = [np.abs(image[own].mean(0) - image[ring].mean(0)).sum() for image in (image0, there)]
            if contrasts[0] > contrasts[1]:
                found.append((places, kind))
    return found


def compared(image0, image1, places, offset):
    """Mean similarity of the places and those at an offset, (dy, dx)."""
    ends = places + offset
    inside = np.all((ends >= 0) & (ends < image0.shape[:2]), axis=1)
    first, second = image0[tuple(places[inside].T)].astype(int), image1[tuple(ends[inside].T)].astype(int)
    return np.maximum(MOST - np.abs(first - second).sum(axis=1), 0).sum() / (MOST * len(places))


def middle(places):
    """The mean place, half a pixel rounded up."""
    return (2 * places.sum(axis=0) + len(places)) // (2 * len(places))


def matches_of(images, flow):
    """Pairs of regions that are the same thing: places in both frames and the offset, (dy, dx)."""
    regions = [regions_of(*images[:: 1 - 2 * n], flow[n]) for n in (0, 1)]
    score, offsets = np.zeros([len(each) for each in regions]), {}
    for i, j in np.ndindex(score.shape):
        (places0, kind0), (places1, kind1) = regions[0][i], regions[1][j]
        if kind0 != kind1 or not 0.5 <= len(places0) / len(places1) <= 2:
            continue
        offset = middle(places1) - middle(places0)
        colours = [image[tuple(places.T)].mean(0) for image, places in zip(images, (places0, places1), strict=True)]
        if np.abs(offset).max() > LIMIT or np.abs(colours[0] - colours[1]).sum() > MOST / 2:
            continue
        for change in np.ndindex(3, 3):
            moved = offset + change - 1
            mean = (compared(*images, places0, moved) + compared(*images[::-1], places1, -moved)) / 2
            if mean > score[i, j]:
                score[i, j], offsets[i, j] = mean, moved
    found = []
    for (i, j), offset in offsets.items():
        (places0, _), (places1, _) = regions[0][i], regions[1][j]
        rivals = np.append(np.delete(score[i], j), np.delete(score[:, j], i))
        if score[i, j] < LEAST or (rivals.size and rivals.max() > score[i, j] - LEAD):
            continue
        sides = (images, places0, flow[0], offset), (images[::-1], places1, flow[1], -offset)
        if all(leads(*side, score[i, j]) for side in sides):
            found.append((places0, places1, offset))
    return found


def leads(pair, places, flow, offset, score):
    """Whether no place near by, but for the region itself, is about as similar."""
    y, x = middle(places)
    ground = np.rint(flow[y // STEP, x // STEP][::-1]).astype(int)
    size = np.ptp(places, axis=0).max() + 2
    near = (ground + np.array(change) - NEARBY for change in np.ndindex(2 * NEARBY + 1, 2 * NEARBY + 1))
    return not any(
        np.abs(there - offset).max() > size and compared(*pair, places, there) >= score - NEARBY_LEAD for there in near
    )


def scene(seed, sizes):
    """Two pictures of a ground with rectangles of these sizes, each of a colour and a motion of its own."""
    random = np.random.default_rng(seed)
    ground = random.integers(90, 110, (48, 64, 3))
    images = [ground.copy(), ground.copy()]
    for height, width in sizes:
        colour = random.choice([0, 60, 140, 220], 3)
        for image in images:
            top, left = random.integers(0, [48 - height, 64 - width])
            image[top : top + height, left : left + width] = colour
    return [image.astype(np.uint8) for image in images]


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32), st.lists(st.tuples(st.integers(2, 7), st.integers(2, 7)), min_size=1, max_size=4))
def test_things_are_found_as_by_plain_loops(seed, sizes):
    """Points of a thing get its motion to half a pixel, and all others keep their own."""
    images = scene(seed, sizes)
    flow = np.zeros((2, *points((48, 64), STEP), 2), np.float32)
    before = np.full(flow.shape[:3], np.float32(0.25))
    looked, similarity = flow.copy(), before.copy()
    match_residual_regions(plane_pair(*images, PADDING, MOST), STEP, LIMIT, looked, similarity)
    expected = np.zeros(flow.shape[:3], bool)
    for *both, offset in matches_of(images, flow):
        for direction, places in enumerate(both):
            touched = np.unique(places // STEP, axis=0)
            motion = (1 - 2 * direction) * offset[::-1]
            taken = looked[direction][tuple(touched.T)]
            assert np.abs(taken - motion).max() <= 0.5 or len(sizes) > 1
            expected[direction][tuple(touched.T)] = True
            first = (middle(places) + STEP // 2) // STEP - 1
            for row, column in first + np.argwhere(np.ones((2, 2))):
                if 0 <= row < flow.shape[1] and 0 <= column < flow.shape[2]:
                    expected[direction, row, column] = True
    np.testing.assert_array_equal(similarity != before, expected)
    np.testing.assert_array_equal(looked[~expected], 0)


@pytest.mark.parametrize("shift", [(9, -6), (-20, 11), (0, 24)])
def test_a_thing_before_flat_ground_moves_and_the_ground_does_not(shift):
    """Where it will be, the ground is unexplained, too, and would move the other way."""
    images = [np.full((64, 96, 3), 100, np.uint8) for _ in range(2)]
    images[0][30:34, 40:45] = 20
    images[1][30 + shift[1] : 34 + shift[1], 40 + shift[0] : 45 + shift[0]] = 20
    flow = np.zeros((2, *points((64, 96), STEP), 2), np.float32)
    match_residual_regions(plane_pair(*images, PADDING, MOST), STEP, LIMIT, flow, np.ones_like(flow[..., 0]))
    for direction in (0, 1):
        changed = flow[direction][np.any(flow[direction] != 0, axis=-1)]
        assert len(changed) == 4
        np.testing.assert_array_equal(changed, np.broadcast_to((1 - 2 * direction) * np.float32(shift), (4, 2)))


@pytest.mark.parametrize("known_of", [0, 1])
def test_motion_that_one_frame_knows_is_that_of_the_thing_in_both(known_of):
    """A point of either frame has the motion, and explains the thing there; the other frame's points have not."""
    images, shift = [np.full((64, 96, 3), 100, np.uint8) for _ in range(2)], np.float32([18, -13])
    images[0][36:41, 42:47] = 20
    images[1][23:28, 60:65] = 20
    flow = np.zeros((2, *points((64, 96), STEP), 2), np.float32)
    for row, column in [((4, 5), (5, 5)), ((2, 7), (3, 7), (2, 8), (3, 8))][known_of]:
        flow[known_of, row, column] = (1 - 2 * known_of) * shift
    match_residual_regions(plane_pair(*images, PADDING, MOST), STEP, LIMIT, flow, np.ones_like(flow[..., 0]))
    for direction, (y, x) in enumerate([(38, 44), (25, 62)]):
        around = flow[direction, (y - 4) // STEP : (y - 4) // STEP + 2, (x - 4) // STEP : (x - 4) // STEP + 2]
        np.testing.assert_array_equal(around, np.broadcast_to((1 - 2 * direction) * shift, (2, 2, 2)))
