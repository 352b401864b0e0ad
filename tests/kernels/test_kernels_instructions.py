"""Instructions, compiled and by their twins, against what they stand for."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from twins import level_similarity, listed_offsets

from fpsboost.kernels.instruction import EIGHT, SIXTEEN, fma, prefetch
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.patch_rows import (
    GAP,
    ROWS_AT_ONCE,
    FramePlanes,
    OffsetRows,
    Ring,
    slide_boxes,
    sum_windows_across,
    sum_windows_down,
)
from fpsboost.kernels.refine import PRODUCT_COUNT, WINDOW_SIDE, window_products
from fpsboost.kernels.search import OUTSIDE, hide_outside, keep_best_of_four
from fpsboost.kernels.semi_global import extend_paths
from fpsboost.kernels.similarity import UNIT, WHITE, compare_one, compare_sixteen, similarity
from fpsboost.kernels.spline import filter_eight, filter_sixteen
from fpsboost.kernels.tiles import NOTHING, NOWHERE, VALUES_PER_ENTRY, insert_eight
from fpsboost.kernels.window_rows import (
    PIXELS_PER_ROW,
    SQUARES_PER_ROW,
    SplinePair,
    add_row,
    blend_rows,
    mix_eight,
    mix_sixteen,
    pool_row,
    sum_five,
    upsample_rows,
)


def forms(call):
    """A call of an instruction, compiled and as it is."""
    return njit(call), call


def assert_only(found, place, expected, before, **tolerance):
    """The expected values stand from a place on, and beside them what was there before."""
    np.testing.assert_allclose(found[place : place + len(expected)], expected, **tolerance)
    written = range(place, place + len(expected))
    np.testing.assert_array_equal(np.delete(found, written), np.delete(before, written))


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


def quarter(near, far):
    """A quarter of the way from one to the other."""
    return 0.75 * near + 0.25 * far


def neighbours(pixel):
    """The square of a pixel, and the one that is next to it, or itself at the ends."""
    return pixel // 2, min(max(pixel // 2 + (1 if pixel % 2 else -1), 0), SQUARES_PER_ROW - 1)


ROWS = {
    "filter_eight": (
        lambda source, w, out: filter_eight(source, 3, 13, w[0], w[1], w[2], w[3], out, 5),
        lambda source, w, before, k: sum(w[n] * source[3 + 13 * n + k] for n in range(4)),
        EIGHT,
    ),
    "filter_sixteen": (
        lambda source, w, out: filter_sixteen(source, 3, 1, w[0], w[1], w[2], w[3], out, 5),
        lambda source, w, before, k: sum(w[n] * source[3 + n + k] for n in range(4)),
        SIXTEEN,
    ),
    "sum_five": (
        lambda source, w, out: sum_five(source, 2, 11, out, 5),
        lambda source, w, before, k: sum(c * source[2 + 11 * n + k] for n, c in enumerate((0.75, 1, 1, 1, 0.75))),
        SQUARES_PER_ROW,
    ),
    "pool_row": (
        lambda source, w, out: pool_row(source, 1, 40, w[0], out, 5),
        lambda source, w, before, k: before[5 + k] + w[0] * sum(source[1 + 2 * k + n] for n in (0, 1, 40, 41)),
        SQUARES_PER_ROW,
    ),
    "add_row": (
        lambda source, w, out: add_row(source, 4, source, 30, out, 5),
        lambda source, w, before, k: before[5 + k] + source[4 + k] * source[30 + k],
        SQUARES_PER_ROW,
    ),
    "blend_rows": (
        lambda source, w, out: blend_rows(source, 40, 4, out, 5),
        lambda source, w, before, k: quarter(source[40 + k], source[4 + k]),
        SQUARES_PER_ROW,
    ),
    "upsample_rows": (
        lambda source, w, out: upsample_rows(source, 40, 4, out, 5),
        lambda source, w, before, k: quarter(*(quarter(source[40 + n], source[4 + n]) for n in neighbours(k))),
        PIXELS_PER_ROW,
    ),
}
"""Calls that write a row from place 5 on, what each value is, and how many there are."""


@pytest.mark.parametrize("name", ROWS)
def test_a_row_is_computed_value_by_value(name):
    """Nothing beside the row is written."""
    call, value, count = ROWS[name]
    random = np.random.default_rng(1)
    source, weights, before = (random.random(size).astype(np.float32) for size in (100, 4, 60))
    for run in forms(call):
        out = before.copy()
        run(source, weights, out)
        assert_only(out, 5, [value(source, weights, before, k) for k in range(count)], before, rtol=1e-6)


@pytest.mark.parametrize(("mix", "columns"), [(mix_eight, 8), (mix_sixteen, 16)])
def test_columns_are_sampled_and_mixed(mix, columns):
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
    for run in forms(lambda pair, t, mixed, distance: mix(pair, 4, 9, tall, t, wide, mixed, distance, 2)):
        mixed, distance = before.copy()
        run(SplinePair(first, second, stride, taps), t, mixed, distance)
        np.testing.assert_allclose([mixed, distance], expected, rtol=1e-5)


@pytest.mark.parametrize("room", [EIGHT, 3 * EIGHT])
@pytest.mark.parametrize("seed", range(3))
def test_paths_are_extended(seed, room):
    """From the cheapest label, with a price for the change up to a limit; nothing beside the node is written."""
    random, here, before = np.random.default_rng(seed), 3, 40
    x, y, energy = random.integers(-5, 6, (3, 80)).astype(np.float32)
    costs_before, sums_before = random.random((2, 80)).astype(np.float32)
    slope, limit = np.float32([0.05, 0.3])
    extended = np.empty(room)
    for k in range(room):
        changes = np.abs(x[here + k] - x[before : before + room]) + np.abs(y[here + k] - y[before : before + room])
        extended[k] = (
            energy[here + k] + (costs_before[before : before + room] + np.minimum(slope * changes, limit)).min()
        )
    calls = forms(
        lambda x, y, energy, costs, total: extend_paths(x, y, energy, costs, total, here, before, room, slope, limit)
    )
    for run in calls:
        costs, total = costs_before.copy(), sums_before.copy()
        run(x, y, energy, costs, total)
        assert_only(costs, here, extended - extended.min(), costs_before, rtol=1e-6, atol=1e-6)
        assert_only(total, here, sums_before[here : here + room] + extended, sums_before, rtol=1e-6)


@pytest.mark.parametrize("most", [1, 92, WHITE])
@pytest.mark.parametrize(("compare", "length"), [(compare_sixteen, SIXTEEN), (compare_one, 1)])
def test_sixteen_pixels_are_compared(compare, length, most):
    """Truncated sums of absolute differences are added to what there is; nothing beside the sixteen is written."""
    random, most = np.random.default_rng(most), np.uint8(most)
    plane, place0, place1, before, after = 40, 5, 7, 2, 20
    first = random.integers(0, 256, 3 * plane).astype(np.uint8)
    second = (first + random.integers(-30, 31, first.size)).clip(0, WHITE).astype(np.uint8)
    second[place1 : place1 + SIXTEEN] = first[place0 : place0 + SIXTEEN]
    a = first.reshape(3, plane)[:, place0 : place0 + length].T
    b = second.reshape(3, plane)[:, place1 : place1 + SIXTEEN].T
    similarities = np.rint(level_similarity(np.broadcast_to(a, b.shape), b, most) * most)
    sums_before = random.integers(0, 60000, 50).astype(np.uint16)
    calls = forms(lambda first, second, sums: compare(first, place0, second, place1, plane, most, sums, before, after))
    for run in calls:
        sums = sums_before.copy()
        run(first, second, sums)
        assert_only(sums, after, sums_before[before : before + SIXTEEN] + similarities, sums_before)


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
@pytest.mark.parametrize("count", [1, EIGHT, 2 * EIGHT + 1])
def test_the_largest_total_stays_with_its_rank(dtype, count):
    """Of equal totals, that of the lowest rank stays; of few values, many are equal."""
    random = np.random.default_rng(count)
    totals, best = (random.integers(-1, 4, length).astype(dtype) for length in (130, 40))
    ranks, winners = np.int32([0, 0, 2, 5, 6, 9]), random.integers(0, 12, 40).astype(np.int32)
    written = 3 + np.arange(-(-count // EIGHT) * EIGHT)
    calls = forms(
        lambda totals, ranks, best, winners: keep_best_of_four(totals, 5, 31, ranks, 2, best, winners, 3, count)
    )
    for run in calls:
        largest, kept = best.copy(), winners.copy()
        run(totals, ranks, largest, kept)
        for place in range(40):
            candidates = [(-best[place], winners[place])]
            if place in written:
                candidates += [(-totals[5 + 31 * which + place - 3], ranks[2 + which]) for which in range(4)]
            assert (-largest[place], kept[place]) == min(candidates)


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
def test_totals_outside_never_win(dtype):
    """Those on either side of the candidates are below all others; the candidates and all farther on stay."""
    for run in forms(lambda totals: hide_outside(totals, 20, 31)):
        totals, expected = np.arange(60).astype(dtype), np.arange(60)
        run(totals)
        expected[20 - OUTSIDE : 20] = expected[31 : 31 + OUTSIDE] = -1
        np.testing.assert_array_equal(totals, expected)


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


WIDTH, PLANE, COUNT = 3 * LANES, 220, 3
END = GAP + COUNT * WIDTH
"""Index after the last sum of three offsets in line."""


def pixel_rows():
    """Three planes of two rows, from equal pixels to such as have nothing in common."""
    random = np.random.default_rng(1)
    first = random.random(3 * PLANE).astype(np.float32) * np.float32(0.5)
    second = first + random.normal(size=first.size).astype(np.float32) * np.float32(0.5)
    second[30] = 50
    for c in range(3):
        second[c * PLANE + 39 : c * PLANE + 43] = first[c * PLANE + 34 : c * PLANE + 38]
    return FramePlanes(first, PLANE, second, PLANE)


def similarities_of(planes, rows):
    """Similarities of the pixels of a row with those to which each offset leads."""
    return np.array(
        [
            [
                similarity(*planes.first[rows.place0 + x :: PLANE][:3], *planes.second[place1 + x :: PLANE][:3])
                for x in range(rows.width)
            ]
            for place1 in rows.place1 + rows.step * np.arange(rows.offsets)
        ]
    )


def sums_across(values, weights):
    """Weighted sums of neighbours, at the last of them, from the first whole window on."""
    windows = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=1)
    return (windows * weights).sum(axis=2)


def tent(size):
    """Symmetric weights."""
    return np.minimum(np.arange(1, size + 1), np.arange(size, 0, -1)).astype(np.float32) / size


@pytest.mark.parametrize("size", [3, 5, 11, 16, 21, 41])
@pytest.mark.parametrize("step", [1, -1])
def test_a_row_comes_into_boxes_and_one_goes_out(size, step):
    """To the bit, for three offsets; nothing behind the last sum is written."""
    planes, rows, random = pixel_rows(), OffsetRows(4, 9, step, COUNT, WIDTH), np.random.default_rng(size)
    similarities = similarities_of(planes, rows)
    assert similarities.max() == UNIT
    assert similarities.min() == 0
    before = random.integers(0, UNIT, (3, END + 9)).astype(np.int32)
    expected = sums_across(similarities, np.ones(size, np.int32))
    whole = np.arange(COUNT)[:, np.newaxis] * WIDTH + np.arange(size - 1, WIDTH) + GAP
    newest = END + 9 + GAP
    for run in forms(
        lambda planes, rows, ring, totals: slide_boxes(planes, rows, size, ring, GAP, newest, totals, GAP)
    ):
        old, new, totals = before.copy()
        ring = np.concatenate([old, new])
        run(planes, rows, ring, totals)
        np.testing.assert_array_equal(ring[len(old) :][whole], expected)
        np.testing.assert_array_equal(totals[whole], before[2][whole] + expected - before[0][whole])
        np.testing.assert_array_equal(ring[: len(old)], before[0])
        np.testing.assert_array_equal(ring[len(old) + END :], before[1][END:])
        np.testing.assert_array_equal(totals[END:], before[2][END:])


@pytest.mark.parametrize("size", [3, 11, 21])
def test_similarities_are_weighted_and_summed_across(size):
    """For three offsets; nothing behind the last sum is written."""
    planes, rows, weights = pixel_rows(), OffsetRows(4, 9, -1, COUNT, WIDTH), tent(size)
    expected = sums_across(similarities_of(planes, rows), weights)
    for run in forms(lambda planes, rows, weights, ring: sum_windows_across(planes, rows, size, weights, ring, GAP)):
        ring = np.zeros(END + 9, np.float32)
        run(planes, rows, weights, ring)
        np.testing.assert_allclose(ring[GAP:END].reshape(COUNT, WIDTH)[:, size - 1 :], expected, rtol=1e-5, atol=1)
        assert not ring[END:].any()


@pytest.mark.parametrize("size", [3, 11])
def test_rows_are_weighted_and_summed_down(size):
    """Windows one below the other, whichever slot of the ring the first row is in."""
    random, slots, weights = np.random.default_rng(size), size + ROWS_AT_ONCE - 1, tent(size)
    rows, price = random.random((slots, 50)).astype(np.float32), np.float32(0.25)
    calls = forms(lambda ring, weights, totals: sum_windows_down(ring, weights, size, price, totals, 3, 40, 2 * LANES))
    for slot in (0, 2, slots - 1):
        in_order = np.roll(rows, -slot, axis=0)[:, 2 : 2 + 2 * LANES]
        expected = [weights @ in_order[k : k + size] - price for k in range(ROWS_AT_ONCE)]
        for run in calls:
            totals = np.zeros(40 * ROWS_AT_ONCE, np.float32)
            run(Ring(rows.ravel(), 2, slot, 50), weights, totals)
            windows = totals.reshape(ROWS_AT_ONCE, 40)
            np.testing.assert_allclose(windows[:, 3 : 3 + 2 * LANES], expected, rtol=1e-5)
            assert not windows[:, :3].any()
            assert not windows[:, 3 + 2 * LANES :].any()
