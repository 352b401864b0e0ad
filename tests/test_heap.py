"""Memory that is kept after it was freed, in processes of their own."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

COUNT_HEAPS = """if True:
    import ctypes, sys
    from threading import Barrier, Thread
    from fpsboost.heap import limit_free_memory

    library = ctypes.CDLL(None)
    if "shared" in sys.argv:
        limit_free_memory()
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


ALLOCATE_AGAIN = """if True:
    import ctypes, sys
    from fpsboost.heap import limit_free_memory

    library = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    if "limited" in sys.argv:
        limit_free_memory()
    size = 2**24
    library.free(ctypes.c_void_p(library.malloc(size)))
    library.malloc(size)
    library.malloc_info(0, ctypes.c_void_p.in_dll(library, "stdout"))
    library.fflush(None)
"""


def bytes_outside_heaps(*arguments: str) -> int:
    """How many bytes of blocks lie outside the heaps after a large block was freed and allocated again."""
    command = [sys.executable, "-c", ALLOCATE_AGAIN, *arguments]
    told = subprocess.run(command, env={}, capture_output=True, text=True, check=True).stdout
    return sum(int(size) for size in re.findall(r'<total type="mmap" count="\d+" size="(\d+)"', told))


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries decide differently")
def test_large_blocks_stay_outside_the_heap():
    """A block of 16 MiB leaves no hole in the heap, although one of its size was freed before."""
    assert bytes_outside_heaps("limited") >= bytes_outside_heaps() + 2**24


FREE_BETWEEN = """if True:
    import ctypes, re
    from pathlib import Path
    from fpsboost.heap import limit_free_memory, return_free_memory

    library = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    limit_free_memory()
    size = 2**20
    blocks = [library.malloc(size) for _ in range(64)]
    for each in blocks:
        ctypes.memset(each, 1, size)
    for each in blocks[:-1]:
        library.free(ctypes.c_void_p(each))

    def resident_bytes():
        return 1024 * int(re.search(r"VmRSS:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])

    before = resident_bytes()
    return_free_memory()
    print(before - resident_bytes())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries decide differently")
def test_free_memory_between_blocks_in_use_is_returned():
    """Of 64 MiB below one block that is still in use, nearly all goes back to the system."""
    told = subprocess.run(
        [sys.executable, "-c", FREE_BETWEEN], env={}, capture_output=True, text=True, check=True
    ).stdout
    assert int(told) >= 56 * 2**20
