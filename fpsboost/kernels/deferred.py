"""Decorators of numba that import it when something is compiled, and not when a kernel is defined.

Importing numba takes longer than anything else that a conversion begins with, and nothing of it is needed to call
machine code that an earlier run has kept (see `fpsboost.kernels.machine_code`).
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, update_wrapper
from importlib import import_module
from typing import Any

AnyFunction = Callable[..., Any]

COMPILE_EVENT = "numba:compile"
"""Event that numba sends when a compilation begins; loading from its cache sends none."""


class Module:
    """Module that is imported when an attribute of it is looked up."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        return getattr(import_module(self._name), attribute)


types, cgutils = Module("numba.core.types"), Module("numba.core.cgutils")


class Compiler:
    """Access to numba, which hears of overloads as soon as it is there.

    Attributes
    ----------
    listeners : list of callable
        Functions that are called whenever a compilation begins, in the thread that compiles.
    """

    def __init__(self) -> None:
        self.listeners: list[Callable[[], None]] = []
        self._overloads: deque[tuple[AnyFunction, dict[str, Any], AnyFunction]] = deque()
        self._is_heard = False

    def replace(self, function: AnyFunction, options: dict[str, Any], implementation: AnyFunction) -> None:
        """Use an implementation in place of a function within kernels, as `numba.extending.overload` does."""
        self._overloads.append((function, options, implementation))

    @contextmanager
    def ready(self) -> Iterator[None]:
        """Import numba and keep other threads from compiling."""
        from numba.core.compiler_lock import global_compiler_lock  # noqa: PLC0415 (a run may not need it)
        from numba.extending import overload  # noqa: PLC0415

        with global_compiler_lock:
            self.hear()
            while self._overloads:
                function, options, implementation = self._overloads.popleft()
                overload(function, **options)(implementation)
            yield

    def tell(self) -> None:
        """Call the listeners."""
        for listener in tuple(self.listeners):
            listener()

    def hear(self) -> None:
        """Have the listeners called from now on, if numba has been imported."""
        if self._is_heard or "numba" not in sys.modules:
            return
        self._is_heard = True
        from numba.core import event  # noqa: PLC0415

        tell = self.tell

        class Forwarder(event.Listener):
            """Listener that calls all of the compiler's."""

            def on_start(self, event: event.Event) -> None:
                tell()

            def on_end(self, event: event.Event) -> None:
                pass

        event.register(COMPILE_EVENT, Forwarder())


compiler = Compiler()


class Kernel:
    """Function that numba compiles when it is called; to whoever asks for more, it is a dispatcher of numba's."""

    def __init__(self, function: AnyFunction, options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func, self._options = function, options
        self._made: dict[bool, Any] = {}

    @property
    def dispatcher(self) -> Any:
        """What numba makes of the function to be called from Python."""
        return self._make(wrapped=True)

    @property
    def _numba_type_(self) -> Any:
        """Type by which numba finds the function, asked for while it compiles one that calls it."""
        return self._make(wrapped=False)._numba_type_

    def _make(self, *, wrapped: bool) -> Any:
        """Return the function as numba's, with or without machine code that translates arguments from Python."""
        with compiler.ready():
            if wrapped not in self._made:
                options = self._options if wrapped else self._options | {"cache": False, "no_cpython_wrapper": True}
                self._made[wrapped] = import_module("numba").njit(**options)(self.py_func)
            return self._made[wrapped]

    def __call__(self, *arguments: Any) -> Any:
        """Compile the function for these types of arguments, unless that has been done, and call it."""
        return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what Python looks for anywhere
            raise AttributeError(name)
        return getattr(self.dispatcher, name)


class Instruction:
    """Function that stands for LLVM code within kernels, see `numba.extending.intrinsic`."""

    def __init__(self, definition: AnyFunction, options: dict[str, Any]) -> None:
        self._definition, self._options = definition, options
        self._type: Any = None

    @property
    def _numba_type_(self) -> Any:
        """Type by which numba finds the code, asked for while it compiles."""
        if self._type is None:
            context = import_module("numba.core.registry").cpu_target.typing_context
            decorator = import_module("numba.extending").intrinsic
            made = (decorator(**self._options) if self._options else decorator)(self._definition)
            context.refresh()
            self._type = context.resolve_value_type(made)
        return self._type


def intrinsic(definition: AnyFunction | None = None, **options: Any) -> Any:
    """Decorate a definition like `numba.extending.intrinsic`, with options or without."""
    return partial(intrinsic, **options) if definition is None else Instruction(definition, options)


def overload(function: AnyFunction, **options: Any) -> Callable[[AnyFunction], AnyFunction]:
    """Decorate an implementation like `numba.extending.overload`."""

    def decorate(implementation: AnyFunction) -> AnyFunction:
        compiler.replace(function, options, implementation)
        return implementation

    return decorate
