"""Write a video file: encode pictures, and carry over everything else of the source unchanged.

The output keeps exact times, orientation, pixel aspect ratio, colour tags, titles and chapters; audio and subtitles are
copied packet by packet. Pictures are encoded in chunks of a fixed number of frames, in a hidden folder beside the
output file. At the end the chunks are muxed into a file that is renamed to its final name when it is complete. A run
that is stopped therefore leaves its finished chunks, and a later run that resumes from them makes the same file.
"""

import contextlib
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Self

from av import VideoFrame, VideoStream

from fpsboost.media.captions import captions_of
from fpsboost.media.chunks import CHUNK_FRAMES, Assembly, Chunk, ChunkWriter, find_chunks
from fpsboost.media.clip import Clip
from fpsboost.media.clock import Window
from fpsboost.media.encoder import VideoEncoder
from fpsboost.media.encoding import choose_encoder
from fpsboost.media.errors import CompleteAlreadyError, OutputError
from fpsboost.media.info import EncodeSettings, OutputTiming
from fpsboost.media.output import Output
from fpsboost.media.parts import PartFolder
from fpsboost.media.pictures import FormatUnifier
from fpsboost.media.pyav import Packet, explained_writing, trial_file
from fpsboost.media.remarks import Remark
from fpsboost.media.safe_files import check_writable
from fpsboost.media.staging import (
    StagedSink,
    StagingDirectory,
    UnfinishedOutput,
    complete_already,
    hidden_place,
)
from fpsboost.media.stream_mapping import map_streams
from fpsboost.media.traits import VideoTraits


