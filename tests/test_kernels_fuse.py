"""The weighted mean over candidate motions, against a slow twin, and its parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from truth import noise, waves
from twins import fused, spline_at, spline_coefficients, uncompiled

from fpsboost.kernels.candidates import CELL
from fpsboost.kernels.fuse import REGION, ROW, SPARE, decay, fetch, fuse_candidates, mark_inside
from fpsboost.kernels.spline import MARGIN, fill_planes, filter_response, find_coefficients


def samples(image):
    """Planes and their coefficients."""
    height, width, channels = image.shape
    planes = np.empty((channels, height + 2 * MARGIN, width + 2 * MARGIN + SPARE), np.float32)
    coefficients = np.empty_like(planes)
    fill_planes(image, np.float32(1), False, planes)
    find_coefficients(planes, filter_response(2**-19), coefficients)
    return planes, coefficients


def listed(candidates):
    """Lists as the twin `collected` makes them as the kernel's arrays, with room to spare."""
    room = 2 + max(len(each) for each in candidates.ravel())
    count = np.zeros(candidates.shape, np.int32)
    votes, sums = np.zeros((*candidates.shape, room), np.float32), np.zeros((*candidates.shape, room, 2), np.float32)
    corners = np.zeros((*candidates.shape, room, 2, 2), np.float32)
    for place in np.ndindex(candidates.shape):
        count[place] = len(candidates[place])
        for k, (vote, dx, dy, *shares) in enumerate(candidates[place]):
            votes[place][k], sums[place][k], corners[place][k] = vote, (dx, dy), np.reshape(shares, (2, 2))
    return count, votes, corners, sums


def even(vote, dx, dy):
    """A candidate whose votes its corners share alike, one for each vote."""
    return [4.0 * vote, 4.0 * vote * dx, 4.0 * vote * dy, *[float(vote)] * 4]


def fuse(image0, image1, t, candidates, bend, *, scale, sharpness, enough):
    """Call the kernel; the mean as an image, and the confidence."""
    height, width, channels = image0.shape
    mean, confidence = np.full((channels, height, width), np.nan, np.float32), np.full((height, width), np.nan, "f4")
    numbers = [np.float32(each) for each in (scale, sharpness, enough)]
    fuse_candidates(
        *samples(image0),
        *samples(image1),
        height,
        width,
        np.float32(t),
        *listed(candidates),
        np.float32(bend),
        *numbers,
        CELL,
        ROW,
        mean,
        confidence,
    )
    return mean.transpose(1, 2, 0), confidence


def random_candidates(random, cells, most, largest):
    """Up to `most` motions a cell and as many in the first, whole and not, with votes of their own."""
    candidates = np.empty(cells, object)
    for place in np.ndindex(cells):
        number = random.integers(0, most + 1) if any(place) else most
        motions = random.uniform(-largest, largest, (number, 2))
        motions[1::2] = np.rint(motions[1::2])
        shares = random.uniform(0, 20, (len(motions), 4)).astype(np.float32)
        candidates[place] = [
            [float(each.sum()), *np.float32(each.sum() * motion).tolist(), *each.tolist()]
            for each, motion in zip(shares, motions, strict=True)
        ]
    return candidates


