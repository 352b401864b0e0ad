"""Calls of the compiled kernels: the library for this processor, and arguments as it takes them.

A kernel is a Python function without a body, whose annotations describe its arguments and whose docstring says what
they mean. `compiled` makes it call the function of the same name in ``fpsboost/native``. There, the arguments are one
record, whose fields have the names and the order of the parameters. Python's lock is released during the call.

Annotations must be the types themselves, so the modules of kernels do not postpone their evaluation: to evaluate them
when a program starts would take longer than to make a frame.

Kernels are compiled for several levels of processors when fpsboost is installed, and give the same bits at all of them.
The environment variable ``FPSBOOST_CPU`` chooses a lower one than the highest that the processor has.
"""

import ctypes
import os
import re
import struct
import sys
from collections.abc import Callable
from functools import cache, lru_cache, wraps
from inspect import get_annotations, signature
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ParamSpec, TypeVar, Union, cast, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

Array = NDArray[Any]

LEVELS = ("baseline", "avx2", "avx512")
"""Levels of x86-64, from the lowest; processors of other kinds have the first alone."""

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
LIBRARY = Path(__file__).parent.parent / "native" / f"kernels{SUFFIX}"

KINDS = ("uint8", "uint16", "float32", "int32", "int64", "float64", "bool")
"""Types of elements; the place of each is its number in C++."""

MAX_AXES = 5

ALIGNMENT = 64
"""Bytes of a cache line, at which every piece of scratch memory begins."""

Convert = Callable[[Any], bytes]
"""Function that converts a value to the bytes of its field in a record."""


class ArrayRecord(ctypes.Structure):
    """Array as C++ has it: the first element, the number of the element type, and sizes and steps along the axes."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("kind", ctypes.c_int64),
        ("shape", ctypes.c_int64 * MAX_AXES),
        ("steps", ctypes.c_int64 * MAX_AXES),  # in elements
    )


Start = ctypes.c_char * 0
"""Start of an array, also of one without elements."""


@cache
def library() -> ctypes.CDLL:
    """Return the compiled kernels; raises `ImportError` if they are missing."""
    try:
        return ctypes.CDLL(os.fspath(LIBRARY))
    except OSError as error:
        raise ImportError(f"The compiled kernels cannot be loaded ({error}); reinstall fpsboost with pip.") from None


@cache
def processor_level() -> str:
    """Return the level whose kernels are used: the highest of this processor, or that of ``FPSBOOST_CPU``.

    Raises `ImportError` if the processor does not have the level that is asked for.
    """
    levels = LEVELS[: library().count_levels()]
    wanted = os.environ.get("FPSBOOST_CPU") or levels[-1]
    if wanted not in levels:
        raise ImportError(f"FPSBOOST_CPU is {wanted}, and this processor has {', '.join(levels)}; choose one of these.")
    return wanted


def compiled(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate the description of a kernel: calls check the arguments and go to the kernel of the same name in C++.

    Arguments are integers, floats, arrays, named tuples of these, and tuples of a fixed number of them; a named tuple
    may be None, which C++ sees as zeros. Arrays are annotated as ``Annotated[Array, "uint8|uint16 (height, width)"]``,
    with their possible types of elements and their axes; numbers among the axes are checked. All but those that are
    ``strided`` must fill their memory in C order.

    Raises `TypeError` if an array has another type, `ValueError` if it has another shape, and `struct.error` if a
    number is none of its type.
    """
    names = list(signature(function).parameters)

    @cache
    def entry() -> tuple[Any, Convert]:
        kernel = getattr(library(), f"{function.__name__}_{processor_level()}")
        kernel.restype = {None: None, int: ctypes.c_int64, float: ctypes.c_double}[get_annotations(function)["return"]]
        return kernel, arguments_of(function)[1]

    @wraps(function)
    def call(*arguments: Parameters.args, **named: Parameters.kwargs) -> Result:
        kernel, as_record = entry()
        given = (*arguments, *[named[name] for name in names[len(arguments) :]])
        return cast("Result", kernel(as_record(given)))

    return call


