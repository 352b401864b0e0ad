"""Prefetch instruction for data that is read soon: hardware prefetchers do not detect small windows of many rows."""

from __future__ import annotations

from llvmlite import ir

from fpsboost.kernels.jit import intrinsic, overload, types
from fpsboost.kernels.lanes import address_of


def prefetch(flat, place):
    """Prefetch the cache line of an element of a flat array; the result is unchanged, and no bounds are checked."""


@intrinsic
def _instruction(typing, flat, place):
    """Emit the processor's prefetch instruction."""
    return types.void(flat, place), _emit


def _emit(context, builder, signature, arguments):
    address = address_of(context, builder, signature.args[0], *arguments, ir.IntType(8))
    integer = ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [address.type, integer, integer, integer])
    function = builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
    to_read, keep, data = integer(0), integer(3), integer(1)
    builder.call(function, [address, to_read, keep, data])
    return context.get_dummy_value()


@overload(prefetch)
def _compiled(flat, place):
    """Return the implementation of `prefetch` within kernels."""

    def compiled(flat, place):
        _instruction(flat, place)

    return compiled
