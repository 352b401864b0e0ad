"""Write a video file: encode new pictures, and carry over everything else of the source unchanged.

The output keeps exact times, orientation, pixel aspect ratio, colour tags, titles and chapters; audio and subtitles are
copied packet by packet. Pictures are encoded in chunks of a fixed number of frames, in a hidden folder beside the
output file. At the end the chunks are muxed into a file that is renamed to its final name when it is complete. A run
that is stopped therefore leaves its finished chunks, and a later run that resumes from them makes the same file.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from fpsboost.colour import Coding
from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.frame import Frame
from fpsboost.image import Pixels
from fpsboost.io.output import Output, check_frame_size
from fpsboost.io.video.ycc import as_picture
from fpsboost.media.chunks import CHUNK_FRAMES, Assembly, Chunk, ChunkWriter, find_chunks
from fpsboost.media.encoder import VideoEncoder
from fpsboost.media.encoding import (
    EXACT_TIME_BASE_CONTAINERS,
    MATROSKA_TICK,
    VIDEO_SUFFIXES,
    choose_encoder,
    containers,
    depth_of,
)
from fpsboost.media.files import check_writable
from fpsboost.media.fitting import Fitting, fit_streams
from fpsboost.media.pixels import BT709, BT2020, has_alpha
from fpsboost.media.side_data import MASTERING
from fpsboost.media.staging import PartFolder, StagedSink, StagingDirectory, complete_already, hidden_place
from fpsboost.media.traits import VideoTraits, primaries, transfers
from fpsboost.memory import return_free_memory


class ChunkSink(StagedSink):
    """Sink that encodes frames into chunks of a fixed number of frames, which are kept if it is left early.

    The encoder is opened anew for every chunk, so that a chunk follows from its frames and the options alone, and the
    output is the same whichever runs have encoded which chunks. A run that resumes gets all frames again, but encodes
    only those behind the chunks that are complete.

    Parameters
    ----------
    output : Output
        Size, times and options of the frames to come, and what is known of their source.
    unfinished : StagingDirectory
        Hidden folder, opened and locked when the sink is entered.
    folder : Path
        Folder of the chunk files, in or at `unfinished`.
    chunk_frames : int
        Frames per chunk.

    Raises
    ------
    OptionError, OutputError
        Options contradict each other, or the container cannot hold the codec or a stream; known before any frame is
        encoded.
    """

    holds_last_frame = True

    def __init__(self, output: Output, unfinished: StagingDirectory, folder: Path, chunk_frames: int) -> None:
        self._output, self._name, self._chunk_frames = output, unfinished.name, chunk_frames
        self._unfinished, self._folder = unfinished, folder
        self._container = container_of(output)
        codec, _ = self._choose_encoder(output.stream.traits)
        # what the container cannot hold is known before any frame is encoded
        plan = Fitting(output.path, self._container, output.encoding, output.stream.video, output.window)
        self._fitting = fit_streams(plan, codec)
        self._chunks: list[Chunk] = []
        self._first_chunk = 0 if output.part is None else output.part.first // chunk_frames
        self._encoder: VideoEncoder | None = None
        self._writer: ChunkWriter | None = None
        self._durations: dict[int, int] = {}
        self._frames_seen = self._frames_in_chunk = 0
        self._last_pts: int | None = None
        self._last_original: object | None = None
        self._reformatter = VideoReformatter()
        self._remarks: list[str] = []

    @property
    def remarks(self) -> list[str]:
        return [*self._unfinished.remarks, *(self._encoder.remarks if self._encoder else []), *self._remarks]

    @property
    def details(self) -> str:
        """Encoder, pixel format and options, for verbose output; empty before the encoder is opened."""
        return "" if self._encoder is None else f"{self._output.path}: {self._encoder.details}"

    def __enter__(self) -> Self:
        """Lock the hidden folder, and find the chunks of an earlier run; for video, open the encoder.

        Sets `completed_frames`. Whatever fails, the folder is released.
        """
        try:
            with self._explained():
                # Created at once, so that a folder without write permission is detected before any work is done.
                self._unfinished.open()
                self._chunks = find_chunks(self._folder, self._first_chunk)
                self.completed_frames = self._frames_finished
                if self._output.stream.traits is not None:
                    self._start(self._output.stream.traits)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def write(self, frame: Frame) -> None:
        """Encode the next frame, unless an earlier run has finished it.

        Times are rounded to ticks of the output's time base and must increase by at least one. Raises `OutputError` if
        they do not, if the frame has another size, or if encoding or writing fails.
        """
        name = self._output.path
        check_frame_size(frame, self._output.info, name)
        with self._explained():
            if self._encoder is None:
                self._start(traits_of_image(frame.pixels, self._output.stream.colours))
            encoder = self._encoder
            assert encoder is not None
            self._remark_on(frame, encoder)
            time_base = self._output.timing.time_base
            pts = round(frame.time / time_base)
            if self._last_pts is not None and pts <= self._last_pts:
                raise OutputError(
                    f"{name} cannot tell two frames at {float(frame.time):.6f} s apart; choose a lower rate."
                )
            self._last_pts = pts
            self._frames_seen += 1
            if self._frames_seen > self.completed_frames:
                end = round((frame.time + frame.duration) / time_base)
                self._encode(encoder, frame, pts, max(1, end - pts))

    def _explained(self) -> contextlib.AbstractContextManager[None]:
        return explained_writing(self._name)

    def _start(self, traits: VideoTraits) -> av.VideoStream:
        """Open an encoder for the source's traits or those of the first frame, and return its stream."""
        self._encoder = VideoEncoder(self._output, *self._choose_encoder(traits), self._container, traits)
        return self._encoder.stream  # opened here, so that errors occur before any work is done

    def _leave(self, error: BaseException | None) -> None:
        """Close and discard everything but the finished chunks that a later run can resume from."""
        if self._writer is not None:
            self._writer.discard()
        if self._encoder is not None:
            self._encoder.close()
        part = self._output.part
        expected = self._output.expected_frames if part is None else part.frames
        self._unfinished.leave(error, self._frames_finished, expected)

    @property
    def _frames_finished(self) -> int:
        """Number of frames in complete chunks."""
        return sum(chunk.frames for chunk in self._chunks)

    def _encode(self, encoder: VideoEncoder, frame: Frame, pts: int, duration: int) -> None:
        """Encode a frame at `pts` for `duration`, both in ticks, and end the chunk if it is complete."""
        if self._writer is None:
            extradata = bytes(encoder.stream.codec_context.extradata or b"")
            self._writer = ChunkWriter(self._folder, self._first_chunk + len(self._chunks), extradata)
        self._durations[pts] = duration
        traits, pixel_format = encoder.traits, encoder.pixel_format
        coding = Coding(
            depth_of(pixel_format), traits.color_space, encoder.full_range, traits.chroma_location, pixel_format
        )
        # decoded pictures are used where the source is video
        keeps_original = self._output.stream.traits is not None
        picture = as_picture(frame, coding, self._reformatter, keeps_original=keeps_original)
        self._keep(self._writer, encoder.encode(picture, pts, duration, is_original=picture is frame.original))
        self._frames_in_chunk += 1
        if self._frames_in_chunk == self._chunk_frames:
            self._finish_chunk()
            return_free_memory()  # of the encoder, which lived as long as its packets

    def _finish_chunk(self) -> None:
        """Flush the encoder, and give the chunk file its final name; no effect between chunks."""
        if self._writer is not None and self._encoder is not None:
            self._keep(self._writer, self._encoder.finish())
            self._chunks.append(self._writer.finish(self._frames_in_chunk))
            self._writer, self._frames_in_chunk = None, 0

    def _keep(self, writer: ChunkWriter, packets: Iterable[av.Packet[Any]]) -> None:
        """Append packets to the chunk, each with the duration of its frame."""
        for packet in packets:
            writer.add(packet, self._durations.pop(packet.pts, 0) if packet.pts is not None else 0)

    def _choose_encoder(self, traits: VideoTraits | None) -> tuple[str, dict[str, str]]:
        """Return FFmpeg's encoder and its options; the depth of images is known only from the first image on."""
        coding = ("yuv420p", "") if traits is None else (traits.pixel_format, traits.codec)
        pixels = self._output.info.height * self._output.info.width
        return choose_encoder(self._output.encoding, self._container, self._output.path, *coding, pixels=pixels)

    def _remark_on(self, frame: Frame, encoder: VideoEncoder) -> None:
        """Add a remark, once each, on alpha, depth, light and closed captions of a frame that the output lacks."""
        name, is_float = self._output.path, frame.image.dtype == np.float32
        is_beyond = is_float and bool(np.logical_or(frame.array[..., :3] < 0, frame.array[..., :3] > 1).any())
        # an original before this frame was not written
        is_replaced = frame.original is None and frame.preceding is not self._last_original
        has_more = frame.image.shape[2] == 4 and not has_alpha(encoder.pixel_format)
        lost = {
            f"{name} cannot hold an alpha channel, which was left out.": has_more,
            # with fewer bits a remark exists already
            f"{name} holds the floating-point values of its source in 16 bits.": is_float
            and depth_of(encoder.pixel_format) == 16,
            f"{name} holds no light beyond white or below black, which was clipped; images as .exr keep it.": is_beyond,
            f"{name} lost closed captions where pictures of its source gave way to interpolated ones.": is_replaced
            and encoder.has_captions,
        }
        self._last_original = frame.original or self._last_original
        self._remarks += [remark for remark, is_lost in lost.items() if is_lost and remark not in self._remarks]


