"""Operations on eight or sixteen values at once, for loops so short that the compiler would leave them scalar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir

from fpsboost.kernels.jit import cgutils, intrinsic, overload, types

EIGHT = 8
"""Pixels per vector."""

_VECTOR = ir.VectorType(ir.FloatType(), EIGHT)


def row_filter(length: int) -> Callable[..., None]:
    """Return a function that applies a four-tap filter to `length` values of a row."""
    vector = ir.VectorType(ir.FloatType(), length)
    fma_type = ir.FunctionType(vector, [vector] * 3)

    def filter_row(source, begin, step, w0, w1, w2, w3, out, target):
        """Write ``w0 s[0] + w1 s[1] + w2 s[2] + w3 s[3]`` of `length` values, where ``s[n]`` begins `n` steps on.

        Parameters
        ----------
        source : (size,) float32
        begin, step : int
            Index of the first value, and distance between taps; no bounds are checked.
        w0, w1, w2, w3 : float32
        out : (size,) float32 out
        target : int
            Index of the first value.
        """
        taps = [source[begin + n * step :][:length] for n in range(4)]
        out[target : target + length] = w0 * taps[0] + w1 * taps[1] + w2 * taps[2] + w3 * taps[3]

    def emit(context, builder, signature, arguments):
        source, begin, step, *weights, out, target = arguments
        fma = cgutils.get_or_insert_function(builder.module, fma_type, f"llvm.fma.v{length}f32")
        sums = None
        for weight in weights:
            values = builder.load(address_of(context, builder, signature.args[0], source, begin, vector), align=4)
            broadcast = broadcast_value(builder, weight, vector)
            sums = builder.fmul(values, broadcast) if sums is None else builder.call(fma, [values, broadcast, sums])
            begin = builder.add(begin, step)
        builder.store(sums, address_of(context, builder, signature.args[7], out, target, vector), align=4)
        return context.get_dummy_value()

    @intrinsic
    def in_vectors(typing, source, begin, step, w0, w1, w2, w3, out, target):
        return types.void(source, types.int64, types.int64, *(types.float32,) * 4, out, types.int64), emit

    @overload(filter_row, inline="always")
    def compiled_filter(source, begin, step, w0, w1, w2, w3, out, target):
        def compiled(source, begin, step, w0, w1, w2, w3, out, target):
            in_vectors(source, begin, step, w0, w1, w2, w3, out, target)

        return compiled

    return filter_row


filter_eight, filter_sixteen = row_filter(EIGHT), row_filter(2 * EIGHT)


def relax_eight(x, y, here, before, costs, least, slope, limit, cheapest, at):
    """Lower the costs of eight labels to the cost of the cheapest transition from one of eight other labels.

    Parameters
    ----------
    x, y : (size,) float32
        Motion of all labels, pixels.
    here, before : int
        Indices of the first of the eight labels and of the eight other labels; no bounds are checked.
    costs : (size,) float32
        Costs of the other labels, from index `before` on.
    least : float32
        Amount subtracted from these costs.
    slope, limit : float32
        Cost of a change of motion per pixel, and its maximum.
    cheapest : (size,) float32
        Least costs so far; updated in place.
    at : int
        Index of the first of the eight labels in `cheapest`.
    """
    for other in range(before, before + EIGHT):
        change = abs(x[here : here + EIGHT] - x[other]) + abs(y[here : here + EIGHT] - y[other])
        reached = costs[other] - least + np.minimum(slope * change, limit)
        cheapest[at : at + EIGHT] = np.minimum(cheapest[at : at + EIGHT], reached)


@intrinsic
def _vector_relax(typing, x, y, here, before, costs, least, slope, limit, cheapest, at):
    """Run `relax_eight` in vector instructions."""
    place, number = types.int64, types.float32
    return types.void(x, y, place, place, costs, number, number, number, cheapest, place), _emit_relax


def _emit_relax(context, builder, signature, arguments):
    x, y, here, before, costs, least, slope, limit, cheapest, at = arguments
    kind_x, kind_y, kind_costs, kind_cheapest = (signature.args[k] for k in (0, 1, 4, 8))
    fabs = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.fabs.v{EIGHT}f32")

    def load(kind, array, place):
        return builder.load(address_of(context, builder, kind, array, place, _VECTOR), align=4)

    def number(kind, array, place):
        return builder.load(address_of(context, builder, kind, array, place, ir.FloatType()))

    def smaller(first, second):
        return builder.select(builder.fcmp_ordered("<", second, first), second, first)

    dx, dy, best = load(kind_x, x, here), load(kind_y, y, here), load(kind_cheapest, cheapest, at)
    slopes, limits = broadcast_value(builder, slope, _VECTOR), broadcast_value(builder, limit, _VECTOR)
    for _ in range(EIGHT):
        across = builder.fsub(dx, broadcast_value(builder, number(kind_x, x, before), _VECTOR))
        down = builder.fsub(dy, broadcast_value(builder, number(kind_y, y, before), _VECTOR))
        change = builder.fadd(builder.call(fabs, [across]), builder.call(fabs, [down]))
        cost = builder.fsub(number(kind_costs, costs, before), least)
        price = smaller(limits, builder.fmul(slopes, change))
        best = smaller(best, builder.fadd(broadcast_value(builder, cost, _VECTOR), price))
        before = builder.add(before, ir.Constant(before.type, 1))
    builder.store(best, address_of(context, builder, kind_cheapest, cheapest, at, _VECTOR), align=4)
    return context.get_dummy_value()


@overload(relax_eight, inline="always")
def _compiled_relax(x, y, here, before, costs, least, slope, limit, cheapest, at):
    """Return the implementation of `relax_eight` within kernels."""

    def compiled(x, y, here, before, costs, least, slope, limit, cheapest, at):
        _vector_relax(x, y, here, before, costs, least, slope, limit, cheapest, at)

    return compiled


def address_of(context, builder, kind, array, index, element):
    """Return the address of an element of a flat array of type `kind` as a pointer to the LLVM type `element`."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def vector_at(builder, row, index, vector):
    """Return the address of a vector in a row."""
    return builder.bitcast(builder.gep(row, [index]), vector.as_pointer())


def broadcast_value(builder, value, vector):
    """Return a vector of type `vector` with the same value in all lanes."""
    integer = ir.IntType(32)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(integer, 0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(integer, vector.count), [0] * vector.count))


class Loop:
    """A loop that works on several vectors at a time, each at another stage."""

    def __init__(self, builder: ir.IRBuilder) -> None:
        self._builder, self._before = builder, builder.block
        self._body, self._end = (builder.append_basic_block(name) for name in ("row", "row.end"))
        builder.branch(self._body)
        builder.position_at_end(self._body)

    def carry(self, first: Any) -> Any:
        """Return a value that is `first` in the first round, and then what `follow` says."""
        self._builder.position_at_start(self._body)
        phi = self._builder.phi(first.type)
        phi.add_incoming(first, self._before)
        self._builder.position_at_end(self._body)
        return phi

    def follow(self, phi: Any, value: Any) -> None:
        """Set what a value is in the next round."""
        phi.add_incoming(value, self._body)

    def later(self, value: Any, rounds: int = 1) -> Any:
        """Return what a value was some rounds before, zero in the first ones."""
        for _ in range(rounds):
            phi = self.carry(ir.Constant(value.type, None))
            self.follow(phi, value)
            value = phi
        return value

    def end(self, again: Any) -> None:
        """End the loop unless `again`."""
        self._builder.cbranch(again, self._body, self._end)
        self._builder.position_at_end(self._end)
