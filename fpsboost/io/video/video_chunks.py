"""Encode frames into the chunks of an output video, after those that earlier runs have finished.

A chunk is the unit of a conversion to video: a fixed number of frames, encoded independently of all others.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import av
import numpy as np

from fpsboost.errors import OutputError
from fpsboost.frame import Frame, Image, describe
from fpsboost.heap import return_free_memory
from fpsboost.io.output import Output
from fpsboost.io.video.chunks import Chunk, ChunkWriter, find_chunks
from fpsboost.io.video.encoder import VideoEncoder
from fpsboost.io.video.encoding import choose_encoder, depth_of
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import has_alpha


class VideoChunks:
    """Chunks of an output video.

    Parameters
    ----------
    output : Output
    container : str
        FFmpeg's name of the container that they are for.
    chunk_frames : int
        Frames per chunk.

    Attributes
    ----------
    chunks : list of Chunk
        Those that are finished.
    codec : str
        FFmpeg's name of the encoder.

    Raises
    ------
    OptionError
        The codec, quality or preset is unknown, or the container cannot hold the codec.
    """

    def __init__(self, output: Output, container: str, chunk_frames: int) -> None:
        self._output, self._name, self._container, self._chunk_frames = output, output.path, container, chunk_frames
        self.chunks: list[Chunk] = []
        self.codec, self._options = self._choose_encoder(output.stream.traits)
        self._folder: Path | None = None
        self._encoder: VideoEncoder | None = None
        self._chunk_encoder: ChunkEncoder | None = None
        self._frames_seen = self._frames_there = 0
        self._last_pts: int | None = None
        self._alpha_dropped = self._light_clipped = False
        self._remarks: list[str] = []

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the video cannot hold."""
        return [*(self._encoder.remarks if self._encoder else []), *self._remarks]

    @property
    def details(self) -> str:
        """Encoder, pixel format and options."""
        return "" if self._encoder is None else f"{self._name}: {self._encoder.details}"

    @property
    def completed_frames(self) -> int:
        """Number of frames in finished chunks."""
        return sum(chunk.frames for chunk in self.chunks)

    @property
    def first_chunk(self) -> int:
        """Number of the first chunk."""
        return 0 if self._output.part is None else self._output.part.first // self._chunk_frames

    def open(self, folder: Path) -> None:
        """Find the finished chunks in a folder; those to come are written there.

        Raises
        ------
        OSError
        """
        self._folder = folder
        self.chunks = find_chunks(folder, self.first_chunk)
        self._frames_there = self.completed_frames

    def start(self, traits: VideoTraits) -> av.VideoStream:
        """Set up the encoder, so that errors occur before any work is done; return a stream that is set up like it.

        Raises
        ------
        OptionError, OutputError
            The encoder cannot encode such frames.
        """
        assert self._folder is not None
        self.codec, self._options = self._choose_encoder(traits)
        self._encoder = VideoEncoder(self._output, self.codec, self._options, self._container, traits)
        self._chunk_encoder = ChunkEncoder(
            self._folder, self.chunks, self._encoder, self._chunk_frames, self.first_chunk
        )
        return self._encoder.stream

    @property
    def is_started(self) -> bool:
        """Whether the encoder is set up."""
        return self._encoder is not None

    def check_size(self, frame: Frame) -> None:
        """Raise `OutputError` if a frame does not have the size of the clip."""
        info = self._output.info
        if frame.image.shape[:2] != (info.height, info.width):
            raise OutputError(
                f"{self._name} is {info.width}x{info.height} and cannot take a frame of {describe(frame.image)}; make "
                "all frames one size first."
            )

    def write(self, frame: Frame) -> None:
        """Encode one frame, unless it is in a finished chunk; times must increase.

        Raises
        ------
        OutputError, av.error.FFmpegError, OSError
        """
        assert self._encoder is not None
        assert self._chunk_encoder is not None
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
            self._chunk_encoder.write(frame, pts, max(1, end - pts))

    def finish(self) -> None:
        """Finish the last chunk.

        Raises
        ------
        av.error.FFmpegError, OSError
        """
        if self._chunk_encoder is not None:
            self._chunk_encoder.finish()

    def discard(self) -> None:
        """Discard the chunk that is not finished."""
        if self._chunk_encoder is not None:
            self._chunk_encoder.discard()

    def _choose_encoder(self, traits: VideoTraits | None) -> tuple[str, dict[str, str]]:
        """Return FFmpeg's encoder and its options; the depth of images is known only from the first image on."""
        known = ("yuv420p", "") if traits is None else (traits.pixel_format, traits.codec)
        pixels = self._output.info.height * self._output.info.width
        return choose_encoder(self._output.encoding, self._container, self._name, *known, pixels=pixels)

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
    """Return whether a float image has colours outside 0 to 1."""
    colours = image[..., :3]
    return bool(np.max(colours, initial=0) > 1 or np.min(colours, initial=0) < 0)


class ChunkEncoder:
    """Encoder of frames into chunk files, which appends each finished one to `chunks`, those of earlier runs.

    The encoder is opened anew for every chunk, so that a chunk follows from its frames and the options alone, and the
    output is the same whichever runs have encoded which chunks.
    """

    def __init__(
        self, folder: Path, chunks: list[Chunk], encoder: VideoEncoder, chunk_frames: int, first: int = 0
    ) -> None:
        self._folder, self._chunks, self._encoder, self._chunk_frames = folder, chunks, encoder, chunk_frames
        self._first = first
        self._writer: ChunkWriter | None = None
        self._frames = 0
        self._durations: dict[int, int] = {}

    def write(self, frame: Frame, pts: int, duration: int) -> None:
        """Encode one frame; times are in ticks.

        Raises
        ------
        OutputError, av.error.FFmpegError, OSError
            The frame cannot be encoded, or the chunk cannot be written.
        """
        if self._writer is None:
            extradata = bytes(self._encoder.stream.codec_context.extradata or b"")
            self._writer = ChunkWriter(self._folder, self._first + len(self._chunks), extradata)
        self._durations[pts] = duration
        self._keep(self._writer, self._encoder.encode(frame, pts, duration))
        self._frames += 1
        if self._frames == self._chunk_frames:
            self.finish()
            return_free_memory()  # of the encoder, which lived as long as its packets

    def finish(self) -> None:
        """Finish the current chunk, if there is one, so that the next one does not depend on its frames.

        Raises
        ------
        av.error.FFmpegError, OSError
            The chunk cannot be encoded or written.
        """
        if self._writer is not None:
            self._keep(self._writer, self._encoder.finish())
            self._chunks.append(self._writer.finish(self._frames))
            self._writer, self._frames = None, 0

    def discard(self) -> None:
        """Discard the current chunk and close the encoder."""
        if self._writer is not None:
            self._writer.discard()
        self._encoder.close()

    def _keep(self, writer: ChunkWriter, packets: Iterable[av.Packet[Any]]) -> None:
        for packet in packets:
            writer.add(packet, self._durations.pop(packet.pts, 0) if packet.pts is not None else 0)