class VideoSink(ChunkSink):
    """Sink that encodes frames into a video file, which gets its final name when it is complete.

    Colour tags and pixel aspect ratio are the source's; from a video file also audio, subtitles, titles, chapters and
    orientation are carried over.

    Parameters
    ----------
    output : Output
        Path of the file, size, times and options of the frames to come, and what is known of their source.
    chunk_frames : int
        Frames per chunk: what a run that is stopped loses at most.

    Raises
    ------
    CompleteAlreadyError
        The job is to be resumed, and its output exists without an unfinished part.
    OptionError, OutputError
        The path cannot be written, exists, is an input, or its container cannot hold the streams.
    """

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        self._path, files = Path(output.path), output.stream.files
        place = hidden_place(self._path.parent, self._path.name)
        unfinished = StagingDirectory(place, f"output{self._path.suffix.lower()}", output.path, output.job)
        resumes = output.job is not None and output.job.resume and not output.overwrite
        is_input = self._path.exists() and any(path.exists() and self._path.samefile(path) for path in files)
        if resumes and self._path.is_file() and not is_input and not unfinished.is_pending:
            raise CompleteAlreadyError(complete_already(output.path))
        check_writable(self._path, output.path, files, output.overwrite)
        super().__init__(output, unfinished, unfinished.folder, chunk_frames)
        self._assembly: Assembly | None = None

    @property
    def remarks(self) -> list[str]:
        return [*super().remarks, *(self._assembly.remarks if self._assembly else [])]

    def join(self, chunks: Sequence[Chunk], traits: VideoTraits) -> None:
        """Take complete chunks of all frames, encoded elsewhere with the same options, instead of calls of `write`.

        `traits` are those that they were encoded with.
        """
        with self._explained():
            if self._encoder is None:
                self._start(traits)
        self._chunks = list(chunks)

    def _start(self, traits: VideoTraits) -> av.VideoStream:
        """Open the encoder, and write the header of the output file."""
        template = super()._start(traits)  # the file's header is written at once
        time_base = self._output.timing.time_base
        self._assembly = Assembly(self._unfinished.staged, template, time_base, self._fitting, traits)
        return template

    def _finish(self) -> None:
        """Mux all chunks and the other streams, and rename the file; `OutputError` if there was no frame."""
        self._finish_chunk()
        if self._assembly is None or not self._chunks:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        self._assembly.finish(self._chunks)
        self._unfinished.publish(self._path)

    def _leave(self, error: BaseException | None) -> None:
        if self._assembly is not None:
            self._assembly.discard()
        super()._leave(error)


