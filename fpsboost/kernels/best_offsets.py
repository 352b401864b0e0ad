"""Best offsets so far, compared with four more, in the processor's own instructions."""

from __future__ import annotations

from llvmlite import ir

from fpsboost.kernels.jit import intrinsic, overload, types
from fpsboost.kernels.lanes import EIGHT, Loop, address_of, broadcast_value, vector_at

_INTEGERS = ir.VectorType(ir.IntType(32), EIGHT)

OUTSIDE = 16
"""Totals on either side of the candidates that may be compared with them: the rest of a vector, and as the four offsets
of a comparison do not lead from the same pixels."""


def keep_best_of_four(totals, at, apart, ranks, first, best, winners, place, count):
    """Update `best` and `winners` where one of four totals is larger than `best`, or equal at a lower rank.

    Parameters
    ----------
    totals : (values,) int32 or float32
    at, apart : int
        Index of the first total of the first offset, and distance to those of the next; no bounds are
        checked.
    ranks : (offsets,) int32
    first : int
        Index of the first of four ranks, which increase.
    best, winners : (values,) int32 or float32, (values,) int32
        Largest totals so far and their ranks; updated in place.
    place : int
        Index of the first.
    count : int
        Pixels, at least one; as many more as fill the last vector are compared, too.
    """
    for x in range(-(-count // EIGHT) * EIGHT):
        value, rank = totals[at + x], ranks[first]
        for which in range(1, 4):
            if totals[at + which * apart + x] > value:
                value, rank = totals[at + which * apart + x], ranks[first + which]
        if value > best[place + x] or (value == best[place + x] and rank < winners[place + x]):
            best[place + x], winners[place + x] = value, rank


@intrinsic
def _keep_best_of_four(typing, totals, at, apart, ranks, first, best, winners, place, count):
    """Run `keep_best_of_four` in vector instructions."""
    index = types.int64
    return types.void(totals, index, index, ranks, index, best, winners, index, index), _emit_keep_best


def _emit_keep_best(context, builder, signature, arguments):
    totals, at, apart, ranks, first, best, winners, place, count = arguments
    kind, kind_best, kind_winners = (signature.args[k] for k in (0, 5, 6))
    whole = isinstance(kind.dtype, types.Integer)
    vector = _INTEGERS if whole else ir.VectorType(ir.FloatType(), EIGHT)
    compare = builder.icmp_signed if whole else builder.fcmp_ordered

    def larger(one, other):
        """Return which of two pairs of totals and ranks has the larger total, the first if they are equal."""
        swap = compare(">", other[0], one[0])
        return tuple(builder.select(swap, second, first) for first, second in zip(one, other, strict=True))

    rows, numbers = [], []
    for _ in range(4):
        rank = builder.load(address_of(context, builder, signature.args[3], ranks, first, ir.IntType(32)))
        rows.append(address_of(context, builder, kind, totals, at, vector.element))
        numbers.append(broadcast_value(builder, rank, _INTEGERS))
        at, first = builder.add(at, apart), builder.add(first, ir.Constant(first.type, 1))
    best_row = address_of(context, builder, kind_best, best, place, vector.element)
    winners_row = address_of(context, builder, kind_winners, winners, place, ir.IntType(32))
    loop = Loop(builder)
    x = loop.carry(ir.Constant(count.type, 0))
    offsets = [
        (builder.load(vector_at(builder, row, x, vector), align=4), number)
        for row, number in zip(rows, numbers, strict=True)
    ]
    value, rank = larger(larger(*offsets[:2]), larger(*offsets[2:]))
    best_place, winners_place = vector_at(builder, best_row, x, vector), vector_at(builder, winners_row, x, _INTEGERS)
    previous, winner = builder.load(best_place, align=4), builder.load(winners_place, align=4)
    lower = builder.icmp_signed("<", rank, winner)
    better = builder.or_(compare(">", value, previous), builder.and_(compare("==", value, previous), lower))
    builder.store(builder.select(compare(">", value, previous), value, previous), best_place, align=4)
    builder.store(builder.select(better, rank, winner), winners_place, align=4)
    following = builder.add(x, ir.Constant(count.type, EIGHT))
    loop.follow(x, following)
    loop.end(builder.icmp_signed("<", following, count))
    return context.get_dummy_value()


@overload(keep_best_of_four, inline="always")
def _compiled_keep_best(totals, at, apart, ranks, first, best, winners, place, count):
    """Return the implementation of `keep_best_of_four` within kernels."""

    def compiled(totals, at, apart, ranks, first, best, winners, place, count):
        _keep_best_of_four(totals, at, apart, ranks, first, best, winners, place, count)

    return compiled


def hide_outside(totals, first, last):
    """Set `OUTSIDE` totals on either side of the candidates to -1, which never wins.

    Parameters
    ----------
    totals : (values,) int32 or float32
    first, last : int
        Index of the first candidate, and that after the last one; no bounds are checked.
    """
    totals[first - OUTSIDE : first] = totals[last : last + OUTSIDE] = -1


@intrinsic
def _hide_outside(typing, totals, first, last):
    """Run `hide_outside` in vector instructions."""
    return types.void(totals, types.int64, types.int64), _emit_hide_outside


def _emit_hide_outside(context, builder, signature, arguments):
    totals, first, last = arguments
    vector = ir.VectorType(context.get_data_type(signature.args[0].dtype), OUTSIDE)
    for index in (builder.sub(first, ir.Constant(first.type, OUTSIDE)), last):
        place = address_of(context, builder, signature.args[0], totals, index, vector)
        builder.store(ir.Constant(vector, [-1] * OUTSIDE), place, align=4)
    return context.get_dummy_value()


@overload(hide_outside, inline="always")
def _compiled_hide_outside(totals, first, last):
    """Return the implementation of `hide_outside` within kernels."""

    def compiled(totals, first, last):
        _hide_outside(totals, first, last)

    return compiled
