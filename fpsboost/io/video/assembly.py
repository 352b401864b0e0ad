"""Mux encoded chunks and the other streams of the source into one output file."""

from __future__ import annotations

import contextlib
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import av
import av.container
import av.error

from fpsboost.errors import OutputError
from fpsboost.io.output import Output
from fpsboost.io.staging import sync
from fpsboost.io.video.chunks import Chunk
from fpsboost.io.video.encoding import EXACT_TIME_BASE_CONTAINERS, containers
from fpsboost.io.video.fitting import Fitting, check_readable, open_muxer
from fpsboost.io.video.other_streams import OtherStreams


class Assembly:
    """Output file whose header is written at once and whose packets are written when all chunks are complete.

    What the container cannot hold is therefore known before any frame is encoded. The path is the staged file's; the
    encoder of `template` is open and set up like that of the chunks.
    """

    def __init__(
        self,
        path: Path,
        template: av.VideoStream,
        output: Output,
        display_matrix: tuple[int, ...] | None,
        fitting: Fitting,
    ) -> None:
        self._path, self._time_base, self._name = path, output.timing.time_base, output.path
        self._container = container = containers[path.suffix]
        self._output: av.container.OutputContainer | None = open_muxer(path, container, any_codec=fitting.any_codec)
        self._others: OtherStreams | None = None
        try:
            self._stream = stream = self._output.add_stream_from_template(template)
            stream.time_base = self._time_base
            stream.codec_context.codec_tag = template.codec_context.codec_tag
            if display_matrix is not None:
                stream.set_display_matrix(display_matrix)
            if output.stream.video is not None:
                self._others = OtherStreams(output, output.stream.video, self._output, stream, container, fitting)
                if output.stream.traits is not None and output.stream.traits.stereo_mode:
                    stream.metadata["stereo_mode"] = output.stream.traits.stereo_mode  # Matroska's and WebM's element
                if container in EXACT_TIME_BASE_CONTAINERS:
                    self._output.container_options["movie_timescale"] = str(self._others.clock)
                    if self._others.tags.free_keys:
                        self._output.container_options["movflags"] = "+faststart+use_metadata_tags"
            self._output.start_encoding()
            if self._others is not None:
                self._others.copy_cover()
        except BaseException:
            self.discard()
            raise

    @property
    def remarks(self) -> list[str]:
        return self._others.remarks if self._others else []

    def finish(self, chunks: Sequence[Chunk]) -> None:
        """Write everything and close the file; raise `OutputError` for a chunk of an encoder with other settings."""
        assert self._output is not None
        extradata = bytes(self._stream.codec_context.extradata or b"")
        if any(chunk.extradata != extradata for chunk in chunks):
            raise OutputError(
                f"{self._name} was begun by an encoder that works differently; leave `resume` out to start anew."
            )
        self._mux(self._output, chunks)
        if self._others is not None:
            self._others.copy_until(None)
            self._others.close()
        output, self._output = self._output, None
        output.close()
        sync(self._path)
        others = self._others.written.values() if self._others is not None else ()
        check_readable(self._path, Counter(["video", *others]), self._name)
        if self._others is not None:
            self._others.check_labels(self._path)

    def discard(self) -> None:
        """Close everything and delete the file, before the muxer closes, so that FFmpeg does no faststart rewrite."""
        if self._others is not None:
            self._others.close()
        if self._output is None:
            return
        with contextlib.suppress(OSError):  # Windows cannot remove an open file; its folder is removed later
            self._path.unlink(missing_ok=True)
        output, self._output = self._output, None
        with contextlib.suppress(av.error.FFmpegError, OSError, ValueError):
            output.close()

    def _mux(self, output: av.container.OutputContainer, chunks: Sequence[Chunk]) -> None:
        """Mux the packets of the video, and those of the other streams that are due before each of them."""
        begin: tuple[int, int] | None = None
        end_pts = 0
        for packet, following in pairwise(chain(timed_packets(chunks), (None,))):
            assert packet is not None
            packet.time_base, packet.stream = self._time_base, self._stream
            pts, dts = packet.pts or 0, packet.dts or 0
            begin, end_pts = begin or (pts, dts), max(end_pts, pts + (packet.duration or 0))
            if following is None and self._container in EXACT_TIME_BASE_CONTAINERS:
                # The duration of an mp4 track is a sum of decoding time differences; only the last one can be chosen.
                left = (end_pts - begin[0]) - (dts - begin[1])
                packet.duration = left if left > 0 else packet.duration
            if self._others is not None:
                self._others.copy_until(dts * self._time_base)
            output.mux(packet)
        if begin is None:
            raise OutputError(f"{self._name} was not written because its encoder made nothing; try another `codec`.")


def timed_packets(chunks: Sequence[Chunk]) -> Iterator[av.Packet[Any]]:
    """Yield all packets with their decoding times in the whole output, in ticks.

    With reordering, those of each chunk's encoder reach back into the chunk before, and for fewer pictures than x265
    buffers they are far before the presentation times. So the decoding time of a packet is the presentation time of
    the picture a fixed number of places before it in presentation order.
    """
    delay = max(chunk.delay for chunk in chunks)
    presented: deque[int] = deque()
    for number, chunk in enumerate(chunks):
        times, packets = chunk.read()
        in_order = sorted(each.pts for each in times)
        if number == 0:
            shift = in_order[min(delay, len(in_order) - 1)] - in_order[0]
            presented.extend(pts - shift for pts in in_order[:delay])
        presented.extend(in_order)
        for packet in packets:
            packet.dts = presented.popleft()
            yield packet
