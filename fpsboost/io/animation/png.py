"""Animations made of the chunks of PNG files (APNG).

FFmpeg is not asked. Its decoder refuses gray of 1 bit and 16-bit alpha that is laid over, shows black where an opaque
frame is cleared, and rounds delays to 10 microseconds. Its muxer gives the last frame the delay of the one before, and
its encoder takes two to eight times as long as OpenCV, because it tries every way to draw a frame.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from io import BytesIO
from typing import BinaryIO

import cv2
import numpy as np

from fpsboost.errors import OutputError
from fpsboost.frame import Image, describe
from fpsboost.io.animation.canvas import (
    DEFAULT_DELAY,
    Disposal,
    Outline,
    Step,
    changed_part,
    outline_of,
)
from fpsboost.io.images.exact_reads import DamagedError, unpacked
from fpsboost.io.images.png_chunks import SIGNATURE, chunk_bytes, chunks_in

MAX_DELAY_PART = 65535  # a delay is a fraction of two 16-bit numbers

_disposals: tuple[Disposal, ...] = ("keep", "clear", "restore")
_coarse_clocks = (10_000, 1000, 100, 10, 1)


def is_apng(file: BinaryIO) -> bool:
    """Return whether an open PNG file says that it is an animation."""
    try:
        for chunk in chunks_in(file, (b"IDAT",)):
            if chunk.name in (b"acTL", b"IDAT"):
                return chunk.name == b"acTL"
    except DamagedError:
        pass
    return False


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
        for name, data in chunks_in(file, (b"IDAT", b"fdAT")):
            if name == b"IHDR":
                width, height, _, kind = unpacked(">IIBB", data)
                size, has_alpha = (height, width), kind in (4, 6)
            elif name == b"tRNS":
                has_alpha = True
            elif name == b"acTL":
                _, plays = unpacked(">II", data)
            elif name == b"fcTL":
                step = _step(data)
                delays[step.delay] += 1
                # what is cleared is transparent; the first frame fills the canvas, so that nothing else is
                has_alpha |= step.disposal == "clear" or (step.disposal == "restore" and delays.total() == 1)
    except DamagedError:
        is_whole = False
    return outline_of(size, delays, plays, has_alpha=has_alpha, is_whole=is_whole)


def read_steps(file: BinaryIO) -> Iterator[tuple[Step, bytes]]:
    """Read the frames of an animation one by one, each as the content of a PNG file.

    Raises
    ------
    DamagedError
        It ends within a frame.
    """
    header, common, step, content = b"", b"", None, bytearray()
    for name, data in chunks_in(file):
        if name == b"IHDR":
            header = data
        elif name in (b"PLTE", b"tRNS"):
            common += chunk_bytes(name, data)
        elif name in (b"fcTL", b"IEND"):
            if step is not None:
                resized = struct.pack(">II", step.width, step.height) + header[8:]
                head = SIGNATURE + chunk_bytes(b"IHDR", resized) + common
                yield step, head + chunk_bytes(b"IDAT", bytes(content)) + chunk_bytes(b"IEND", b"")
            step, content = (_step(data) if name == b"fcTL" else None), bytearray()
        elif name == b"IDAT" and step is not None:  # else a picture for those who know no animations
            content += data
        elif name == b"fdAT":
            content += data[4:]
    if step is not None:
        raise DamagedError


def _step(data: bytes) -> Step:
    _, width, height, left, top, above, below, disposal, blending = unpacked(">5I2H2B", data)
    delay = Fraction(above, below or 100) or DEFAULT_DELAY
    return Step(height, width, top, left, delay, blending == 1, _disposals[min(disposal, 2)])


class ApngWriter:
    """Writes an APNG, without loss; see `AnimationWriter`. Of each frame it stores what changed.

    Parameters
    ----------
    file : file of bytes
        Open for writing, empty.
    plays : int
        How often the animation is shown; 0 for ever again.
    """

    def __init__(self, file: BinaryIO, plays: int) -> None:
        self._file, self._plays = file, plays
        self._count = self._numbered = 0
        self._place_of_counts = 0
        self._before: Image | None = None

    def add(self, image: Image, delay: Fraction) -> None:
        is_first = self._before is None
        if self._before is not None and self._before.shape != image.shape:
            raise OutputError(f"One frame is {describe(image)}, unlike the first; make all frames alike.")
        rows, columns = changed_part(self._before, image, 1)
        changed = np.ascontiguousarray(image[rows, columns])
        _, data = cv2.imencode(".png", changed)
        chunks = list(chunks_in(BytesIO(data.tobytes())))
        if is_first:
            self._file.write(SIGNATURE + chunk_bytes(*chunks[0]))
            self._place_of_counts = self._file.tell()
            self._file.write(chunk_bytes(b"acTL", bytes(8)))
        height, width = changed.shape[:2]
        control = (width, height, columns.start, rows.start, delay.numerator, delay.denominator, 0, 0)
        self._file.write(chunk_bytes(b"fcTL", self._number() + struct.pack(">4I2H2B", *control)))
        content = b"".join(chunk.data for chunk in chunks if chunk.name == b"IDAT")
        self._file.write(chunk_bytes(b"IDAT", content) if is_first else chunk_bytes(b"fdAT", self._number() + content))
        self._before = image
        self._count += 1

    def finish(self) -> None:
        self._file.write(chunk_bytes(b"IEND", b""))
        self._file.seek(self._place_of_counts)
        self._file.write(chunk_bytes(b"acTL", struct.pack(">II", self._count, self._plays)))

    def _number(self) -> bytes:
        self._numbered += 1
        return struct.pack(">I", self._numbered - 1)


def representable_delay(delay: Fraction) -> Fraction:
    """Return the nearest delay that an APNG can store."""
    if max(delay.numerator, delay.denominator) <= MAX_DELAY_PART:
        return delay
    clock = next(clock for clock in _coarse_clocks if delay * clock <= MAX_DELAY_PART)
    return Fraction(round(delay * clock), clock)
