"""The chunks that a PNG file consists of."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from fpsboost.io.images.exact_reads import DamagedError

SIGNATURE = b"\x89PNG\r\n\x1a\n"


class Chunk(NamedTuple):
    """A named part of the file."""

    name: bytes
    data: bytes


def chunks_in(file: BinaryIO, without_data: tuple[bytes, ...] = ()) -> Iterator[Chunk]:
    """Yield the chunks of an open file, up to its end or IEND.

    Parameters
    ----------
    file : file of bytes
        At its beginning.
    without_data : tuple of bytes
        Names of chunks whose content is passed over.

    Raises
    ------
    DamagedError
        It does not begin like a PNG file, or ends within a chunk.
    """
    if file.read(len(SIGNATURE)) != SIGNATURE:
        raise DamagedError
    size = file.seek(0, 2)
    file.seek(len(SIGNATURE))
    while head := file.read(8):
        length, name = struct.unpack(">I4s", head.ljust(8, b"\0"))
        if len(head) < 8 or file.tell() + length + 4 > size:
            raise DamagedError
        if name in without_data:
            file.seek(length, 1)
            yield Chunk(name, b"")
        else:
            yield Chunk(name, file.read(length))
        file.seek(4, 1)
        if name == b"IEND":
            return
    raise DamagedError


def chunk_bytes(name: bytes, data: bytes) -> bytes:
    """Return a chunk as bytes of the file."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
