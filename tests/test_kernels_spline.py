"""Cubic B-splines: planes, coefficients and weights, against the equations that define them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import noise
from twins import bspline, spline_at, spline_coefficients, uncompiled

from fpsboost.kernels.spline import MARGIN, fill_planes, filter_response, find_coefficients, spline_weights

BEYOND = 40


def planes_of(image, scale=1.0, premultiply=False, spare=3):
    """The kernel's planes, with a few columns more than it needs."""
    height, width, channels = image.shape
    planes = np.full((channels, height + 2 * MARGIN, width + 2 * MARGIN + spare), np.nan, np.float32)
    fill_planes(image, np.float32(scale), premultiply, planes)
    return planes


def coefficients_of(planes, spare=3):
    """The kernel's coefficients; the planes have a few columns more than it needs."""
    coefficients = np.empty_like(planes)
    find_coefficients(
        planes, planes.shape[2] - 2 * MARGIN - spare, np.float32(1), filter_response(2**-19), coefficients
    )
    return coefficients


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("size", [(5, 7, 3), (1, 1, 1), (2, 9, 4)])
def test_planes_repeat_the_edges(dtype, size):
    """One plane a channel, scaled, with numpy's own padding and whatever columns there are more."""
    image = noise(*size, dtype)
    planes = planes_of(image, 0.5)
    expected = np.pad(image.astype(float) * 0.5, ((MARGIN,) * 2, (MARGIN, MARGIN + 3), (0, 0)), "edge")
    np.testing.assert_allclose(planes, expected.transpose(2, 0, 1), rtol=1e-6)


def test_planes_can_be_multiplied_by_alpha():
    """Colours are, the fourth channel itself is not."""
    image = noise(4, 6, 4)
    inner = planes_of(image, 1 / 255, True)[:, MARGIN:-MARGIN, MARGIN : MARGIN + 6].transpose(1, 2, 0)
    colours, alpha = image[..., :3] / 255, image[..., 3:] / 255
    np.testing.assert_allclose(inner, np.concatenate([colours * alpha, alpha], axis=-1), atol=1e-6)


@settings(max_examples=8)
@given(st.integers(1, 7), st.integers(1, 7), st.integers(0, 2**32))
def test_coefficients_solve_the_equations(height, width, seed):
    """The filter finds what a linear solver finds, in the frame and around it."""
    image = noise(height, width, 1, np.float32, seed)
    found = coefficients_of(planes_of(image))[0, :, : 2 * MARGIN + width]
    beyond = BEYOND + MARGIN
    expected = spline_coefficients(image[..., 0], beyond)[BEYOND:-BEYOND, BEYOND:-BEYOND]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_coefficients_of_levels_are_those_of_their_share_of_white():
    """Planes of bytes and a factor give what float planes give; the rows that the filter keeps come around."""
    image = noise(30, 17, 2)
    planes = np.empty((2, 30 + 2 * MARGIN, 17 + 2 * MARGIN), np.uint8)
    fill_planes(image, np.float32(1), False, planes)
    np.testing.assert_array_equal(planes[:, MARGIN:-MARGIN, MARGIN:-MARGIN], image.transpose(2, 0, 1))
    coefficients = np.empty(planes.shape, np.float32)
    find_coefficients(planes, 17, np.float32(1 / 255), filter_response(2**-19), coefficients)
    np.testing.assert_allclose(coefficients, coefficients_of(planes_of(image, 1 / 255, spare=0), spare=0), atol=1e-6)


def test_the_spline_meets_every_sample():
    """At whole pixels the spline is the image again."""
    image = noise(9, 11, 2, np.float32, 3)
    coefficients = coefficients_of(planes_of(image))
    for c in range(2):
        again = [[spline_at(coefficients[c], MARGIN, y, x) for x in range(11)] for y in range(9)]
        np.testing.assert_allclose(again, image[..., c], atol=1e-5)


def test_flat_images_have_flat_coefficients():
    """The filter's response sums to 1 but for what is cut off."""
    response = filter_response(2**-19).astype(float)
    assert response[0] + 2 * response[1:].sum() == pytest.approx(1, abs=1e-5)
    flat = np.full((3, 4, 1), 0.7, np.float32)
    np.testing.assert_allclose(coefficients_of(planes_of(flat)), 0.7, atol=1e-5)


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.3, 0.5, 0.999])
def test_weights_are_the_b_spline(fraction):
    """Four values of the cubic B-spline, which sum to 1, have their centre at the place, and mirror."""
    weights = np.array(uncompiled(spline_weights)(np.float32(fraction)), float)
    np.testing.assert_allclose(weights, [bspline(fraction - k) for k in (-1, 0, 1, 2)], atol=1e-6)
    assert weights.sum() == pytest.approx(1, abs=1e-6)
    assert weights @ [-1, 0, 1, 2] == pytest.approx(fraction, abs=1e-6)
    np.testing.assert_allclose(weights, uncompiled(spline_weights)(np.float32(1 - fraction))[::-1], atol=1e-6)


def test_smooth_waves_are_sampled_right():
    """Between the pixels, a wave eight pixels long is right to half a percent of its height, away from the edges."""
    y, x = np.mgrid[0:1, 0:48].astype(float)
    wave = np.sin(2 * np.pi * x / 8)[..., np.newaxis].astype(np.float32)
    coefficients = coefficients_of(planes_of(wave))[0]
    places = np.arange(12, 36, 0.3)
    values = [spline_at(coefficients, MARGIN, float(y[0, 0]), place) for place in places]
    np.testing.assert_allclose(values, np.sin(2 * np.pi * places / 8), atol=5e-3)