class VideoPartSink(ChunkSink):
    """Sink that encodes a part of a video into chunks, which appear in a folder of their own when all are complete.

    Parameters
    ----------
    output : Output
        As for `VideoSink`, with `part`, which begins at the first frame of a chunk.
    """

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        self._part = PartFolder(output.part, output.job, overwrite=output.overwrite)
        super().__init__(output, self._part, self._part.staged, CHUNK_FRAMES)

    def _finish(self) -> None:
        self._finish_chunk()
        if len(find_chunks(self._folder, self._first_chunk)) < len(self._chunks):
            raise OutputError(f"{self._name} was not written because it cannot be read back; check the disk.")
        self._part.publish_part()


def traits_of_image(image: Pixels | None, colours: VideoTraits) -> VideoTraits:
    """Return the traits to write for images: limited range, own channels and depth, and the colours that they name.

    Colours that they do not name, or by unknown numbers, are tagged as BT.709. Y, Cb and Cr are made by the matrix of
    BT.2020 for its primaries, otherwise by that of BT.709.
    """
    channels = 3 if image is None else image.shape[2]
    deep = image is not None and image.dtype != np.uint8
    matrix = BT2020 if colours.color_primaries == BT2020 else BT709
    return VideoTraits(
        {1: "gray", 3: "gbrp"}.get(channels, "gbrap") + ("16le" if deep else ""),
        color_space=matrix,
        tagged_color_space=matrix,
        color_primaries=colours.color_primaries if colours.color_primaries in primaries else BT709,
        color_transfer=colours.color_transfer if colours.color_transfer in transfers else BT709,
        mastering_display=colours.mastering_display,
        light_level=colours.light_level,
        side_data={kind: word for kind, word in colours.side_data.items() if word == MASTERING},
    )


