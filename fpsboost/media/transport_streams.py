"""Transport and program streams, of which a sample tells whether they are scrambled and whether their clock jumps."""

import re
import statistics
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

TRANSPORT_PACKET = re.compile(rb"(?=\x47(..)(.)(?:.{184}|.{188}|.{200})\x47)", re.DOTALL)
"""A packet of 188, 192 or 204 bytes before another: its identifier, below flags, and how it is scrambled, above."""


PICTURE_TIME = re.compile(rb"\x00\x00\x01[\xe0-\xef]..[\x80-\xbf][\x80-\xff].(.{5})", re.DOTALL)
"""Presentation time, among bits that are always set, in the header of a packet of video (PES)."""


MAX_REORDERED_TIME = 45_000
"""Maximum backward step between presentation times in storage order, as reordering causes it, ticks of 90 kHz."""


PROBES = 256
"""Number of places of a file at which a sample is taken."""


MIN_PROBED_BYTES = 1 << 12
"""Least size of a sample."""


MAX_PROBED_BYTES = 1 << 15
"""Greatest size of a sample."""


def probed(path: Path) -> Iterator[bytes]:
    """Yield blocks of a file at regular distances, as a sample of its content."""
    size = path.stat().st_size
    step = max(MIN_PROBED_BYTES, size // PROBES)
    with path.open("rb") as file:
        for place in range(0, size, step):
            file.seek(place)
            yield file.read(min(step, MAX_PROBED_BYTES))


def is_scrambled(path: Path, pid: int) -> bool:
    """Return whether packets with this identifier are scrambled somewhere in a transport stream, by a sample.

    FFmpeg passes over such packets without a word.
    """
    flags = (
        [flags[0] for head, flags in TRANSPORT_PACKET.findall(block) if int.from_bytes(head) & 0x1FFF == pid]
        for block in probed(path)
    )
    return any(4 * sum(each >= 0x40 for each in of_block) > len(of_block) for of_block in flags)


def clock_jumps(path: Path) -> bool:
    """Return whether the clock of a transport or program stream jumps, by a sample of its pictures' times."""
    times: list[int] = []
    for block in probed(path):
        if match := PICTURE_TIME.search(block):
            bits = int.from_bytes(match[1])  # of the time: 3, 15 and 15, with markers between
            times.append(bits >> 3 & 7 << 30 | bits >> 2 & 0x7FFF << 15 | bits >> 1 & 0x7FFF)
    steps = [(later - earlier + MAX_REORDERED_TIME) % (1 << 33) for earlier, later in pairwise(times)]
    return max(steps, default=0) > 10 * max(statistics.median(steps or [0]), MAX_REORDERED_TIME)
