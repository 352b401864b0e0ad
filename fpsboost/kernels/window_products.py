"""Sums of a least-squares step over a window: products of gradients and temporal differences, eight pixels at once.

Values are integers until they are multiplied: a gradient is the difference of two levels in each frame.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir

from fpsboost.kernels.jit import cgutils, intrinsic, overload, types
from fpsboost.kernels.lanes import address_of, broadcast_value

WINDOW_SIDE = 8
"""Side of the window, pixels."""

PRODUCT_COUNT = 6
"""Number of sums: gradients along x and y: xx, xy, yy; gradients and temporal difference: xt, yt; temporal difference:
tt."""

_READ = 16
_BYTES, _WORDS = ir.VectorType(ir.IntType(8), _READ), ir.VectorType(ir.IntType(16), _READ)
_INTEGERS, _FLOATS = ir.VectorType(ir.IntType(32), WINDOW_SIDE), ir.VectorType(ir.FloatType(), WINDOW_SIDE)


def window_products(first, start0, second, start1, stride, plane, tail, sums):
    """Sum the products of a window's pixels, each weighted by its similarity, ``(1 + tail tt)^-4``.

    Parameters
    ----------
    first, second : (size,) uint8
        Three planes of both frames.
    start0, start1 : int
        Index of the pixel above and to the left of the window's first one, in the first plane; no bounds are checked.
    stride, plane : int
        Distances between rows and between planes.
    tail : float32
        Rate at which the weight of a pixel falls with tt.
    sums : (PRODUCT_COUNT,) float32 out
        Gradients are sums of four one-pixel differences: over two pixels, in both frames.
    """
    products = np.zeros((PRODUCT_COUNT, WINDOW_SIDE, WINDOW_SIDE), np.float32)
    for c in range(3):
        windows = []
        for frame, start in ((first, start0), (second, start1)):
            rows = [frame[start + c * plane + j * stride :][: WINDOW_SIDE + 2] for j in range(WINDOW_SIDE + 2)]
            windows.append(np.array(rows).astype(np.float32))
        both, change = windows[0] + windows[1], (windows[1] - windows[0])[1:-1, 1:-1]
        along_x, along_y = both[1:-1, 2:] - both[1:-1, :-2], both[2:, 1:-1] - both[:-2, 1:-1]
        factors = (along_x, along_x), (along_x, along_y), (along_y, along_y)
        for k, (one, other) in enumerate((*factors, (along_x, change), (along_y, change), (change, change))):
            products[k] += one * other
    weights = (1 + tail * products[-1]) ** -4
    sums[:] = (weights * products).sum(axis=(1, 2))


@intrinsic
def _window_products(typing, first, start0, second, start1, stride, plane, tail, sums):
    """Run `window_products` in vector instructions."""
    place = types.int64
    return types.void(first, place, second, place, place, place, types.float32, sums), _emit


def _emit(context, builder, signature, arguments):
    first, start0, second, start1, stride, plane, tail, sums = arguments
    fma = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_FLOATS, [_FLOATS] * 3), f"llvm.fma.v{WINDOW_SIDE}f32"
    )

    def constant(number):
        return ir.Constant(_FLOATS, [number] * WINDOW_SIDE)

    def levels(number, array, place):
        loaded = builder.load(address_of(context, builder, signature.args[number], array, place, _BYTES), align=1)
        return builder.zext(loaded, _WORDS)

    def from_place(words, place):
        places = ir.Constant(ir.VectorType(ir.IntType(32), WINDOW_SIDE), list(range(place, place + WINDOW_SIDE)))
        return builder.shuffle_vector(words, words, places)

    def as_floats(words):
        return builder.sitofp(builder.sext(words, _INTEGERS), _FLOATS)

    def rows(start0, start1):
        """Return sums and differences of both frames in a plane, from the row above the window to the one below."""
        taken = []
        for _ in range(WINDOW_SIDE + 2):
            one, other = levels(0, first, start0), levels(2, second, start1)
            taken.append((builder.add(one, other), builder.sub(other, one)))
            start0, start1 = builder.add(start0, stride), builder.add(start1, stride)
        return taken

    planes = []
    for _ in range(3):
        planes.append(rows(start0, start1))
        start0, start1 = builder.add(start0, plane), builder.add(start1, plane)
    tails, totals = broadcast_value(builder, tail, _FLOATS), [constant(0.0)] * PRODUCT_COUNT
    for j in range(1, WINDOW_SIDE + 1):
        products = [None] * PRODUCT_COUNT
        for taken in planes:
            (above, _), (here, change), (below, _) = taken[j - 1 : j + 2]
            x = as_floats(builder.sub(from_place(here, 2), from_place(here, 0)))
            y = as_floats(builder.sub(from_place(below, 1), from_place(above, 1)))
            t = as_floats(from_place(change, 1))
            for k, (one, other) in enumerate(((x, x), (x, y), (y, y), (x, t), (y, t), (t, t))):
                so_far = products[k]
                products[k] = builder.fmul(one, other) if so_far is None else builder.call(fma, [one, other, so_far])
        falls = builder.call(fma, [products[-1], tails, constant(1.0)])
        falls = builder.fmul(falls, falls)
        weights = builder.fdiv(constant(1.0), builder.fmul(falls, falls))
        totals = [builder.call(fma, [weights, each, total]) for each, total in zip(products, totals, strict=True)]
    for k, total in enumerate(totals):
        place = ir.Constant(start0.type, k)
        address = address_of(context, builder, signature.args[7], sums, place, ir.FloatType())
        builder.store(_horizontal_sum(builder, total), address)
    return context.get_dummy_value()


def _horizontal_sum(builder, values):
    """Return the sum of a vector's elements, by repeated halving."""
    length = values.type.count
    while length > 1:
        length //= 2
        index = ir.VectorType(ir.IntType(32), length)
        lower, upper = (
            builder.shuffle_vector(values, values, ir.Constant(index, list(range(start, start + length))))
            for start in (0, length)
        )
        values = builder.fadd(lower, upper)
    return builder.extract_element(values, ir.Constant(ir.IntType(32), 0))


@overload(window_products)
def _compiled(first, start0, second, start1, stride, plane, tail, sums):
    """Return the implementation of `window_products` within kernels."""

    def compiled(first, start0, second, start1, stride, plane, tail, sums):
        _window_products(first, start0, second, start1, stride, plane, tail, sums)

    return compiled
