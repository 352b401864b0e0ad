"""Animations made of the chunks of WebP files."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np

from fpsboost.errors import OutputError
from fpsboost.frame import Image
from fpsboost.io.animation.canvas import (
    DEFAULT_DELAY,
    Disposal,
    Outline,
    Piece,
    changed_part,
    decoded_still,
    outline_of,
    with_four_channels,
)
from fpsboost.io.images.exact import DamagedError, read_exactly, unpacked
from fpsboost.io.images.files import encode_image
from fpsboost.io.images.sizes import declared_size
from fpsboost.io.images.webp_chunks import ALPHA, ANIMATED, chunk_bytes, chunks_in

CLOCK = 1000  # ticks per second
MAX_DELAY = Fraction(2**24 - 1, CLOCK)
MAX_FILE = 2**32 - 2

CLEARS, REPLACES = 0x01, 0x02
"""Flags of a frame."""

_pixels = (b"ALPH", b"VP8 ", b"VP8L")


def is_animated(file: BinaryIO) -> bool:
    """Whether an open WebP file says that it is an animation."""
    head = file.read(21)
    return len(head) == 21 and head[12:16] == b"VP8X" and bool(head[20] & ANIMATED)


def read_outline(file: BinaryIO) -> Outline:
    """Read what an animation says of itself.

    Raises
    ------
    DamagedError
        It is no animation, or ends too early to tell anything.
    """
    size, plays, delays = (0, 0), 0, Counter[Fraction]()
    has_alpha, is_whole = False, True
    try:
        for name, _ in chunks_in(file):
            if name == b"VP8X":
                data = read_exactly(file, 10)
                size, has_alpha = _canvas(data), bool(data[0] & ALPHA)
            elif name == b"ANIM":
                _, plays = unpacked("<IH", read_exactly(file, 6))
            elif name == b"ANMF":
                head = read_exactly(file, 16)
                delays[_delay(head)] += 1
                has_alpha |= bool(head[15] & CLEARS) or (delays.total() == 1 and _size(head) != size)
    except DamagedError:
        is_whole = False
    return outline_of(size, delays, plays, has_alpha=has_alpha, is_whole=is_whole)


def read_pieces(file: BinaryIO) -> Iterator[Piece]:
    """Decode the frames of an animation one by one.

    Raises
    ------
    DamagedError
        It ends within a frame, or a frame cannot be decoded.
    """
    canvas = 0, 0
    for name, size in chunks_in(file):
        if name == b"VP8X":
            canvas = _canvas(read_exactly(file, 10))
        if name != b"ANMF":
            continue
        head, content = read_exactly(file, 16), read_exactly(file, size - 16) if size > 16 else b""
        if any(side > whole for side, whole in zip(_size(head), canvas, strict=True)):
            raise DamagedError
        image = _decoded(content, *_size(head))
        disposal: Disposal = "clear" if head[15] & CLEARS else "keep"
        yield Piece(image, 2 * _three(head, 3), 2 * _three(head, 0), _delay(head), not head[15] & REPLACES, disposal)


def _three(data: bytes, place: int) -> int:
    return int.from_bytes(data[place : place + 3], "little")


def _canvas(data: bytes) -> tuple[int, int]:
    """Height and width of the whole."""
    return 1 + _three(data, 7), 1 + _three(data, 4)


def _size(head: bytes) -> tuple[int, int]:
    """Height and width of a frame."""
    return 1 + _three(head, 9), 1 + _three(head, 6)


def _delay(head: bytes) -> Fraction:
    return Fraction(_three(head, 12), CLOCK) or DEFAULT_DELAY


def _decoded(content: bytes, height: int, width: int) -> Image:
    """Decode a frame as the still image that it is."""
    extended = b""
    if content[:4] == b"ALPH":
        size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
        extended = chunk_bytes(b"VP8X", bytes((ALPHA, 0, 0, 0)) + size)
    still = chunk_bytes(b"RIFF", b"WEBP" + extended + content)
    if declared_size(still) != (width, height):
        raise DamagedError
    image = decoded_still(still)
    if image.shape[:2] != (height, width):
        raise DamagedError
    return with_four_channels(image)


class WebpWriter:
    """Writes an animated WebP, without loss; see `AnimationWriter`. Of each frame it stores what changed.

    Parameters
    ----------
    file : file of bytes
        Open for writing, empty.
    plays : int
        How often the animation is shown; 0 for ever again.
    """

    def __init__(self, file: BinaryIO, plays: int) -> None:
        self._file, self._plays = file, plays
        self._before: Image | None = None

    def add(self, image: Image, delay: Fraction) -> None:
        height, width = image.shape[:2]
        rows, columns = slice(0, height), slice(0, width)
        if self._before is None:
            self._write_head(height, width, image.shape[2] == 4)
        else:
            rows, columns = changed_part(self._before, image, 2)
        changed = np.ascontiguousarray(image[rows, columns])
        numbers = (columns.start // 2, rows.start // 2, changed.shape[1] - 1, changed.shape[0] - 1, int(delay * CLOCK))
        head = b"".join(number.to_bytes(3, "little") for number in numbers)
        still = BytesIO(encode_image(Path("frame.webp"), changed))
        pixels = b"".join(chunk_bytes(name, still.read(size)) for name, size in chunks_in(still) if name in _pixels)
        self._file.write(chunk_bytes(b"ANMF", head + bytes((REPLACES,)) + pixels))
        if self._file.tell() > MAX_FILE:
            raise OutputError("A WebP file cannot grow beyond 4 GB; write an .apng, or images.")
        self._before = image

    def _write_head(self, height: int, width: int, has_alpha: bool) -> None:
        self._file.write(struct.pack("<4sI4s", b"RIFF", 0, b"WEBP"))
        size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
        self._file.write(chunk_bytes(b"VP8X", bytes((ANIMATED | (ALPHA if has_alpha else 0), 0, 0, 0)) + size))
        self._file.write(chunk_bytes(b"ANIM", struct.pack("<IH", 0, self._plays)))

    def finish(self) -> None:
        size = self._file.tell() - 8
        self._file.seek(4)
        self._file.write(struct.pack("<I", size))
