"""Encoded packets in chunks on disk, the unit of a conversion to video, and their assembly into one output file.

A chunk is a fixed number of frames, encoded independently of all others. Its file, complete or absent, is a ZIP archive
of the packets' data, one after the other, and an index with everything else. FFmpeg's containers would round times,
rewrite packets or drop side data when writing and reading.
"""

from __future__ import annotations

import json
import zlib
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, get_args
from zipfile import BadZipFile, ZipFile, ZipInfo

import av
from av.container import OutputContainer
from av.packet import PacketSideData, PktSideDataT

from fpsboost.media.captions import with_captions
from fpsboost.media.errors import OutputError, undone_by
from fpsboost.media.pyav import REFUSALS, Packet
from fpsboost.media.remarks import Remarks
from fpsboost.media.safe_files import rename_safely, sync
from fpsboost.media.stream_copier import MOVIE_CLOCK, StreamCopier
from fpsboost.media.stream_mapping import StreamMapping, check_readable, open_muxer
from fpsboost.media.traits import VideoTraits

CHUNK_FRAMES = 240
"""Frames per chunk: near the default maximum keyframe interval of x264 and x265, so chunks do not enlarge the file."""

CHUNK_SUFFIX = ".chunk"
DATA = "packets"
INDEX = "index.json"
DAMAGES = (BadZipFile, zlib.error, EOFError, KeyError, OSError, OverflowError, RuntimeError, ValueError)
"""Exceptions that reading a damaged archive raises."""

kinds_of_side_data: tuple[str, ...] = get_args(PktSideDataT)


class ChunkWriter:
    """Writer of one chunk file, which is renamed to its final name when it is complete.

    Parameters
    ----------
    folder : Path
        Existing folder of the chunks.
    number : int
        Place of the chunk in the output, counted from 0; it becomes the file's name.
    extradata : bytes
        Codec headers of the encoder, by which `Assembly` recognizes chunks of an encoder with other settings.
    """

    def __init__(self, folder: Path, number: int, extradata: bytes) -> None:
        self._path = folder / f"{number:08d}{CHUNK_SUFFIX}"
        self._part = self._path.with_name(self._path.name + ".part")
        self._archive = ZipFile(self._part, "w")
        self._data = self._archive.open(ZipInfo(DATA), "w", force_zip64=True)
        self._extradata = extradata
        self._packets: list[Any] = []

    def add(self, packet: Packet, duration: int, captions: bytes) -> None:
        """Append a packet, in decoding order; its data and side data are copied, with closed captions for its picture.

        Its times and `duration` are in ticks of the output's time base.
        """
        picture = with_captions(bytes(packet), captions)
        side_data = [(item.data_type, bytes(item)) for item in packet.iter_sidedata()]
        self._data.write(b"".join([picture, *(content for _, content in side_data)]))
        sizes = [(kind, len(content)) for kind, content in side_data]
        self._packets.append(((packet.pts, packet.dts, duration), packet.is_keyframe, len(picture), sizes))

    def finish(self, frames: int) -> Chunk:
        """Write the index, sync the file to disk and rename it; return the chunk, with its number of frames.

        The writer must not be used afterwards.
        """
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
    """Complete chunk file, with the facts about all of its packets that are needed before the first is muxed."""

    path: Path
    frames: int
    extradata: bytes
    """Codec headers of the encoder."""
    delay: int
    """Number of packets that are decoded before the first one is presented."""
    times: Sequence[int]
    """Presentation times, in that order, in ticks."""

    def read(self) -> Iterator[Packet]:
        """Yield the packets in decoding order, without stream and time base."""
        with ZipFile(self.path) as archive, archive.open(DATA) as data:
            for times, is_keyframe, size, side_data in _index_of(self.path)["packets"]:
                packet = av.Packet(data.read(size))
                packet.pts, packet.dts, packet.duration = times
                packet.is_keyframe = is_keyframe
                for kind, length in side_data:
                    item = PacketSideData(kinds_of_side_data.index(kind), length)  # type: ignore[call-arg]
                    item.update(data.read(length))
                    packet.set_sidedata(item)
                yield packet


def _index_of(path: Path) -> dict[str, Any]:
    """Read the index of a chunk file."""
    with ZipFile(path) as archive:
        return dict(json.loads(archive.read(INDEX)))


def _chunk_of(path: Path, index: dict[str, Any]) -> Chunk:
    """Describe a chunk by its index; its delay is that of the packets' order or of the encoder's decoding times."""
    times = [times for times, *_ in index["packets"]]
    in_order = sorted(pts for pts, *_ in times)
    places = {pts: place for place, pts in enumerate(in_order)}
    needed = max((place - places[pts] for place, (pts, *_) in enumerate(times)), default=0)
    delay = max(needed, sum(dts is not None and dts < in_order[0] for _, dts, _ in times))
    return Chunk(path, index["frames"], bytes.fromhex(index["extradata"]), delay, in_order)


def complete_chunk(path: Path) -> Chunk:
    """Return a chunk that is known to be complete and intact, without reading all of it."""
    return _chunk_of(path, _index_of(path))


def find_chunks(folder: Path, first: int = 0) -> list[Chunk]:
    """Return the complete chunks from a number on, up to the first that is missing or damaged; reads all data."""
    chunks: list[Chunk] = []
    with suppress(*DAMAGES):
        while True:
            path = folder / f"{first + len(chunks):08d}{CHUNK_SUFFIX}"
            with ZipFile(path) as archive:
                if archive.testzip() is not None:
                    break
            chunks.append(complete_chunk(path))
    return chunks


