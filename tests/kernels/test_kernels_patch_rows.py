"""Rows of sums of similarity, compiled and not."""

from __future__ import annotations

import numpy as np
import pytest
from twins import uncompiled

from fpsboost.kernels.jit import LANES, njit
from fpsboost.kernels.patch_rows import GAP, ROWS_AT_ONCE, slide_boxes, sum_windows_across, sum_windows_down
from fpsboost.kernels.similarity import UNIT, similarity

WIDTH, PLANE, COUNT = 3 * LANES, 220, 3
END = GAP + COUNT * WIDTH
"""Index after the last sum of three offsets in line."""


def pixel_rows() -> tuple[np.ndarray, np.ndarray]:
    """Three planes of two rows, from equal pixels to such as have nothing in common."""
    random = np.random.default_rng(1)
    first = random.random(3 * PLANE).astype(np.float32) * np.float32(0.5)
    second = first + random.normal(size=first.size).astype(np.float32) * np.float32(0.5)
    second[30] = 50
    for c in range(3):
        second[c * PLANE + 39 : c * PLANE + 43] = first[c * PLANE + 34 : c * PLANE + 38]
    return first, second


def similarities(first: np.ndarray, second: np.ndarray, step: int) -> np.ndarray:
    """Similarities of the pixels from 4 on with those from 9 on, and those `step` and twice as far on."""
    return np.array(
        [
            [similarity(*first[4 + x :: PLANE][:3], *second[9 + step * which + x :: PLANE][:3]) for x in range(WIDTH)]
            for which in range(COUNT)
        ]
    )


def sums_across(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted sums of neighbours, at the last of them, from the first whole window on."""
    windows = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=1)
    return (windows * weights).sum(axis=2)


def box_row(size: int):
    """A compiled call with boxes of one size."""

    @njit()
    def call(first, second, step, ring, oldest, newest, totals):
        slide_boxes(first, 4, PLANE, second, 9, PLANE, step, COUNT, WIDTH, size, ring, oldest, newest, totals, GAP)

    return call


@pytest.mark.parametrize("size", [3, 5, 11, 16, 21, 41])
@pytest.mark.parametrize("step", [1, -1])
def test_a_row_comes_into_boxes_and_one_goes_out_alike_compiled_and_not(size, step):
    """To the bit, for three offsets; nothing behind the last sum is written."""
    (first, second), random = pixel_rows(), np.random.default_rng(size)
    alike = similarities(first, second, step)
    assert alike.max() == UNIT
    assert alike.min() == 0
    before = random.integers(0, UNIT, (3, END + 9)).astype(np.int32)
    call = box_row(size)
    for each in (call, uncompiled(call)):
        old, new, totals = before.copy()
        ring = np.concatenate([old, new])
        each(first, second, step, ring, GAP, len(old) + GAP, totals)
        expected = sums_across(alike, np.ones(size, np.int32))
        whole = np.arange(COUNT)[:, np.newaxis] * WIDTH + np.arange(size - 1, WIDTH) + GAP
        np.testing.assert_array_equal(ring[len(old) :][whole], expected)
        np.testing.assert_array_equal(totals[whole], before[2][whole] + expected - before[0][whole])
        np.testing.assert_array_equal(ring[: len(old)], before[0])
        np.testing.assert_array_equal(ring[len(old) + END :], before[1][END:])
        np.testing.assert_array_equal(totals[END:], before[2][END:])


def window_row(size: int):
    """A compiled call with windows of one size."""

    @njit()
    def call(first, second, step, weights, ring):
        sum_windows_across(first, 4, PLANE, second, 9, PLANE, step, COUNT, WIDTH, size, weights, ring, GAP)

    return call


@pytest.mark.parametrize("size", [3, 11, 21])
def test_similarities_are_weighted_and_summed_alike_compiled_and_not(size):
    """Across a row, for three offsets; nothing behind the last sum is written."""
    first, second = pixel_rows()
    weights = np.minimum(np.arange(1, size + 1), np.arange(size, 0, -1)).astype(np.float32) / size
    call = window_row(size)
    for each in (call, uncompiled(call)):
        ring = np.zeros(END + 9, np.float32)
        each(first, second, -1, weights, ring)
        expected = sums_across(similarities(first, second, -1), weights)
        np.testing.assert_allclose(ring[GAP:END].reshape(COUNT, WIDTH)[:, size - 1 :], expected, rtol=1e-5, atol=1)
        assert not ring[END:].any()


def windows_down(size: int):
    """A compiled call with windows of one size."""

    @njit()
    def call(ring, slot, weights, price, totals):
        sum_windows_down(ring, 2, slot, 50, weights, size, price, totals, 3, 40, 2 * LANES)

    return call


@pytest.mark.parametrize("size", [3, 11])
def test_rows_are_weighted_and_summed_alike_compiled_and_not(size):
    """Windows one below the other, whichever slot of the ring the first row is in."""
    random, slots = np.random.default_rng(size), size + ROWS_AT_ONCE - 1
    rows, price = random.random((slots, 50)).astype(np.float32), np.float32(0.25)
    weights = np.minimum(np.arange(1, size + 1), np.arange(size, 0, -1)).astype(np.float32) / size
    call = windows_down(size)
    for slot in (0, 2, slots - 1):
        in_order = np.roll(rows, -slot, axis=0)[:, 2 : 2 + 2 * LANES]
        expected = [weights @ in_order[k : k + size] - price for k in range(ROWS_AT_ONCE)]
        for each in (call, uncompiled(call)):
            totals = np.zeros(40 * ROWS_AT_ONCE, np.float32)
            each(rows.ravel(), slot, weights, price, totals)
            found = totals.reshape(ROWS_AT_ONCE, 40)
            np.testing.assert_allclose(found[:, 3 : 3 + 2 * LANES], expected, rtol=1e-5)
            assert not found[:, :3].any()
            assert not found[:, 3 + 2 * LANES :].any()
