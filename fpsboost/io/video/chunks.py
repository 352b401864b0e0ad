"""Encoded packets in chunks on disk, the unit of a conversion to video.

A chunk is a fixed number of frames, encoded independently of all others. Its file, complete or absent, is a ZIP archive
of the packets' data, one after the other, and an index with everything else. FFmpeg's containers would round times,
rewrite packets or drop side data when writing and reading.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args
from zipfile import BadZipFile, ZipFile, ZipInfo

import av
from av.packet import PacketSideData, PktSideDataT

from fpsboost.io.staging import rename_safely, sync

CHUNK_FRAMES = 240
"""Frames per chunk: near the default maximum keyframe interval of x264 and x265, so chunks do not enlarge the file."""

CHUNK_SUFFIX = ".chunk"
DATA, INDEX = "packets", "index.json"
DAMAGES = (BadZipFile, zlib.error, EOFError, KeyError, OSError, OverflowError, RuntimeError, ValueError)
"""What reading a damaged archive raises."""

kinds_of_side_data: tuple[str, ...] = get_args(PktSideDataT)


class Times(NamedTuple):
    """Presentation time, decoding time and duration of a packet, in ticks."""

    pts: int
    dts: int | None
    duration: int


class ChunkWriter:
    """Writer of one chunk file, which is renamed to its final name when it is complete."""

    def __init__(self, folder: Path, number: int, extradata: bytes) -> None:
        self._path = folder / f"{number:08d}{CHUNK_SUFFIX}"
        self._part = self._path.with_name(self._path.name + ".part")
        self._archive = ZipFile(self._part, "w")
        self._data = self._archive.open(ZipInfo(DATA), "w", force_zip64=True)
        self._extradata = extradata
        self._packets: list[Any] = []

    def add(self, packet: av.Packet[Any], duration: int) -> None:
        side_data = [(item.data_type, bytes(item)) for item in packet.iter_sidedata()]
        self._data.write(b"".join([bytes(packet), *(content for _, content in side_data)]))
        sizes = [(kind, len(content)) for kind, content in side_data]
        self._packets.append(((packet.pts, packet.dts, duration), packet.is_keyframe, packet.size, sizes))

    def finish(self, frames: int) -> Chunk:
        self._data.close()
        index = {"frames": frames, "extradata": self._extradata.hex(), "packets": self._packets}
        self._archive.writestr(ZipInfo(INDEX), json.dumps(index))
        self._archive.close()
        sync(self._part)
        rename_safely(self._part, self._path)
        return _chunk_of(self._path, index)

    def discard(self) -> None:
        """Close the incomplete file, which later runs ignore because of its suffix."""
        with suppress(OSError), self._archive:  # the buffered rest may not fit on the disk
            self._data.close()


@dataclass(frozen=True)
class Chunk:
    """Complete chunk, and what must be known of all before the first is muxed."""

    path: Path
    frames: int
    extradata: bytes
    delay: int
    """Number of packets that are decoded before the first one is presented."""

    def read(self) -> tuple[list[Times], Iterator[av.Packet[Any]]]:
        """Return the times of all packets in decoding order, and the packets, without stream and time base."""
        packets = _index_of(self.path)["packets"]
        return _times_of(packets), self._packets(packets)

    def _packets(self, packets: Sequence[Any]) -> Iterator[av.Packet[Any]]:
        with ZipFile(self.path) as archive, archive.open(DATA) as data:
            for times, is_keyframe, size, side_data in packets:
                packet: av.Packet[Any] = av.Packet(data.read(size))
                packet.pts, packet.dts, packet.duration = times
                packet.is_keyframe = is_keyframe
                for kind, length in side_data:
                    item = PacketSideData(kinds_of_side_data.index(kind), length)  # type: ignore[call-arg]
                    item.update(data.read(length))
                    packet.set_sidedata(item)
                yield packet


def _index_of(path: Path) -> dict[str, Any]:
    with ZipFile(path) as archive:
        index: dict[str, Any] = json.loads(archive.read(INDEX))
        return index


def _times_of(packets: Sequence[Any]) -> list[Times]:
    return [Times(*times) for times, *_ in packets]


def _chunk_of(path: Path, index: dict[str, Any]) -> Chunk:
    times = _times_of(index["packets"])
    in_order = sorted(entry.pts for entry in times)
    places = {pts: place for place, pts in enumerate(in_order)}
    needed = max((place - places[entry.pts] for place, entry in enumerate(times)), default=0)
    delay = max(needed, sum(entry.dts is not None and entry.dts < in_order[0] for entry in times))
    return Chunk(path, index["frames"], bytes.fromhex(index["extradata"]), delay)


def complete_chunk(path: Path) -> Chunk:
    """Return a chunk that is known to be complete and intact, without reading all of it."""
    return _chunk_of(path, _index_of(path))


def find_chunks(folder: Path, first: int = 0) -> list[Chunk]:
    """Return the complete chunks in a folder from a number on, up to the first that is missing or damaged."""
    chunks: list[Chunk] = []
    with suppress(*DAMAGES):
        while True:
            path = folder / f"{first + len(chunks):08d}{CHUNK_SUFFIX}"
            with ZipFile(path) as archive:
                if archive.testzip() is not None:
                    break
            chunks.append(complete_chunk(path))
    return chunks
