"""Write a video file: new pictures encoded, everything else of the source carried over untouched.

The output keeps exact times, orientation, pixel shape, colour tags, titles and chapters; sound and subtitles are copied
packet by packet. Pictures are encoded in chunks of a fixed number of frames, in a hidden folder beside the file's final
place; they are put together at the end, and what was put together gets the file's name when it is complete. So a run
that is stopped leaves the chunks that it has finished, and a later one that goes on with them makes the same file.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import av.error
import numpy as np

from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.frame import ClipInfo, Frame, Image, describe
from fpsboost.io.staging import JobFingerprint, StagingDirectory, complete_already, hidden_place
from fpsboost.io.target import check_target
from fpsboost.io.trim import Window
from fpsboost.io.video.assembly import Assembly
from fpsboost.io.video.chunks import CHUNK_FRAMES, Chunk, ChunkWriter, find_chunks
from fpsboost.io.video.encoder import VideoEncoder, traits_of_image
from fpsboost.io.video.encoding import (
    CLOCK_OF_MATROSKA,
    EXACT_CLOCKS,
    VIDEO_SUFFIXES,
    Encoding,
    choose_encoder,
    containers,
    depth_of,
)
from fpsboost.io.video.fitting import Fitting, fit_streams
from fpsboost.io.video.pipe import PipeSource
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import has_alpha
from fpsboost.timing.schedule import OutputTiming


class VideoSink:
    """A video file, which appears under its name when it is complete.

    Parameters
    ----------
    path : str or path
        Target; its suffix is one of `VIDEO_SUFFIXES`.
    info : ClipInfo
        Size of the frames to come.
    timing : OutputTiming
        Rate and clock.
    encoding : Encoding
        How to encode, and what to carry over.
    source : VideoSource, PipeSource or None
        What to carry colour and pixel shape over from; of a file also sound, subtitles, titles and orientation.
    overwrite : bool
        Replace an existing file.
    job : JobFingerprint, optional
        What a later run must have in common with this one to go on with it; without one, nothing can be resumed.
    frame_count : int, optional
        Expected number of frames, for messages.
    chunk_frames : int
        Frames that are encoded together, which a later run takes over all or none.
    window : Window, optional
        Which part of the source is written.

    Raises
    ------
    OptionError
        Unknown codec, quality or preset, or a codec that the container cannot hold.
    OutputError
        The target exists, is the source itself, is being written by another run, cannot be written, or cannot hold the
        source's other streams.
    """

    holds_last_frame = True

    def __init__(
        self,
        path: str | os.PathLike[str],
        info: ClipInfo,
        timing: OutputTiming,
        encoding: Encoding,
        source: VideoSource | PipeSource | None,
        *,
        overwrite: bool,
        job: JobFingerprint | None = None,
        frame_count: int | None = None,
        chunk_frames: int = CHUNK_FRAMES,
        window: Window | None = None,
    ) -> None:
        self._window = window
        self._name = os.fspath(path)
        self._path = Path(path)
        self._timing, self._encoding = timing, encoding
        suffix = self._path.suffix.lower()
        if suffix not in containers:
            raise OutputError(f"{self._name} has no suffix of a video file; use one of {', '.join(VIDEO_SUFFIXES)}.")
        self._format = containers[suffix]
        file = source if isinstance(source, VideoSource) else None
        self._unfinished = StagingDirectory(
            hidden_place(self._path.parent, self._path.name), f"output{suffix}", self._name, job
        )
        inputs = [] if file is None else [file.path]
        if not overwrite and job is not None and job.resume and _is_there_already(self._path, inputs, self._unfinished):
            raise CompleteAlreadyError(complete_already(self._name))
        check_target(self._path, self._name, inputs, overwrite)
        if self._format not in EXACT_CLOCKS and 1 / timing.rate < CLOCK_OF_MATROSKA:
            raise OutputError(
                f"{self._name} counts time in milliseconds and cannot hold {float(timing.rate):g} frames per second; "
                "write an .mp4 or .mov instead."
            )
        self._source, self._traits = file, source.traits if source is not None else None
        self._codec, self._options = self._choose_encoder(self._traits)
        self._info = info if file is None else file.info  # whose first picture knows the size better than the header
        self._fitting = Fitting()
        if file is not None:
            self._fitting = fit_streams(file, encoding, self._codec, self._format, self._name, window)
        self._frame_count, self._chunk_frames = frame_count, chunk_frames
        self._encoder: VideoEncoder | None = None
        self._assembly: Assembly | None = None
        self._writer: ChunkWriter | None = None
        self._chunks: list[Chunk] = []
        self._frames_there = self._frames_seen = self._frames_in_chunk = 0
        self._durations: dict[int, int] = {}
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
        """How many frames an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def __enter__(self) -> Self:
        try:
            with self._explained():
                # Made at once, so that a folder that may not be written is noticed before any work is done.
                self._unfinished.open()
                self._chunks = find_chunks(self._unfinished.folder)
                self._frames_there = self._frames_finished
                if self._traits is not None:
                    self._start(self._traits)
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
        if frame.image.shape[:2] != (self._info.height, self._info.width):
            raise OutputError(
                f"{self._name} is {self._info.width}x{self._info.height} and cannot take a frame of "
                f"{describe(frame.image)}; make all frames one size first."
            )
        with self._explained():
            if self._encoder is None:
                self._start(traits_of_image(frame.image))
            assert self._encoder is not None
            if frame.image.dtype == np.float32:
                self._say_floats(frame.array)
            if frame.image.shape[2] == 4 and not self._alpha_dropped and not has_alpha(self._encoder.pixel_format):
                self._alpha_dropped = True
                self._remarks.append(f"{self._name} cannot hold an alpha channel, which was left out.")
            pts = round(frame.time / self._timing.time_base)
            if self._last_pts is not None and pts <= self._last_pts:
                raise OutputError(
                    f"{self._name} cannot tell two frames at {float(frame.time):.6f} s apart; choose a lower rate."
                )
            self._last_pts = pts
            self._frames_seen += 1
            if self._frames_seen > self._frames_there:
                self._encode(frame, pts)

    def _start(self, traits: VideoTraits) -> None:
        """Set up the encoder and write the file's header, so that what cannot work is known before any work is done.

        Where no source says what frames are like it takes a frame.
        """
        self._codec, self._options = self._choose_encoder(traits)
        self._encoder = VideoEncoder(
            self._name,
            self._codec,
            self._options,
            self._format,
            self._info,
            self._timing,
            self._encoding,
            traits,
            keeps_original=self._traits is not None,
        )
        self._assembly = Assembly(
            self._unfinished.staged,
            self._encoder.stream,
            self._timing.time_base,
            traits.display_matrix,
            self._source,
            encoding=self._encoding,
            container=self._format,
            name=self._name,
            fitting=self._fitting,
            window=self._window,
        )

    def _say_floats(self, image: Image) -> None:
        """Say once what whole numbers do not hold of floating-point images."""
        assert self._encoder is not None
        if self._last_pts is None and depth_of(self._encoder.pixel_format) == 16:  # else less depth is said already
            self._remarks.append(f"{self._name} holds the floating-point values of its source in 16 bits.")
        if not self._light_clipped and _is_beyond_white(image):
            self._light_clipped = True
            self._remarks.append(
                f"{self._name} holds no light beyond white or below black, which was clipped; images as .exr keep it."
            )

    def _choose_encoder(self, traits: VideoTraits | None) -> tuple[str, dict[str, str]]:
        """FFmpeg's encoder and its options; the depth of images is known only with the first of them."""
        known = ("yuv420p", "") if traits is None else (traits.pixel_format, traits.codec)
        return choose_encoder(self._encoding, self._format, self._name, *known)

    def _encode(self, frame: Frame, pts: int) -> None:
        assert self._encoder is not None
        if self._writer is None:
            extradata = bytes(self._encoder.stream.codec_context.extradata or b"")
            self._writer = ChunkWriter(self._unfinished.folder, len(self._chunks), extradata)
        end = round((frame.time + frame.duration) / self._timing.time_base)
        self._durations[pts] = max(1, end - pts)
        self._keep(self._encoder.encode(frame, pts, self._durations[pts]))
        self._frames_in_chunk += 1
        if self._frames_in_chunk == self._chunk_frames:
            self._finish_chunk()

    def _keep(self, packets: list[av.Packet[Any]]) -> None:
        assert self._writer is not None
        for packet in packets:
            self._writer.add(packet, self._durations.pop(packet.pts, 0) if packet.pts is not None else 0)

    def _finish_chunk(self) -> None:
        """Let the encoder end, so that what follows does not hang on what it has seen."""
        assert self._encoder is not None
        assert self._writer is not None
        self._keep(self._encoder.finish())
        self._chunks.append(self._writer.finish(self._frames_in_chunk))
        self._writer, self._frames_in_chunk = None, 0

    @property
    def _frames_finished(self) -> int:
        return sum(chunk.frames for chunk in self._chunks)

    def _finish(self) -> None:
        if self._assembly is None or self._last_pts is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        if self._writer is not None:
            self._finish_chunk()
        self._assembly.finish(self._chunks)
        self._unfinished.publish(self._path)

    def _leave(self, error: BaseException | None) -> None:
        """Let go of everything but finished chunks that a later run can go on with."""
        if self._writer is not None:
            self._writer.discard()
        if self._assembly is not None:
            self._assembly.discard()
        if self._encoder is not None:
            self._encoder.close()
        self._unfinished.leave(error, self._frames_finished, self._frame_count)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn what FFmpeg and the system raise into a sentence about the file."""
        try:
            yield
        except (av.error.FFmpegError, OSError) as error:
            raise OutputError(_explain(error, self._name)) from error


def _is_beyond_white(image: Image) -> bool:
    """Whether a float image has colours outside 0 to 1."""
    colours = image[..., :3]
    return bool(np.max(colours, initial=0) > 1 or np.min(colours, initial=0) < 0)


def _is_there_already(path: Path, inputs: Collection[Path], unfinished: StagingDirectory) -> bool:
    """Whether a run has finished an output, and none has begun it again."""
    is_input = path.exists() and any(each.exists() and path.samefile(each) for each in inputs)
    return path.is_file() and not is_input and not unfinished.is_pending


def _explain(error: Exception, name: str) -> str:
    reasons = {
        errno.ENOSPC: f"{name} could not be finished because the disk is full; free some space and run again.",
        errno.EDQUOT: f"{name} could not be finished because the disk quota is used up; free some space and run again.",
        errno.EACCES: f"{name} may not be written; check the permissions of its folder.",
        errno.EPERM: f"{name} may not be written; check the permissions of its folder.",
        errno.EROFS: f"{name} lies on a read-only disk; choose another folder.",
        errno.EFBIG: f"{name} grew larger than the disk or the system allows; choose another disk or a higher --crf.",
    }
    number = getattr(error, "errno", None)
    reason = getattr(error, "strerror", None) or error
    return reasons.get(number or 0, f"{name} could not be written ({reason}); try another --codec or container.")
