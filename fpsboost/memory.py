"""Memory that the C library keeps after it has been freed."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress

MIB = 2**20

settings = (
    ("MALLOC_ARENA_MAX", -8, 1),
    ("MALLOC_MMAP_THRESHOLD_", -3, 7 * MIB),
    ("MALLOC_TRIM_THRESHOLD_", -1, 16 * MIB),
)
"""Environment variable, number of the option in glibc's ``malloc.h``, and value.

All threads share one heap, because each would keep for itself what it has freed: 60 of 790 MB with two threads at
1920x1080. Blocks as large as a plane of floats of that size lie outside the heap, because it would be left with holes
of their size: 40 of 720 MB there, 170 MB of 2.1 GB at 3840x2160. To fix their size also fixes how much free memory may
remain at the end of the heap, at a value that makes it shrink and grow with every frame: a twentieth more processor
time.
"""


def limit_free_memory() -> None:
    """Bound what is kept, where the C library is glibc; what the environment sets stays."""
    if sys.platform != "linux":
        return
    with suppress(AttributeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for variable, option, value in settings:
            if variable not in os.environ:
                mallopt(option, value)


def return_free_memory() -> None:
    """Return to the system what is free between blocks in use, where the C library is glibc.

    Takes about 10 ms after an encoder was closed, which leaves 100 to 200 MB in pieces that the next one does not fill.
    """
    if sys.platform == "linux":
        with suppress(AttributeError):  # another C library
            ctypes.CDLL(None).malloc_trim(0)
