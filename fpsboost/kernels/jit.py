"""Compiler of the kernels, and its options.

The compiler may not change a finite number: sums are not reassociated, so that results do not depend on how a loop is
vectorised, and nothing is contracted (see `fpsboost.kernels.instruction.fma`). Where a sum is taken in parts, or by one
instruction, the kernel says so itself. No entry points for C are compiled, as nothing calls them. Every kernel runs in
one thread and releases Python's global interpreter lock, so that pairs of frames can be processed in parallel (see
`fpsboost.threads`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property, update_wrapper
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.core import cgutils, event
from numba.extending import lower_builtin, register_jitable, type_callable

from fpsboost.kernels.compiling import tell_listeners

__all__ = ["FINITE_JIT", "JIT", "LANES", "borrowed", "cgutils", "njit", "types"]

JIT: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}

FINITE_JIT: dict[str, Any] = {**JIT, "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions.

What a NaN or an infinity would become is not defined then, nor is the sign of a zero.
"""

LANES = 16
"""Group size, pixels: rows are processed in whole groups, as a scalar remainder loop would cost as much as ten
vectors."""

Function = Callable[..., Any]


class TellsListeners(event.Listener):
    """Tells the listeners when numba begins to compile what its cache does not hold."""

    def on_start(self, event: event.Event) -> None:
        tell_listeners()

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:compile", TellsListeners())


class Kernel:
    """Function to call from Python, compiled for every combination of types and kept in numba's cache."""

    def __init__(self, function: Function, options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func, self._options = function, options

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        try:
            made = numba.njit(cache=True, **self._options)(self.py_func)
        except RuntimeError:  # no folder can be written; every process compiles
            return numba.njit(**self._options)(self.py_func)
        delete_outdated(Path(made.stats.cache_path))
        return made

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel; the first call for some types compiles it or loads it from the cache."""
        return self.dispatcher(*arguments)


@cache
def delete_outdated(folder: Path) -> None:
    """Delete kernels that were compiled from other sources than these.

    numba looks at the file of a kernel alone, not at those of the functions that it calls, and cannot read what it has
    kept if a class among the arguments has moved.
    """
    states = [(path.name, path.stat()) for path in sorted(Path(__file__).parent.glob("*.py"))]
    sources = repr([(name, state.st_mtime_ns, state.st_size) for name, state in states])
    mark = folder / f"{sha256(sources.encode()).hexdigest()[:16]}.sources"
    with suppress(OSError):  # a cache that can only be read
        if not mark.exists():
            for outdated in [*folder.glob("*.nb[ic]"), *folder.glob("*.sources")]:
                outdated.unlink(missing_ok=True)
            mark.touch()


def njit(*, cache: bool = False, **options: Any) -> Callable[[Function], Any]:
    """Decorate a function like `numba.njit`; with `cache` it becomes a `Kernel`, which no other kernel can call.

    Without, it is for kernels alone: it is compiled without an entry for Python, where it stays a plain function.
    """
    if cache and not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return lambda function: Kernel(function, options)
    # functions that are inlined are inlined before types are known, which is faster than after
    return numba.njit(**options) if cache or "inline" in options else register_jitable(**options)


def borrowed(arrays):
    """Return an array, or nested tuples of arrays, without counting references to them, as the caller keeps them.

    Where many arrays are passed on in inner loops, counting them takes half as long as the rest.
    """
    return arrays


@type_callable(borrowed)
def _choose_borrowed(context):
    return lambda arrays: arrays


@lower_builtin(borrowed, types.Any)
def _build_borrowed(context, builder, signature, arguments):
    def without_owner(kind, value):
        if isinstance(kind, types.BaseTuple):
            fields = cgutils.unpack_tuple(builder, value, len(kind))
            return context.make_tuple(builder, kind, list(map(without_owner, kind, fields)))
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = array.meminfo.type(None)
            return array._getvalue()
        return value

    return without_owner(*signature.args, *arguments)
