"""Instructions, compiled and by their twins, whose faults the searches that use them might not show."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from twins import listed_offsets

from fpsboost.kernels.instruction import EIGHT, fma, prefetch
from fpsboost.kernels.jit import borrowed
from fpsboost.kernels.refine import PRODUCT_COUNT, WINDOW_SIDE, window_products
from fpsboost.kernels.tiles import NOTHING, NOWHERE, VALUES_PER_ENTRY, insert_eight
from fpsboost.kernels.window_rows import (
    SQUARES_PER_WINDOW,
    add_feature_row,
    decay_row,
    distance_row,
    multiply_row,
    scale_row,
)

ROW = np.random.default_rng(3).uniform(-0.5, 2, 32).astype(np.float32)  # values of some squares, and more


def forms(call):
    """A call of an instruction, compiled and as it is."""
    return njit(call), call


@njit
def multiply_add(a, b, c):
    """Call the instruction, and so below."""
    return fma(a, b, c)


numbers = st.floats(-100, 100, width=32, allow_subnormal=False).map(np.float32)


@given(numbers, numbers, numbers)
def test_a_fused_multiply_add_is_the_nearest_number(a, b, c):
    """No float32 lies nearer to the exact result than the one given."""
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    assume(exact == 0 or abs(exact) > 1e-30)
    found = np.float32(multiply_add(a, b, c))
    for other in (np.nextafter(found, np.float32(-np.inf)), np.nextafter(found, np.float32(np.inf))):
        assert abs(Fraction(float(found)) - exact) <= abs(Fraction(float(other)) - exact)


@njit
def fetch_ahead(flat, place):
    """Any place."""
    prefetch(flat, place)


@pytest.mark.parametrize("place", [0, 3, 10**15, 2**64 - 5])
def test_prefetching_changes_nothing_wherever_it_points(place):
    """Neither the array nor anything else, for places within the array and far beyond it."""
    flat = np.arange(4, dtype=np.float32)
    fetch_ahead(flat, np.uint64(place))
    np.testing.assert_array_equal(flat, [0, 1, 2, 3])


def test_borrowed_arrays_are_the_same_arrays():
    """They are read and written like those that they were made of, in nested tuples, too."""

    def scale(given):
        ((values, factor), out), (further,) = borrowed(given), borrowed((given[1],))
        for i in range(out.size):
            further[i] = values[i, 0] * factor

    for run in forms(scale):
        run(((np.arange(6.0).reshape(3, 2), 2), out := np.zeros(3)))
        np.testing.assert_array_equal(out, [0, 4, 8])


@njit
def insert(dx, dy, similarities, at, lists, size, capacity):
    """Any offset, and any number of lists."""
    insert_eight(dx, dy, similarities, at, lists, size, capacity)


def lists_of(offsets, similarities, at, size, capacity, run):
    """The entries of all points after all offsets, (capacity, VALUES_PER_ENTRY, points)."""
    lists = np.empty((capacity, VALUES_PER_ENTRY, size), np.float32)
    lists[:] = np.float32([NOTHING, NOWHERE, NOWHERE])[:, np.newaxis]
    for (dx, dy), values in zip(np.float32(offsets), similarities, strict=True):
        run(dx, dy, values, at, lists.reshape(-1), size, capacity)
    return lists


@settings(max_examples=30)
@given(st.integers(1, 9), st.integers(0, 30), st.integers(1, 6), st.integers(0, 2**32))
def test_lists_are_kept_as_offset_by_offset(capacity, count, largest, seed):
    """The best so many, falling; of neighbours the better, of equal ones the first; and of other points nothing."""
    random, at, size = np.random.default_rng(seed), 4, 20
    offsets = random.integers(-largest, largest + 1, (count, 2))
    similarities = random.integers(-2, 7, (count, size)).astype(np.float32) / 8
    expected = [listed_offsets(offsets, similarities[:, point], capacity) for point in range(size)]
    for run in (insert, insert_eight):
        lists = lists_of(offsets, similarities, at, size, capacity, run)
        for point in range(size):
            entries = [tuple(entry) for entry in lists[:, :, point].tolist() if entry[0] > NOTHING]
            assert entries == (expected[point] if at <= point < at + EIGHT else [])


@pytest.mark.parametrize("largest", [16, 256])
def test_products_are_summed_over_a_window(largest):
    """As pixel by pixel, with the largest differences that bytes can have, too."""
    random, stride, rows = np.random.default_rng(1), 40, 20
    frames = random.integers(0, largest, (2, 3, rows, stride)).astype(np.uint8)
    frames[:, :, 3:6] = frames[:, :, 3:6] // (largest - 1) * (largest - 1)
    (y0, x0), (y1, x1), tail = (3, 4), (5, 9), np.float32(1 / 5000)
    expected = np.zeros(PRODUCT_COUNT)
    for y, x in np.ndindex(WINDOW_SIDE, WINDOW_SIDE):
        here, there = (
            frame[:, y + at_y : y + at_y + 3, x + at_x : x + at_x + 3].astype(float)
            for frame, at_y, at_x in zip(frames, (y0, y1), (x0, x1), strict=True)
        )
        both, change = here + there, (there - here)[:, 1, 1]
        along_x, along_y = both[:, 1, 2] - both[:, 1, 0], both[:, 2, 1] - both[:, 0, 1]
        pairs = (along_x, along_x), (along_x, along_y), (along_y, along_y), (along_x, change), (along_y, change)
        products = np.array([one @ other for one, other in (*pairs, (change, change))])
        expected += products * (1 + tail * products[-1]) ** -4
    start0, start1, plane = y0 * stride + x0, y1 * stride + x1, rows * stride
    calls = forms(lambda first, second, sums: window_products(first, start0, second, start1, stride, plane, tail, sums))
    for run in calls:
        sums = np.empty(PRODUCT_COUNT, np.float32)
        run(*(frame.ravel() for frame in frames), sums)
        np.testing.assert_allclose(sums, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        (decay_row, (ROW, 3, np.float32(2), np.float32(40), np.float32(0.5), None, 5)),
        (scale_row, (np.float32(-1.5), ROW, 2, None, 4)),
        (multiply_row, (ROW, 1, ROW, 7, None, 6)),
        (distance_row, (ROW, 1, ROW, 7, None, 6)),
    ],
)
def test_rows_of_squares_equal_their_twins(call, arguments):
    """Sixteen values from some place on, and none beside them; exponentials of numbers below 0 and above 60, too."""
    found = []
    compiled = njit(lambda *given: call(*given))  # noqa: PLW0108 - numba compiles calls of instructions alone
    for form in (compiled, call):
        out = np.arange(32, dtype=np.float32)
        form(*(out if each is None else each for each in arguments))
        found.append(out)
    np.testing.assert_allclose(*found, rtol=1e-4)
    assert (found[0] != np.arange(32)).sum() == 16
    if call is decay_row:
        exact = 0.5 * np.exp(-(2 + 40 * ROW[3:19].astype(float)).clip(0, 60))
        np.testing.assert_allclose(found[0][5:21], exact, atol=1e-6)


def test_sums_of_features_equal_their_twin():
    """Of sixteen squares the logarithms for both frames and for either alone; a floor cuts off what is below it."""
    random = np.random.default_rng(5)
    squares, cells, factors = (random.normal(size=size).astype(np.float32) for size in (7 * 256, 128, 40))
    below, above, floor = map(np.float32, (0.375, 0.625, -0.5))
    found = []
    for form in forms(lambda out: add_feature_row(squares, 48, cells, 16, below, above, factors, 20, floor, out)):
        out = np.ones(3 * SQUARES_PER_WINDOW, np.float32)
        form(out)
        found.append(out)
    np.testing.assert_allclose(*found, rtol=1e-4, atol=1e-5)
    assert (found[0] != 1).sum() == 48
