"""Word of kernels that are compiled because the cache does not hold them yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

COMPILE = "numba:compile"
"""The event that numba sends when it begins to compile; loading from its cache sends none."""


class _Once(event.Listener):
    """Passes on the first beginning."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, event: event.Event) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function once, when the first kernel begins to be compiled, and never if all come from the cache.

    Parameters
    ----------
    tell : callable
        Called in the thread that compiles.
    """
    listener = _Once(tell)
    with event.install_listener(COMPILE, listener):
        yield
