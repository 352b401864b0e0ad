"""Store independently encoded chunks of video packets on disk; each chunk file is either complete or absent.

A chunk file holds the encoder's extradata and its packets one after the other, then a frame count and a checksum.
FFmpeg's containers would round times, rewrite packets or drop side data when writing and reading.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, get_args

import av
from av.packet import PacketSideData, PktSideDataT

from fpsboost.io.staging import rename_safely

CHUNK_FRAMES = 240
"""Frames per chunk: near the default maximum keyframe interval of x264 and x265, so chunks do not enlarge the file."""

CHUNK_SUFFIX = ".chunk"
FILE_MAGIC = b"fpsboost packets 1\n"
EXTRADATA_HEADER = struct.Struct("<I")
PACKET_HEADER = struct.Struct("<qqqBBI")
SIDE_DATA_HEADER = struct.Struct("<HI")
TRAILER = struct.Struct("<4sII")
NO_DTS = -(2**63)
READ_SIZE = 1 << 20
"""Bytes that are read at a time to compute the checksum of a chunk file."""

kinds_of_side_data: tuple[str, ...] = get_args(PktSideDataT)


@dataclass(frozen=True)
class Times:
    """Presentation time, decoding time and duration of a packet, in ticks."""

    pts: int
    dts: int | None
    duration: int


class ChunkWriter:
    """Writer of one chunk file, which is renamed to its final name when it is complete.

    Parameters
    ----------
    folder : Path
    number : int
        Number of the chunk, counted from 0.
    extradata : bytes
        Extradata of the encoder.
    """

    def __init__(self, folder: Path, number: int, extradata: bytes) -> None:
        self._path = folder / f"{number:08d}{CHUNK_SUFFIX}"
        self._part = self._path.with_name(self._path.name + ".part")
        self._file = self._part.open("wb")
        self._sum = 0
        self._write(FILE_MAGIC + EXTRADATA_HEADER.pack(len(extradata)) + extradata)

    def add(self, packet: av.Packet[Any], duration: int) -> None:
        """Write one packet with a duration of `duration` ticks."""
        assert packet.pts is not None
        side_data = list(packet.iter_sidedata())
        dts = NO_DTS if packet.dts is None else packet.dts
        self._write(PACKET_HEADER.pack(packet.pts, dts, duration, packet.is_keyframe, len(side_data), packet.size))
        for item in side_data:
            self._write(SIDE_DATA_HEADER.pack(kinds_of_side_data.index(item.data_type), item.data_size) + bytes(item))
        self._write(bytes(packet))

    def finish(self, frames: int) -> Chunk:
        """Close the chunk of `frames` frames and rename it to its final name."""
        self._file.write(TRAILER.pack(b"done", frames, self._sum))
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        rename_safely(self._part, self._path)
        return Chunk(self._path, frames)

    def discard(self) -> None:
        """Close the incomplete file, which later runs ignore because of its suffix."""
        with suppress(OSError):  # the buffered rest may not fit on the disk
            self._file.close()

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._sum = zlib.crc32(data, self._sum)


@dataclass(frozen=True)
class Chunk:
    """Complete chunk: its path and its number of frames."""

    path: Path
    frames: int

    @property
    def extradata(self) -> bytes:
        with self.path.open("rb") as file:
            return _read_extradata(file)

    def times(self) -> Iterator[Times]:
        """Yield the times of all packets in decoding order, without reading their data."""
        with self.path.open("rb") as file:
            for times, _, side_data, size in self._packet_headers(file):
                for _ in range(side_data):
                    _, length = SIDE_DATA_HEADER.unpack(file.read(SIDE_DATA_HEADER.size))
                    file.seek(length, os.SEEK_CUR)
                file.seek(size, os.SEEK_CUR)
                yield times

    def packets(self) -> Iterator[av.Packet[Any]]:
        """Yield all packets in decoding order, with neither stream nor time base set."""
        with self.path.open("rb") as file:
            for times, is_keyframe, side_data, size in self._packet_headers(file):
                items = [_read_side_data(file) for _ in range(side_data)]
                packet: av.Packet[Any] = av.Packet(file.read(size))
                packet.pts, packet.dts, packet.duration = times.pts, times.dts, times.duration
                packet.is_keyframe = is_keyframe
                for item in items:
                    packet.set_sidedata(item)
                yield packet

    def _packet_headers(self, file: BinaryIO) -> Iterator[tuple[Times, bool, int, int]]:
        """Yield the header of each packet as times, keyframe flag, number of side data items and size in bytes.

        The caller must read or skip the packet's side data and data before it asks for the next header.
        """
        end = self.path.stat().st_size - TRAILER.size
        _read_extradata(file)
        while file.tell() < end:
            pts, dts, duration, is_keyframe, side_data, size = PACKET_HEADER.unpack(file.read(PACKET_HEADER.size))
            yield Times(pts, None if dts == NO_DTS else dts, duration), bool(is_keyframe), side_data, size


def find_chunks(folder: Path, first: int = 0) -> list[Chunk]:
    """Return the complete chunks in a folder from a number on, up to the first that is missing or damaged."""
    found: list[Chunk] = []
    while True:
        path = folder / f"{first + len(found):08d}{CHUNK_SUFFIX}"
        frames = _frames_if_intact(path) if path.exists() else None
        if frames is None:
            return found
        found.append(Chunk(path, frames))


def complete_chunk(path: Path) -> Chunk:
    """Return a chunk that is known to be complete and intact, without reading all of it.

    Raises
    ------
    OSError
    """
    with path.open("rb") as file:
        file.seek(-TRAILER.size, os.SEEK_END)
        _, frames, _ = TRAILER.unpack(file.read(TRAILER.size))
    return Chunk(path, frames)


def _frames_if_intact(path: Path) -> int | None:
    """Return the number of frames of a chunk, or None if the file is damaged or incomplete."""
    left = path.stat().st_size - TRAILER.size
    if left < len(FILE_MAGIC) + EXTRADATA_HEADER.size:
        return None
    total = 0
    with path.open("rb") as file:
        begins_well = file.read(len(FILE_MAGIC)) == FILE_MAGIC
        file.seek(0)
        while left:
            data = file.read(min(left, READ_SIZE))
            total = zlib.crc32(data, total)
            left -= len(data)
        word, frames, expected = TRAILER.unpack(file.read(TRAILER.size))
    return int(frames) if begins_well and word == b"done" and total == expected else None


def _read_extradata(file: BinaryIO) -> bytes:
    file.seek(len(FILE_MAGIC))
    (length,) = EXTRADATA_HEADER.unpack(file.read(EXTRADATA_HEADER.size))
    return file.read(length)


def _read_side_data(file: BinaryIO) -> PacketSideData:
    kind, length = SIDE_DATA_HEADER.unpack(file.read(SIDE_DATA_HEADER.size))
    item = PacketSideData(kind, length)  # type: ignore[call-arg]
    item.update(file.read(length))
    return item
