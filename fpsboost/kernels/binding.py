"""Calls of the compiled kernels: the library for this processor, and arguments as it takes them.

A kernel is a Python function without a body, whose annotations describe its arguments and whose docstring says what
they mean. `compiled` makes it call the function of the same name in ``fpsboost/native``. There, the arguments are one
record, whose fields have the names and the order of the parameters; ``hatch_build.py`` declares it in C++ from the same
annotations. The name of the compiled function ends with a checksum of the description, so that a library that was
compiled from other ones is never called. Python's lock is released during the call.

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
from collections import defaultdict
from collections.abc import Callable, Hashable
from functools import cache, lru_cache, wraps
from inspect import get_annotations, signature
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, ParamSpec, Union, get_args, get_origin
from zlib import crc32

import numpy as np

from fpsboost.kernels import constants
from fpsboost.kernels.constants import KINDS, MAX_AXES

Parameters = ParamSpec("Parameters")

Array = np.ndarray

Float = float | np.float32
"""Number that kernels round to float32."""

LEVELS = ("baseline", "avx2", "avx512")
"""Levels of x86-64, from the lowest; processors of other kinds have the first alone."""

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
LIBRARY = Path(__file__).parent.parent / "native" / f"kernels{SUFFIX}"

CONSTANTS = {name: value for name, value in vars(constants).items() if name.isupper()}

Convert = Callable[[Any, list[Hashable]], bytes]
"""Function that converts a value to the bytes of its field in a record, and appends what is compared of it to a list:
whole numbers, and the types and shapes of arrays."""


class WorkMemory(NamedTuple):
    """Work memory of a kernel, which allocates none itself."""

    address: int
    size: int


Scratch = WorkMemory | None
"""Last parameter of a kernel that needs work memory. None asks for the number of bytes that the kernel needs; each call
makes the memory."""


class Compared(NamedTuple):
    """Part of the arguments of a call that must agree with the others."""

    scope: str
    """Where names of axes count, by the annotation; empty for the whole call."""
    name: str
    """Of the argument, as messages show it."""
    kinds: list[str]
    """Possible types of an array's elements; none for a whole number."""
    variable: str | None
    """Arrays with the same variable take the same place in their lists of types."""
    axes: list[str]
    may_be_empty: bool


class Field(NamedTuple):
    """Field of a record."""

    layout: str
    """Description of the field, whose checksum is part of the kernel's name in the library."""
    size: int
    """Bytes."""
    compared: list[Compared]
    convert: Convert


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


def compiled(function: Callable[Parameters, None]) -> Callable[Parameters, None]:
    """Decorate the description of a kernel: calls check the arguments and go to the kernel of the same name in C++.

    Arguments are integers, floats, arrays, named tuples of these, and tuples of a fixed number of them. Arrays are
    annotated as ``Annotated[Array, "float32 (height, width)"]``, with the type of their elements and their axes:

    - ``out float32 (height, width)``: an array that is written, also one that is updated; all others are only read.
    - Axes of one name have one size in all arrays of a call. A name may be followed by a condition on it, such as
      ``columns >= width + 2 * padding``, of other axes, of the whole numbers among the arguments, and of `constants`;
      numbers and constants in place of a name are the size itself.
    - ``pixel: uint8|uint16 (height, width)``: of several types, arrays of the same variable have the same one, or that
      in the same place of their lists.
    - ``... or empty``: an array without elements stands for none.
    - ``... strided``: the array need not fill its memory in C order, as all others must.
    - ``Record | None``: None stands for no record, which C++ sees as zeros.
    - ``Annotated[Record, "further"]``, or a further text for an array: names of axes count within this scope first.

    Raises `TypeError` if an array has another type, `ValueError` if it has another shape or is read-only although it is
    written, and `struct.error` if a number is none of its type.
    """
    names = [name for name in signature(function).parameters if name != "scratch"]
    unknown = (None,) * ("scratch" in function.__annotations__)

    @cache
    def entry() -> tuple[Any, Convert, Callable[[tuple[Hashable, ...]], None]]:
        fields = arguments_of(function)
        symbol = f"{function.__name__}_{crc32(f'{fields.layout}{CONSTANTS}'.encode()):08x}_{processor_level()}"
        try:
            kernel = getattr(library(), symbol)
        except AttributeError:
            raise ImportError(
                f"The compiled kernels in {LIBRARY} are not those of this version of fpsboost; compile them by "
                f"`python hatch_build.py` in its checkout, or reinstall it with pip."
            ) from None
        kernel.restype = ctypes.c_int64 if unknown else None
        return kernel, fields.convert, agreement_of(fields.compared)

    @wraps(function)
    def call(*arguments: Parameters.args, **named: Parameters.kwargs) -> None:
        kernel, as_record, check = entry()
        given = (*arguments, *[named[name] for name in names[len(arguments) :]], *unknown)
        compared: list[Hashable] = []
        record = as_record(given, compared)
        check(tuple(compared))
        size = kernel(record)
        if unknown:  # the scratch, in the last bytes of the record
            memory = np.empty(size, np.uint8)
            kernel(record[:-16] + struct.pack("2q", memory.ctypes.data, memory.size))

    return call