class Writer(StagedSink):
    """Writer that encodes pictures into chunks of a fixed number, which are kept if it is left early.

    The encoder is opened anew for every chunk, so that a chunk follows from its pictures and the options alone, and the
    output is the same whichever runs have encoded which chunks. A run that resumes gets all pictures again, but encodes
    only those behind the chunks that are complete.

    Parameters
    ----------
    output : Output
        Size, times and options of the pictures to come, and what is known of their source.
    unfinished : StagingDirectory
        Hidden folder, opened and locked when the writer is entered.
    folder : Path
        Folder of the chunk files, in or at `unfinished`.
    chunk_frames : int
        Pictures per chunk: what a run that is stopped loses at most.

    Raises
    ------
    OptionError, OutputError
        Options contradict each other, or the container cannot hold the codec or a stream; known before encoding.
    """

    encoder: VideoEncoder | None = None
    """The encoder, open once the writer is entered; of images, which have no traits before, when it is started."""

    def __init__(self, output: Output, unfinished: StagingDirectory, folder: Path, chunk_frames: int) -> None:
        self._output = output
        self._name = unfinished.name
        self._chunk_frames = chunk_frames
        self._unfinished = unfinished
        self._folder = folder
        # what the container cannot hold is known before any picture is encoded
        encoder, _ = choose_encoder(output, output.stream.traits)
        self._mapping = map_streams(output, encoder)
        self._chunks: list[Chunk] = []
        self._first_chunk = 0 if output.part is None else output.part.first // chunk_frames
        self._writer: ChunkWriter | None = None
        self._pending: dict[int | None, tuple[int, bytes]] = {}  # ticks and captions of pictures in the encoder, by pts
        self._frames_seen = self._frames_in_chunk = 0
        self._last_pts: int | None = None
        self._unifier: FormatUnifier | None = None

    @property
    def remarks(self) -> list[Remark]:
        """What the file does not hold of its source so far, and what became of an earlier run."""
        return [*self._unfinished.remarks, *(self.encoder.remarks if self.encoder else [])]

    @property
    def details(self) -> str:
        """Encoder, pixel format and options, for verbose output; empty before the encoder is opened."""
        return "" if self.encoder is None else f"{self._output.path}: {self.encoder.details}"

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
                    self.start(self._output.stream.traits)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def start(self, traits: VideoTraits) -> VideoEncoder:
        """Open the encoder for pictures with these traits, unless it is open, and return it.

        Needed before the first `encode` of pictures whose source says nothing of them, such as images.
        """
        if self.encoder is None:
            with self._explained():
                self.encoder = VideoEncoder(self._output, traits)
                self._begin(self.encoder.stream, traits)  # opened here, so that errors occur before any work is done
        return self.encoder

    def _begin(self, template: VideoStream, traits: VideoTraits) -> None:
        """Prepare for packets like those of the stream of an open encoder."""

    @property
    def is_complete(self) -> bool:
        """Whether the next picture is in a chunk of an earlier run, so that `encode` ignores its pixels."""
        return self._frames_seen < self.completed_frames

    def encode(
        self,
        picture: VideoFrame | None,
        time: Fraction,
        duration: Fraction,
        *,
        is_original: bool = False,
        captions: bytes | None = None,
    ) -> bool:
        """Encode the next picture, unless an earlier run has finished it.

        Parameters
        ----------
        picture : av.VideoFrame
            Picture, which is converted to the encoder's size and pixel format if it has another; None if `is_complete`.
        time, duration : Fraction
            Presentation time and duration, seconds; times, in ticks of the output's time base, must increase.
        is_original : bool
            Whether it is a decoded picture of the source, whose own colour tags stay; others get the encoder's.
        captions : bytes, optional
            Closed captions to begin with it, as `captions_of` returns them; by default those that the picture carries.

        Returns
        -------
        bool
            Whether a chunk was finished with it, and the encoder closed.

        Raises
        ------
        OutputError
            Two pictures have the same time, or encoding or writing fails.
        """
        name = self._output.path
        time_base = self._output.timing.time_base
        encoder = self.encoder
        assert encoder is not None
        with self._explained():
            pts = round(time / time_base)
            if self._last_pts is not None and pts <= self._last_pts:
                raise OutputError(f"{name} cannot tell two frames at {float(time):.6f} s apart; choose a lower rate.")
            self._last_pts = pts
            self._frames_seen += 1
            if self._frames_seen <= self.completed_frames:
                return False
            assert picture is not None
            if self._writer is None:
                extradata = bytes(encoder.stream.codec_context.extradata or b"")
                self._writer = ChunkWriter(self._folder, self._first_chunk + len(self._chunks), extradata)
            ticks = max(1, round((time + duration) / time_base) - pts)
            captions = captions_of(picture) if captions is None else captions
            self._pending[pts] = ticks, captions if encoder.keeps_captions else b""
            picture = self._like_encoded(picture, encoder)
            self._keep(self._writer, encoder.encode(picture, pts, ticks, is_original=is_original))
            self._frames_in_chunk += 1
            if self._frames_in_chunk < self._chunk_frames:
                return False
            self._finish_chunk()
        return True

    def _like_encoded(self, picture: VideoFrame, encoder: VideoEncoder) -> VideoFrame:
        """Return a picture in the size and pixel format that the encoder takes; itself if it has both."""
        size = self._output.info.width, self._output.info.height
        pixel_format = encoder.pixel_format
        if (picture.width, picture.height) == size and picture.format.name == pixel_format:
            return picture
        traits = replace(encoder.traits, pixel_format=pixel_format, full_range=encoder.full_range)
        self._unifier = self._unifier or FormatUnifier(self._name, size, traits, stops=False)
        return self._unifier.unified(picture, self._frames_seen - 1)

    def _explained(self) -> contextlib.AbstractContextManager[None]:
        return explained_writing(self._name)

    def _leave(self, error: BaseException | None) -> None:
        """Close and discard everything but the finished chunks that a later run can resume from."""
        if self._writer is not None:
            self._writer.discard()
        if self.encoder is not None:
            self.encoder.close()
        self._unfinished.leave(error, self._frames_finished, self._output.expected_of_part)

    @property
    def _frames_finished(self) -> int:
        """Number of frames in complete chunks."""
        return sum(chunk.frames for chunk in self._chunks)

    def _finish_chunk(self) -> None:
        """Flush the encoder, and give the chunk file its final name; no effect between chunks."""
        if self._writer is not None and self.encoder is not None:
            self._keep(self._writer, self.encoder.finish())
            self._chunks.append(self._writer.finish(self._frames_in_chunk))
            self._writer = None
            self._frames_in_chunk = 0

    def _keep(self, writer: ChunkWriter, packets: Iterable[Packet]) -> None:
        """Append packets to the chunk, each with the duration and the closed captions of its frame."""
        for packet in packets:
            writer.add(packet, *self._pending.pop(packet.pts, (0, b"")))