def arguments_of(function: Callable[..., Any]) -> tuple[type[ctypes.Structure], Convert]:
    """Return the record of a kernel, and the function that converts arguments to it; see `record`."""
    hints = get_annotations(function)
    fields = {name: converter(f"{function.__name__}: {name}", hint) for name, hint in hints.items() if name != "return"}
    return record(function.__name__, fields)


@cache
def converter(name: str, hint: Any) -> tuple[Any, Convert]:
    """Return the type that C++ has for an annotation, and the function that converts values to it."""
    if get_origin(hint) is Annotated:
        return ArrayRecord, array_converter(name, *get_args(hint)[1:])
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    hint = next(kind for kind in members if kind is not NoneType)
    if get_origin(hint) is tuple:
        structure, convert = record(name, {f"{n}": converter(name, each) for n, each in enumerate(get_args(hint))})
        return structure._fields_[0][1] * len(structure._fields_), convert
    if hasattr(hint, "_fields"):
        fields = get_annotations(hint)
        return record(hint.__name__, {each: converter(f"{name}.{each}", fields[each]) for each in hint._fields})
    kind, code = (ctypes.c_int64, "q") if issubclass(hint, int | np.integer) else (ctypes.c_double, "d")
    return kind, struct.Struct(code).pack


def record(name: str, fields: dict[str, tuple[Any, Convert]]) -> tuple[type[ctypes.Structure], Convert]:
    """Return a structure with these fields, and the function that converts a tuple to it, and None to zeros.

    The structure only describes the bytes: to join them is several times faster than to fill its fields.
    """
    structure = type(name, (ctypes.Structure,), {"_fields_": [(each, kind) for each, (kind, _) in fields.items()]})
    zeros, converts = bytes(ctypes.sizeof(structure)), [convert for _, convert in fields.values()]

    def convert(values: Any) -> bytes:
        if values is None:
            return zeros
        return b"".join([convert(value) for convert, value in zip(converts, values, strict=True)])

    return structure, convert


def array_converter(name: str, description: str) -> Convert:
    """Return the function that converts an array of the type and shape that are described, after checking it."""
    kinds, axes, strided = re.fullmatch(r"([\w|]+) \(([^()]*)\)( strided)?", description).groups()  # type: ignore[union-attr]
    sizes = [int(axis) if axis.isdigit() else None for axis in re.split(", *", axes.rstrip(","))]
    numbers = {np.dtype(kind): KINDS.index(kind) for kind in kinds.split("|")}
    unused = [0] * (MAX_AXES - len(sizes))

    @lru_cache(32)  # arrays of a run have few shapes
    def checked(kind: np.dtype[Any], shape: tuple[int, ...], strides: tuple[int, ...], is_contiguous: bool) -> bytes:
        if kind not in numbers:
            raise TypeError(f"{name} must be {kinds.replace('|', ' or ')}, not {kind}.")
        if len(shape) != len(sizes) or any(size not in (None, own) for size, own in zip(sizes, shape, strict=True)):
            raise ValueError(f"{name} must have the shape ({axes}), not {shape}.")
        if not (strided or is_contiguous):
            raise ValueError(f"{name} must be contiguous.")
        steps = [stride // kind.itemsize for stride in strides]
        return struct.pack(f"{1 + 2 * MAX_AXES}q", numbers[kind], *shape, *unused, *steps, *unused)

    def convert(array: Array) -> bytes:
        rest = checked(array.dtype, array.shape, array.strides, array.flags.c_contiguous)
        # the quick way to the address needs an array that fills its memory and may be written
        quick = array.flags.carray
        address = ctypes.addressof(Start.from_buffer(array)) if quick else array.ctypes.data  # type: ignore[arg-type]
        return address.to_bytes(8, sys.byteorder) + rest

    return convert


def scratch_of(*sizes: int) -> Array:
    """Return memory for pieces of these sizes, bytes, as ``fpsboost/native/scratch.h`` takes them from it.

    Compiled kernels allocate no memory themselves.
    """
    return np.empty(sum(-(-size // ALIGNMENT) for size in sizes) * ALIGNMENT + ALIGNMENT, np.uint8)
