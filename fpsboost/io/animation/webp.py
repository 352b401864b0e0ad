"""Animations made of the chunks of WebP files.

Each frame is a WebP file of its own, which OpenCV reads and writes. Pillow refuses an animation that ends early, holds
the whole file in memory, and shows one colour where an opaque frame is cleared; its encoder keeps all frames up to the
end and makes one of those that are alike. FFmpeg reads no animated WebP, and its muxer writes only whole pictures.
"""

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
from fpsboost.io.animation.canvas import DEFAULT_DELAY, Disposal, Outline, Step, changed_part, outline_of
from fpsboost.io.images.exact_reads import DamagedError, read_exactly, unpacked
from fpsboost.io.images.files import encode_image
from fpsboost.io.images.webp_chunks import ALPHA, ANIMATED, chunk_bytes, chunks_in

CLOCK = 1000  # ticks per second
MAX_DELAY = Fraction(2**24 - 1, CLOCK)
MAX_FILE = 2**32 - 2

CLEARS, REPLACES = 0x01, 0x02
"""Flags of a frame."""

_disposals: tuple[Disposal, ...] = ("keep", "clear")
_pixels = (b"ALPH", b"VP8 ", b"VP8L")


def is_animated(file: BinaryIO) -> bool:
    """Return whether an open WebP file says that it is an animation."""
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
                width, height = _numbers(data[4:])
                size, has_alpha = (1 + height, 1 + width), bool(data[0] & ALPHA)
            elif name == b"ANIM":
                _, plays = unpacked("<IH", read_exactly(file, 6))
            elif name == b"ANMF":
                step = _step(read_exactly(file, 16))
                delays[step.delay] += 1
                has_alpha |= step.disposal == "clear" or (delays.total() == 1 and (step.height, step.width) != size)
    except DamagedError:
        is_whole = False
    return outline_of(size, delays, plays, has_alpha=has_alpha, is_whole=is_whole)


def read_steps(file: BinaryIO) -> Iterator[tuple[Step, bytes]]:
    """Read the frames of an animation one by one, each as the content of a WebP file.

    Raises
    ------
    DamagedError
        It ends within a frame.
    """
    for name, size in chunks_in(file):
        if name == b"ANMF":
            step = _step(read_exactly(file, 16))
            content = read_exactly(file, max(0, size - 16))
            extended = _extended(ALPHA, step.height, step.width) if content[:4] == b"ALPH" else b""
            yield step, chunk_bytes(b"RIFF", b"WEBP" + extended + content)


def _step(head: bytes) -> Step:
    left, top, width, height, ticks = _numbers(head[:15])
    delay, disposal = Fraction(ticks, CLOCK) or DEFAULT_DELAY, _disposals[head[15] & CLEARS]
    return Step(1 + height, 1 + width, 2 * top, 2 * left, delay, not head[15] & REPLACES, disposal)


def _numbers(data: bytes) -> list[int]:
    """Return the 3-byte integers in `data`."""
    return [int.from_bytes(data[place : place + 3], "little") for place in range(0, len(data), 3)]


def _from_numbers(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(3, "little") for number in numbers)


def _extended(flags: int, height: int, width: int) -> bytes:
    """Return the chunk that says what a file holds, and its size."""
    return chunk_bytes(b"VP8X", bytes((flags, 0, 0, 0)) + _from_numbers(width - 1, height - 1))


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
        if self._before is None:
            self._write_head(*image.shape)
        rows, columns = changed_part(self._before, image, 2)
        changed = np.ascontiguousarray(image[rows, columns])
        height, width = changed.shape[:2]
        head = _from_numbers(columns.start // 2, rows.start // 2, width - 1, height - 1, int(delay * CLOCK))
        still = BytesIO(encode_image(Path("frame.webp"), changed))
        pixels = b"".join(chunk_bytes(name, still.read(size)) for name, size in chunks_in(still) if name in _pixels)
        self._file.write(chunk_bytes(b"ANMF", head + bytes((REPLACES,)) + pixels))
        if self._file.tell() > MAX_FILE:
            raise OutputError("A WebP file cannot grow beyond 4 GB; write an .apng, or images.")
        self._before = image

    def _write_head(self, height: int, width: int, channels: int) -> None:
        self._file.write(struct.pack("<4sI4s", b"RIFF", 0, b"WEBP"))
        self._file.write(_extended(ANIMATED | ALPHA * (channels == 4), height, width))
        self._file.write(chunk_bytes(b"ANIM", struct.pack("<IH", 0, self._plays)))

    def finish(self) -> None:
        size = self._file.tell() - 8
        self._file.seek(4)
        self._file.write(struct.pack("<I", size))
