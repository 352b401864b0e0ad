"""Write a video file: encode new pictures, and carry over everything else of the source unchanged.

The output keeps exact times, orientation, pixel aspect ratio, colour tags, titles and chapters; audio and subtitles are
copied packet by packet. Pictures are encoded in chunks of a fixed number of frames, in a hidden folder beside the
output file. At the end the chunks are muxed into a file that is renamed to its final name when it is complete. A run
that is stopped therefore leaves its finished chunks, and a later run that resumes from them makes the same file.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import av.error
import numpy as np

from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.frame import Frame, Image, describe
from fpsboost.io.output import Output
from fpsboost.io.staging import StagingDirectory, complete_already, hidden_place
from fpsboost.io.video.assembly import Assembly
from fpsboost.io.video.chunk_encoder import ChunkEncoder
from fpsboost.io.video.chunks import CHUNK_FRAMES, Chunk, find_chunks
from fpsboost.io.video.encoder import VideoEncoder, traits_of_image
from fpsboost.io.video.encoding import (
    EXACT_TIME_BASE_CONTAINERS,
    MATROSKA_TICK,
    VIDEO_SUFFIXES,
    choose_encoder,
    containers,
    depth_of,
)
from fpsboost.io.video.fitting import fit_streams
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import has_alpha
from fpsboost.io.writable import check_writable


class VideoSink:
    """Sink that encodes frames into a video file, which gets its final name when it is complete.

    Parameters
    ----------
    output : Output
        Its path ends with one of `VIDEO_SUFFIXES`. Colour tags and pixel aspect ratio are the source's; of a file also
        audio, subtitles, titles and orientation.
    chunk_frames : int
        Frames per chunk; a later run reuses complete chunks only.

    Raises
    ------
    OptionError
        The codec, quality or preset is unknown, or the container cannot hold the codec.
    OutputError
        The target exists, is the source itself, is being written by another run, cannot be written, or cannot hold the
        source's other streams.
    """

    holds_last_frame = True

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        self._plan = output
        self._name, self._path = output.path, Path(output.path)
        suffix = self._path.suffix.lower()
        if suffix not in containers:
            raise OutputError(f"{self._name} has no suffix of a video file; use one of {', '.join(VIDEO_SUFFIXES)}.")
        self._container = containers[suffix]
        self._unfinished = StagingDirectory(
            hidden_place(self._path.parent, self._path.name), f"output{suffix}", self._name, output.job
        )
        resumes = output.job is not None and output.job.resume
        if resumes and not output.overwrite and self._is_complete_already():
            raise CompleteAlreadyError(complete_already(self._name))
        check_writable(self._path, self._name, output.stream.files, output.overwrite)
        if self._container not in EXACT_TIME_BASE_CONTAINERS and 1 / output.timing.rate < MATROSKA_TICK:
            raise OutputError(
                f"{self._name} counts time in milliseconds and cannot hold {float(output.timing.rate):g} frames per "
                "second; write an .mp4 or .mov instead."
            )
        self._codec, self._options = self._choose_encoder(output.stream.traits)
        self._fitting = fit_streams(output, self._codec, self._container)
        self._chunk_frames = chunk_frames
        self._encoder: VideoEncoder | None = None
        self._assembly: Assembly | None = None
        self._chunk_encoder: ChunkEncoder | None = None
        self._chunks: list[Chunk] = []
        self._frames_there = self._frames_seen = 0
        self._last_pts: int | None = None
        self._alpha_dropped = self._light_clipped = False
        self._remarks: list[str] = []

    @property
    def remarks(self) -> list[str]:
        parts = (self._unfinished, self._encoder, self._assembly)
        return [*(remark for part in parts if part for remark in part.remarks), *self._remarks]

    @property
    def details(self) -> str:
        """Encoder, pixel format and options."""
        return "" if self._encoder is None else f"{self._name}: {self._encoder.details}"

    @property
    def completed_frames(self) -> int:
        """Number of frames that an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def __enter__(self) -> Self:
        try:
            with self._explained():
                # Created at once, so that a folder without write permission is detected before any work is done.
                self._unfinished.open()
                self._chunks = find_chunks(self._unfinished.folder)
                self._frames_there = self._frames_finished
                if self._plan.stream.traits is not None:
                    self._start(self._plan.stream.traits)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with self._explained():
                    self._finish()
        except BaseException as failure:
            self._leave(failure)
            raise
        self._leave(error)

    def write(self, frame: Frame) -> None:
        """Encode one frame; times must increase.

        Raises
        ------
        OutputError
            The frame does not fit the clip, or the file cannot be written.
        """
        if frame.image.shape[:2] != (self._plan.info.height, self._plan.info.width):
            raise OutputError(
                f"{self._name} is {self._plan.info.width}x{self._plan.info.height} and cannot take a frame of "
                f"{describe(frame.image)}; make all frames one size first."
            )
        with self._explained():
            if self._encoder is None:
                self._start(traits_of_image(frame.pixels))
            assert self._encoder is not None
            if frame.image.dtype == np.float32:
                self._remark_on_floats(frame.array)
            if frame.image.shape[2] == 4 and not self._alpha_dropped and not has_alpha(self._encoder.pixel_format):
                self._alpha_dropped = True
                self._remarks.append(f"{self._name} cannot hold an alpha channel, which was left out.")
            pts = round(frame.time / self._plan.timing.time_base)
            if self._last_pts is not None and pts <= self._last_pts:
                raise OutputError(
                    f"{self._name} cannot tell two frames at {float(frame.time):.6f} s apart; choose a lower rate."
                )
            self._last_pts = pts
            self._frames_seen += 1
            if self._frames_seen > self._frames_there:
                assert self._chunk_encoder is not None
                end = round((frame.time + frame.duration) / self._plan.timing.time_base)
                self._chunk_encoder.write(frame, pts, max(1, end - pts))

    def _start(self, traits: VideoTraits) -> None:
        """Set up the encoder and write the file's header, so that errors occur before any work is done.

        Without the traits of a source, the traits are those of the first frame.
        """
        self._codec, self._options = self._choose_encoder(traits)
        self._encoder = VideoEncoder(self._plan, self._codec, self._options, self._container, traits)
        self._chunk_encoder = ChunkEncoder(self._unfinished.folder, self._chunks, self._encoder, self._chunk_frames)
        self._assembly = Assembly(
            self._unfinished.staged, self._encoder.stream, self._plan, traits.display_matrix, self._fitting
        )

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

    def _choose_encoder(self, traits: VideoTraits | None) -> tuple[str, dict[str, str]]:
        """Return FFmpeg's encoder and its options; the depth of images is known only from the first image on."""
        known = ("yuv420p", "") if traits is None else (traits.pixel_format, traits.codec)
        return choose_encoder(self._plan.encoding, self._container, self._name, *known)

    @property
    def _frames_finished(self) -> int:
        return sum(chunk.frames for chunk in self._chunks)

    def _finish(self) -> None:
        if self._assembly is None or self._last_pts is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        if self._chunk_encoder is not None:
            self._chunk_encoder.finish()
        self._assembly.finish(self._chunks)
        self._unfinished.publish(self._path)

    def _is_complete_already(self) -> bool:
        """Return whether an earlier run has finished the output and no later run has begun it again."""
        files = self._plan.stream.files
        is_input = self._path.exists() and any(each.exists() and self._path.samefile(each) for each in files)
        return self._path.is_file() and not is_input and not self._unfinished.is_pending

    def _leave(self, error: BaseException | None) -> None:
        """Close and discard everything but the finished chunks that a later run can resume from."""
        if self._chunk_encoder is not None:
            self._chunk_encoder.discard()
        if self._assembly is not None:
            self._assembly.discard()
        self._unfinished.leave(error, self._frames_finished, self._plan.expected_frames)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Convert errors of FFmpeg and the operating system into an OutputError with a message about the file."""
        try:
            yield
        except (av.error.FFmpegError, OSError) as error:
            raise OutputError(_explain(error, self._name)) from error


def _is_beyond_white(image: Image) -> bool:
    """Return whether a float image has colours outside 0 to 1."""
    colours = image[..., :3]
    return bool(np.max(colours, initial=0) > 1 or np.min(colours, initial=0) < 0)


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