def container_of(output: Output) -> str:
    """Return FFmpeg's name of an output's container; raise `OutputError` if none can hold it."""
    container = containers.get(Path(output.path).suffix.lower())
    if container is None:
        raise OutputError(f"{output.path} has no suffix of a video file; use one of {', '.join(VIDEO_SUFFIXES)}.")
    if container not in EXACT_TIME_BASE_CONTAINERS and 1 / output.timing.rate < MATROSKA_TICK:
        raise OutputError(
            f"{output.path} counts time in milliseconds and cannot hold {float(output.timing.rate):g} frames per "
            "second; write an .mp4 or .mov instead."
        )
    return container


@contextlib.contextmanager
def explained_writing(name: str) -> Iterator[None]:
    """Convert errors of FFmpeg and the operating system into an `OutputError` with a sentence about the file."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        other = f"could not be written ({error.strerror or error}); try another `codec` or container."
        raise OutputError(f"{name} {_reasons.get(error.errno or 0, other)}") from error


_reasons = {
    errno.ENOSPC: "could not be finished because the disk is full; free some space and run again.",
    errno.EDQUOT: "could not be finished because the disk quota is used up; free some space and run again.",
    errno.EACCES: "may not be written; check the permissions of its folder.",
    errno.EPERM: "may not be written; check the permissions of its folder.",
    errno.EROFS: "lies on a read-only disk; choose another folder.",
    errno.EFBIG: "grew larger than the disk or the system allows; choose another disk or a higher `crf`.",
}
