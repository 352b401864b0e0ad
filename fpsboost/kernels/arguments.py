"""Arguments of kernels as a record of scalars and of addresses of array objects, and what tells their types."""

from __future__ import annotations

import ctypes
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

SCALARS: Mapping[type, str] = MappingProxyType(
    {
        **{int: "q", float: "d", bool: "?", np.bool_: "?", np.float32: "f", np.float64: "d"},
        **{np.int8: "b", np.int16: "h", np.int32: "i", np.int64: "q"},
        **{np.uint8: "B", np.uint16: "H", np.uint32: "I", np.uint64: "Q"},
    }
)
"""Format of scalar arguments in the record, as `struct` names it, by type."""

LAYOUTS = {
    flags: f"{'C' if flags & 1 else 'F' if flags & 2 else 'A'} {flags & 0x500:x}"
    for flags in range(0x504)
    if not flags & ~0x503
}
"""What numba distinguishes of the flags of an array: the order in which it is contiguous, aligned and writeable."""


HEADER = object.__basicsize__
DATA, SHAPE, STRIDES = HEADER, HEADER + 16, HEADER + 24
"""Places in an array object, bytes: the address of its first element, and those of its shape and strides, as NumPy's C
interface has them (``PyArrayObject_fields`` in ``numpy/ndarraytypes.h``). Machine code reads them in a fraction of the
time that Python takes to ask for them."""


class NotKeptError(Exception):
    """Something about a kernel or its arguments prevents that its machine code is called without numba."""


def flatten(arguments: Sequence[Any], kinds: list[Any], values: list[Any]) -> None:
    """Append what tells the types of arguments, and what stands for them in the record.

    Raises
    ------
    NotKeptError
        If there are arguments other than arrays of numbers, scalars and tuples of these.
    """
    for each in arguments:
        kind = type(each)
        if kind is np.ndarray:
            kinds.append((each.dtype, each.ndim, LAYOUTS[each.flags.num & 0x503]))
            values.append(id(each))  # its address; the caller's reference outlives the call
        elif kind in SCALARS:
            kinds.append(kind)
            values.append(each)
        elif isinstance(each, tuple):
            kinds += kind, len(each)
            flatten(each, kinds, values)
        else:
            raise NotKeptError(f"an argument is of type {kind}")


def record_format(kinds: Sequence[Any]) -> struct.Struct:
    """Return the format of the record of arguments of these kinds."""
    codes = "".join(code for _, code, _ in fields_of(kinds))
    if "P" in codes and not arrays_are_as_expected():
        raise NotKeptError("arrays are objects of another kind")
    return struct.Struct(codes)


def fields_of(kinds: Sequence[Any]) -> Iterator[tuple[Any, str, int]]:
    """Yield what the record holds: the kind of each scalar or array, its format, and the place where it begins.

    Raises
    ------
    NotKeptError
        If there are arrays of other types than those that have been tried.
    """
    codes = ""
    for kind in kinds:
        if isinstance(kind, tuple):
            dtype, _, layout = kind
            if not (dtype.kind in "biuf" and dtype.isnative and dtype.itemsize <= 8) or layout.startswith("F"):
                raise NotKeptError(f"an array is of type {dtype}, {layout}")
            code = "P"
        elif kind in SCALARS:
            code = SCALARS[kind]
        else:  # a tuple, whose parts follow
            continue
        codes += code
        yield kind, code, struct.calcsize(codes) - struct.calcsize(code)


@cache
def arrays_are_as_expected() -> bool:
    """Return whether an array object can be read at its address."""
    probe = np.zeros((2, 3), np.int32)
    if sys.implementation.name != "cpython":
        return False
    data, shape, strides = (ctypes.c_void_p.from_address(id(probe) + place).value for place in (DATA, SHAPE, STRIDES))
    if data != probe.ctypes.data or not shape or not strides:
        return False
    found = [tuple((ctypes.c_int64 * probe.ndim).from_address(each)) for each in (shape, strides)]
    return found == [probe.shape, probe.strides]


def name_of(kind: Any) -> str:
    """Return the same name in every process for what `flatten` tells of a type."""
    if isinstance(kind, tuple):
        return f"{kind[0].str} {kind[1:]}"
    if isinstance(kind, type):
        return f"{kind.__module__}.{kind.__qualname__} {getattr(kind, '_fields', '')}"
    return str(kind)
