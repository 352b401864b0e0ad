"""Arguments of kernels as numbers in a record, and what tells their types."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
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


class NotKeptError(Exception):
    """Something about a kernel or its arguments prevents that its machine code is called without numba."""


def flatten(arguments: Sequence[Any], kinds: list[Any], values: list[Any]) -> None:
    """Append what tells the types of arguments, and the numbers that stand for them in the record.

    Raises
    ------
    NotKeptError
        If there are arguments other than arrays of numbers, scalars and tuples of these.
    """
    for each in arguments:
        kind = type(each)
        if kind is np.ndarray:
            kinds.append((each.dtype, each.ndim, LAYOUTS[each.flags.num & 0x503]))
            # no object owns the memory as far as the kernel can tell: the caller's reference outlives the call
            values += 0, 0, each.size, each.itemsize, each.ctypes.data
            values += each.shape
            values += each.strides
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
    codes = ""
    for kind in kinds:
        if isinstance(kind, tuple):
            dtype, dimensions, layout = kind
            if not (dtype.kind in "biuf" and dtype.isnative and dtype.itemsize <= 8) or layout.startswith("F"):
                raise NotKeptError(f"an array is of type {dtype}, {layout}")
            codes += "PPqqP" + "qq" * dimensions
        elif kind in SCALARS:
            codes += SCALARS[kind]
    return struct.Struct(codes)


def name_of(kind: Any) -> str:
    """Return the same name in every process for what `flatten` tells of a type."""
    if isinstance(kind, tuple):
        return f"{kind[0].str} {kind[1:]}"
    if isinstance(kind, type):
        return f"{kind.__module__}.{kind.__qualname__} {getattr(kind, '_fields', '')}"
    return str(kind)
