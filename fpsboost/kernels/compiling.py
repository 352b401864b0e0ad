"""Notification that kernels are being compiled because the cache does not hold them yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

COMPILE_EVENT = "numba:compile"
"""Event that numba sends when a compilation begins; loading from its cache sends none."""


class _FirstStartListener(event.Listener):
    """Listener that calls a function at the first start event only."""

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
    """Call a function once, when the compilation of the first kernel begins; never if all come from the cache.

    Parameters
    ----------
    tell : callable
        Function to call, in the thread that compiles.
    """
    listener = _FirstStartListener(tell)
    with event.install_listener(COMPILE_EVENT, listener):
        yield
