"""Memory: how much a clip may take, and what the C library keeps after it has been freed.

The limit is checked by a clip's frame size before decoding, because a short file can declare any size. Measured peaks
of whole conversions, 8 to 16 bits per channel: 90 to 270 bytes per pixel if frames are only blended, 190 to 520 with
motion; the estimate uses one number for all, because only what exceeds the machine is to be refused.
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from fpsboost.errors import InputError, OptionError

AT_LEAST = 300_000_000
BYTES_PER_PIXEL = 400
"""Bytes per pixel for all frames in memory at a time, the results computed from them, and the encoder's frames."""

BYTES_PER_PIXEL_OF_A_THREAD = 100
"""Bytes per pixel for every thread beyond the first that processes a pair of frames; measured: 70 with `nlm`."""

BYTES_PER_PLANE, BYTES_PER_PLANE_OF_A_THREAD = 32, 12
"""The same for every plane of layers beside the picture; measured with 40 of them: 29 and 10."""

UNKNOWN_MACHINE = 8_000_000_000

multiples = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}


def available_memory() -> int:
    """Return the bytes available without swapping; if unknown, three quarters of the machine's memory, or 8 GB."""
    try:
        match = re.search(r"^MemAvailable: *([0-9]+) kB$", Path("/proc/meminfo").read_text(), re.MULTILINE)
        if match is not None:
            return int(match[1]) * 1024
    except OSError:  # not Linux
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4
    except (AttributeError, ValueError, OSError):  # not Unix
        return UNKNOWN_MACHINE


@dataclass(frozen=True)
class MemoryLimit:
    """Maximum memory that a conversion may need.

    Parameters
    ----------
    bytes : int
        Above 0; by default the memory that is available now.
    """

    bytes: int = field(default_factory=available_memory)

    def __post_init__(self) -> None:
        if self.bytes <= 0:
            raise OptionError(f"`limit` must be above 0, not {self.bytes}.")

    def check(
        self, name: str | os.PathLike[str], width: int, height: int, planes: int = 0, *, decoding: int = 0
    ) -> None:
        """Raise `InputError` if frames of this size, planes of layers and bytes for decoding one frame need more."""
        need = _needed(width, height, planes) + decoding
        if need > self.bytes:
            layers = f" with {planes} planes of layers" if planes else ""
            raise InputError(
                f"{os.fspath(name)} is {width}x{height}{layers}, which takes about {_readable(need)} of memory where "
                f"{_readable(self.bytes)} may be taken; scale it down, or allow more with `limit`."
            )

    def affordable_threads(self, width: int, height: int, most: int, planes: int = 0) -> int:
        """Return how many pairs of frames of this size can be processed in parallel, from 1 to `most`.

        Examples
        --------
        >>> [MemoryLimit(size * 10**9).affordable_threads(3840, 2160, 16) for size in (4, 8)]
        [1, 6]
        """
        per_thread = (BYTES_PER_PIXEL_OF_A_THREAD + BYTES_PER_PLANE_OF_A_THREAD * planes) * width * height
        return max(1, min(most, 1 + (self.bytes - _needed(width, height, planes)) // per_thread))

    def affordable_processes(self, width: int, height: int, most: int, planes: int = 0) -> int:
        """Return how many processes can each convert a clip of this size with one thread, from 1 to `most`."""
        return max(1, min(most, self.bytes // _needed(width, height, planes)))


def _needed(width: int, height: int, planes: int) -> int:
    return AT_LEAST + (BYTES_PER_PIXEL + BYTES_PER_PLANE * planes) * width * height


def parse_memory(text: str, option: str = "`limit`") -> MemoryLimit:
    """Parse a size of memory as people write it; messages name it by `option`."""
    match = re.fullmatch(r"([0-9]{1,18}(?:\.[0-9]{1,9})?) *([KMGT]?)B?", text.strip(), re.IGNORECASE)
    if match is None:
        raise OptionError(f"{option} must be a size such as 8G or 500M, not {text!r}.")
    return MemoryLimit(round(float(match[1]) * multiples[match[2].upper()]))


def _readable(size: int) -> str:
    unit, name = next(((unit, name) for unit, name in ((10**12, "TB"), (10**9, "GB")) if size >= unit), (10**6, "MB"))
    return f"{size / unit:.{0 if name == 'MB' else 1}f} {name}"


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
