"""Rows of sixteen squares at once, compiled and not."""

from __future__ import annotations

import numpy as np
import pytest
from twins import uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.lanes import filter_sixteen
from fpsboost.kernels.window_rows import (
    PIXELS_PER_ROW,
    SQUARES_PER_ROW,
    add_row,
    blend_rows,
    mix_eight,
    mix_sixteen,
    pool_row,
    sum_five,
    upsample_rows,
)


@njit()
def filtered(source, weights, out):
    """Call the compiled form, and so below."""
    filter_sixteen(source, 3, 7, weights[0], weights[1], weights[2], weights[3], out, 5)


@njit()
def summed(source, weights, out):
    """Five values 11 apart."""
    sum_five(source, 2, 11, out, 5)


@njit()
def pooled(source, weights, out):
    """Two rows 40 apart."""
    pool_row(source, 1, 40, weights[0], out, 5)


@njit()
def added(source, weights, out):
    """Sixteen values and their weights."""
    add_row(source, 4, source, 30, out, 5)


@njit()
def blended(source, weights, out):
    """Two rows."""
    blend_rows(source, 40, 4, out, 5)


@njit()
def spread(source, weights, out):
    """Two rows of sixteen squares to 32 pixels."""
    upsample_rows(source, 40, 4, out, 5)


def quarter(near, far):
    """A quarter of the way from one to the other."""
    return 0.75 * near + 0.25 * far


def neighbours(pixel):
    """The square of a pixel, and the one that is next to it, or itself at the ends."""
    return pixel // 2, min(max(pixel // 2 + (1 if pixel % 2 else -1), 0), SQUARES_PER_ROW - 1)


def expected_of(kernel, source, weights, before):
    """What is to stand from place 5 on."""
    group_singly = {
        filtered: lambda k: sum(weights[n] * source[3 + 7 * n + k] for n in range(4)),
        summed: lambda k: sum(share * source[2 + 11 * n + k] for n, share in enumerate((0.75, 1, 1, 1, 0.75))),
        pooled: lambda k: before[5 + k] + weights[0] * sum(source[1 + 2 * k + n] for n in (0, 1, 40, 41)),
        added: lambda k: before[5 + k] + source[4 + k] * source[30 + k],
        blended: lambda k: quarter(source[40 + k], source[4 + k]),
        spread: lambda k: quarter(*(quarter(source[40 + n], source[4 + n]) for n in neighbours(k))),
    }
    return np.array([group_singly[kernel](k) for k in range(PIXELS_PER_ROW if kernel is spread else SQUARES_PER_ROW)])


@pytest.mark.parametrize("kernel", [filtered, summed, pooled, added, blended, spread])
def test_a_row_is_computed_alike_compiled_and_not(kernel):
    """As one value after the other would be; nothing beside the row is written."""
    random = np.random.default_rng(1)
    source, weights, before = (random.random(size).astype(np.float32) for size in (100, 4, 60))
    expected = expected_of(kernel, source, weights, before)
    for call in (kernel, uncompiled(kernel)):
        out = before.copy()
        call(source, weights, out)
        np.testing.assert_allclose(out[5 : 5 + len(expected)], expected, rtol=1e-6)
        np.testing.assert_array_equal(out[:5], before[:5])
        np.testing.assert_array_equal(out[5 + len(expected) :], before[5 + len(expected) :])


@njit()
def mixed_by_eight(first, second, stride, tall, taps, t, wide, mixed, distance):
    """Call the compiled form, and so below."""
    mix_eight(first, 4, second, 9, stride, tall, taps, t, wide, mixed, distance, 2)


@njit()
def mixed_by_sixteen(first, second, stride, tall, taps, t, wide, mixed, distance):
    """Twice as many columns."""
    mix_sixteen(first, 4, second, 9, stride, tall, taps, t, wide, mixed, distance, 2)


@pytest.mark.parametrize(("kernel", "columns"), [(mixed_by_eight, 8), (mixed_by_sixteen, 16)])
def test_columns_are_sampled_and_mixed_alike_compiled_and_not(kernel, columns):
    """As sums over four by four coefficients say; nothing beside the columns is written."""
    random = np.random.default_rng(columns)
    stride, tall, wide, t = 40, 5, 20, np.float32(0.25)
    first, second = random.random((2, 12 * stride)).astype(np.float32)
    taps, before = random.random(16).astype(np.float32), random.random((2, 110)).astype(np.float32)
    expected = before.astype(float)
    for j, i in np.ndindex(tall, columns):
        samples = [
            sum(
                taps[at + 4 + down] * taps[at + across] * source[begin + (j + down) * stride + i + across]
                for down, across in np.ndindex(4, 4)
            )
            for source, begin, at in ((first, 4, 0), (second, 9, 8))
        ]
        place = 2 + j * wide + i
        expected[0, place] = samples[0] + t * (samples[1] - samples[0])
        expected[1, place] = before[1, place] + (samples[1] - samples[0]) ** 2
    for call in (kernel, uncompiled(kernel)):
        mixed, distance = before.copy()
        call(first, second, stride, tall, taps, t, wide, mixed, distance)
        np.testing.assert_allclose([mixed, distance], expected, rtol=1e-5)
