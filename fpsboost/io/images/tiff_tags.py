"""The tags of a TIFF file, which EXIF data consist of too: read by tifffile, and added to what OpenCV has written."""

from __future__ import annotations

import logging
import struct
from collections.abc import Mapping
from io import BytesIO
from typing import Any, NamedTuple

WIDTH, HEIGHT, ORIENTATION, PROFILE, XMP, PHOTOMETRIC = 256, 257, 274, 34675, 700, 262
BITS, SAMPLES, EXTRA_SAMPLES = 258, 277, 338
ACROSS, DOWN, RESOLUTION_UNIT = 282, 283, 296
BYTE, SHORT, RATIONAL, UNDEFINED = 1, 3, 5, 7
INCH, CENTIMETRE = 2, 3
MORE_PAGES = -1
"""No number of a tag: whether there is an image behind the first."""

_read = (*range(WIDTH, EXTRA_SAMPLES + 1), XMP, PROFILE)

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # its words on damaged tags, which are passed over


class Tag(NamedTuple):
    """The type of its values, how many there are, and their bytes, little-endian."""

    kind: int
    length: int
    data: bytes


def read_tags(data: bytes) -> dict[int, Any]:
    """Read tags of the first image by number, and `MORE_PAGES`; none where it is no TIFF, or damaged."""
    if not data.startswith((b"II", b"MM")):
        return {}
    from tifffile import TiffFile  # noqa: PLC0415  # only who has such files waits for it

    try:
        pages = TiffFile(BytesIO(data)).pages
        return {number: pages.first.tags.valueof(number) for number in _read} | {MORE_PAGES: len(pages) > 1}
    except (ArithmeticError, LookupError, TypeError, ValueError, struct.error):
        return {}


def number_of(tags: Mapping[int, Any], number: int) -> int | None:
    """Return the first value of a tag if it is an integer."""
    value = tags.get(number)
    first = value[0] if isinstance(value, tuple) and value else value
    return int(first) if isinstance(first, int) else None


def bytes_of(tags: Mapping[int, Any], number: int) -> bytes:
    """Return the bytes of a tag that is no number; b"" if there are none."""
    value = tags.get(number)
    return value.encode() if isinstance(value, str) else value if isinstance(value, bytes) else b""


def size_of(data: bytes) -> tuple[int, int] | None:
    """Width and height of the first image; None where it does not say so."""
    tags = read_tags(data)
    width, height = number_of(tags, WIDTH), number_of(tags, HEIGHT)
    return None if width is None or height is None else (width, height)


def with_tags(data: bytes, added: Mapping[int, Tag]) -> bytes:
    """Add tags to a little-endian, one-image TIFF, replacing existing tags of the same number."""
    (place,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, place)
    entries = [data[place + 2 + 12 * index :][:12] for index in range(count)]
    own = {struct.unpack_from("<H", entry)[0]: entry for entry in entries}
    result = bytearray(data)
    for number, tag in added.items():
        value = tag.data.ljust(4, b"\0")
        if len(tag.data) > 4:
            result += b"\0" * (len(result) % 2)
            value = struct.pack("<I", len(result))
            result += tag.data
        own[number] = struct.pack("<HHI", number, tag.kind, tag.length) + value
    result += b"\0" * (len(result) % 2)
    struct.pack_into("<I", result, 4, len(result))
    result += struct.pack("<H", len(own)) + b"".join(own[number] for number in sorted(own)) + bytes(4)
    return bytes(result)
