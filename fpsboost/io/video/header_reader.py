"""Let FFmpeg list the packets of an MP4 or QuickTime file without reading them from the disk.

Their header says where each packet lies, how long it is and when it is shown. FFmpeg gives all that only with the
packet itself, so it is given zeros for what lies behind the header: a film of 100 GB is listed without reading it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

BLOCK = bytes(1 << 20)


class HeaderReader:
    """File for FFmpeg whose content is zeros from a moment on.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    is_blank : bool
        Whether to return zeros, as many as the file has bytes.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self._size, self._place = os.fstat(self._file.fileno()).st_size, 0
        self.is_blank = False

    def read(self, count: int) -> bytes:
        """Return at most this many bytes; none at the end of the file."""
        count = min(count, self._size - self._place, len(BLOCK))
        if count <= 0:
            return b""
        if self.is_blank:
            data = BLOCK if count == len(BLOCK) else BLOCK[:count]
        else:
            self._file.seek(self._place)
            data = self._file.read(count)
        self._place += len(data)
        return data

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place; return it."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        self._place = base + offset
        return self._place

    def tell(self) -> int:
        """Return the place."""
        return self._place

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def has_whole_header(path: Path) -> bool:
    """Return whether all packets of an MP4 or QuickTime file are listed in one place, not in fragments."""
    with path.open("rb") as file:
        kinds = list(_kinds_of_boxes(file))
    return b"moov" in kinds and b"moof" not in kinds


def _kinds_of_boxes(file: BinaryIO) -> list[bytes]:
    """Return the types of the outermost boxes of a file."""
    kinds, place, size = [], 0, os.fstat(file.fileno()).st_size
    while place + 8 <= size:
        file.seek(place)
        head = file.read(16)
        length, kind = int.from_bytes(head[:4], "big"), head[4:8]
        if length == 1:
            length = int.from_bytes(head[8:], "big")
        kinds.append(kind)
        if length < 8:  # 0 for a box up to the end
            break
        place += length
    return kinds
