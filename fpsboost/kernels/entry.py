"""Entry to a compiled kernel: a function that takes all arguments as one record and passes them on as numba would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from llvmlite import binding, ir

from fpsboost.kernels.arguments import DATA, SHAPE, STRIDES, NotKeptError, fields_of

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


def entry_of(name: str, kind: ir.FunctionType, kinds: Sequence[Any]) -> ir.Module:
    """Return a module with the entry to a function, and with the part of numba's runtime that it needs.

    Parameters
    ----------
    name : str
    kind : llvmlite.ir.FunctionType
        Type of the function.
    kinds : sequence
        Types of the arguments; see `fpsboost.kernels.arguments.flatten`.

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
    values: list[ir.Value] = []
    for each, code, begin in fields_of(kinds):
        value = load(builder, record, begin, LLVM_TYPES[code])
        values += [value] if code != "P" else array_values(builder, value, *each[:2])
    if len(expected) != len(values):
        raise NotKeptError(f"{name} takes {len(expected)} numbers, not {len(values)}")
    for place, (value, taken) in enumerate(zip(values, expected, strict=True)):
        is_pointer = isinstance(taken, ir.PointerType)
        if is_pointer != (value.type == POINTER) or not (is_pointer or taken == value.type):
            raise NotKeptError(f"{name} takes {taken} as number {place + 1}, not {value.type}")
        values[place] = builder.bitcast(value, taken)
    nothing, what = builder.alloca(POINTER), builder.bitcast(error, error_kind)
    callee = ir.Function(module, kind, name)
    builder.ret(builder.call(callee, [builder.bitcast(nothing, kind.args[0]), what, *values]))
    add_allocation(module)
    add_reshape(module)
    return module


def load(builder: ir.IRBuilder, address: ir.Value, place: int, kind: ir.Type) -> ir.Value:
    """Return what is stored some bytes after an address."""
    return builder.load(builder.bitcast(builder.gep(address, [LONG(place)]), kind.as_pointer()), align=1)


def array_values(builder: ir.IRBuilder, array: ir.Value, dtype: np.dtype[Any], dimensions: int) -> list[ir.Value]:
    """Return what numba passes for an array object at an address.

    No object owns the memory, as far as the function can tell.
    """
    nobody, size = POINTER(None), LONG(1)
    lists = []
    for place in (SHAPE, STRIDES):
        numbers = load(builder, array, place, POINTER)
        lists.append([load(builder, numbers, 8 * axis, LONG) for axis in range(dimensions)])
    for length in lists[0]:
        size = builder.mul(size, length)
    data = load(builder, array, DATA, POINTER)
    return [nobody, nobody, size, LONG(dtype.itemsize), data, *lists[0], *lists[1]]


MEMORY_HEADER = 48
"""Bytes before the data of an array that a kernel allocates: six words; kernels read the first and the fourth."""


def add_allocation(module: ir.Module) -> None:
    """Add functions of numba's runtime that make and free arrays of numbers, which need no destructor."""
    malloc = ir.Function(module, ir.FunctionType(POINTER, [LONG]), "malloc")
    free = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER]), "free")
    for name in ("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_alloc_safe_aligned"):
        function = ir.Function(module, ir.FunctionType(POINTER, [LONG, ir.IntType(32)]), name)
        builder = ir.IRBuilder(function.append_basic_block())
        size, alignment = function.args[0], builder.zext(function.args[1], LONG)
        block = builder.call(malloc, [builder.add(builder.add(size, alignment), LONG(MEMORY_HEADER))])
        with builder.if_then(builder.icmp_unsigned("==", builder.ptrtoint(block, LONG), LONG(0))):
            builder.ret(POINTER(None))
        after = builder.add(builder.ptrtoint(block, LONG), builder.add(alignment, LONG(MEMORY_HEADER - 1)))
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
