"""Priority of the threads that encoders start."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

TASKS = Path("/proc/self/task")
"""Folder with an entry for each thread of this process."""


@contextmanager
def unchanged_priority() -> Iterator[None]:
    """Give all threads of the process the priority that the current one has, once the block is left.

    SVT-AV1 gives real-time priority to its own threads and to the one that opens it, if the user may do that: what this
    process starts afterwards inherits it, and two busy processes then keep a machine of two cores from all other work.
    """
    if sys.platform != "linux":
        yield
        return
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        for task in TASKS.iterdir():
            with suppress(OSError):  # a thread has ended meanwhile
                if os.sched_getscheduler(int(task.name)) != policy:
                    os.sched_setscheduler(int(task.name), policy, parameter)