def arguments_of(function: Callable[..., Any]) -> Field:
    """Return the record of a kernel's arguments."""
    hints = get_annotations(function)
    fields = {name: field_of(f"{function.__name__}: {name}", hint) for name, hint in hints.items() if name != "return"}
    return record(fields)


def field_of(name: str, hint: Any, scope: str = "") -> Field:
    """Return what an annotation describes."""
    if get_origin(hint) is Annotated:
        hint, *texts = get_args(hint)
        scope = "".join(texts[1:] if hint is Array else texts) or scope
        if hint is Array:
            return array_field(name, texts[0], scope)
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    hint = members[0]
    if get_origin(hint) is tuple:
        return record({f"{n}": field_of(name, each, scope) for n, each in enumerate(get_args(hint))})
    if hasattr(hint, "_fields"):
        fields = get_annotations(hint)
        parts = {each: field_of(f"{name}.{each}", fields[each], scope) for each in hint._fields}
        return record(parts, may_be_none=NoneType in members)
    if not issubclass(hint, int | np.integer):
        pack = struct.Struct("d").pack
        return Field("d", 8, [], lambda value, _: pack(value))
    pack_whole = struct.Struct("q").pack

    def convert(value: Any, compared: list[Hashable]) -> bytes:
        compared.append(value)
        return pack_whole(value)

    return Field("q", 8, [Compared(scope, re.split(r"[.: ]+", name)[-1], [], None, [], False)], convert)


def record(fields: dict[str, Field], may_be_none: bool = False) -> Field:
    """Return a record of fields, which is converted from a tuple, or from None to zeros where that is allowed.

    To join bytes is several times faster than to fill the fields of a structure of ctypes.
    """
    layout = ", ".join(f"{name} {field.layout}" for name, field in fields.items())
    size = sum(field.size for field in fields.values())
    compared = [each for field in fields.values() for each in field.compared]
    converts = [field.convert for field in fields.values()]
    zeros = bytes(size)
    nothing = [None] * len(compared)

    def convert(values: Any, compared: list[Hashable]) -> bytes:
        if may_be_none and values is None:
            compared += nothing
            return zeros
        return b"".join([convert(value, compared) for convert, value in zip(converts, values, strict=True)])

    return Field(f"({layout})", size, compared, convert)


