"""Handler of signals that ask a process to stop."""

from __future__ import annotations

import signal
from threading import Timer
from traceback import walk_stack
from types import FrameType

CANNOT_STOP = {"llvmlite.binding.executionengine", "importlib._bootstrap"}
"""Modules whose functions LLVM calls while it writes machine code, and Python while it imports a module."""

AGAIN_AFTER = 0.05
"""Time after which a request to stop is repeated, seconds."""


def interrupt(number: int, frame: FrameType | None) -> None:
    """Treat a signal like Ctrl-C, so that no incomplete output remains.

    LLVM calls back from machine code, which swallows an exception, as a compiled library may while it is imported: the
    signal is then raised again a moment later.

    Raises
    ------
    KeyboardInterrupt
        Always, but not while LLVM calls back or a module is imported.
    """
    modules = {caller.f_globals.get("__name__") for caller, _ in walk_stack(frame)}
    if CANNOT_STOP & modules:
        Timer(AGAIN_AFTER, signal.raise_signal, [number]).start()
    else:
        raise KeyboardInterrupt
