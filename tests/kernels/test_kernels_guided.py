"""Weights of pictures by their errors, and differences beyond the usual ones, against slow twins."""

import numpy as np
import pytest
from scipy import ndimage

from fpsboost.kernels.constants import BANDS, BINS
from fpsboost.kernels.guided import keep_excess, measure_error, measure_usual_power, weigh

SIZES = [(1, 1), (2, 7), (40, 70), (15, 33)]


def boxed(values, side):
    """Means over squares, mirrored at the outermost pixels."""
    return ndimage.uniform_filter(values.astype(float), side, mode="mirror") if min(values.shape) > 1 else values


def noise(*shape, seed=0):
    return np.random.default_rng(seed).normal(0, 20, shape).astype(np.float32)


@pytest.mark.parametrize("side", [1, 3, 5])
@pytest.mark.parametrize("size", SIZES[1:])
def test_errors_are_means_over_squares(size, side):
    """Of the squared differences of all colours, less the variance of noise, and never negative."""
    guide, shown = noise(*size, 3, seed=1), noise(*size, 3, seed=2)
    error = np.empty(size, np.float32)
    measure_error(guide, shown, side, 700.0, error)
    expected = (boxed(np.mean((guide - shown).astype(float) ** 2, axis=2), side) - 700).clip(0)
    np.testing.assert_allclose(error, expected, rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("own_side", [1, 7])
def test_weights_fall_with_the_cube_of_expected_errors(own_side):
    """The best has 1; own pictures have their own means, trust and factor, the others the error of motion."""
    size, is_own = (12, 20), np.array([False, True, False])
    errors = np.abs(noise(3, *size))
    usual, motion_error, trust = (np.abs(noise(*size, seed=seed)) for seed in (1, 2, 3))
    shares = np.empty_like(errors)
    weigh(errors, is_own, usual, motion_error, trust, own_side, 2.0, 0.5, 3.0, 40.0, shares)
    expected = (errors - usual).clip(0) + motion_error
    expected[1] = (boxed(errors[1], own_side) - usual).clip(0) * trust
    expected += 2 + 0.5 * usual
    factor = np.where(is_own[:, np.newaxis, np.newaxis], 3 * (1 + usual / 40), 1)
    np.testing.assert_allclose(shares, (expected.min(axis=0) / expected) ** 3 * factor, rtol=1e-3)


def shrunk(image):
    """Half the size by the weights 1, 4, 6, 4, 1."""
    taps = np.array([1, 4, 6, 4, 1]) / 16
    for axis in (0, 1):
        image = image if image.shape[axis] == 1 else ndimage.convolve1d(image, taps, axis, mode="mirror")
    return image[::2, ::2]


def risen(small, height, width):
    """Twice the size by the same weights, edges repeated."""
    for axis, size in ((0, height), (1, width)):
        padded = np.moveaxis(np.pad(small, [(int(k == axis),) * 2 for k in range(3)], "edge"), axis, 0)
        both = np.empty((2 * small.shape[axis], *padded.shape[1:]))
        both[::2] = (padded[:-2] + 6 * padded[1:-1] + padded[2:]) / 8
        both[1::2] = (padded[1:-1] + padded[2:]) / 2
        small = np.moveaxis(both[:size], 0, axis)
    return small


def split(image, count):
    """The bands of a Laplacian pyramid, the finest first."""
    bands = []
    for _ in range(count - 1):
        smaller = shrunk(image)
        bands.append(image - risen(smaller, *image.shape[:2]))
        image = smaller
    return [*bands, image]


def count_of(height, width):
    return 1 + int(np.clip(np.log2(min(height, width) / 8), 0, BANDS - 1))


def powers(band, is_coarsest):
    return boxed(np.mean(band**2, axis=2), 3 if is_coarsest else 7)


@pytest.mark.parametrize("use_median", [False, True])
@pytest.mark.parametrize("size", [(64, 130), (36, 50)])
def test_usual_power_is_that_beside_as_much_detail(size, use_median):
    """In bins of equally many pixels, to the width of a key: a twenty-third; one bin for the coarsest band."""
    difference, shown = (
        noise(*size, 3, seed=1),
        noise(*size, 3, seed=2) * np.linspace(0, 3, size[1], dtype=np.float32)[:, np.newaxis],
    )
    usual = np.empty((BANDS, 2, BINS), np.float32)
    measure_usual_power(difference, shown, use_median, usual)
    count = count_of(size[0] if use_median else size[0] // 2, size[1])
    bands = zip(*(split(each.astype(float), count) for each in (difference, shown)), strict=True)
    for level, (band, detail) in enumerate(bands):
        bins = 1 if level == count - 1 else BINS
        power, strength = powers(band, bins == 1), powers(detail, bins == 1)
        limits = np.quantile(strength, np.arange(1, bins) / bins)
        np.testing.assert_allclose(usual[level, 0, : bins - 1], limits, rtol=0.1)
        index = np.searchsorted(limits, strength)
        means = [(np.median if use_median else np.mean)(power[index == k]) for k in range(bins)]
        np.testing.assert_allclose(usual[level, 1, :bins], means, rtol=0.1)
    assert not usual[count:].any()


@pytest.mark.parametrize("size", SIZES)
def test_what_exceeds_usual_power_is_kept_band_by_band(size):
    """A share of each band by its power around each pixel, and by what is usual beside as much detail."""
    difference, shown = noise(*size, 3, seed=3), noise(*size, 3, seed=4)
    difference[: size[0] // 2] *= 3
    usual = np.abs(noise(BANDS, 2, BINS, seed=5)) * 5
    usual[:, 0].sort(axis=1)
    usual[:, 0] = usual[:, 0].view(np.int32) >> 19 << 19  # what keys tell apart
    kept = np.empty_like(difference)
    keep_excess(difference, shown, usual, 2.0, kept)
    count = count_of(*size)
    bands = [split(each.astype(float), count) for each in (difference, shown)]
    expected = np.zeros((*bands[0][-1].shape[:2], 3))
    for level in range(count - 1, -1, -1):
        band, detail = (each[level] for each in bands)
        bins = 1 if level == count - 1 else BINS
        power, strength = powers(band, bins == 1), powers(detail, bins == 1)
        keys = np.float32(strength).view(np.int32) >> 19
        limits = usual[level, 0, : bins - 1].view(np.int32) >> 19
        around = boxed(usual[level, 1][np.sum(keys[..., np.newaxis] > limits, axis=2)], 3 if bins == 1 else 7)
        share = (power - 2 * around).clip(0) / (power + 1e-3)
        expected = risen(expected, *band.shape[:2]) if level < count - 1 else expected
        expected = expected + band * share[..., np.newaxis]
    np.testing.assert_allclose(kept, expected, atol=0.05)


def test_nothing_is_kept_of_a_usual_difference():
    """Differences like those by which the usual power was measured vanish, but for chance."""
    size = (40, 56)
    usual = np.empty((BANDS, 2, BINS), np.float32)
    shown = noise(*size, 3)
    measure_usual_power(noise(80, 56, 3, seed=1), np.vstack([shown, shown]), False, usual)
    difference, kept = noise(*size, 3, seed=2), np.empty((*size, 3), np.float32)
    keep_excess(difference, shown, usual, 2.0, kept)
    assert np.abs(kept).mean() < 0.02 * np.abs(difference).mean()
    difference[12:32, 16:46] += 150
    keep_excess(difference, shown, usual, 2.0, kept)
    assert kept[16:28, 20:42].mean() > 120
