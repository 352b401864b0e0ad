"""The segments of a JPEG file before its pixels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

START_OF_SCAN = 0xDA
_start_of_frame = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}


class Segment(NamedTuple):
    """Its mark, where it begins in the file, and its content."""

    mark: int
    place: int
    content: bytes


def segments_in(data: bytes) -> Iterator[Segment]:
    """Yield the segments of a file up to the start of its scan; none where it is no JPEG."""
    place = 2 if data.startswith(b"\xff\xd8") else len(data)
    while data[place : place + 1] == b"\xff" and place + 4 <= len(data):
        mark, end = data[place + 1], place + 2 + int.from_bytes(data[place + 2 : place + 4])
        if mark == 0xFF:  # a filler
            place += 1
            continue
        yield Segment(mark, place, data[place + 4 : end])
        if mark == START_OF_SCAN:
            return
        place = max(end, place + 4)


def frame_header(data: bytes) -> bytes:
    """Return the frame header of a JPEG: depth, height, width and number of components; b"" without one."""
    return next((each.content for each in segments_in(data) if each.mark in _start_of_frame), b"")


def components_of(data: bytes) -> int:
    """Return how many values a pixel of a JPEG has; 0 where it does not say."""
    return int.from_bytes(frame_header(data)[5:6])