class FileWriter(Writer):
    """Writer of a whole video file, which gets its final name when it is complete.

    Colour tags and pixel aspect ratio are the source's; from a video file also audio, subtitles, titles, chapters and
    orientation are carried over.

    Parameters
    ----------
    output : Output
        Path of the file, size, times and options of the pictures to come, and what is known of their source.
    chunk_frames : int
        Pictures per chunk: what a run that is stopped loses at most.

    Raises
    ------
    CompleteAlreadyError
        The job is to be resumed, and its output exists without an unfinished part.
    OptionError, OutputError
        The path cannot be written, exists, is an input, or its container cannot hold the streams.
    """

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        self._path = Path(output.path)
        files = output.stream.files
        UnfinishedOutput(self._path).discard_published()
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
    def remarks(self) -> list[Remark]:
        """What the file does not hold of its source so far, and what became of an earlier run."""
        return [*super().remarks, *(self._assembly.remarks if self._assembly else [])]

    def join(self, chunks: Sequence[Chunk], traits: VideoTraits) -> None:
        """Take complete chunks of all frames, encoded elsewhere with the same options, instead of calls of `encode`.

        `traits` are those that they were encoded with.
        """
        self.start(traits)
        self._chunks = list(chunks)

    def _begin(self, template: VideoStream, traits: VideoTraits) -> None:
        """Write the header of the output file."""
        self._assembly = Assembly(self._unfinished.staged, template, self._mapping, traits)

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


class PartWriter(Writer):
    """Writer of a part of a video: chunks, which appear in a folder of their own when all are complete.

    Parameters
    ----------
    output : Output
        As for `FileWriter`, with `part`, which begins at the first frame of a chunk.
    chunk_frames : int
        Pictures per chunk.
    """

    def __init__(self, output: Output, *, chunk_frames: int = CHUNK_FRAMES) -> None:
        assert output.part is not None
        self._part = PartFolder(output.part, output.job, overwrite=output.overwrite)
        super().__init__(output, self._part, self._part.staged, chunk_frames)

    def _finish(self) -> None:
        self._finish_chunk()
        if len(find_chunks(self._folder, self._first_chunk)) < len(self._chunks):
            raise OutputError(f"{self._name} was not written because it cannot be read back; check the disk.")
        self._part.publish_part()


def create(
    path: str | os.PathLike[str],
    like: Clip,
    *,
    encoding: EncodeSettings | None = None,
    timing: OutputTiming | None = None,
    window: Window | None = None,
    overwrite: bool = False,
) -> FileWriter:
    """Return a writer of a video file that keeps whatever a clip has beside its pictures.

    Parameters
    ----------
    path : str or os.PathLike
        File to write, whose suffix chooses the container: .mp4, .m4v, .mov, .mkv or .webm.
    like : Clip
        Clip whose sound, subtitles, tags, chapters, colours and orientation are carried over, and which may be read at
        the same time. Its first picture is decoded.
    encoding : EncodeSettings, optional
        What is asked for of the encoder, and which streams are carried over; all by default.
    timing : OutputTiming, optional
        Frame rate and time base of the pictures to come; those of the clip by default.
    window : Window, optional
        Part of the clip that is written, for its sound and subtitles; all of it by default.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    FileWriter
        Writer to be entered; the file appears when it is left without an error.

    Raises
    ------
    OptionError, OutputError
        The path cannot be written, exists, or is the clip itself, or its container cannot hold the codec or a stream.
    """
    stream = like.stream_info
    timing = timing or OutputTiming(like.info.rate, like.info.time_base)
    return FileWriter(
        Output(
            os.fspath(path), like.info, timing, stream, encoding or EncodeSettings(), overwrite=overwrite, window=window
        )
    )


def try_out(output: Output) -> tuple[list[str], list[Remark]]:
    """Return the encoder and the pixel format of a video, and what it would not hold of its source; write nothing.

    Opens the encoder and writes the header of a trial file, and raises like `FileWriter`. Of images nothing is known.
    """
    traits = output.stream.traits
    name, _ = choose_encoder(output, traits)
    mapping = map_streams(output, name)
    if traits is None:
        return [], []
    encoder = VideoEncoder(output, traits)
    with explained_writing(output.path), trial_file() as path, contextlib.closing(encoder):
        header = Assembly(path, encoder.stream, mapping, traits)
        header.discard()
        return [name, encoder.pixel_format], [*encoder.remarks, *header.remarks]
