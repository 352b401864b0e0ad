"""The chunks that a WebP file consists of."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

from fpsboost.io.images.exact_reads import DamagedError, read_exactly, unpacked

ANIMATED, ALPHA, PROFILE = 0x02, 0x10, 0x20
"""Flags of the chunk VP8X."""


def chunks_in(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Yield name and size of the chunks of an open file; it stands at the content, and may be read or left.

    Raises
    ------
    DamagedError
        It does not begin like a WebP file, or ends within a chunk.
    """
    head = file.read(12)
    if head[:4] != b"RIFF" or head[8:] != b"WEBP":
        raise DamagedError
    end = 8 + unpacked("<I", head[4:])[0]
    size_of_file = file.seek(0, 2)
    place = 12
    while place < end:
        file.seek(place)
        name, size = struct.unpack("<4sI", read_exactly(file, 8))
        if place + 8 + size > size_of_file:
            raise DamagedError
        yield name, size
        place += 8 + size + size % 2


def chunk_bytes(name: bytes, data: bytes) -> bytes:
    """Return a chunk as bytes of the file, padded to an even length."""
    return struct.pack("<4sI", name, len(data)) + data + b"\0" * (len(data) % 2)
