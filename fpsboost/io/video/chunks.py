"""Encode frames into chunks on disk, the unit of a conversion to video.

A chunk is a fixed number of frames, encoded independently of all others. Its file, complete or absent, is a ZIP archive
of the packets' data, one after the other, and an index with everything else. FFmpeg's containers would round times,
rewrite packets or drop side data when writing and reading.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args
from zipfile import BadZipFile, ZipFile, ZipInfo

import av
import numpy as np
from av.packet import PacketSideData, PktSideDataT

from fpsboost.errors import OutputError
from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.io.output import Output
from fpsboost.io.staging import rename_safely, sync
from fpsboost.io.video.encoder import VideoEncoder
from fpsboost.io.video.encoding import choose_encoder, depth_of
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import has_alpha
from fpsboost.memory import return_free_memory

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
        return Chunk(self._path, frames)

    def discard(self) -> None:
        """Close the incomplete file, which later runs ignore because of its suffix."""
        with suppress(OSError), self._archive:  # the buffered rest may not fit on the disk
            self._data.close()


@dataclass(frozen=True)
class Chunk:
    """Complete chunk: its path and its number of frames."""

    path: Path
    frames: int

    @property
    def extradata(self) -> bytes:
        return bytes.fromhex(_index_of(self.path)["extradata"])

    def times(self) -> list[Times]:
        """Return the times of all packets in decoding order, without reading their data."""
        return [Times(*times) for times, *_ in _index_of(self.path)["packets"]]

    def packets(self) -> Iterator[av.Packet[Any]]:
        """Yield all packets in decoding order, with neither stream nor time base set."""
        with ZipFile(self.path) as archive, archive.open(DATA) as data:
            for times, is_keyframe, size, side_data in _index_of(self.path)["packets"]:
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


def complete_chunk(path: Path) -> Chunk:
    """Return a chunk that is known to be complete and intact, without reading all of it."""
    return Chunk(path, _index_of(path)["frames"])


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


class VideoChunks:
    """Chunks of an output video for a container, of `chunk_frames` frames each.

    The encoder is opened anew for every chunk, so that a chunk follows from its frames and the options alone, and the
    output is the same whichever runs have encoded which chunks. `chunks` are the finished ones, `codec` is FFmpeg's
    encoder.
    """

    def __init__(self, output: Output, container: str, chunk_frames: int) -> None:
        self._output, self._name, self._container, self._chunk_frames = output, output.path, container, chunk_frames
        self.chunks: list[Chunk] = []
        self.codec, _ = self._choose_encoder(output.stream.traits)
        self._folder: Path | None = None
        self._first_chunk = 0 if output.part is None else output.part.first // chunk_frames
        self._encoder: VideoEncoder | None = None
        self._writer: ChunkWriter | None = None
        self._durations: dict[int, int] = {}
        self._frames_seen = self._frames_there = self._frames_in_chunk = 0
        self._last_pts: int | None = None
        self._alpha_dropped = self._light_clipped = False
        self._remarks: list[str] = []

    @property
    def remarks(self) -> list[str]:
        return [*(self._encoder.remarks if self._encoder else []), *self._remarks]

    @property
    def details(self) -> str:
        return "" if self._encoder is None else f"{self._name}: {self._encoder.details}"

    @property
    def completed_frames(self) -> int:
        return sum(chunk.frames for chunk in self.chunks)

    def open(self, folder: Path) -> None:
        """Find the finished chunks in a folder; those to come are written there."""
        self._folder = folder
        self.chunks = find_chunks(folder, self._first_chunk)
        self._frames_there = self.completed_frames

    def start(self, traits: VideoTraits) -> av.VideoStream:
        """Set up the encoder, so that errors occur before any work is done; return a stream that is set up like it."""
        self.codec, options = self._choose_encoder(traits)
        self._encoder = VideoEncoder(self._output, self.codec, options, self._container, traits)
        return self._encoder.stream

    @property
    def is_started(self) -> bool:
        return self._encoder is not None

    def write(self, frame: Frame) -> None:
        """Encode one frame, unless it is in a finished chunk; times must increase."""
        assert self._encoder is not None
        if frame.image.dtype == np.float32:
            self._remark_on_floats(frame.array)
        if frame.image.shape[2] == 4 and not self._alpha_dropped and not has_alpha(self._encoder.pixel_format):
            self._alpha_dropped = True
            self._remarks.append(f"{self._name} cannot hold an alpha channel, which was left out.")
        time_base = self._output.timing.time_base
        pts = round(frame.time / time_base)
        if self._last_pts is not None and pts <= self._last_pts:
            raise OutputError(
                f"{self._name} cannot tell two frames at {float(frame.time):.6f} s apart; choose a lower rate."
            )
        self._last_pts = pts
        self._frames_seen += 1
        if self._frames_seen > self._frames_there:
            end = round((frame.time + frame.duration) / time_base)
            self._encode(self._encoder, frame, pts, max(1, end - pts))

    def finish(self) -> None:
        """Finish the current chunk, if there is one, so that the next one does not depend on its frames."""
        if self._writer is not None and self._encoder is not None:
            self._keep(self._writer, self._encoder.finish())
            self.chunks.append(self._writer.finish(self._frames_in_chunk))
            self._writer, self._frames_in_chunk = None, 0

    def discard(self) -> None:
        """Discard the chunk that is not finished, and close the encoder."""
        if self._writer is not None:
            self._writer.discard()
        if self._encoder is not None:
            self._encoder.close()

    def _encode(self, encoder: VideoEncoder, frame: Frame, pts: int, duration: int) -> None:
        if self._writer is None:
            assert self._folder is not None
            extradata = bytes(encoder.stream.codec_context.extradata or b"")
            self._writer = ChunkWriter(self._folder, self._first_chunk + len(self.chunks), extradata)
        self._durations[pts] = duration
        self._keep(self._writer, encoder.encode(frame, pts, duration))
        self._frames_in_chunk += 1
        if self._frames_in_chunk == self._chunk_frames:
            self.finish()
            return_free_memory()  # of the encoder, which lived as long as its packets

    def _keep(self, writer: ChunkWriter, packets: Iterable[av.Packet[Any]]) -> None:
        for packet in packets:
            writer.add(packet, self._durations.pop(packet.pts, 0) if packet.pts is not None else 0)

    def _choose_encoder(self, traits: VideoTraits | None) -> tuple[str, dict[str, str]]:
        """Return FFmpeg's encoder and its options; the depth of images is known only from the first image on."""
        coding = ("yuv420p", "") if traits is None else (traits.pixel_format, traits.codec)
        pixels = self._output.info.height * self._output.info.width
        return choose_encoder(self._output.encoding, self._container, self._name, *coding, pixels=pixels)

    def _remark_on_floats(self, image: Image) -> None:
        """Add a remark, once each, on depth and light of floating-point images that the integer format cannot hold."""
        assert self._encoder is not None
        if self._last_pts is None and depth_of(self._encoder.pixel_format) == 16:  # else a remark exists already
            self._remarks.append(f"{self._name} holds the floating-point values of its source in 16 bits.")
        if not self._light_clipped and _is_beyond_white(image):
            self._light_clipped = True
            self._remarks.append(
                f"{self._name} holds no light beyond white or below black, which was clipped; images as .exr keep it."
            )


def _is_beyond_white(image: Image) -> bool:
    colours = image[..., :3]
    return bool(np.max(colours, initial=0) > 1 or np.min(colours, initial=0) < 0)
