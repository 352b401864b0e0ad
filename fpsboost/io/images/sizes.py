"""The size that an image file promises, from its first bytes and without decoding."""

from __future__ import annotations

import struct
from collections.abc import Callable

SIZE_OF_SHORT, SIZE_OF_LONG, SIZE_OF_LONG8 = 3, 4, 16
"""Types of TIFF's numbers."""

WIDTH, HEIGHT = 256, 257
"""TIFF's names of them."""

START_OF_FRAME = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that a size follows."""

Size = tuple[int, int]


def declared_size(data: bytes) -> Size | None:
    """Read what a PNG, JPEG, WebP, GIF, BMP or TIFF file says of its size.

    Parameters
    ----------
    data : bytes
        The whole file; of PNG, GIF and animated WebP, its beginning is enough.

    Returns
    -------
    (width, height) or None
        None where the file is another, or ends before it says so.
    """
    try:
        return next((read(data) for magic, read in readers.items() if data.startswith(magic)), None)
    except (struct.error, IndexError):
        return None


def _png(data: bytes) -> Size:
    width, height = struct.unpack_from(">2I", data, 16)
    return width, height


def _gif(data: bytes) -> Size:
    width, height = struct.unpack_from("<2H", data, 6)
    return width, height


def _bmp(data: bytes) -> Size:
    if data[14] == 12:  # OS/2
        width, height = struct.unpack_from("<2H", data, 18)
    else:
        width, height = struct.unpack_from("<2i", data, 18)
    return abs(width), abs(height)  # below 0: upside down


def _jpeg(data: bytes) -> Size | None:
    place = 2
    while data[place] == 0xFF:
        marker = data[place + 1]
        if marker in START_OF_FRAME:
            height, width = struct.unpack_from(">2H", data, place + 5)
            return width, height
        place += 1 if marker == 0xFF else 2 + int.from_bytes(data[place + 2 : place + 4])
    return None


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<2H", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


def _tiff(data: bytes) -> Size | None:
    order = "<" if data[:2] == b"II" else ">"
    (version,) = struct.unpack_from(f"{order}H", data, 2)
    first, count, entry = ("Q", "Q", "2HQ") if version == 43 else ("I", "H", "2HI")  # 43: beyond 4 GB
    (place,) = struct.unpack_from(order + first, data, 8 if version == 43 else 4)
    (entries,) = struct.unpack_from(order + count, data, place)
    place += struct.calcsize(order + count)
    step, found = struct.calcsize(f"{order}{entry}{first}"), {}
    for start in range(place, min(place + step * entries, len(data)), step):
        tag, kind, _ = struct.unpack_from(order + entry, data, start)
        letter = {SIZE_OF_SHORT: "H", SIZE_OF_LONG: "I", SIZE_OF_LONG8: "Q"}.get(kind)
        if tag in (WIDTH, HEIGHT) and letter:
            (found[tag],) = struct.unpack_from(order + letter, data, start + struct.calcsize(order + entry))
    return (found[WIDTH], found[HEIGHT]) if len(found) == 2 else None


readers: dict[bytes, Callable[[bytes], Size | None]] = {
    b"\x89PNG": _png,
    b"GIF8": _gif,
    b"BM": _bmp,
    b"\xff\xd8": _jpeg,
    b"RIFF": _webp,
    b"II": _tiff,
    b"MM": _tiff,
}
"""By the first bytes of a file."""
