"""The tags of a TIFF file, which EXIF data consist of too: read, and added to what OpenCV has written."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import NamedTuple

ORIENTATION, PROFILE, XMP, PHOTOMETRIC = 274, 34675, 700, 262
BITS, SAMPLES, EXTRA_SAMPLES = 258, 277, 338
ACROSS, DOWN, RESOLUTION_UNIT = 282, 283, 296
BYTE, SHORT, RATIONAL, UNDEFINED = 1, 3, 5, 7
INCH, CENTIMETRE = 2, 3

_sizes = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_layouts = {SHORT: "H", 4: "I", RATIONAL: "II"}


class Tag(NamedTuple):
    """The type of its values, how many there are, and their bytes in the file's order."""

    kind: int
    length: int
    data: bytes


def read_tags(data: bytes) -> tuple[str, dict[int, Tag]]:
    """Read the tags of the first image.

    Returns
    -------
    str, dict of int to Tag
        The order of bytes as `struct` calls it, and the tags by number; none where it is no TIFF.
    """
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return "<", {}
    tags = {}
    try:
        (place,) = struct.unpack_from(order + "I", data, 4)
        (count,) = struct.unpack_from(order + "H", data, place)
        for index in range(count):
            at = place + 2 + 12 * index
            number, kind, length = struct.unpack_from(order + "HHI", data, at)
            size = _sizes.get(kind, 0) * length
            begin = at + 8 if size <= 4 else struct.unpack_from(order + "I", data, at + 8)[0]
            if begin + size <= len(data):
                tags[number] = Tag(kind, length, data[begin : begin + size])
    except struct.error:
        pass
    return order, tags


def has_more_pages(data: bytes) -> bool:
    """Whether there is an image behind the first."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return False
    try:
        (place,) = struct.unpack_from(order + "I", data, 4)
        (count,) = struct.unpack_from(order + "H", data, place)
        (following,) = struct.unpack_from(order + "I", data, place + 2 + 12 * count)
    except struct.error:
        return False
    return bool(following)


def numbers_of(order: str, tag: Tag | None) -> tuple[int, ...]:
    """The first value of a tag as whole numbers, two for a fraction; none where there is none."""
    layout = _layouts.get(tag.kind) if tag is not None else None
    if tag is None or layout is None or len(tag.data) < struct.calcsize(order + layout):
        return ()
    return struct.unpack_from(order + layout, tag.data)


def with_tags(data: bytes, added: Mapping[int, Tag]) -> bytes:
    """Add tags to a little-endian TIFF file of one image; its own of these numbers give way."""
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
