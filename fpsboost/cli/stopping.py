"""Signals that stop a command; requests are repeated until they have an effect, so that no incomplete output stays."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, main_thread
from traceback import walk_stack
from types import FrameType

AGAIN_AFTER = 0.05
"""Time after which a request to stop is repeated, seconds."""


@contextmanager
def stopping_on(*numbers: int) -> Iterator[None]:
    """Let signals stop a block of the main thread like Ctrl-C, so that no incomplete output remains; then at once.

    A `KeyboardInterrupt` can be lost: in a destructor, in a callback of a compiled library, or where closing a file
    raises another error in its place. The request is therefore repeated until the block ends, but never while the
    exception is on its way, so that cleaning up is not disturbed.
    """
    request = _Request()
    for number in numbers:
        signal.signal(number, request.receive)
    sys.unraisablehook = _report_unless_interrupted
    sys.excepthook = lambda *error: None  # called by Cython alone here, which calls the other hook for the same error
    try:
        yield
    finally:
        request.end()
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)
        sys.unraisablehook = sys.__unraisablehook__
        sys.excepthook = sys.__excepthook__


class _Request:
    """Request to stop by a signal, and the timer that repeats it."""

    def __init__(self) -> None:
        self._timer: Timer | None = None
        self._is_repeated = False

    def receive(self, number: int, frame: FrameType | None) -> None:
        """Raise `KeyboardInterrupt`, and start the timer that repeats the request.

        It is not raised where it would be lost, during an import, nor while one that was raised before is being
        handled, unless a user asks again.
        """
        is_repeated = self._is_repeated
        self._is_repeated = False
        self.end()
        self._timer = Timer(AGAIN_AFTER, self._repeat, [number])
        self._timer.daemon = True
        self._timer.start()
        modules = {caller.f_globals.get("__name__") for caller, _ in walk_stack(frame)}
        if "importlib._bootstrap" not in modules and not (is_repeated and _is_on_its_way(sys.exc_info()[1])):
            raise KeyboardInterrupt

    def end(self) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()

    def _repeat(self, number: int) -> None:
        """Send the signal again, to the main thread."""
        self._is_repeated = True
        if sys.platform == "win32":
            signal.raise_signal(number)
        else:  # in the main thread, so that it wakes from waiting
            signal.pthread_kill(main_thread().ident or 0, number)


def _is_on_its_way(error: BaseException | None) -> bool:
    """Return whether an exception that is being handled is a `KeyboardInterrupt`, or was raised while one was."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _report_unless_interrupted(unraisable: sys.UnraisableHookArgs) -> None:
    """Report an exception that cannot be raised, except `KeyboardInterrupt`, whose request is repeated."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
