"""Handler of signals that ask a process to stop."""

from __future__ import annotations

import signal
from threading import Timer
from traceback import walk_stack
from types import FrameType

CALLED_BACK = "llvmlite.binding.executionengine"
"""Module whose functions LLVM calls while it writes machine code."""

AGAIN_AFTER = 0.05
"""Time after which a request to stop is repeated, seconds."""


def interrupt(number: int, frame: FrameType | None) -> None:
    """Treat a signal like Ctrl-C, so that no incomplete output remains.

    LLVM calls back from machine code, which swallows an exception: the signal is then raised again a moment later.

    Raises
    ------
    KeyboardInterrupt
        Always, but not while LLVM calls back.
    """
    modules = {caller.f_globals.get("__name__") for caller, _ in walk_stack(frame)}
    if CALLED_BACK in modules:
        Timer(AGAIN_AFTER, signal.raise_signal, [number]).start()
    else:
        raise KeyboardInterrupt
