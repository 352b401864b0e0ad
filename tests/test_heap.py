"""One heap for all threads, in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

COUNT_HEAPS = """if True:
    import ctypes, sys
    from threading import Barrier, Thread
    from fpsboost.cli.heap import share_one_heap

    library = ctypes.CDLL(None)
    if "shared" in sys.argv:
        share_one_heap()
    barrier = Barrier(4)

    def allocate():
        library.malloc(1000)
        barrier.wait()

    threads = [Thread(target=allocate) for _ in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    library.malloc_info(0, ctypes.c_void_p.in_dll(library, "stdout"))
    library.fflush(None)
"""


def heaps(*arguments: str, **environment: str) -> int:
    """How many heaps four threads use."""
    command = [sys.executable, "-c", COUNT_HEAPS, *arguments]
    told = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    return told.count("<heap ")


@pytest.mark.skipif(sys.platform != "linux", reason="only glibc has several heaps")
def test_all_threads_allocate_from_one_heap():
    """Of four threads, some have another one unless the command line sees to it, or its user has decided."""
    assert heaps() > 1
    assert heaps("shared") == 1
    assert heaps("shared", MALLOC_ARENA_MAX="8") > 1
