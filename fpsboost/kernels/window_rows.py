"""Vector instructions for rows of the windows of `fpsboost.kernels.multi_hypothesis`.

The loops are so short that the compiler would leave them scalar. A row has 16 squares of two by two pixels. Arrays are
flat float32; of integers named for a place, each is the index of the first value; no bounds are checked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import AS_GIVEN, FLOAT, INDEX, PLACE, REAL, instruction, vector
from fpsboost.kernels.jit import cgutils

SQUARES_PER_ROW = 16
"""Number of squares across a window: one for two pixels, as for subsampled chroma. Each square has one weight: weights
are means over patches, which vary slowly."""

SQUARES_PER_WINDOW = SQUARES_PER_ROW * SQUARES_PER_ROW
"""Number of squares of two by two pixels in a window; each square has one weight."""

CELLS_PER_ROW = 4
"""Cells across a window, for each of which the motion fields are looked up."""

PIXELS_PER_ROW = 2 * SQUARES_PER_ROW
"""Pixels per row."""

END_WEIGHT = 0.75
"""Weight of the first and the last of five squares: equivalent to sums over patches of nine pixels around each
pixel."""

EXPONENTIAL = -1 / 120, 1 / 24, -1 / 6, 1 / 2, -1, 1
"""Coefficients of the polynomial that approximates exp(-x) for small x, of the highest power first."""

_SQUARES, _PIXELS = vector(REAL, SQUARES_PER_ROW), vector(REAL, PIXELS_PER_ROW)


def sum_five(source, begin, step, out, target):
    """Write ``E s[0] + s[1] + s[2] + s[3] + E s[4]``, E = END_WEIGHT, of sixteen values; ``s[n]`` is `n` steps on."""
    taps = [source[begin + n * step :][:SQUARES_PER_ROW] for n in range(5)]
    out[target : target + SQUARES_PER_ROW] = (taps[1] + taps[2] + taps[3]) + np.float32(END_WEIGHT) * (
        taps[0] + taps[4]
    )


@instruction(sum_five, AS_GIVEN, INDEX, INDEX, AS_GIVEN, INDEX)
def _build_sum_five(code, source, begin, step, out, target):
    taps = [source.load(place, _SQUARES) for place in code.steps(begin, step, 5)]
    add = code.builder.fadd
    near, far = add(add(taps[1], taps[2]), taps[3]), add(taps[0], taps[4])
    out.store(code.fma(far, code.fill(END_WEIGHT, _SQUARES), near), target)


def pool_row(values, begin, below, share, sums, target):
    """Add `share` times the sum over the pixels of each of sixteen squares to the sums; the lower row is `below` on."""
    both = values[begin : begin + PIXELS_PER_ROW] + values[begin + below :][:PIXELS_PER_ROW]
    sums[target : target + SQUARES_PER_ROW] += share * (both[::2] + both[1::2])


@instruction(pool_row, AS_GIVEN, INDEX, INDEX, FLOAT, AS_GIVEN, INDEX)
def _build_pool_row(code, values, begin, below, share, sums, target):
    add = code.builder.fadd
    both = add(*(values.load(place, _PIXELS) for place in code.steps(begin, below, 2)))
    pooled = add(*(code.choose(both, range(first, PIXELS_PER_ROW, 2)) for first in (0, 1)))
    sums.store(code.fma(code.broadcast(share, _SQUARES), pooled, sums.load(target, _SQUARES)), target)


def add_row(weights, begin, values, here, sums, there):
    """Add sixteen values times their weights to the sums."""
    sums[there : there + SQUARES_PER_ROW] += (
        weights[begin : begin + SQUARES_PER_ROW] * values[here : here + SQUARES_PER_ROW]
    )


@instruction(add_row, AS_GIVEN, INDEX, AS_GIVEN, INDEX, AS_GIVEN, INDEX)
def _build_add_row(code, weights, begin, values, here, sums, there):
    sums.store(code.fma(weights.load(begin, _SQUARES), values.load(here, _SQUARES), sums.load(there, _SQUARES)), there)


def scale_row(coefficient, values, begin, sums, there):
    """Add a coefficient times sixteen values to the sums."""
    sums[there : there + SQUARES_PER_ROW] += coefficient * values[begin : begin + SQUARES_PER_ROW]


@instruction(scale_row, FLOAT, AS_GIVEN, INDEX, AS_GIVEN, INDEX)
def _build_scale_row(code, coefficient, values, begin, sums, there):
    factor = code.broadcast(coefficient, _SQUARES)
    sums.store(code.fma(factor, values.load(begin, _SQUARES), sums.load(there, _SQUARES)), there)


def add_feature_row(squares, begin, cells, first, below, above, coefficients, number, floor, logits):
    """Add what a sum of features says of sixteen squares to the logarithms of the weights of three options.

    `squares` has seven features a window apart; `cells` two rows for each of the even and the odd part of the other
    features, of which the mean by the weights `below` and `above` counts. From `number` on are the coefficients of the
    seven, that of the odd part of the fifth and sixth, and the factors of the sum of the frames and of either alone.
    """
    row = slice(begin, begin + SQUARES_PER_ROW)
    features = np.stack([squares[n * SQUARES_PER_WINDOW :][row] for n in range(7)])
    rows = [cells[first + n * SQUARES_PER_ROW :][:SQUARES_PER_ROW] for n in (0, 1, CELLS_PER_ROW, CELLS_PER_ROW + 1)]
    factors = coefficients[number : number + 10]
    even = below * rows[0] + above * rows[1] + factors[:7] @ features
    odd = below * rows[2] + above * rows[3] + factors[7] * (features[4] - features[5])
    of_frame0, of_frame1 = np.maximum(even + odd, floor), np.maximum(even - odd, floor)
    logits[:SQUARES_PER_WINDOW][row] += factors[8] * (of_frame0 + of_frame1)
    logits[SQUARES_PER_WINDOW:][row] += factors[9] * of_frame0
    logits[2 * SQUARES_PER_WINDOW :][row] += factors[9] * of_frame1


@instruction(add_feature_row, AS_GIVEN, INDEX, AS_GIVEN, INDEX, FLOAT, FLOAT, AS_GIVEN, INDEX, FLOAT, AS_GIVEN)
def _build_add_feature_row(code, squares, begin, cells, first, below, above, coefficients, number, floor, logits):
    builder = code.builder
    factors = [code.broadcast(coefficients.load(code.add(number, n), REAL), _SQUARES) for n in range(10)]
    shares, floor = [code.broadcast(share, _SQUARES) for share in (below, above)], code.broadcast(floor, _SQUARES)
    features = [squares.load(code.add(begin, n * SQUARES_PER_WINDOW), _SQUARES) for n in range(7)]
    rows = [
        cells.load(code.add(first, n * SQUARES_PER_ROW), _SQUARES) for n in (0, 1, CELLS_PER_ROW, CELLS_PER_ROW + 1)
    ]
    even = code.weighted_sum([*rows[:2], *features], [*shares, *factors[:7]])
    odd = code.weighted_sum([*rows[2:], builder.fsub(features[4], features[5])], [*shares, factors[7]])
    sides = [code.call("maxnum", change(even, odd), floor) for change in (builder.fadd, builder.fsub)]
    for n, value, factor in ((0, builder.fadd(*sides), 8), (1, sides[0], 9), (2, sides[1], 9)):
        place = code.add(begin, n * SQUARES_PER_WINDOW)
        logits.store(code.fma(factors[factor], value, logits.load(place, _SQUARES)), place)


def multiply_row(first, begin, second, here, out, target):
    """Write the products of sixteen values and sixteen others."""
    out[target : target + SQUARES_PER_ROW] = first[begin:][:SQUARES_PER_ROW] * second[here:][:SQUARES_PER_ROW]


@instruction(multiply_row, AS_GIVEN, INDEX, AS_GIVEN, INDEX, AS_GIVEN, INDEX)
def _build_multiply_row(code, first, begin, second, here, out, target):
    out.store(code.builder.fmul(first.load(begin, _SQUARES), second.load(here, _SQUARES)), target)


def distance_row(first, begin, second, here, out, target):
    """Write how far sixteen values and sixteen others are apart."""
    out[target : target + SQUARES_PER_ROW] = abs(first[begin:][:SQUARES_PER_ROW] - second[here:][:SQUARES_PER_ROW])


@instruction(distance_row, AS_GIVEN, INDEX, AS_GIVEN, INDEX, AS_GIVEN, INDEX)
def _build_distance_row(code, first, begin, second, here, out, target):
    out.store(code.call("fabs", code.builder.fsub(first.load(begin, _SQUARES), second.load(here, _SQUARES))), target)


def decay_row(values, begin, offset, factor, part, out, target):
    """Write ``part * exp(-x)``, accurate to a millionth, of sixteen values; x = offset + factor * value, from 0 to 60.

    It is a polynomial of x / 64, squared six times.
    """
    x = offset + factor * values[begin : begin + SQUARES_PER_ROW]
    x = x.clip(np.float32(0), np.float32(60)) * np.float32(1 / 64)
    power = np.float32(EXPONENTIAL[0])
    for coefficient in EXPONENTIAL[1:]:
        power = power * x + np.float32(coefficient)
    out[target : target + SQUARES_PER_ROW] = part * power**64


@instruction(decay_row, AS_GIVEN, INDEX, FLOAT, FLOAT, FLOAT, AS_GIVEN, INDEX)
def _build_decay_row(code, values, begin, offset, factor, part, out, target):
    multiply, fill = code.builder.fmul, lambda number: code.fill(number, _SQUARES)
    offset, factor, part = (code.broadcast(value, _SQUARES) for value in (offset, factor, part))
    x = code.fma(factor, values.load(begin, _SQUARES), offset)
    x = multiply(code.call("minnum", code.call("maxnum", x, fill(0)), fill(60)), fill(1 / 64))
    power = fill(EXPONENTIAL[0])
    for coefficient in EXPONENTIAL[1:]:
        power = code.fma(power, x, fill(coefficient))
    for _ in range(6):
        power = multiply(power, power)
    out.store(multiply(part, power), target)


def blend_rows(squares, near, far, out, target):
    """Write sixteen values interpolated a quarter of the way from the nearer to the farther row of squares."""
    out[target : target + SQUARES_PER_ROW] = _between(squares[near:][:SQUARES_PER_ROW], squares[far:][:SQUARES_PER_ROW])


@instruction(blend_rows, AS_GIVEN, INDEX, INDEX, AS_GIVEN, INDEX)
def _build_blend_rows(code, squares, near, far, out, target):
    out.store(_quarter_way(code, squares.load(near, _SQUARES), squares.load(far, _SQUARES)), target)


def upsample_rows(squares, near, far, out, target):
    """Write the values of 32 pixels interpolated between sixteen squares, horizontally by a quarter as well."""
    values = _between(squares[near:][:SQUARES_PER_ROW], squares[far:][:SQUARES_PER_ROW])
    out[target : target + PIXELS_PER_ROW : 2] = _between(values, np.append(values[:1], values[:-1]))
    out[target + 1 : target + PIXELS_PER_ROW : 2] = _between(values, np.append(values[1:], values[-1:]))


@instruction(upsample_rows, AS_GIVEN, INDEX, INDEX, AS_GIVEN, INDEX)
def _build_upsample_rows(code, squares, near, far, out, target):
    values, count = _quarter_way(code, squares.load(near, _SQUARES), squares.load(far, _SQUARES)), SQUARES_PER_ROW
    left = _quarter_way(code, values, code.choose(values, [max(place - 1, 0) for place in range(count)]))
    right = _quarter_way(code, values, code.choose(values, [min(place + 1, count - 1) for place in range(count)]))
    out.store(code.choose(left, [place // 2 + place % 2 * count for place in range(PIXELS_PER_ROW)], right), target)


def _between(near, far):
    """Return values a quarter of the way from near to far."""
    return np.float32(0.75) * near + np.float32(0.25) * far


def _quarter_way(code, near, far):
    """Return the vector for `_between`."""
    return code.fma(far, code.fill(0.25, _SQUARES), code.builder.fmul(near, code.fill(0.75, _SQUARES)))


class SplinePair(NamedTuple):
    """Spline coefficients of both frames at a window, `stride` per row, and the weights of its samples."""

    first: NDArray[Any]
    second: NDArray[Any]
    stride: int
    taps: NDArray[Any]
    """Horizontal and vertical weights in frame 0, then in frame 1, (16,) float32."""


def columns_mixer(columns: int) -> Callable[..., None]:
    """Return a function that samples this many columns of two windows, blends them and sums squared differences."""
    lanes = vector(REAL, columns)

    def mix_columns(pair, begin0, begin1, tall, t, wide, mixed, changes, distance, target):
        """Sample some columns of two windows, blend them, write their differences and add up the squares of these.

        The first of the sixteen coefficients of the first sample are at `begin0` and `begin1`; `t` is the weight of the
        second frame. The window has `tall` rows, `wide` apart in the output.
        """
        first, second, stride, taps = pair
        samples = []
        for source, begin, (across, down) in zip((first, second), (begin0, begin1), taps.reshape(2, 2, 4), strict=True):
            rows = np.array([source[begin + j * stride :][: columns + 3] for j in range(tall + 3)])
            filtered = sum(across[n] * rows[:, n : n + columns] for n in range(4))
            samples.append(sum(down[n] * filtered[n : n + tall] for n in range(4)))
        change = samples[1] - samples[0]
        for j in range(tall):
            place = slice(target + j * wide, target + j * wide + columns)
            distance[place] += change[j] * change[j]
            mixed[place], changes[place] = samples[0][j] + t * change[j], change[j]

    @instruction(mix_columns, AS_GIVEN, INDEX, INDEX, INDEX, FLOAT, INDEX, AS_GIVEN, AS_GIVEN, AS_GIVEN, INDEX)
    def build(code, pair, begin0, begin1, tall, t, wide, mixed, changes, distance, target):
        (first, second, stride, taps), builder = pair, code.builder
        share = code.broadcast(t, lanes)
        weights = [code.broadcast(taps.load(PLACE(number), REAL), lanes) for number in range(16)]
        begins = [cgutils.alloca_once_value(builder, begin) for begin in (begin0, begin1)]
        place = cgutils.alloca_once_value(builder, target)
        previous = [[cgutils.alloca_once(builder, lanes) for _ in range(3)] for _ in range(2)]

        def filter_row(frame):
            """Return the next row of a frame, filtered horizontally."""
            begin, source = builder.load(begins[frame]), (first, second)[frame]
            builder.store(builder.add(begin, stride), begins[frame])
            values = [source.load(code.add(begin, n), lanes) for n in range(4)]
            return code.weighted_sum(values, weights[8 * frame : 8 * frame + 4])

        for n in range(3):
            for frame in range(2):
                builder.store(filter_row(frame), previous[frame][n])
        with cgutils.for_range(builder, tall):
            samples = []
            for frame in range(2):
                rows = [*map(builder.load, previous[frame]), filter_row(frame)]
                for variable, row in zip(previous[frame], rows[1:], strict=True):
                    builder.store(row, variable)
                samples.append(code.weighted_sum(rows, weights[8 * frame + 4 : 8 * frame + 8]))
            at = builder.load(place)
            builder.store(builder.add(at, wide), place)
            change = builder.fsub(samples[1], samples[0])
            distance.store(code.fma(change, change, distance.load(at, lanes)), at)
            mixed.store(code.fma(share, change, samples[0]), at)
            changes.store(change, at)

    return mix_columns


mix_eight, mix_sixteen = columns_mixer(8), columns_mixer(16)
