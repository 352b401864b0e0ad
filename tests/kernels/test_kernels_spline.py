"""Cubic splines: coefficients, weights and samples, against the equations that define them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost.kernels.constants import MARGIN
from fpsboost.kernels.spline import Source, filter_weights, find_coefficients, mix_along
from support.truth import noise
from support.twins import sharpening_at, spline_coefficients, spline_window

BEYOND = 40


def planes_of(image, scale=1.0):
    """One plane a channel, scaled."""
    return np.ascontiguousarray(image.transpose(2, 0, 1), np.float32) * np.float32(scale)


def coefficients_of(planes, unit=1.0, spare=3, precision=2**-19):
    """The kernel's coefficients, with a few columns more than it needs."""
    channels, height, width = planes.shape
    coefficients = np.full((channels, height + 2 * MARGIN, width + 2 * MARGIN + spare), np.nan, np.float32)
    find_coefficients(planes, np.float32(unit), filter_weights(precision), coefficients)
    return coefficients


@settings(max_examples=5)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**32))
def test_coefficients_solve_the_equations(height, width, seed):
    """The filter finds what a linear solver finds, in the frame and around it; the last ones go on beyond."""
    image = noise(height, width, 1, np.float32, seed)
    everywhere = coefficients_of(planes_of(image))[0]
    found = everywhere[:, : 2 * MARGIN + width]
    np.testing.assert_array_equal(everywhere[:, 2 * MARGIN + width :], np.repeat(found[:, -1:], 3, axis=1))
    expected = spline_coefficients(image[..., 0], BEYOND + MARGIN)[BEYOND:-BEYOND, BEYOND:-BEYOND]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_coefficients_of_levels_are_those_of_their_share_of_white():
    """Planes of bytes and a factor give what float planes give; the rows that the filter keeps come around."""
    image = noise(30, 17, 2)
    found = coefficients_of(image.transpose(2, 0, 1).copy(), 1 / 255)
    np.testing.assert_allclose(found, coefficients_of(planes_of(image, 1 / 255)), atol=1e-6)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_filter_is_as_precise_as_the_samples(bits):
    """At the samples, the spline is right to a quarter of a level even where they alternate between black and white."""
    checkered = (np.indices((16, 16)).sum(0) % 2).astype(np.float32)[np.newaxis]
    precision = 2.0 ** -(bits + 2)
    coefficients = coefficients_of(checkered, precision=precision)[0].astype(float)
    assert np.abs(spline_window(coefficients, MARGIN, 0, 0, (16, 16)) - checkered[0]).max() < precision


@pytest.mark.parametrize("seed", range(4))
def test_frames_are_mixed_along_a_motion_of_every_pixel(seed):
    """Both frames are sampled by the spline of that time at the end of each motion, and hidden ones have no weight."""
    random = np.random.default_rng(seed)
    size, t = (7, 9), np.float32(0.3)
    sources = [
        Source(
            random.random((2, size[0] + 2 * MARGIN, size[1] + 2 * MARGIN), np.float32),
            random.normal(0, 6, (*size, 2)).astype(np.float32),
            random.random(size) < 0.7,
        )
        for _ in range(2)
    ]
    mixed, squared = np.empty((2, *size), np.float32), np.empty(size, np.float32)
    mix_along(*sources, t, mixed, squared)
    for place in np.ndindex(size):
        seen0, seen1 = (source.is_visible[place] for source in sources)
        share = t if seen0 == seen1 else float(seen1)
        value0, value1 = (_sampled(source, place, sharpening_at(t)) for source in sources)
        np.testing.assert_allclose(mixed[:, *place], value0 + share * (value1 - value0), rtol=1e-4, atol=1e-5)
        expected = ((value1 - value0) ** 2).sum() if seen0 and seen1 else 0
        np.testing.assert_allclose(squared[place], expected, rtol=1e-3, atol=1e-6)


def test_values_as_coefficients_stay_within_their_range():
    """No weight is negative at any place and time, so that a spline of the values themselves never overshoots."""
    random, size = np.random.default_rng(1), (40, 50)
    for t in (0.01, 0.25, 0.5):
        sources = [
            Source(
                random.integers(0, 2, (1, size[0] + 2 * MARGIN, size[1] + 2 * MARGIN)).astype(np.float32),
                random.uniform(-9, 9, (*size, 2)).astype(np.float32),
                np.ones(size, bool),
            )
            for _ in range(2)
        ]
        mixed, squared = np.empty((1, *size), np.float32), np.empty(size, np.float32)
        mix_along(*sources, t, mixed, squared)
        assert mixed.min() >= 0
        assert mixed.max() <= 1 + 1e-6


def _sampled(source: Source, place: tuple[int, int], sharpening: float) -> np.ndarray:
    (i, j), (dx, dy) = place, source.motion[place].astype(float)
    height, width = source.motion.shape[:2]
    end = np.clip(i + dy, -1, height), np.clip(j + dx, -1, width)
    return np.array([spline_window(plane, MARGIN, *end, (1, 1), sharpening)[0, 0] for plane in source.coefficients])
