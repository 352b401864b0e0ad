"""Memory: how much a clip may take, and what the C library keeps after it has been freed.

The limit is checked by a clip's frame size before decoding, because a short file can declare any size. What a pixel
takes is known of each method and kind of output, measured as the growth of the peak of whole conversions from one size
to four times as many pixels; see `fpsboost.preparation.memory_limit`.

Where the system bounds the address space (``ulimit -v``), libraries end the process, or wait for ever, when they get no
more of it: OpenBLAS and OpenCV while they are loaded, FFmpeg when it starts threads. So what is left of it counts as
memory, and where too little is left for the libraries themselves, nothing is begun.
"""

import ctypes
import os
import re
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from fpsboost.errors import FpsboostError, InputError, OptionError, rounded
from fpsboost.options import Checked, PathName, PositiveInt

BASE_BYTES = 300_000_000  # memory that a conversion takes whatever the size of its frames
BYTES_PER_PIXEL = 400
"""Bytes per pixel for all frames in memory at a time, the results computed from them, and the encoder's frames, where
neither method nor output are known."""

ADDRESS_SPACE = 1_300_000_000
"""Bytes of address space that code, threads and reserves of libraries take; measured: 1.15 GB on two cores."""

BYTES_PER_PIXEL_OF_A_THREAD = 100
"""Bytes per pixel for every thread beyond the first that processes a pair of frames; measured: 70 with `nlm`."""

BYTES_PER_PLANE = 32
"""The same for every plane of layers beside the picture; measured with 40 of them: 29."""
BYTES_PER_PLANE_OF_A_THREAD = 12
"""The same of a thread; measured: 10."""

UNKNOWN_MACHINE = 8_000_000_000

multiples = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}


def address_space() -> int:
    """Return the bytes of address space that the system leaves to frames; `sys.maxsize` without a limit.

    Raises `FpsboostError` if it is too little to load the libraries.
    """
    with suppress(ImportError):  # not Unix
        import resource  # noqa: PLC0415

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY and soft <= ADDRESS_SPACE + BASE_BYTES:
            raise FpsboostError(
                "The limit of address space is too low to load the libraries; allow more than "
                f"{readable_size(ADDRESS_SPACE + BASE_BYTES)} with ulimit -v."
            )
        return sys.maxsize if soft == resource.RLIM_INFINITY else soft - ADDRESS_SPACE
    return sys.maxsize


def available_memory() -> int:
    """Return the bytes available without swapping; if unknown, three quarters of the machine's memory, or 8 GB."""
    with suppress(OSError):  # not Linux
        match = re.search(r"^MemAvailable: *([0-9]+) kB$", Path("/proc/meminfo").read_text(), re.MULTILINE)
        if match is not None:
            return int(match[1]) * 1024
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4
    except (AttributeError, ValueError, OSError):  # not Unix
        return UNKNOWN_MACHINE


@dataclass(frozen=True)
class MemoryLimit(Checked):
    """Maximum memory that a conversion may need.

    Parameters
    ----------
    bytes : int
        At least 1; by default the memory that is available now.
    bytes_per_pixel : int
        What a conversion takes for each pixel of a frame, with one thread.
    """

    bytes: PositiveInt = field(default_factory=available_memory)
    bytes_per_pixel: PositiveInt = BYTES_PER_PIXEL

    def check(self, name: PathName, width: int, height: int, planes: int = 0, *, decoding: int = 0) -> None:
        """Raise `InputError` if frames of this size, planes of layers, and further bytes for decoding, need more."""
        need = self._needed(width, height, planes) + decoding
        most = self._most()
        if need > most:
            layers = f" with {planes} planes of layers" if planes else ""
            raise InputError(
                f"{os.fspath(name)} is {width}x{height}{layers}, which takes about {readable_size(need)} of memory "
                f"where {readable_size(most)} may be taken; scale it down, or allow more with "
                f"{'`limit`' if most == self.bytes else 'ulimit -v'}."
            )

    def affordable_threads(self, width: int, height: int, most: int, planes: int = 0) -> int:
        """Return how many pairs of frames of this size can be processed in parallel, from 1 to `most`.

        Examples
        --------
        >>> [MemoryLimit(size * 10**9).affordable_threads(3840, 2160, 16) for size in (4, 8)]
        [1, 6]
        """
        per_thread = (BYTES_PER_PIXEL_OF_A_THREAD + BYTES_PER_PLANE_OF_A_THREAD * planes) * width * height
        return max(1, min(most, 1 + (self._most() - self._needed(width, height, planes)) // per_thread))

    def affordable_processes(self, width: int, height: int, most: int, planes: int = 0) -> int:
        """Return how many processes can each convert a clip of this size with one thread, from 1 to `most`."""
        return max(1, min(most, self._most() // self._needed(width, height, planes)))

    def _most(self) -> int:
        """Return the bytes that may be taken, which are never more than the system leaves of the address space."""
        return min(self.bytes, address_space())

    def _needed(self, width: int, height: int, planes: int) -> int:
        return BASE_BYTES + (self.bytes_per_pixel + BYTES_PER_PLANE * planes) * width * height


def parse_memory(text: str, option: str = "`limit`") -> MemoryLimit:
    """Parse a size of memory as people write it; messages name it by `option`."""
    match = re.fullmatch(r"([0-9]{1,18}(?:\.[0-9]{1,9})?) *([KMGT]?)B?", text.strip(), re.IGNORECASE)
    if match is None or not float(match[1]):
        raise OptionError(f"{option} must be a size such as 8G or 500M, not {text!r}.")
    return MemoryLimit(round(float(match[1]) * multiples[match[2].upper()]))


def readable_size(size: float) -> str:
    """Return bytes as people write them, with three figures that count.

    Examples
    --------
    >>> readable_size(4_560_000_000), readable_size(78_900)
    ('4.56 GB', '78.9 kB')
    """
    unit = next((letter for letter in "TGMk" if size >= multiples[letter.upper()]), "k")
    return f"{rounded(size / multiples[unit.upper()], 3)} {unit}B"


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
