"""Write a video file: encode new pictures, and carry over everything else of the source unchanged.

The output keeps exact times, orientation, pixel aspect ratio, colour tags, titles and chapters; audio and subtitles are
copied packet by packet. Pictures are encoded in chunks of a fixed number of frames, in a hidden folder beside the
output file. At the end the chunks are muxed into a file that is renamed to its final name when it is complete. A run
that is stopped therefore leaves its finished chunks, and a later run that resumes from them makes the same file.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import av.error

from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.frame import Frame
from fpsboost.io.new_output import check_writable
from fpsboost.io.output import Output, check_frame_size
from fpsboost.io.part import PartFolder
from fpsboost.io.staging import StagingDirectory, complete_already, hidden_place
from fpsboost.io.video.assembly import Assembly
from fpsboost.io.video.chunks import CHUNK_FRAMES, Chunk, VideoChunks
from fpsboost.io.video.encoder import traits_of_image
from fpsboost.io.video.encoding import EXACT_TIME_BASE_CONTAINERS, MATROSKA_TICK, VIDEO_SUFFIXES, containers
from fpsboost.io.video.fitting import fit_streams
from fpsboost.io.video.traits import VideoTraits


class _ChunkSink:
    """Sink that encodes frames into chunks, which are kept if it is left early."""

    holds_last_frame = True

    def __init__(self, output: Output, name: str, container: str, chunk_frames: int) -> None:
        self._output, self._name = output, name
        self._video = VideoChunks(output, container, chunk_frames)
        # what the container cannot hold is known before any frame is encoded
        self._fitting = fit_streams(output, self._video.codec, container)
        self._frames_there = 0

    @property
    def details(self) -> str:
        return self._video.details

    @property
    def completed_frames(self) -> int:
        """Number of frames that an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def __enter__(self) -> Self:
        try:
            with explained_writing(self._name):
                # Created at once, so that a folder without write permission is detected before any work is done.
                self._video.open(self._open())
                self._frames_there = self._video.completed_frames
                if self._output.stream.traits is not None:
                    self._start(self._output.stream.traits)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with explained_writing(self._name):
                    self._video.finish()
                    self._publish()
        except BaseException as failure:
            self._leave(failure)
            raise
        self._leave(error)

    def write(self, frame: Frame) -> None:
        check_frame_size(frame, self._output.info, self._output.path)
        with explained_writing(self._name):
            if not self._video.is_started:
                self._start(traits_of_image(frame.pixels))
            self._video.write(frame)

    def _open(self) -> Path:
        """Return the folder for the chunks, which is locked for this run."""
        raise NotImplementedError

    def _start(self, traits: VideoTraits) -> None:
        """Set up the encoder, so that errors occur before any work is done.

        Without the traits of a source, the traits are those of the first frame.
        """
        self._video.start(traits)

    def _publish(self) -> None:
        """Give the complete output its final name."""
        raise NotImplementedError

    def _leave(self, error: BaseException | None) -> None:
        """Close and discard everything but the finished chunks that a later run can resume from."""
        self._video.discard()


