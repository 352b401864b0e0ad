"""Headers of OpenEXR files with one part or several, read by hand before anything is decoded.

A few bytes can promise any size, so a file must hold the beginning of every one of its chunks before memory is taken
for what is in them, which neither of OpenEXR's readers asks for. Attributes are kept as they are stored, so that a file
made after another one can say the same, whatever its types are.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError

MAGIC = b"v/1\x01"
MAX_CHANNELS = 1024
MAX_PARTS = 1024

TILED, LONG_NAMES, DEEP, SEVERAL_PARTS = 0x200, 0x400, 0x800, 0x1000
"""Flags of the version."""

Precision = Literal["uint", "half", "float"]
_precisions: tuple[Precision, ...] = ("uint", "half", "float")
_kept_attributes = ("chromaticities", "whiteLuminance", "pixelAspectRatio")
_lines_per_chunk = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32}
"""By compression, as numbered in the format."""


class Window(NamedTuple):
    """A rectangle of pixels, both ends included."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top + 1, self.right - self.left + 1


class Attribute(NamedTuple):
    """An attribute as it is stored."""

    kind: str
    """Name of its type, ``box2i``."""
    value: bytes


class Channel(NamedTuple):
    """A channel of a part."""

    precision: Precision
    is_linear: bool
    """What the format calls pLinear: a hint for lossy compression."""
    is_subsampled: bool
    """Whether it has fewer pixels than the image."""


@dataclass(frozen=True, eq=False)
class ExrPart:
    """One part of a file: an image with channels of its own.

    Attributes
    ----------
    name : str
        Empty in a file with one part.
    channels : mapping of str to Channel
        By the names as they are stored, in the order of the alphabet.
    data, display : Window
        Where there are pixels, and what is to be shown.
    attributes : mapping of str to Attribute
        All of them, in the order of the file.
    is_tiled : bool
    chunks : (count,) int64 or None
        Where each chunk begins in the file; None for a compression of a later time.
    """

    name: str
    channels: Mapping[str, Channel]
    data: Window
    display: Window
    attributes: Mapping[str, Attribute]
    is_tiled: bool
    chunks: NDArray[np.int64] | None = None

    def full_name(self, channel: str) -> str:
        """Return the name of a channel with that of its part before it, unless it begins with that anyway."""
        return channel if not self.name or channel.startswith(f"{self.name}.") else f"{self.name}.{channel}"


@dataclass(frozen=True, eq=False)
class ExrHeader:
    """What a file says of itself.

    Attributes
    ----------
    version : int
        With its flags.
    parts : tuple of ExrPart
        At least one.
    tables : int
        Where the tables of chunks begin in the file.
    """

    version: int
    parts: tuple[ExrPart, ...]
    tables: int

    @cached_property
    def places(self) -> dict[str, tuple[ExrPart, str]]:
        """Part and stored name of every channel, by its full name."""
        return {part.full_name(name): (part, name) for part in self.parts for name in part.channels}

    @property
    def channels(self) -> dict[str, Precision]:
        """How precise each channel is, by its full name, in the order of the file."""
        return {name: part.channels[own].precision for name, (part, own) in self.places.items()}

    @property
    def subsampled(self) -> frozenset[str]:
        """Channels that have fewer pixels than the image."""
        return frozenset(name for name, (part, own) in self.places.items() if part.channels[own].is_subsampled)

    @property
    def display(self) -> Window:
        """What is to be shown, of all parts."""
        return self.parts[0].display

    @property
    def attributes(self) -> dict[str, tuple[float, ...]]:
        """What the file says of its colours and of the shape of its pixels, unless that is square."""
        first = self.parts[0].attributes
        stored = {name: first[name].value for name in _kept_attributes if name in first}
        values = {
            name: struct.unpack(f"<{len(value) // 4}f", value) for name, value in stored.items() if len(value) % 4 == 0
        }
        return {name: value for name, value in values.items() if (name, value) != ("pixelAspectRatio", (1.0,))}


def parse_exr_header(path: Path, data: bytes) -> ExrHeader:
    """Read what a file says of itself, nothing decoded.

    Parameters
    ----------
    path : Path
        For messages.
    data : bytes
        The content of the file, whole: it must have all its chunks.

    Raises
    ------
    InputError
        It is damaged, or has deep pixels.
    """
    if data[:4] != MAGIC:
        raise damaged(path)
    (version,) = struct.unpack("<I", data[4:8].ljust(4, b"\0"))
    if version & DEEP:
        raise InputError(f"{path} has deep pixels; save it as one flat image.")
    try:
        parts, end = _parts(data, version)
        header = ExrHeader(version, tuple(_with_chunks(data, version, parts, end)), end)
        if not header.places:
            raise ValueError("no channels")
        if len(header.places) != sum(len(part.channels) for part in parts):
            raise ValueError("two parts with one name")
    except (KeyError, IndexError, ValueError, OverflowError, ZeroDivisionError, struct.error) as error:
        raise damaged(path) from error
    if any(part.display != header.display for part in header.parts):
        raise InputError(f"{path} has parts of different sizes; save them with one display window.")
    return header


def damaged(path: Path) -> InputError:
    """Return the error to raise for a file that cannot be read."""
    return InputError(f"{path} is damaged or no OpenEXR file; replace it.")


def header_bytes(attributes: Mapping[str, Attribute]) -> bytes:
    """Return a part's header as it is stored."""
    stored = [
        b"\0".join((name.encode(), each.kind.encode(), struct.pack("<i", len(each.value)) + each.value))
        for name, each in attributes.items()
    ]
    return b"".join(stored) + b"\0"


