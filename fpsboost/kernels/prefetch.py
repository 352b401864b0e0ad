"""Word to the processor of what is read next: small windows of many rows are no pattern that it finds by itself."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from fpsboost.kernels.lanes import address_of


def prefetch(flat, place):
    """Fetch the cache line of an element of a flat array; changes nothing, and the place need not exist."""


@intrinsic
def _instruction(typing, flat, place):
    """The processor's own instruction."""
    return types.void(flat, place), _emit


def _emit(context, builder, signature, arguments):
    address = address_of(context, builder, signature.args[0], *arguments, ir.IntType(8))
    integer = ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [address.type, integer, integer, integer])
    function = builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
    to_read, keep, data = integer(0), integer(3), integer(1)
    builder.call(function, [address, to_read, keep, data])
    return context.get_dummy_value()


@overload(prefetch, inline="always")
def _compiled(flat, place):
    """What `prefetch` is within kernels."""

    def compiled(flat, place):
        _instruction(flat, place)

    return compiled
