"""Entry to a compiled kernel: a function that takes all arguments as one record and passes them on as numba would."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from types import MappingProxyType

from llvmlite import binding, ir

from fpsboost.kernels.arguments import NotKeptError

ENTRY = "fpsboost_entry"
"""Name of the function."""

BYTE, LONG = ir.IntType(8), ir.IntType(64)
POINTER = BYTE.as_pointer()
LLVM_TYPES: Mapping[str, ir.Type] = MappingProxyType(
    {
        **{"P": POINTER, "f": ir.FloatType(), "d": ir.DoubleType(), "?": BYTE, "b": BYTE, "B": BYTE},
        **{"h": ir.IntType(16), "H": ir.IntType(16), "i": ir.IntType(32), "I": ir.IntType(32), "q": LONG, "Q": LONG},
    }
)
"""What numba passes for a format."""


def entry_of(name: str, kind: ir.FunctionType, format_: str) -> ir.Module:
    """Return a module with the entry to a function, and with the part of numba's runtime that it needs.

    Raises
    ------
    NotKeptError
        If the function takes anything else than the record holds.
    """
    module = ir.Module(ENTRY)
    module.triple = binding.get_process_triple()
    function = ir.Function(module, ir.FunctionType(ir.IntType(32), [POINTER, POINTER.as_pointer()]), ENTRY)
    builder = ir.IRBuilder(function.append_basic_block())
    record, error = function.args
    _, error_kind, *expected = kind.args
    if len(expected) != len(format_):
        raise NotKeptError(f"{name} takes {len(expected)} numbers, not {len(format_)}")
    values = []
    for place, (code, taken) in enumerate(zip(format_, expected, strict=True), 1):
        is_pointer = isinstance(taken, ir.PointerType)
        if is_pointer != (code == "P") or not (is_pointer or taken == LLVM_TYPES[code]):
            raise NotKeptError(f"{name} takes {taken} as number {place}, not {LLVM_TYPES[code]}")
        begin = struct.calcsize(format_[:place]) - struct.calcsize(code)
        address = builder.bitcast(builder.gep(record, [LONG(begin)]), taken.as_pointer())
        values.append(builder.load(address, align=1))
    nothing, what = builder.alloca(POINTER), builder.bitcast(error, error_kind)
    callee = ir.Function(module, kind, name)
    builder.ret(builder.call(callee, [builder.bitcast(nothing, kind.args[0]), what, *values]))
    add_allocation(module)
    add_reshape(module)
    return module


HEADER = 48
"""Bytes before the data of an array that a kernel allocates: six words; kernels read the first and the fourth."""


def add_allocation(module: ir.Module) -> None:
    """Add functions of numba's runtime that make and free arrays of numbers, which need no destructor."""
    malloc = ir.Function(module, ir.FunctionType(POINTER, [LONG]), "malloc")
    free = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER]), "free")
    for name in ("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_alloc_safe_aligned"):
        function = ir.Function(module, ir.FunctionType(POINTER, [LONG, ir.IntType(32)]), name)
        builder = ir.IRBuilder(function.append_basic_block())
        size, alignment = function.args[0], builder.zext(function.args[1], LONG)
        block = builder.call(malloc, [builder.add(builder.add(size, alignment), LONG(HEADER))])
        with builder.if_then(builder.icmp_unsigned("==", builder.ptrtoint(block, LONG), LONG(0))):
            builder.ret(POINTER(None))
        after = builder.add(builder.ptrtoint(block, LONG), builder.add(alignment, LONG(HEADER - 1)))
        data = builder.and_(after, builder.neg(alignment))
        words = builder.bitcast(block, LONG.as_pointer())
        for place, word in enumerate((LONG(1), LONG(0), LONG(0), data, size, LONG(0))):  # the first counts references
            builder.store(word, builder.gep(words, [LONG(place)]))
        builder.ret(block)
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER]), "NRT_MemInfo_call_dtor")
    builder = ir.IRBuilder(function.append_basic_block())
    builder.call(free, [function.args[0]])
    builder.ret_void()


def add_reshape(module: ir.Module) -> None:
    """Add the function of numba's runtime that finds the strides of an array in another shape.

    The array is contiguous in C's order: numba reshapes no others but those in Fortran's order, which are not kept.
    """
    longs, integer = LONG.as_pointer(), ir.IntType(32)
    kinds = [LONG, longs, longs, LONG, longs, longs, LONG, integer]
    function = ir.Function(module, ir.FunctionType(integer, kinds), "numba_attempt_nocopy_reshape")
    _, _, _, dimensions, shape, strides, size, _ = function.args
    start, body, end = (function.append_basic_block() for _ in range(3))
    ir.IRBuilder(start).branch(body)
    builder = ir.IRBuilder(body)  # from the last axis to the first; numba never asks for none
    after, stride = builder.phi(LONG), builder.phi(LONG)
    axis = builder.sub(after, LONG(1))
    builder.store(stride, builder.gep(strides, [axis]))
    farther = builder.mul(stride, builder.load(builder.gep(shape, [axis])))
    for number, first, later in ((after, dimensions, axis), (stride, size, farther)):
        number.add_incoming(first, start)
        number.add_incoming(later, body)
    builder.cbranch(builder.icmp_signed(">", axis, LONG(0)), body, end)
    ir.IRBuilder(end).ret(integer(1))
