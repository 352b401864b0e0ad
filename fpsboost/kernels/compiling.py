"""Compilation of kernels that the cache does not hold yet: notification of it, and a second process for it.

Importing this does not import numba, which methods without kernels never need.
"""

from __future__ import annotations

import gc
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import IO, cast

listeners: list[Callable[[], None]] = []
"""Functions to call when a kernel is compiled, in the thread that compiles."""

RUN_TASK = """
import gc, os, pickle, sys
gc.disable()
sys.path[:] = pickle.load(sys.stdin.buffer)
pickle.load(sys.stdin.buffer)()
os._exit(0)
"""
"""Program of the second process. It ends at once: to take down what compiling has built up would take a second."""


def tell_listeners() -> None:
    """Call the listeners."""
    for listener in tuple(listeners):
        listener()


@contextmanager
def told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function once, in the thread that compiles, before the first kernel that the cache does not hold.

    Compiling takes seconds, once on a machine: a program can tell its user why it waits.
    """
    first = Lock()

    def listen() -> None:
        if first.acquire(blocking=False):  # of the threads that compile at the same time, too
            tell()

    listeners.append(listen)
    try:
        yield
    finally:
        listeners.remove(listen)


@contextmanager
def uncollected() -> Iterator[None]:
    """Have Python look for no cycles among objects: importing and compiling make many objects and few cycles."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def compiled_aside(task: Callable[[], None]) -> Iterator[None]:
    """Run a task in a second process while this one compiles, so that its kernels are in the cache afterwards.

    numba compiles in one thread at a time. The process is started when the compilation of the first kernel begins, and
    never if all come from the cache. If the task cannot be pickled or fails, its kernels are still to be compiled.
    """
    process: subprocess.Popen[bytes] | None = None

    def start() -> None:
        nonlocal process
        with suppress(Exception):  # a part of the task that cannot be pickled may raise anything
            process = _start(pickle.dumps(sys.path) + pickle.dumps(task))

    try:
        with told_of_compiling(start):
            yield
        if process is not None:
            process.wait()
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _start(message: bytes) -> subprocess.Popen[bytes] | None:
    """Start the second process; None where Python is part of another program, which cannot be started for this."""
    if not Path(sys.executable or "").stem.startswith("python"):
        return None
    process = subprocess.Popen(
        [sys.executable, "-c", RUN_TASK],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    with cast("IO[bytes]", process.stdin) as pipe:
        pipe.write(message)
    return process
