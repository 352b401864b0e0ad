"""Reading of exact byte counts from files that may be truncated."""

from __future__ import annotations

import struct
from typing import BinaryIO


class DamagedError(Exception):
    """The file is not what its format says; whoever opened it knows its name."""


def read_exactly(file: BinaryIO, count: int) -> bytes:
    """Read a number of bytes from a file.

    Raises
    ------
    DamagedError
        It ends before that.
    """
    data = file.read(count)
    if len(data) < count:
        raise DamagedError
    return data


def unpacked(layout: str, data: bytes) -> tuple[int, ...]:
    """Unpack the integers at the beginning of some bytes; see `struct`.

    Raises
    ------
    DamagedError
        There are too few.
    """
    try:
        return struct.unpack_from(layout, data)
    except struct.error:
        raise DamagedError from None
