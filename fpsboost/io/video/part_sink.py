"""Write a part of a video: its chunks, which are muxed with those of the other parts later."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from fpsboost.frame import Frame
from fpsboost.io.output import Output
from fpsboost.io.part_folder import PartFolder
from fpsboost.io.video.chunks import CHUNK_FRAMES
from fpsboost.io.video.encoder import traits_of_image
from fpsboost.io.video.explaining import explained_writing
from fpsboost.io.video.fitting import fit_streams
from fpsboost.io.video.sink import check_time_base, container_of
from fpsboost.io.video.video_chunks import VideoChunks


class VideoPartSink:
    """Sink that encodes the frames of a part into chunks, in a folder that appears when the part is complete.

    Parameters
    ----------
    output : Output
        With a part that begins with a chunk. Its path is that of the whole video.
    chunk_frames : int
        Frames per chunk.

    Raises
    ------
    OptionError, OutputError
        See `fpsboost.io.video.sink.VideoSink` and `fpsboost.io.part_folder.PartFolder`.
    """

    holds_last_frame = True

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        self._traits = output.stream.traits
        container = container_of(Path(output.path), output.path)
        check_time_base(output, container)
        self._folder = PartFolder(output)
        self._video = VideoChunks(output, container, chunk_frames)
        fit_streams(output, self._video.codec, container)  # what does not fit is known before any frame is made
        self._frames_there = 0

    @property
    def remarks(self) -> list[str]:
        return [*self._folder.remarks, *self._video.remarks]

    @property
    def details(self) -> str:
        """Encoder, pixel format and options."""
        return self._video.details

    @property
    def completed_frames(self) -> int:
        """Number of frames that an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def __enter__(self) -> Self:
        try:
            with explained_writing(self._folder.name):
                self._folder.open()
                self._video.open(self._folder.files)
                self._frames_there = self._video.completed_frames
                if self._traits is not None:
                    self._video.start(self._traits)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with explained_writing(self._folder.name):
                    self._video.finish()
                    self._folder.publish()
        except BaseException as failure:
            self._leave(failure)
            raise
        self._leave(error)

    def write(self, frame: Frame) -> None:
        """Encode one frame; times must increase.

        Raises
        ------
        OutputError
            The frame does not fit the clip, or the chunk cannot be written.
        """
        self._video.check_size(frame)
        with explained_writing(self._folder.name):
            if not self._video.is_started:
                self._video.start(traits_of_image(frame.pixels))
            self._video.write(frame)

    def _leave(self, error: BaseException | None) -> None:
        self._video.discard()
        self._folder.leave(error, self._video.completed_frames)
