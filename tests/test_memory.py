"""Memory that is kept after it was freed, in processes of their own."""

import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other C libraries decide differently")

START = """
import ctypes, re, sys
from pathlib import Path
from threading import Barrier, Thread
from fpsboost.memory import limit_free_memory, return_free_memory

library = ctypes.CDLL(None)
library.malloc.restype = ctypes.c_void_p
if "limited" in sys.argv:
    limit_free_memory()
"""

DESCRIBE = """
library.malloc_info(0, ctypes.c_void_p.in_dll(library, "stdout"))
library.fflush(None)
"""

FOUR_THREADS = """
barrier = Barrier(4)

def allocate():
    library.malloc(1000)
    barrier.wait()

threads = [Thread(target=allocate) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""

LARGE_BLOCK_TWICE = """
library.free(ctypes.c_void_p(library.malloc(2**24)))
library.malloc(2**24)
"""

FREE_BETWEEN = """
size = 2**20
blocks = [library.malloc(size) for _ in range(64)]
for block in blocks:
    ctypes.memset(block, 1, size)
for block in blocks[:-1]:
    library.free(ctypes.c_void_p(block))

def resident_bytes():
    return 1024 * int(re.search(r"VmRSS:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])

before = resident_bytes()
return_free_memory()
print(before - resident_bytes())
"""


def output_of(code: str, *arguments: str, **environment: str) -> str:
    """What a process prints that runs some code after the start."""
    command = [sys.executable, "-c", START + code, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


def test_all_threads_allocate_from_one_heap():
    """Of four threads, some have another one unless the command line sees to it, or its user has decided."""
    code = FOUR_THREADS + DESCRIBE
    assert output_of(code).count("<heap ") > 1
    assert output_of(code, "limited").count("<heap ") == 1
    assert output_of(code, "limited", MALLOC_ARENA_MAX="8").count("<heap ") > 1


def test_large_blocks_stay_outside_the_heap():
    """A block of 16 MiB leaves no hole in the heap, although one of its size was freed before."""
    pattern = r'<total type="mmap" count="\d+" size="(\d+)"'
    usual, limited = (
        sum(map(int, re.findall(pattern, output_of(LARGE_BLOCK_TWICE + DESCRIBE, *arguments))))
        for arguments in ((), ("limited",))
    )
    assert limited >= usual + 2**24


def test_free_memory_between_blocks_in_use_is_returned():
    """Of 64 MiB below one block that is still in use, nearly all goes back to the system."""
    assert int(output_of(FREE_BETWEEN, "limited")) >= 56 * 2**20
