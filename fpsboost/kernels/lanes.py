"""Operations on eight or sixteen values at once, for loops so short that the compiler would leave them scalar."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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

    @overload(filter_row)
    def compiled_filter(source, begin, step, w0, w1, w2, w3, out, target):
        def compiled(source, begin, step, w0, w1, w2, w3, out, target):
            in_vectors(source, begin, step, w0, w1, w2, w3, out, target)

        return compiled

    return filter_row


filter_eight, filter_sixteen = row_filter(EIGHT), row_filter(2 * EIGHT)


def extend_paths(x, y, energy, costs, total, here, before, room, slope, limit):
    """Extend the cheapest paths to the labels of a node by the labels of the next node.

    Parameters
    ----------
    x, y : (size,) float32
        Motion of all labels, pixels.
    energy : (size,) float32
        Cost of each label itself.
    costs : (size,) float32
        Cost of the cheapest path to each label, without that of the cheapest of its node; read at `before`, written at
        `here`.
    total : (size,) float32
        To which the costs of the paths to `here` are added.
    here, before : int
        Indices of the first label of both nodes; no bounds are checked.
    room : int
        Number of labels of a node, a multiple of EIGHT.
    slope, limit : float32
        Cost of a change of motion per pixel, and its maximum.
    """
    own, others = slice(here, here + room), range(before, before + room)
    changes = [abs(x[own] - x[other]) + abs(y[own] - y[other]) for other in others]
    reached = [costs[other] + np.minimum(slope * change, limit) for other, change in zip(others, changes, strict=True)]
    extended = energy[own] + np.min(reached, axis=0)
    costs[own] = extended - extended.min()
    total[own] += extended


@intrinsic
def _in_vectors(typing, x, y, energy, costs, total, here, before, room, slope, limit):
    """Run `extend_paths` in vector instructions."""
    place, number = types.int64, types.float32
    return types.void(x, y, energy, costs, total, place, place, place, number, number), _emit_extension


def _emit_extension(context, builder, signature, arguments):
    x, y, energy, costs, total = (
        partial(address_of, context, builder, kind, array)
        for kind, array in zip(signature.args[:5], arguments[:5], strict=True)
    )
    here, before, room, slope, limit = arguments[5:]
    fabs = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.fabs.v{EIGHT}f32")
    slopes, limits = broadcast_value(builder, slope, _VECTOR), broadcast_value(builder, limit, _VECTOR)
    groups = builder.udiv(room, ir.Constant(room.type, EIGHT))

    def load(array, place):
        return builder.load(array(place, _VECTOR), align=4)

    def of_each_lane(array, place):
        return broadcast_value(builder, builder.load(array(place, ir.FloatType())), _VECTOR)

    def smaller(first, second):
        return builder.select(builder.fcmp_ordered("<", second, first), second, first)

    def lower(variable, value):
        builder.store(smaller(builder.load(variable), value), variable)

    def along(first, group):
        return builder.add(first, builder.mul(group, ir.Constant(group.type, EIGHT)))

    highest = ir.Constant(_VECTOR, [float(np.finfo(np.float32).max)] * EIGHT)
    lowest, cheapest = (cgutils.alloca_once_value(builder, highest) for _ in range(2))
    builder.store(highest, lowest)
    with cgutils.for_range(builder, groups) as own:
        at = along(here, own.index)
        dx, dy = load(x, at), load(y, at)
        builder.store(highest, cheapest)
        with cgutils.for_range(builder, groups) as others:
            for lane in range(EIGHT):
                other = builder.add(along(before, others.index), ir.Constant(before.type, lane))
                across, down = (
                    builder.call(fabs, [builder.fsub(d, of_each_lane(axis, other))]) for d, axis in ((dx, x), (dy, y))
                )
                price = smaller(limits, builder.fmul(slopes, builder.fadd(across, down)))
                lower(cheapest, builder.fadd(of_each_lane(costs, other), price))
        extended = builder.fadd(load(energy, at), builder.load(cheapest))
        lower(lowest, extended)
        builder.store(extended, costs(at, _VECTOR), align=4)
        builder.store(builder.fadd(load(total, at), extended), total(at, _VECTOR), align=4)
    least = builder.load(lowest)
    for distance in (4, 2, 1):  # afterwards every lane holds the least of all
        turned = ir.Constant(ir.VectorType(ir.IntType(32), EIGHT), [lane ^ distance for lane in range(EIGHT)])
        least = smaller(least, builder.shuffle_vector(least, least, turned))
    with cgutils.for_range(builder, groups) as own:
        at = along(here, own.index)
        builder.store(builder.fsub(load(costs, at), least), costs(at, _VECTOR), align=4)
    return context.get_dummy_value()


@overload(extend_paths)
def _compiled_extension(x, y, energy, costs, total, here, before, room, slope, limit):
    """Return the implementation of `extend_paths` within kernels."""

    def compiled(x, y, energy, costs, total, here, before, room, slope, limit):
        _in_vectors(x, y, energy, costs, total, here, before, room, slope, limit)

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