def array_field(name: str, description: str, scope: str) -> Field:
    """Return the field of an array of the type and axes that are described."""
    is_output, variable, kinds, axes, empty, strided = re.fullmatch(  # type: ignore[union-attr]
        r"(out )?(?:(\w+): )?([\w|]+) \((.*)\)( or empty)?( strided)?", description
    ).groups()
    own = Compared(scope, name, kinds.split("|"), variable, re.split(", *", axes.rstrip(",")), bool(empty))
    unused = [0] * (MAX_AXES - len(own.axes))

    @lru_cache(32)  # arrays of a run have few shapes
    def checked(kind: np.dtype[Any], shape: tuple[int, ...], strides: tuple[int, ...], is_contiguous: bool) -> bytes:
        if str(kind) not in own.kinds:
            raise TypeError(f"{name} must be {' or '.join(own.kinds)}, not {kind}.")
        if len(shape) != len(own.axes):
            raise ValueError(f"{name} must have the shape ({axes}), not {shape}.")
        if not (strided or is_contiguous):
            raise ValueError(f"{name} must be contiguous.")
        steps = [stride // kind.itemsize for stride in strides]
        return struct.pack(f"{1 + 2 * MAX_AXES}q", KINDS.index(str(kind)), *shape, *unused, *steps, *unused)

    def convert(array: Array, compared: list[Hashable]) -> bytes:
        rest = checked(array.dtype, array.shape, array.strides, array.flags.c_contiguous)
        compared.append(rest)
        # the quick way to the address needs an array that fills its memory and may be written
        quick = array.flags.carray
        if is_output and not (quick or array.flags.writeable):
            raise ValueError(f"{name} is written, so it must not be read-only.")
        address = ctypes.addressof(Start.from_buffer(array)) if quick else array.ctypes.data  # type: ignore[arg-type]
        return address.to_bytes(8, sys.byteorder) + rest

    return Field(f"{kinds}[{len(own.axes)}]", 16 * (1 + MAX_AXES), [own], convert)


def agreement_of(compared: list[Compared]) -> Callable[[tuple[Hashable, ...]], None]:
    """Return the function that checks what is compared of a call; calls of a run are alike, and checked once."""

    @lru_cache(64)
    def check(values: tuple[Any, ...]) -> None:
        known: defaultdict[str, dict[str, Any]] = defaultdict(dict)
        shapes: list[tuple[Compared, list[int]]] = []
        for own, value in zip(compared, values, strict=True):
            if value is not None and not own.kinds:
                known[own.scope][own.name] = value
            elif value is not None:
                kind, *sizes = struct.unpack_from(f"{1 + MAX_AXES}q", value)
                check_type(own, KINDS[kind], known[""])
                shape = sizes[: len(own.axes)]
                if not (own.may_be_empty and 0 in shape):
                    shapes.append((own, shape))
        for own, shape in shapes:
            for axis, size in zip(own.axes, shape, strict=True):
                if (name := axis.partition(" ")[0]).islower():
                    known[own.scope].setdefault(name, size)
        for own, shape in shapes:
            check_shape(own, shape, CONSTANTS | known[""] | known[own.scope])

    return check


def check_type(own: Compared, kind: str, known: dict[str, Any]) -> None:
    """Check the type of an array against those of the same variable before, whose places in their lists are known."""
    places = {n for n, each in enumerate(own.kinds) if each == kind}
    shared = known.setdefault(f"type of {own.variable or own.name}", set(range(len(own.kinds))))
    if not shared & places:
        raise TypeError(f"{own.name} must be {' or '.join({own.kinds[n] for n in shared})} here, not {kind}.")
    shared &= places


def check_shape(own: Compared, shape: list[int], known: dict[str, Any]) -> None:
    """Check the sizes of an array against what is known of its axes."""
    for axis, size in zip(own.axes, shape, strict=True):
        name, _, condition = axis.partition(" ")
        expected = known[name] if name in known else int(name)
        # a text that is evaluated in another thread would make Python forget that Ctrl-C ends the program
        if size != expected or (condition and not eval(compile(axis, name, "eval"), known)):
            names = dict.fromkeys(re.findall(r"[a-z]\w*", axis))
            given = [f"{each} = {known[each]}" for each in names if each in known]
            where = f" with {', '.join(given)}" if given else ""
            raise ValueError(f"{own.name} must have the shape ({', '.join(own.axes)}){where}, not {(*shape,)}.")