def _parts(data: bytes, version: int) -> tuple[list[ExrPart], int]:
    """Return all parts without their chunks, and where the tables of chunks begin."""
    parts, place = list[ExrPart](), 8
    has_several = bool(version & SEVERAL_PARTS)
    while not parts or (has_several and data[place] != 0):
        attributes, place = _attributes(data, place)
        kind = attributes["type"].value if has_several else b""
        parts.append(
            ExrPart(
                attributes["name"].value.decode("utf-8") if has_several else "",
                _channels(attributes["channels"].value),
                Window(*struct.unpack("<4i", attributes["dataWindow"].value)),
                Window(*struct.unpack("<4i", attributes["displayWindow"].value)),
                attributes,
                kind == b"tiledimage" if has_several else bool(version & TILED),
            )
        )
        if min(parts[-1].data.size + parts[-1].display.size) < 1:
            raise ValueError("a window without pixels")
        if has_several and kind not in (b"scanlineimage", b"tiledimage"):
            raise ValueError("a part of an unknown kind")
        if len(parts) > MAX_PARTS:
            raise ValueError("more parts than any program writes")
    return parts, place + has_several


def _attributes(data: bytes, place: int) -> tuple[dict[str, Attribute], int]:
    """Return all attributes of a part by name, and the position after them."""
    attributes = {}
    while data[place] != 0:
        name, place = _word(data, place)
        kind, place = _word(data, place)
        (size,) = struct.unpack_from("<i", data, place)
        if not 0 <= size <= len(data) - place - 4:
            raise ValueError("an attribute ends behind the file")
        attributes[name] = Attribute(kind, data[place + 4 : place + 4 + size])
        place += 4 + size
    return attributes, place + 1


def _word(data: bytes, place: int) -> tuple[str, int]:
    """Read a null-terminated string; return it and the position after it."""
    end = data.index(b"\0", place)
    return data[place:end].decode("utf-8"), end + 1


def _channels(data: bytes) -> dict[str, Channel]:
    channels, place = {}, 0
    while data[place] != 0:
        name, place = _word(data, place)
        kind, is_linear, *sampling = struct.unpack_from("<iB3xii", data, place)
        channels[name] = Channel(_precisions[kind], bool(is_linear), sampling != [1, 1])
        place += 16
        if len(channels) > MAX_CHANNELS:
            raise ValueError("more channels than any program writes")
    return channels


def channel_bytes(channels: Mapping[str, Channel]) -> bytes:
    """Return a list of channels, none of which is subsampled, as it is stored."""
    stored = [
        name.encode() + b"\0" + struct.pack("<iB3xii", _precisions.index(each.precision), each.is_linear, 1, 1)
        for name, each in channels.items()
    ]
    return b"".join(stored) + b"\0"


def _with_chunks(data: bytes, version: int, parts: list[ExrPart], table: int) -> Iterator[ExrPart]:
    """Yield the parts with the places of their chunks, all of which lie within the file."""
    behind = table
    counts = []
    for part in parts:
        count = _full_count(part)
        if version & SEVERAL_PARTS:
            (declared,) = struct.unpack("<i", part.attributes["chunkCount"].value)
            if declared < (count or 0):
                raise ValueError("fewer chunks than the image has")
            count = declared
        counts.append(count)
        behind += 8 * (count or 0)
    for number, (part, count) in enumerate(zip(parts, counts, strict=True)):
        if count is None:  # the decoder will know
            yield part
            continue
        chunks = _checked_chunks(data, table, count, behind, part.is_tiled, number if version & SEVERAL_PARTS else None)
        table += 8 * count
        yield replace(part, chunks=chunks)


def _full_count(part: ExrPart) -> int | None:
    """Return the number of chunks of a part's full image; None for a compression of a later time."""
    rows, columns = part.data.size
    if part.is_tiled:
        across, down = struct.unpack_from("<II", part.attributes["tiles"].value)
        return int(-(-rows // down) * -(-columns // across))
    compression = part.attributes["compression"].value[0]
    if compression not in _lines_per_chunk:
        return None
    return -(-rows // _lines_per_chunk[compression])


def chunk_head(is_tiled: bool, has_several: bool) -> int:
    """Return how many bytes of a chunk come before its size."""
    return (16 if is_tiled else 4) + (4 if has_several else 0)


def _checked_chunks(
    data: bytes, table: int, count: int, behind: int, is_tiled: bool, part: int | None
) -> NDArray[np.int64]:
    """Return where a part's chunks begin, by the table and by what each one says of itself."""
    if behind > len(data):
        raise ValueError("the tables of chunks end behind the file")
    head = chunk_head(is_tiled, part is not None)
    chunks = np.frombuffer(data, "<u8", count, table)
    if count and (chunks.min() < behind or chunks.max() > len(data) - head - 4):
        raise ValueError("a chunk lies outside of the file")
    places = chunks.astype(np.int64)
    sizes = numbers_at(data, places + head)
    if sizes.min(initial=0) < 0 or (places + head + 4 + sizes).max(initial=0) > len(data):
        raise ValueError("a chunk ends behind the file")
    if part is not None and (numbers_at(data, places) != part).any():
        raise ValueError("a chunk of another part")
    return places


def numbers_at(data: bytes, places: NDArray[np.int64]) -> NDArray[Any]:
    """Return the whole numbers of four bytes at these places."""
    content = np.frombuffer(data, np.uint8)
    return np.ascontiguousarray(content[places[:, np.newaxis] + np.arange(4)]).view("<i4")[:, 0].astype(np.int64)
