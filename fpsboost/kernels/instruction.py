"""Instructions: functions that are LLVM IR within kernels, and plain Python where nothing is compiled.

The compiler leaves loops over a few values scalar, and it may not change the order of a sum. Where a vector is worth
its own code, the function is a slow twin in NumPy, which documents it and runs uncompiled, and `instruction` says which
LLVM IR stands for it when numba compiles a call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import numpy as np
from llvmlite import ir
from numba.extending import lower_builtin, type_callable

from fpsboost.kernels.jit import cgutils, types

BYTE, WORD, INTEGER, PLACE = (ir.IntType(bits) for bits in (8, 16, 32, 64))
REAL = ir.FloatType()
"""Elements of arrays and vectors; indices of arrays are of type PLACE."""

AS_GIVEN = None
"""Type of an argument: an array or a record, whatever it holds."""

CONSTANT = types.IntegerLiteral
"""Type of an argument: an integer that is known when the call is compiled."""

vector = ir.VectorType

INDEX, FLOAT, UINT8 = types.int64, types.float32, types.uint8
"""Types of scalar arguments."""

Index = np.uint64
"""Type of array indices in kernels: unsigned, so that numba need not handle negative indices."""

EIGHT, SIXTEEN = 8, 16
"""Values in the vectors of most instructions."""


def instruction(twin: Callable[..., Any], *kinds: Any, returns: Any = types.void) -> Callable[..., Any]:
    """Return a decorator for the function that builds the LLVM IR of an instruction.

    Calls of `twin` in kernels become this LLVM IR; `kinds` are the types of its parameters: a numba type, AS_GIVEN or
    CONSTANT. The decorated function takes a `Code` and the arguments: arrays as `FlatArray`, records as lists of their
    fields, constants as numbers, and all else as values of LLVM. It returns the result, if there is one.
    """

    def decorate(build: Callable[..., Any]) -> Callable[..., Any]:
        @type_callable(twin)
        def choose_types(context):
            @wraps(twin)
            def find_signature(*given):
                pairs = list(zip(kinds, given, strict=True))
                if any(kind is CONSTANT and not isinstance(argument, CONSTANT) for kind, argument in pairs):
                    return None  # numba asks again, and with constants
                return returns(*(argument if kind in {AS_GIVEN, CONSTANT} else kind for kind, argument in pairs))

            return find_signature

        @lower_builtin(twin, types.VarArg(types.Any))
        def emit(context, builder, signature, arguments):
            code = Code(context, builder)
            result = build(code, *map(code.operand, signature.args, arguments))
            return context.get_dummy_value() if result is None else result

        return build

    return decorate


class FlatArray:
    """A flat array of an element type, from one of its elements on; no bounds are checked."""

    def __init__(self, builder: ir.IRBuilder, data: Any, element: ir.Type) -> None:
        self._builder, self._data, self.element = builder, data, element

    def at(self, index: Any) -> FlatArray:
        """Return the same array from an index on."""
        return FlatArray(self._builder, self._builder.gep(self._data, [index]), self.element)

    def address(self, index: Any, kind: ir.Type) -> Any:
        """Return the address of an element as that of a value of some type."""
        return self._builder.bitcast(self._builder.gep(self._data, [index]), kind.as_pointer())

    def load(self, index: Any, kind: ir.Type) -> Any:
        """Return the elements from an index on that make up a vector, or the element."""
        return self._builder.load(self.address(index, kind), align=_alignment(kind))

    def store(self, values: Any, index: Any) -> None:
        """Write a vector to the elements from an index on, or a value to an element."""
        self._builder.store(values, self.address(index, values.type), align=_alignment(values.type))


def _alignment(kind: ir.Type) -> int:
    """Return the size of an element, bytes: vectors begin anywhere."""
    element = kind.element if isinstance(kind, ir.VectorType) else kind
    return 4 if element == REAL else element.width // 8


class Code:
    """LLVM IR of an instruction while it is built."""

    def __init__(self, context: Any, builder: ir.IRBuilder) -> None:
        self._context, self.builder = context, builder

    def operand(self, kind: Any, value: Any) -> Any:
        """Return an argument of a numba type in the form in which instructions are built."""
        if isinstance(kind, types.Array):
            data = self._context.make_array(kind)(self._context, self.builder, value).data
            return FlatArray(self.builder, data, self._context.get_data_type(kind.dtype))
        if isinstance(kind, types.BaseTuple):
            fields = cgutils.unpack_tuple(self.builder, value, len(kind))
            return list(map(self.operand, kind, fields))
        return kind.literal_value if isinstance(kind, CONSTANT) else value

    def add(self, index: Any, number: int) -> Any:
        """Return an index some elements on."""
        return self.builder.add(index, ir.Constant(index.type, number))

    def steps(self, index: Any, step: Any, count: int) -> list[Any]:
        """Return some indices a step apart."""
        places = [index]
        while len(places) < count:
            places.append(self.builder.add(places[-1], step))
        return places

    def fill(self, number: float, kind: ir.VectorType) -> Any:
        """Return a vector with the same constant in all lanes."""
        return ir.Constant(kind, [number] * kind.count)

    def broadcast(self, value: Any, kind: ir.VectorType) -> Any:
        """Return a vector with the same value in all lanes."""
        first = self.builder.insert_element(ir.Constant(kind, ir.Undefined), value, INTEGER(0))
        return self.choose(first, [0] * kind.count)

    def choose(self, values: Any, lanes: Sequence[int], further: Any = None) -> Any:
        """Return some lanes of a vector; lanes of `further` are counted after those of `values`."""
        mask = ir.Constant(vector(INTEGER, len(lanes)), list(lanes))
        return self.builder.shuffle_vector(values, values if further is None else further, mask)

    def call(self, name: str, *values: Any) -> Any:
        """Return what an intrinsic function of LLVM returns for some vectors of one type."""
        kind = values[0].type
        suffix = f"v{kind.count}{'f32' if kind.element == REAL else kind.element}"
        function = ir.FunctionType(kind, [kind] * len(values))
        return self.builder.call(
            cgutils.get_or_insert_function(self.builder.module, function, f"llvm.{name}.{suffix}"), values
        )

    def fma(self, first: Any, second: Any, third: Any) -> Any:
        """Return ``first * second + third`` of three vectors, rounded once."""
        return self.call("fma", first, second, third)

    def weighted_sum(self, values: Sequence[Any], weights: Sequence[Any]) -> Any:
        """Return the sum of vectors times their weights, in order."""
        total = self.builder.fmul(values[0], weights[0])
        for value, weight in zip(values[1:], weights[1:], strict=True):
            total = self.fma(value, weight, total)
        return total


class Loop:
    """Loop that works on several vectors at a time, each at another stage."""

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

    def end(self, index: Any, step: int, last: Any) -> None:
        """Go on with an index some elements on as long as it is below `last`, and end the loop then."""
        following = self._builder.add(index, ir.Constant(index.type, step))
        self.follow(index, following)
        self._builder.cbranch(self._builder.icmp_signed("<", following, last), self._body, self._end)
        self._builder.position_at_end(self._end)


def fma(a, b, c):
    """Return ``a * b + c`` of three float32, rounded once.

    It is requested where it pays off instead of being allowed everywhere: a compiler that may contract ``a * b + c`` on
    its own decides anew at every compilation, so that a kernel gave different bits when it was compiled and when it was
    loaded from the cache.
    """
    return np.float32(np.float64(a) * np.float64(b) + np.float64(c))


@instruction(fma, FLOAT, FLOAT, FLOAT, returns=FLOAT)
def _build_fma(code, a, b, c):
    return code.builder.fma(a, b, c)


def prefetch(flat, place):
    """Prefetch the cache line of an element of a flat array, which is read soon; no bounds are checked.

    Hardware prefetchers do not detect small windows of many rows.
    """


@instruction(prefetch, AS_GIVEN, AS_GIVEN)
def _build_prefetch(code, flat, place):
    address = flat.address(place, BYTE)
    kind = ir.FunctionType(ir.VoidType(), [address.type, INTEGER, INTEGER, INTEGER])
    function = code.builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
    to_read, keep, data = INTEGER(0), INTEGER(3), INTEGER(1)
    code.builder.call(function, [address, to_read, keep, data])
