"""Samples and weighted sums along motion that is interpolated between points, against a slow twin."""

import numpy as np
import pytest

from fpsboost.kernels.constants import FRACTIONS
from fpsboost.kernels.smooth_motion import SmoothMotion, add_along, sample_along

SIZES = [(1, 1), (2, 5), (9, 14)]


def at_pixels(values, layout, height, width):
    """Values of points at the pixels of a picture, bilinear, and constant beyond the outermost points."""
    (spacing_x, spacing_y), (left, top) = layout.astype(float)
    places = []
    for size, spacing, begin, count in (
        (height, spacing_y, top, len(values)),
        (width, spacing_x, left, values.shape[1]),
    ):
        at = ((np.arange(size) + 0.5) / size - begin) / spacing - 0.5
        places.append(at.clip(0, count - 1))
    mixed = np.array(
        [[np.interp(places[1], np.arange(values.shape[1]), row) for row in each] for each in values.T.swapaxes(1, 2)]
    )
    return np.array([[np.interp(places[0], np.arange(len(values)), column) for column in each.T] for each in mixed]).T


def cubic(distance):
    """The usual filter with a = -0.75."""
    d = abs(distance)
    if d <= 1:
        return 1.25 * d**3 - 2.25 * d**2 + 1
    return -0.75 * (d**3 - 5 * d**2 + 8 * d - 4) if d < 2 else 0.0


def sampled(picture, flow):
    """The picture at the end of each vector, in pixels, one by one."""
    height, width = picture.shape[:2]
    found = np.zeros(picture.shape)
    for y in range(height):
        for x in range(width):
            end_x, end_y = (
                np.floor((place + move) * FRACTIONS + 0.5) / FRACTIONS
                for place, move in zip((x, y), flow[y, x], strict=True)
            )
            for j in range(int(np.floor(end_y)) - 1, int(np.floor(end_y)) + 3):
                for i in range(int(np.floor(end_x)) - 1, int(np.floor(end_x)) + 3):
                    pixel = picture[min(max(j, 0), height - 1), min(max(i, 0), width - 1)]
                    found[y, x] += cubic(end_x - i) * cubic(end_y - j) * pixel
    return found


def case(height, width, channels, seed):
    """A picture, motion that leads anywhere, and weights of points beside it."""
    random = np.random.default_rng(seed)
    picture = random.uniform(0, 255, (height, width, channels)).astype(np.float32)
    # in sixteenths of a pixel, so that no rounding is near a tie
    vectors = (random.integers(-80, 80, (3, 2, 2)) / 16 + 1 / 200) / (width, height)
    motion = SmoothMotion(vectors.astype(np.float32), np.array([(1e4, 1e4), (0, 0)], np.float32))
    weights = random.uniform(0.1, 1, (3, 4)).astype(np.float32)
    return picture, motion, weights, np.array([(1 / 4, 1 / 3), (0.1, -0.05)], np.float32)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_samples_equal_a_slow_twin(height, width, channels):
    """At any place, also far beyond the edges, which are repeated, with any number of channels."""
    picture, motion, _, _ = case(height, width, channels, 3)
    found = np.empty_like(picture)
    sample_along(picture, motion, found)
    flow = np.broadcast_to(motion.vectors[0, 0] * (width, height), (height, width, 2))
    np.testing.assert_allclose(found, sampled(picture, flow), atol=2e-3)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_weighted_sums_equal_a_slow_twin(height, width):
    """With weights between points, along motion and without it; what was there before stays in the sums."""
    picture, motion, weights, layout = case(height, width, 3, 4)
    total, sums = np.ones_like(picture), np.ones((height, width, 1), np.float32)
    add_along(picture, motion, weights, layout, total, sums)
    add_along(picture, None, weights, layout, total, sums)
    expected = at_pixels(weights[..., np.newaxis], layout, height, width)
    flow = np.broadcast_to(motion.vectors[0, 0] * (width, height), (height, width, 2))
    np.testing.assert_allclose(total, 1 + expected * (sampled(picture, flow) + picture), rtol=1e-4)
    np.testing.assert_allclose(sums, 1 + 2 * expected, rtol=1e-5)


@pytest.mark.parametrize("corner", [(0, 0), (0.03, -0.2)])
def test_motion_is_interpolated_between_points(corner):
    """The place to which each pixel moves is that of the points around it, mixed by their distances."""
    height, width = 12, 20
    places = np.ascontiguousarray(np.moveaxis(np.indices((height, width), np.float32)[::-1], 0, 2))
    vectors = np.random.default_rng(5).uniform(-0.02, 0.02, (3, 5, 2)).astype(np.float32)
    layout = np.array([(1 / 5, 1 / 3), corner], np.float32)
    ends = np.empty_like(places)
    sample_along(places, SmoothMotion(vectors, layout), ends)
    flow = at_pixels(vectors, layout, height, width) * (width, height)
    # another rounding of the interpolated motion may lead to the next fraction
    np.testing.assert_allclose(ends, sampled(places, flow), atol=1.1 / FRACTIONS)