@pytest.mark.parametrize(
    ("size", "channels", "t", "largest", "most"),
    [((16, 16), 3, 0.5, 3, 2), ((19, 9), 1, 0.3, 6, 3), ((5, 21), 4, 0.75, 60, 2), ((1, 1), 3, 0.5, 4, 1)],
)
def test_fusing_equals_its_slow_twin(size, channels, t, largest, most):
    """Within the frame, across its borders and far out, along straight and bent paths, with and without candidates."""
    random = np.random.default_rng(channels)
    y, x = np.mgrid[0 : size[0], 0 : size[1]].astype(float)
    image0, image1 = (waves(x + k, y, channels, seed=2).astype(np.float32) for k in (0, 1.5))
    cells = -(-size[0] // CELL), -(-size[1] // CELL)
    bend = random.normal(size=(*cells, 2)).astype(np.float32)
    candidates = random_candidates(random, cells, most, largest)
    options = {"scale": 4.0, "sharpness": 10.0, "enough": 2.0}
    mean, confidence = fuse(image0, image1, t, candidates, bend, **options)
    expected_mean, expected_confidence = fused(image0, image1, t, candidates, bend, **options)
    np.testing.assert_allclose(mean, expected_mean, atol=1e-4)
    np.testing.assert_allclose(confidence, expected_confidence, atol=1e-4)


def test_once_all_pixels_are_similar_enough_the_rest_is_left_out():
    """By falling votes: the true motion comes first and is taken alone, as the twin does it."""
    y, x = np.mgrid[0:16, 0:16].astype(float)
    image0, image1 = (waves(x - k, y, 1, seed=2).astype(np.float32) for k in (0, 2))
    candidates = np.empty((1, 1), object)
    candidates[0, 0] = [even(2, 4, 0), even(9, 2, 0)]
    bend, options = np.zeros((1, 1, 2)), {"scale": 1.0, "sharpness": 2.0}
    alone, _ = fuse(image0, image1, 0.5, candidates, bend, **options, enough=0.5)
    np.testing.assert_allclose(alone, fused(image0, image1, 0.5, candidates, bend, **options, enough=0.5)[0], atol=1e-5)
    np.testing.assert_allclose(alone[:, 6:-6], waves(x - 1, y, 1, seed=2)[:, 6:-6], atol=1e-5)
    together, _ = fuse(image0, image1, 0.5, candidates, bend, **options, enough=2.0)
    assert np.abs(together - alone).max() > 0.01


def test_what_stands_still_is_not_bent():
    """However the surroundings turn, no motion means no path to bend."""
    image = noise(16, 16, 3, np.float32)
    candidates = np.empty((1, 1), object)
    candidates[0, 0] = [even(5, 0, 0)]
    mean, confidence = fuse(image, image, 0.5, candidates, np.full((1, 1, 2), 7.3), scale=5, sharpness=30, enough=0.99)
    np.testing.assert_allclose(mean, image, atol=1e-6)
    np.testing.assert_allclose(confidence, 1, atol=1e-5)


def test_more_votes_weigh_more():
    """Motions that are equally similar have shares by their votes, no motion a quarter of one."""
    x = np.arange(48)
    image0, image1 = np.zeros((16, 48, 1), np.float32), np.zeros((16, 48, 1), np.float32)
    image0[..., 0] = x / 48
    candidates = np.empty((1, 3), object)
    for column in range(3):
        candidates[0, column] = [even(2, -2, 0), even(4, 2, 0)]
    options = {"scale": 0.0, "sharpness": 30.0, "enough": 2.0}
    mean, _ = fuse(image0, image1, 0.25, candidates, np.zeros((1, 3, 2)), **options)
    expected = 0.75 * (x - 0.25 * (4 * 2 - 2 * 2) / (4 + 2 + 1 / 4)) / 48
    np.testing.assert_allclose(mean[8, 8:-8, 0], expected[8:-8], atol=1e-5)


def test_votes_change_from_corner_to_corner():
    """Between its corners every pixel has its own share: the left one's motion goes over into the right one's."""
    image0, image1 = np.zeros((16, 16, 1), np.float32), np.zeros((16, 16, 1), np.float32)
    image0[..., 0] = np.arange(16) / 48
    candidates = np.empty((1, 1), object)
    candidates[0, 0] = [[200.0, 400.0, 0.0, 100.0, 0.0, 100.0, 0.0], [200.0, -400.0, 0.0, 0.0, 100.0, 0.0, 100.0]]
    options = {"scale": 0.0, "sharpness": 30.0, "enough": 2.0}
    mean, _ = fuse(image0, image1, 0.25, candidates, np.zeros((1, 1, 2)), **options)
    expected, _ = fused(image0, image1, 0.25, candidates, np.zeros((1, 1, 2)), **options)
    np.testing.assert_allclose(mean, expected, atol=1e-5)
    shift = mean[8, 5:-5, 0] * 48 / 0.75 - np.arange(5, 11)
    np.testing.assert_allclose(shift, (np.arange(5.5, 11) / 16 - 0.5), atol=0.01)


def test_a_lone_voice_is_not_heard():
    """What has less than three hundredths of all votes is not tried."""
    y, x = np.mgrid[0:16, 0:16].astype(float)
    image0, image1 = (waves(x - k, y, 1, seed=2).astype(np.float32) for k in (0, 2))
    candidates = np.empty((1, 1), object)
    bend, options = np.zeros((1, 1, 2)), {"scale": 1.0, "sharpness": 2.0, "enough": 2.0}
    means = []
    for votes in (0, 2, 5):
        candidates[0, 0] = [even(99, 4, 0), *([even(votes, 2, 0)] if votes else [])]
        means.append(fuse(image0, image1, 0.5, candidates, bend, **options)[0])
    np.testing.assert_array_equal(means[0], means[1])
    assert np.abs(means[2] - means[0]).max() > 1e-4


def test_decay_is_the_exponential():
    """To a millionth, and never negative, however large the number."""
    for x in (0, 1e-4, 0.01, 0.3, 1, 2.5, 5, 10, 20, 40, 60, 1000):
        found = float(uncompiled(decay)(np.float32(x)))
        assert found == pytest.approx(math.exp(-x), abs=2e-6)
        assert found >= 0
    assert uncompiled(decay)(np.float32(0)) == 1


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.25, 0.0), (0.0, -0.6), (-3.4, 2.7), (5.0, -4.0)])
def test_regions_are_sampled_as_the_spline_says(place):
    """At fractions of a pixel as the twin does, at whole ones as a copy."""
    image = noise(26, 30, 1, np.float32)
    planes, coefficients = samples(image)
    out, rows = np.empty((REGION, ROW), np.float32), np.empty((REGION + 3, ROW), np.float32)
    y, x = np.float32(place[0] + MARGIN), np.float32(place[1] + MARGIN)
    uncompiled(fetch)(planes[0], coefficients[0], y, x, ROW, rows, out)
    slow = spline_coefficients(image[..., 0], 40)
    expected = [[spline_at(slow, 40, place[0] + j, place[1] + i) for i in range(REGION)] for j in range(REGION)]
    np.testing.assert_allclose(out[:, :REGION], expected, atol=1e-5)
    if all(value == int(value) for value in place):
        top, left = int(y), int(x)
        np.testing.assert_array_equal(out, planes[0, top : top + REGION, left : left + ROW])


@pytest.mark.parametrize(
    ("start", "size", "expected"),
    [(-2.0, 3, [0, 0, 1, 1, 1, 0]), (-0.5, 3, [0, 1, 1, 0, 0, 0]), (0.25, 9, [1] * 6), (7.0, 3, [0] * 6)],
)
def test_places_inside_are_marked(start, size, expected):
    """From the first pixel to the last, both counted, and nothing between them and beyond."""
    marks = np.empty(6, np.float32)
    uncompiled(mark_inside)(np.float32(start), size, marks)
    assert marks.tolist() == expected
