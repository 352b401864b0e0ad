"""Handlers of signals that ask a process to stop, and of requests that were lost."""

from __future__ import annotations

import signal
import sys
from threading import Timer
from traceback import walk_stack
from types import FrameType

CANNOT_STOP = {"llvmlite.binding.executionengine", "importlib._bootstrap"}
"""Modules whose functions LLVM calls while it writes machine code, and Python while it imports a module."""

AGAIN_AFTER = 0.05
"""Time after which a request to stop is repeated, seconds."""


def stop_on(*numbers: int) -> None:
    """Let signals stop this process like Ctrl-C, so that no incomplete output remains.

    The exception may be raised in a destructor or in another callback, from which none leaves: the signal is then
    raised again.
    """
    for number in numbers:
        signal.signal(number, interrupt)

    def repeat_if_lost(unraisable: sys.UnraisableHookArgs) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            _repeat(numbers[0])
        else:
            sys.__unraisablehook__(unraisable)

    sys.unraisablehook = repeat_if_lost


def interrupt(number: int, frame: FrameType | None) -> None:
    """Treat a signal like Ctrl-C.

    LLVM calls back from machine code, which swallows an exception, as a compiled library may while it is imported: the
    signal is then raised again a moment later.
    """
    modules = {caller.f_globals.get("__name__") for caller, _ in walk_stack(frame)}
    if CANNOT_STOP & modules:
        _repeat(number)
    else:
        raise KeyboardInterrupt


def _repeat(number: int) -> None:
    Timer(AGAIN_AFTER, signal.raise_signal, [number]).start()