class Assembly:
    """Output file whose header is written at once, and whose packets are written when all chunks are complete.

    So what the container cannot hold is known before any frame is encoded.

    Parameters
    ----------
    path : Path
        Staged file to write, not the final name.
    template : av.VideoStream
        Stream of an open encoder with the settings of the chunks' encoder.
    mapping : StreamMapping
        Container, and the other streams of the source, if there is one.
    traits : VideoTraits
        Orientation and stereo mode to store in the container.
    """

    def __init__(
        self,
        path: Path,
        template: av.VideoStream,
        mapping: StreamMapping,
        traits: VideoTraits,
    ) -> None:
        output = mapping.output
        self._path = path
        self._time_base = output.timing.time_base
        self._name = output.path
        self._container = container = output.container
        self._output: OutputContainer | None = open_muxer(path, container, any_codec=mapping.any_codec)
        self._copier: StreamCopier | None = None
        with undone_by(self.discard):
            self._stream = stream = self._output.add_stream_from_template(template)
            stream.time_base = self._time_base
            stream.codec_context.codec_tag = template.codec_context.codec_tag
            if traits.display_matrix is not None:
                stream.set_display_matrix(traits.display_matrix)
            if output.stream.video is not None:
                self._copier = StreamCopier(mapping, output.stream.video, self._output, stream)
                if traits.stereo_mode:
                    stream.metadata["stereo_mode"] = traits.stereo_mode  # Matroska's and WebM's element
                if self._copier.tags.free_keys:
                    self._output.container_options["movflags"] = "+faststart+use_metadata_tags"
            if container.exact_times:
                clock = MOVIE_CLOCK if self._copier is None else self._copier.clock
                if output.timing.rate > clock:  # a whole frame could lie behind the end of its rounded edit list
                    clock = self._time_base.denominator
                self._output.container_options["movie_timescale"] = str(clock)
            self._output.start_encoding()
            if self._copier is not None:
                self._copier.copy_cover()

    @property
    def remarks(self) -> Remarks:
        return self._copier.remarks if self._copier else Remarks()

    def finish(self, chunks: Sequence[Chunk]) -> None:
        """Mux all chunks and the other streams, close the file, sync it to disk and read it back.

        Raises
        ------
        OutputError
            A chunk is of an encoder with other settings, there is no packet, or the finished file cannot be read.
        """
        assert self._output is not None
        extradata = bytes(self._stream.codec_context.extradata or b"")
        if any(chunk.extradata != extradata for chunk in chunks):
            raise OutputError(
                f"{self._name} was begun by an encoder that works differently; start anew without `resume`."
            )
        end = self._mux(self._output, chunks)
        if self._copier is not None:
            self._copier.finish(end * self._time_base)
        output = self._output
        self._output = None
        output.close()
        sync(self._path)
        others = self._copier.written.values() if self._copier is not None else ()
        check_readable(self._path, Counter(["video", *others]), self._name)
        if self._copier is not None:
            self._copier.check_labels(self._path)

    def discard(self) -> None:
        """Close and delete the file; deleted first, so that FFmpeg's muxer does no faststart rewrite on closing."""
        if self._copier is not None:
            self._copier.close()
        if self._output is None:
            return
        with suppress(OSError):  # Windows cannot remove an open file; its folder is removed later
            self._path.unlink(missing_ok=True)
        output = self._output
        self._output = None
        with suppress(*REFUSALS, OSError):
            output.close()

    def _mux(self, output: OutputContainer, chunks: Sequence[Chunk]) -> int:
        """Mux the packets of the video, and those of the other streams due before each; return its end in ticks."""
        begin: tuple[int, int] | None = None
        end_pts = 0
        for packet, following in pairwise(chain(timed_packets(chunks), (None,))):
            assert packet is not None
            packet.time_base = self._time_base
            packet.stream = self._stream
            pts = packet.pts or 0
            dts = packet.dts or 0
            begin = begin or (pts, dts)
            end_pts = max(end_pts, pts + (packet.duration or 0))
            if following is None and self._container.exact_times:
                # The duration of an mp4 track is a sum of decoding time differences; only the last one can be chosen.
                left = (end_pts - begin[0]) - (dts - begin[1])
                packet.duration = left if left > 0 else packet.duration
            if self._copier is not None:
                self._copier.copy_until(dts * self._time_base)
            output.mux(packet)
        if begin is None:
            raise OutputError(f"{self._name} was not written because its encoder made nothing; try another `codec`.")
        return end_pts


def timed_packets(chunks: Sequence[Chunk]) -> Iterator[Packet]:
    """Yield all packets with their decoding times in the whole output, in ticks.

    With reordering, those of each chunk's encoder reach back into the chunk before, and for fewer pictures than x265
    buffers they are far before the presentation times. So the decoding time of a packet is the presentation time of
    the picture a fixed number of places before it in presentation order.
    """
    delay = max(chunk.delay for chunk in chunks)
    presented: deque[int] = deque()
    for number, chunk in enumerate(chunks):
        if number == 0:
            shift = chunk.times[min(delay, len(chunk.times) - 1)] - chunk.times[0]
            presented.extend(pts - shift for pts in chunk.times[:delay])
        presented.extend(chunk.times)
        for packet in chunk.read():
            packet.dts = presented.popleft()
            yield packet
