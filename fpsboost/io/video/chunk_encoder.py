"""Encode frames into chunks, the unit of a conversion to video.

A chunk holds a fixed number of the output's frames, one after the other, and follows from these frames and the options
alone: its encoder is opened anew. Its file is complete or absent. What is put together of chunks is therefore the same
whichever runs have made them, and a frame of a finished chunk need not be made again.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import av

from fpsboost.frame import Frame
from fpsboost.heap import return_free_memory
from fpsboost.io.video.chunks import Chunk, ChunkWriter
from fpsboost.io.video.encoder import VideoEncoder


class ChunkEncoder:
    """Encoder of frames into chunk files, after those that earlier runs have finished.

    Parameters
    ----------
    folder : Path
        Folder of the chunk files.
    chunks : list of Chunk
        Chunks that are there; each finished one is appended.
    encoder : VideoEncoder
        Opened and closed for every chunk.
    chunk_frames : int
        Frames per chunk; the last one may have fewer.
    first : int
        Number of the first chunk.
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
