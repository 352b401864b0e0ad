"""Similarity of pixels in bytes."""

from __future__ import annotations

import numpy as np
import pytest
from twins import level_similarity, uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.levels import SIXTEEN, WHITE, compare_one, compare_sixteen, level_scale, truncation
from fpsboost.motion.components import contrast_components, contrast_planes


@njit()
def compare_pairs(first, second, place0, place1, plane, most, sums, before, after):
    """Call the compiled form."""
    compare_sixteen(first, place0, second, place1, plane, most, sums, before, after)


@njit()
def compare_with_one(first, second, place0, place1, plane, most, sums, before, after):
    """Call the compiled form."""
    compare_one(first, place0, second, place1, plane, most, sums, before, after)


@pytest.mark.parametrize("most", [1, 92, WHITE])
@pytest.mark.parametrize("kernel", [compare_pairs, compare_with_one])
def test_sixteen_pixels_are_compared_alike_compiled_and_not(kernel, most):
    """Truncated sums of absolute differences are added to what there is; nothing beside the sixteen is written."""
    random = np.random.default_rng(most)
    plane, place0, place1, before, after = 40, 5, 7, 2, 20
    first = random.integers(0, 256, 3 * plane).astype(np.uint8)
    second = (first + random.integers(-30, 31, first.size)).clip(0, WHITE).astype(np.uint8)
    second[place1 : place1 + SIXTEEN] = first[place0 : place0 + SIXTEEN]
    length = SIXTEEN if kernel is compare_pairs else 1
    a = first.reshape(3, plane)[:, place0 : place0 + length].T
    b = second.reshape(3, plane)[:, place1 : place1 + SIXTEEN].T
    alike = np.rint(level_similarity(np.broadcast_to(a, b.shape), b, most) * most)
    known = random.integers(0, 60000, 50).astype(np.uint16)
    for call in (kernel, uncompiled(kernel)):
        sums = known.copy()
        call(first, second, place0, place1, plane, np.uint8(most), sums, before, after)
        np.testing.assert_array_equal(sums[after : after + SIXTEEN], known[before : before + SIXTEEN] + alike)
        np.testing.assert_array_equal(np.delete(sums, range(after, after + SIXTEEN)), np.delete(known, range(20, 36)))


@pytest.mark.parametrize(("v", "most"), [(0.0001, 1), (0.05, 51), (0.09, 92), (0.25, 255), (2.0, 255)])
def test_the_truncation_is_four_widths(v, most):
    """In levels, from one on; where four widths are more than white, the levels are scaled down instead."""
    assert truncation(v) == most
    assert level_scale(v) == pytest.approx(min(255, 255 / (4 * v)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_levels_are_those_of_the_components(dtype):
    """Half luma, twice the high-pass around the middle, and chroma; beyond the frame as at its edge."""
    random, padding, v = np.random.default_rng(4), 20, 0.09
    image = random.random((9, 14, 3)) * 0.3 + 0.3
    image = image.astype(dtype) if dtype == np.float32 else (image * np.iinfo(dtype).max).astype(dtype)
    expected = contrast_components(image) * level_scale(v) + [0, 128, 0]
    levels = contrast_planes(image, padding, v).transpose(1, 2, 0)
    assert np.abs(levels[padding : padding + 9, padding : padding + 14] - expected.clip(0, WHITE)).max() < 0.51
    np.testing.assert_array_equal(levels[:padding, padding], np.broadcast_to(levels[padding, padding], (padding, 3)))
    np.testing.assert_array_equal(levels[padding, -1], levels[padding, padding + 13])
