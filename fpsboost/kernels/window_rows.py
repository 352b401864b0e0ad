"""Vector instructions for rows of the windows of `fpsboost.kernels.multi_hypothesis`.

The loops are so short that the compiler would leave them scalar. A row has 16 squares of two by two pixels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from llvmlite import ir

from fpsboost.kernels.jit import cgutils, intrinsic, overload, types
from fpsboost.kernels.lanes import address_of, broadcast_value

SQUARES_PER_ROW = 16
"""Number of squares across a window: one for two pixels, as for subsampled chroma. Each square has one weight: weights
are means over patches, which vary slowly."""

PIXELS_PER_ROW = 2 * SQUARES_PER_ROW
"""Pixels per row."""

END_WEIGHT = 0.75
"""Weight of the first and the last of five squares: equivalent to sums over patches of nine pixels around each
pixel."""

_INDEX = ir.IntType(32)
_SQUARES, _PIXELS = ir.VectorType(ir.FloatType(), SQUARES_PER_ROW), ir.VectorType(ir.FloatType(), PIXELS_PER_ROW)


def sum_five(source, begin, step, out, target):
    """Write ``E s[0] + s[1] + s[2] + s[3] + E s[4]`` of sixteen values, where E is END_WEIGHT.

    ``s[n]`` begins `n` steps on.

    No bounds are checked in this module; see `fpsboost.kernels.lanes.row_filter`.
    """
    taps = [source[begin + n * step :][:SQUARES_PER_ROW] for n in range(5)]
    out[target : target + SQUARES_PER_ROW] = (taps[1] + taps[2] + taps[3]) + np.float32(END_WEIGHT) * (
        taps[0] + taps[4]
    )


def pool_row(values, begin, below, share, sums, target):
    """Add `share` times the sum over the pixels of each of sixteen squares to the sums of the squares.

    Parameters
    ----------
    values : (size,) float32
    begin, below : int
        Index of the first pixel of the upper row, and distance to that of the lower row.
    share : float32
    sums : (size,) float32
        Updated in place.
    target : int
        Index of the first square.
    """
    both = values[begin : begin + PIXELS_PER_ROW] + values[begin + below :][:PIXELS_PER_ROW]
    sums[target : target + SQUARES_PER_ROW] += share * (both[::2] + both[1::2])


def add_row(weights, begin, values, here, sums, there):
    """Add sixteen values times their weights to the sums.

    Parameters
    ----------
    weights, values : (size,) float32
    begin, here, there : int
        Indices of the first weight, value and sum.
    sums : (size,) float32
        Updated in place.
    """
    sums[there : there + SQUARES_PER_ROW] += (
        weights[begin : begin + SQUARES_PER_ROW] * values[here : here + SQUARES_PER_ROW]
    )


def blend_rows(squares, near, far, out, target):
    """Write sixteen values interpolated a quarter of the way between two rows of squares.

    Parameters
    ----------
    squares : (size,) float32
    near, far : int
        Indices of the first square of the nearer and of the farther row.
    out : (size,) float32 out
    target : int
        Index of the first of the sixteen values.
    """
    out[target : target + SQUARES_PER_ROW] = _between(squares[near:][:SQUARES_PER_ROW], squares[far:][:SQUARES_PER_ROW])


def upsample_rows(squares, near, far, out, target):
    """Write the values of 32 pixels interpolated between sixteen squares, horizontally by a quarter as well."""
    values = _between(squares[near:][:SQUARES_PER_ROW], squares[far:][:SQUARES_PER_ROW])
    out[target : target + PIXELS_PER_ROW : 2] = _between(values, np.append(values[:1], values[:-1]))
    out[target + 1 : target + PIXELS_PER_ROW : 2] = _between(values, np.append(values[1:], values[-1:]))


def _between(near, far):
    return np.float32(0.75) * near + np.float32(0.25) * far


class _Rows:
    """Loads, stores and operations on vectors of the arrays that an intrinsic receives."""

    def __init__(self, context, builder, signature, arguments):
        self.context, self.builder, self.kinds, self.arguments = context, builder, signature.args, arguments

    def place(self, number, index, vector):
        return address_of(self.context, self.builder, self.kinds[number], self.arguments[number], index, vector)

    def load(self, number, index, vector=_SQUARES):
        return self.builder.load(self.place(number, index, vector), align=4)

    def store(self, values, number, index):
        self.builder.store(values, self.place(number, index, values.type), align=4)

    def fma(self, first, second, third):
        kind = ir.FunctionType(first.type, [first.type] * 3)
        name = f"llvm.fma.v{first.type.count}f32"
        return self.builder.call(
            cgutils.get_or_insert_function(self.builder.module, kind, name), [first, second, third]
        )

    def chosen(self, values, places, further=None):
        """Return the values at the given positions; positions in `further` are counted after those in `values`."""
        mask = ir.Constant(ir.VectorType(_INDEX, len(places)), list(places))
        return self.builder.shuffle_vector(values, values if further is None else further, mask)

    def between(self, near, far):
        """Return the value a quarter of the way from near to far."""
        nearer, farther = (ir.Constant(near.type, [share] * near.type.count) for share in (0.75, 0.25))
        return self.fma(far, farther, self.builder.fmul(near, nearer))


@intrinsic
def _sum_five(typing, source, begin, step, out, target):
    def emit(context, builder, signature, arguments):
        rows, (_, begin, step, _, target) = _Rows(context, builder, signature, arguments), arguments
        taps = []
        for _ in range(5):
            taps.append(rows.load(0, begin))
            begin = builder.add(begin, step)
        near, far = builder.fadd(builder.fadd(taps[1], taps[2]), taps[3]), builder.fadd(taps[0], taps[4])
        rows.store(rows.fma(far, ir.Constant(_SQUARES, [END_WEIGHT] * SQUARES_PER_ROW), near), 3, target)
        return context.get_dummy_value()

    return types.void(source, types.int64, types.int64, out, types.int64), emit


@intrinsic
def _pool_row(typing, values, begin, below, share, sums, target):
    def emit(context, builder, signature, arguments):
        rows, (_, begin, below, share, _, target) = _Rows(context, builder, signature, arguments), arguments
        upper, lower = rows.load(0, begin, _PIXELS), rows.load(0, builder.add(begin, below), _PIXELS)
        both = builder.fadd(upper, lower)
        pooled = builder.fadd(
            rows.chosen(both, range(0, PIXELS_PER_ROW, 2)), rows.chosen(both, range(1, PIXELS_PER_ROW, 2))
        )
        rows.store(rows.fma(broadcast_value(builder, share, _SQUARES), pooled, rows.load(4, target)), 4, target)
        return context.get_dummy_value()

    return types.void(values, types.int64, types.int64, types.float32, sums, types.int64), emit


@intrinsic
def _add_row(typing, weights, begin, values, here, sums, there):
    def emit(context, builder, signature, arguments):
        rows, (_, begin, _, here, _, there) = _Rows(context, builder, signature, arguments), arguments
        rows.store(rows.fma(rows.load(0, begin), rows.load(2, here), rows.load(4, there)), 4, there)
        return context.get_dummy_value()

    return types.void(weights, types.int64, values, types.int64, sums, types.int64), emit


@intrinsic
def _blend_rows(typing, squares, near, far, out, target):
    def emit(context, builder, signature, arguments):
        rows, (_, near, far, _, target) = _Rows(context, builder, signature, arguments), arguments
        rows.store(rows.between(rows.load(0, near), rows.load(0, far)), 3, target)
        return context.get_dummy_value()

    return types.void(squares, types.int64, types.int64, out, types.int64), emit


@intrinsic
def _spread_rows(typing, squares, near, far, out, target):
    def emit(context, builder, signature, arguments):
        rows, (_, near, far, _, target) = _Rows(context, builder, signature, arguments), arguments
        values, last = rows.between(rows.load(0, near), rows.load(0, far)), SQUARES_PER_ROW - 1
        left = rows.between(values, rows.chosen(values, [max(place - 1, 0) for place in range(SQUARES_PER_ROW)]))
        right = rows.between(values, rows.chosen(values, [min(place + 1, last) for place in range(SQUARES_PER_ROW)]))
        rows.store(
            rows.chosen(left, [place // 2 + place % 2 * SQUARES_PER_ROW for place in range(PIXELS_PER_ROW)], right),
            3,
            target,
        )
        return context.get_dummy_value()

    return types.void(squares, types.int64, types.int64, out, types.int64), emit


@overload(sum_five)
def _compiled_sum(source, begin, step, out, target):
    def compiled(source, begin, step, out, target):
        _sum_five(source, begin, step, out, target)

    return compiled


@overload(pool_row)
def _compiled_pool(values, begin, below, share, sums, target):
    def compiled(values, begin, below, share, sums, target):
        _pool_row(values, begin, below, share, sums, target)

    return compiled


@overload(add_row)
def _compiled_add(weights, begin, values, here, sums, there):
    def compiled(weights, begin, values, here, sums, there):
        _add_row(weights, begin, values, here, sums, there)

    return compiled


@overload(blend_rows)
def _compiled_blend(squares, near, far, out, target):
    def compiled(squares, near, far, out, target):
        _blend_rows(squares, near, far, out, target)

    return compiled


@overload(upsample_rows)
def _compiled_spread(squares, near, far, out, target):
    def compiled(squares, near, far, out, target):
        _spread_rows(squares, near, far, out, target)

    return compiled


def columns_mixer(columns: int) -> Callable[..., None]:  # noqa: C901 (all its parts depend on the columns)
    """Return a function that samples this many columns of two windows, blends them and sums squared differences."""
    vector = ir.VectorType(ir.FloatType(), columns)

    def mix_columns(first, begin0, second, begin1, stride, tall, taps, t, wide, mixed, distance, target):
        """Sample some columns of two windows, blend them and add up their squared differences.

        Parameters
        ----------
        first, second : (size,) float32
            Spline coefficients of both frames.
        begin0, begin1 : int
            Index of the first of the sixteen coefficients of the first sample, in each frame.
        stride : int
            Distance between rows of coefficients.
        tall, wide : int
            Rows of the window, and distance between its rows in the output.
        taps : (16,) float32
            Horizontal and vertical weights in the first frame, then in the second.
        t : float32
            Weight of the second frame.
        mixed : (size,) float32 out
        distance : (size,) float32
            Sums of squared differences; updated in place.
        target : int
            Index of the first column in both.
        """
        samples = []
        for source, begin, (across, down) in zip((first, second), (begin0, begin1), taps.reshape(2, 2, 4), strict=True):
            rows = np.array([source[begin + j * stride :][: columns + 3] for j in range(tall + 3)])
            filtered = sum(across[n] * rows[:, n : n + columns] for n in range(4))
            samples.append(sum(down[n] * filtered[n : n + tall] for n in range(4)))
        apart = samples[1] - samples[0]
        for j in range(tall):
            place = slice(target + j * wide, target + j * wide + columns)
            distance[place] += apart[j] * apart[j]
            mixed[place] = samples[0][j] + t * apart[j]

    @intrinsic
    def in_vectors(typing, first, begin0, second, begin1, stride, tall, taps, t, wide, mixed, distance, target):
        place, number = types.int64, types.float32
        kinds = first, place, second, place, place, place, taps, number, place, mixed, distance, place

        def emit(context, builder, signature, arguments):
            rows = _Rows(context, builder, signature, arguments)
            _, begin0, _, begin1, stride, tall, _, t, wide, _, _, target = arguments
            share = broadcast_value(builder, t, vector)

            def tap(number):
                weight = rows.load(6, ir.Constant(begin0.type, number), ir.FloatType())
                return broadcast_value(builder, weight, vector)

            weights = [tap(number) for number in range(16)]

            def weighted(values, numbers):
                sums = builder.fmul(values[0], weights[numbers[0]])
                for value, number in zip(values[1:], numbers[1:], strict=True):
                    sums = rows.fma(value, weights[number], sums)
                return sums

            places = [cgutils.alloca_once_value(builder, each) for each in (begin0, begin1, target)]
            held = [[cgutils.alloca_once(builder, vector) for _ in range(3)] for _ in range(2)]

            def filtered(frame):
                """Return the next row of a frame, filtered horizontally."""
                begin = builder.load(places[frame])
                builder.store(builder.add(begin, stride), places[frame])
                taken = [builder.add(begin, ir.Constant(begin.type, n)) for n in range(4)]
                values = [rows.load(2 * frame, place, vector) for place in taken]
                return weighted(values, range(8 * frame, 8 * frame + 4))

            for n in range(3):
                for frame in range(2):
                    builder.store(filtered(frame), held[frame][n])
            with cgutils.for_range(builder, tall):
                samples = []
                for frame in range(2):
                    known = [builder.load(each) for each in held[frame]]
                    known.append(filtered(frame))
                    for each, value in zip(held[frame], known[1:], strict=True):
                        builder.store(value, each)
                    samples.append(weighted(known, range(8 * frame + 4, 8 * frame + 8)))
                at = builder.load(places[2])
                builder.store(builder.add(at, wide), places[2])
                apart = builder.fsub(samples[1], samples[0])
                rows.store(rows.fma(apart, apart, rows.load(10, at, vector)), 10, at)
                rows.store(rows.fma(share, apart, samples[0]), 9, at)
            return context.get_dummy_value()

        return types.void(*kinds), emit

    @overload(mix_columns)
    def compiled_mix(first, begin0, second, begin1, stride, tall, taps, t, wide, mixed, distance, target):
        def compiled(first, begin0, second, begin1, stride, tall, taps, t, wide, mixed, distance, target):
            in_vectors(first, begin0, second, begin1, stride, tall, taps, t, wide, mixed, distance, target)

        return compiled

    return mix_columns


mix_eight, mix_sixteen = columns_mixer(8), columns_mixer(16)