class VideoSink(_ChunkSink):
    """Sink that encodes frames into a video file, which gets its final name when it is complete.

    Colour tags and pixel aspect ratio are the source's; of a file also audio, subtitles, titles and orientation. A
    later run reuses complete chunks only.
    """

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        name, self._path = output.path, Path(output.path)
        container = container_of(self._path, name)
        place = hidden_place(self._path.parent, self._path.name)
        self._unfinished = StagingDirectory(place, f"output{self._path.suffix.lower()}", name, output.job)
        resumes = output.job is not None and output.job.resume
        if resumes and not output.overwrite and self._is_complete_already(output.stream.files):
            self._unfinished.remove_leftovers()
            raise CompleteAlreadyError(complete_already(name))
        check_writable(self._path, name, output.stream.files, output.overwrite)
        check_time_base(output, container)
        super().__init__(output, name, container, chunk_frames)
        self._assembly: Assembly | None = None

    @property
    def remarks(self) -> list[str]:
        parts = (self._unfinished, self._video, self._assembly)
        return [remark for part in parts if part for remark in part.remarks]

    def join(self, chunks: Sequence[Chunk], traits: VideoTraits) -> None:
        """Take chunks that were encoded elsewhere, all of the output's, instead of frames."""
        with explained_writing(self._name):
            if not self._video.is_started:
                self._start(traits)
        self._video.chunks[:] = chunks

    def _open(self) -> Path:
        self._unfinished.open()
        return self._unfinished.folder

    def _start(self, traits: VideoTraits) -> None:
        template = self._video.start(traits)  # the file's header is written at once
        self._assembly = Assembly(self._unfinished.staged, template, self._output, traits.display_matrix, self._fitting)

    def _publish(self) -> None:
        if self._assembly is None or not self._video.chunks:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        self._assembly.finish(self._video.chunks)
        self._unfinished.publish(self._path)

    def _is_complete_already(self, sources: Sequence[Path]) -> bool:
        """Return whether an earlier run has finished the output and no later run has begun it again."""
        is_input = self._path.exists() and any(path.exists() and self._path.samefile(path) for path in sources)
        return self._path.is_file() and not is_input and not self._unfinished.is_pending

    def _leave(self, error: BaseException | None) -> None:
        super()._leave(error)
        if self._assembly is not None:
            self._assembly.discard()
        self._unfinished.leave(error, self._video.completed_frames, self._output.expected_frames)


class VideoPartSink(_ChunkSink):
    """Sink that encodes the frames of a part into chunks, in a folder that appears when the part is complete.

    The part begins with a chunk; the output's path is that of the whole video.
    """

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        container = container_of(Path(output.path), output.path)
        check_time_base(output, container)
        self._folder = PartFolder(output)
        super().__init__(output, self._folder.name, container, chunk_frames)

    @property
    def remarks(self) -> list[str]:
        return [*self._folder.remarks, *self._video.remarks]

    def _open(self) -> Path:
        self._folder.open()
        return self._folder.files

    def _publish(self) -> None:
        self._folder.publish()

    def _leave(self, error: BaseException | None) -> None:
        super()._leave(error)
        self._folder.leave(error, self._video.completed_frames)


def container_of(path: Path, name: str) -> str:
    """Return FFmpeg's name of the container that a file name asks for; raise `OutputError` if it asks for none."""
    suffix = path.suffix.lower()
    if suffix not in containers:
        raise OutputError(f"{name} has no suffix of a video file; use one of {', '.join(VIDEO_SUFFIXES)}.")
    return containers[suffix]


def check_time_base(output: Output, container: str) -> None:
    """Raise `OutputError` if a container cannot tell the frames of an output apart."""
    if container not in EXACT_TIME_BASE_CONTAINERS and 1 / output.timing.rate < MATROSKA_TICK:
        raise OutputError(
            f"{output.path} counts time in milliseconds and cannot hold {float(output.timing.rate):g} frames per "
            "second; write an .mp4 or .mov instead."
        )


@contextlib.contextmanager
def explained_writing(name: str) -> Iterator[None]:
    """Convert errors of FFmpeg and the operating system into an `OutputError` with a sentence about the file."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        raise OutputError(_explain(error, name)) from error


def _explain(error: Exception, name: str) -> str:
    reasons = {
        errno.ENOSPC: f"{name} could not be finished because the disk is full; free some space and run again.",
        errno.EDQUOT: f"{name} could not be finished because the disk quota is used up; free some space and run again.",
        errno.EACCES: f"{name} may not be written; check the permissions of its folder.",
        errno.EPERM: f"{name} may not be written; check the permissions of its folder.",
        errno.EROFS: f"{name} lies on a read-only disk; choose another folder.",
        errno.EFBIG: f"{name} grew larger than the disk or the system allows; choose another disk or a higher `crf`.",
    }
    number = getattr(error, "errno", None)
    reason = getattr(error, "strerror", None) or error
    return reasons.get(number or 0, f"{name} could not be written ({reason}); try another `codec` or container.")
