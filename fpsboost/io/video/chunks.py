"""Encoded video on its way to a file: chunks of packets, each encoded by itself and whole on the disk or not there.

A chunk file is the encoder's extradata and its packets one after the other, closed by a count and a check sum. FFmpeg's
containers would round times, rewrite packets or forget side data on the way in and out.
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
"""Frames that are encoded together: as far apart as x264 and x265 set key frames anyway, so it costs no size."""

SUFFIX = ".chunk"
MAGIC = b"fpsboost packets 1\n"
EXTRADATA = struct.Struct("<I")
PACKET = struct.Struct("<qqqBBI")
SIDE_DATA = struct.Struct("<HI")
END = struct.Struct("<4sII")
UNKNOWN = -(2**63)
PORTION = 1 << 20

kinds_of_side_data: tuple[str, ...] = get_args(PktSideDataT)


@dataclass(frozen=True)
class Times:
    """When a packet is decoded and shown, in ticks."""

    pts: int
    dts: int | None
    duration: int


class ChunkWriter:
    """Writes one chunk, which gets its name when it is complete.

    Parameters
    ----------
    folder : Path
    number : int
        Counted from 0.
    extradata : bytes
        The encoder's.
    """

    def __init__(self, folder: Path, number: int, extradata: bytes) -> None:
        self._path = folder / f"{number:08d}{SUFFIX}"
        self._part = self._path.with_name(self._path.name + ".part")
        self._file = self._part.open("wb")
        self._sum = 0
        self._write(MAGIC + EXTRADATA.pack(len(extradata)) + extradata)

    def add(self, packet: av.Packet[Any], duration: int) -> None:
        """Write one packet, shown for `duration` ticks."""
        assert packet.pts is not None
        side_data = list(packet.iter_sidedata())
        dts = UNKNOWN if packet.dts is None else packet.dts
        self._write(PACKET.pack(packet.pts, dts, duration, packet.is_keyframe, len(side_data), packet.size))
        for item in side_data:
            self._write(SIDE_DATA.pack(kinds_of_side_data.index(item.data_type), item.data_size) + bytes(item))
        self._write(bytes(packet))

    def finish(self, frames: int) -> Chunk:
        """Close the chunk, of so many frames, and give it its name."""
        self._file.write(END.pack(b"done", frames, self._sum))
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        rename_safely(self._part, self._path)
        return Chunk(self._path, frames)

    def discard(self) -> None:
        """Close the file; it has no name that counts."""
        with suppress(OSError):  # what is still to be written may not fit on the disk
            self._file.close()

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._sum = zlib.crc32(data, self._sum)


@dataclass(frozen=True)
class Chunk:
    """A finished chunk: where it is, and how many frames it holds."""

    path: Path
    frames: int

    @property
    def extradata(self) -> bytes:
        with self.path.open("rb") as file:
            return _read_extradata(file)

    def times(self) -> Iterator[Times]:
        """Times of all packets, in the order of decoding, without their data."""
        with self.path.open("rb") as file:
            for times, _, side_data, size in self._walk(file):
                for _ in range(side_data):
                    _, length = SIDE_DATA.unpack(file.read(SIDE_DATA.size))
                    file.seek(length, os.SEEK_CUR)
                file.seek(size, os.SEEK_CUR)
                yield times

    def packets(self) -> Iterator[av.Packet[Any]]:
        """All packets in the order of decoding, of no stream and without a time base."""
        with self.path.open("rb") as file:
            for times, is_keyframe, side_data, size in self._walk(file):
                items = [_read_side_data(file) for _ in range(side_data)]
                packet: av.Packet[Any] = av.Packet(file.read(size))
                packet.pts, packet.dts, packet.duration = times.pts, times.dts, times.duration
                packet.is_keyframe = is_keyframe
                for item in items:
                    packet.set_sidedata(item)
                yield packet

    def _walk(self, file: BinaryIO) -> Iterator[tuple[Times, bool, int, int]]:
        """Yield what stands before each packet's data, which must be read before the next."""
        end = self.path.stat().st_size - END.size
        _read_extradata(file)
        while file.tell() < end:
            pts, dts, duration, is_keyframe, side_data, size = PACKET.unpack(file.read(PACKET.size))
            yield Times(pts, None if dts == UNKNOWN else dts, duration), bool(is_keyframe), side_data, size


def find_chunks(folder: Path) -> list[Chunk]:
    """The finished chunks of an earlier run, from the first up to the first that is missing or damaged."""
    found: list[Chunk] = []
    while True:
        path = folder / f"{len(found):08d}{SUFFIX}"
        frames = _frames_if_whole(path) if path.exists() else None
        if frames is None:
            return found
        found.append(Chunk(path, frames))


def _frames_if_whole(path: Path) -> int | None:
    """How many frames a chunk holds; None where it is not as it was written."""
    left = path.stat().st_size - END.size
    if left < len(MAGIC) + EXTRADATA.size:
        return None
    total = 0
    with path.open("rb") as file:
        begins_well = file.read(len(MAGIC)) == MAGIC
        file.seek(0)
        while left:
            data = file.read(min(left, PORTION))
            total = zlib.crc32(data, total)
            left -= len(data)
        word, frames, expected = END.unpack(file.read(END.size))
    return int(frames) if begins_well and word == b"done" and total == expected else None


def _read_extradata(file: BinaryIO) -> bytes:
    file.seek(len(MAGIC))
    (length,) = EXTRADATA.unpack(file.read(EXTRADATA.size))
    return file.read(length)


def _read_side_data(file: BinaryIO) -> PacketSideData:
    kind, length = SIDE_DATA.unpack(file.read(SIDE_DATA.size))
    item = PacketSideData(kind, length)  # type: ignore[call-arg]
    item.update(file.read(length))
    return item
