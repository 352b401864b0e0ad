"""Write a video file: new pictures encoded, everything else of the source carried over untouched.

The output keeps exact times, orientation, pixel shape, colour tags, titles and chapters; sound and subtitles are copied
packet by packet. It is written under a hidden name beside its final place and renamed when it is complete.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import av.container
import av.error
import av.filter
import cv2
import numpy as np
from av.codec.codec import PixFmtLoss, UnknownCodecError, find_best_pix_fmt_of_list
from av.video.frame import PictureType
from av.video.reformatter import VideoReformatter

from fpsboost.errors import OptionError, OutputError
from fpsboost.frame import ClipInfo, Frame, Image, describe
from fpsboost.media import OutputTiming
from fpsboost.media.video_source import (
    BT709,
    FULL_RANGE,
    LIMITED_RANGE,
    SCALER_FLAGS,
    VideoSource,
    VideoTraits,
    bgr_to_ycc,
    full_chroma,
    is_cover_art,
    open_video,
    plane_arrays,
)

containers = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}
"""FFmpeg's name of the container by suffix."""

VIDEO_SUFFIXES = tuple(containers)
"""Suffixes of the video files that can be written."""

CLOCK_OF_MATROSKA = Fraction(1, 1000)
EXACT_CLOCKS = ("mp4", "mov")

x26x_presets = (
    *("ultrafast", "superfast", "veryfast", "faster", "fast"),
    *("medium", "slow", "slower", "veryslow", "placebo"),
)


@dataclass(frozen=True)
class Encoder:
    """What an encoder's quality and speed are called, and which values they take."""

    name: str
    crf: int
    largest_crf: int
    preset: str
    presets: tuple[str, ...]
    preset_option: str
    fixed_options: tuple[tuple[str, str], ...] = ()
    needs_whole_chroma: bool = False
    """An odd width or height cannot be halved for chroma."""


encoders = {
    "h264": Encoder("libx264", 18, 51, "medium", x26x_presets, "preset", needs_whole_chroma=True),
    # x265 prints on its own, past FFmpeg's log.
    "hevc": Encoder(
        "libx265",
        20,
        51,
        "medium",
        x26x_presets,
        "preset",
        (("x265-params", "log-level=none"),),
        needs_whole_chroma=True,
    ),
    "vp9": Encoder(
        *("libvpx-vp9", 30, 63, "4"),
        *(tuple(map(str, range(9))), "cpu-used"),
        (("b", "0"), ("row-mt", "1"), ("deadline", "good")),
    ),
    "av1": Encoder("libsvtav1", 30, 63, "8", tuple(map(str, range(14))), "preset"),
}
"""Encoders by the name people use for the format."""


@dataclass(frozen=True)
class Encoding:
    """How to encode, and what to carry over.

    Parameters
    ----------
    codec : str, optional
        ``h264``, ``hevc``, ``vp9``, ``av1`` or the exact name of an FFmpeg encoder; by default H.264, in .webm VP9.
    crf : int, optional
        Quality, 0 (best) to 51 or 63; by default one that is hard to tell from the source.
    preset : str, optional
        Speed: ``ultrafast`` ... ``placebo`` for h264 and hevc, a number for vp9 (0-8) and av1 (0-13, larger is faster).
    audio, subtitles : bool
        Copy the source's sound and subtitles.
    """

    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    audio: bool = True
    subtitles: bool = True


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
    source : VideoSource or None
        The file to carry sound, subtitles, titles, colour and orientation over from.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        Unknown codec, quality or preset, or a codec that the container cannot hold.
    OutputError
        The target exists, is the source itself, cannot be written, or cannot hold the source's other streams.
    """

    holds_last_frame = True

    def __init__(
        self,
        path: str | os.PathLike[str],
        info: ClipInfo,
        timing: OutputTiming,
        encoding: Encoding,
        source: VideoSource | None,
        *,
        overwrite: bool,
    ) -> None:
        self._name = os.fspath(path)
        self._path = Path(path)
        self._info, self._timing, self._encoding = info, timing, encoding
        suffix = self._path.suffix.lower()
        if suffix not in containers:
            raise OutputError(f"{self._name} has no suffix of a video file; use one of {', '.join(VIDEO_SUFFIXES)}.")
        self._format = containers[suffix]
        _check_target(self._path, self._name, source, overwrite)
        self._encoder, self._options = choose_encoder(encoding, self._format, self._name)
        if self._format not in EXACT_CLOCKS and 1 / timing.rate < CLOCK_OF_MATROSKA:
            raise OutputError(
                f"{self._name} counts time in milliseconds and cannot hold {float(timing.rate):g} frames per second; "
                "write an .mp4 or .mov instead."
            )
        self._remarks: list[str] = []
        self._source, self._traits = source, source.traits if source is not None else None
        if source is not None:
            check_streams(source, encoding, self._encoder, self._format, self._name)
        self._temporary: Path | None = None
        self._output: av.container.OutputContainer | None = None
        self._video: av.VideoStream | None = None
        self._others: OtherStreams | None = None
        self._reformatter = VideoReformatter()
        self._durations: dict[int, int] = {}
        self._held: av.Packet[av.VideoStream] | None = None
        self._first_dts = self._first_pts = 0
        self._last_pts: int | None = None
        self._end_pts = 0
        self._alpha_dropped = False

    @property
    def remarks(self) -> list[str]:
        return [*self._remarks, *(self._others.remarks if self._others else [])]

    def __enter__(self) -> Self:
        try:
            with self._explained():
                self._open()
        except BaseException:
            self._discard()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with self._explained():
                    self._finish()
        finally:
            self._discard()

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
            if self._video is None:
                self._start(frame.image)
            self._encode(frame)

    def _open(self) -> None:
        temporary = self._path.with_name(f".{self._path.name}.partial-{secrets.token_hex(4)}")
        # Created here and not by FFmpeg, so that a folder that may not be written is noticed before any work is done.
        temporary.open("xb").close()
        self._temporary = temporary
        options = {"movflags": "+faststart"} if self._format in EXACT_CLOCKS else {}
        self._output = av.open(str(temporary.absolute()), "w", format=self._format, container_options=options)
        if self._traits is not None:
            self._start(None)

    def _start(self, image: Image | None) -> None:
        """Add the streams and write the header; needs a frame only where no source says what frames are like."""
        assert self._output is not None
        traits = self._traits or _traits_of_image(image)
        self._pixel_format = self._choose_pixel_format(traits)
        self._color_space, self._full_range = _output_color(traits, self._pixel_format)
        self._chroma_location = traits.chroma_location
        stream: av.VideoStream = self._output.add_stream(  # type: ignore[assignment]
            self._encoder, rate=_bounded(self._timing.rate), width=self._info.width, height=self._info.height
        )
        context = stream.codec_context
        stream.time_base = context.time_base = self._timing.time_base
        context.pix_fmt = self._pixel_format
        context.color_primaries, context.color_trc = traits.color_primaries, traits.color_transfer
        context.color_range = traits.color_range
        context.colorspace = traits.tagged_color_space
        if _is_rgb(traits.pixel_format) and not _is_rgb(self._pixel_format):
            context.colorspace, context.color_range = self._color_space, LIMITED_RANGE
        if traits.sample_aspect_ratio is not None:
            context.sample_aspect_ratio = traits.sample_aspect_ratio
            if traits.sample_aspect_ratio != 1 and not self._keeps_pixel_shape():
                self._remarks.append(
                    f"{self._name} lost the pixel shape {traits.sample_aspect_ratio} of its source, which "
                    f"{self._encoder} cannot say in this container; write an .mp4 or .mov to keep it."
                )
        if traits.tagged_chroma_location and traits.chroma_location != "left":  # the default, which need not be said
            self._options["chroma_sample_location"] = traits.chroma_location
        if self._encoder == "libx265" and self._format in EXACT_CLOCKS:
            context.codec_tag = "hvc1"  # the only tag of HEVC that Apple's players take
        context.options = self._options
        if traits.display_matrix is not None:
            stream.set_display_matrix(traits.display_matrix)
        if traits.has_mastering_data:
            self._remarks.append(f"{self._name} lost the HDR mastering data of its source; colour tags were kept.")
        self._open_encoder(context)
        self._video = stream
        if self._source is not None:
            self._others = OtherStreams(
                self._source,
                self._output,
                stream,
                encoding=self._encoding,
                container=self._format,
                name=self._name,
            )
            if self._format in EXACT_CLOCKS:
                self._output.container_options["movie_timescale"] = str(self._others.clock)
        self._output.start_encoding()
        if self._others is not None:
            self._others.copy_cover()

    def _keeps_pixel_shape(self) -> bool:
        """PyAV does not reach the container's own entry in Matroska, so there the coded stream must hold it."""
        return self._format in EXACT_CLOCKS or self._encoder in ("libx264", "libx265")

    def _open_encoder(self, context: av.VideoCodecContext) -> None:
        try:
            with _quiet_encoder():
                context.open()
        except av.error.FFmpegError:
            raise OutputError(
                f"{self._name} cannot be encoded by {self._encoder} at {self._info.width}x{self._info.height}, "
                f"{float(self._timing.rate):g} frames per second, {self._pixel_format}; choose another --codec."
            ) from None

    def _choose_pixel_format(self, traits: VideoTraits) -> str:
        """Take the source's format, or the one among the encoder's that loses least; say what is lost."""
        wanted = traits.pixel_format
        offered = [item.name for item in av.Codec(self._encoder, "w").video_formats or ()]
        if not offered:
            return wanted
        whole_only = any(e.name == self._encoder and e.needs_whole_chroma for e in encoders.values())
        fitting = [name for name in offered if not whole_only or _divides(name, self._info.width, self._info.height)]
        if wanted in fitting:
            return wanted
        found, loss = find_best_pix_fmt_of_list(fitting, wanted)
        if found is None:
            raise OutputError(f"{self._name} cannot hold {wanted} with {self._encoder}; choose another --codec.")
        width, height = self._info.width, self._info.height
        if wanted in offered or wanted.replace("yuvj", "yuv") in offered:
            if found.name != wanted.replace("yuvj", "yuv"):
                self._remarks.append(
                    f"{self._name} has the odd size {width}x{height} and was written as {found.name}, which few "
                    "players show; write a .webm, or crop to an even size."
                )
        elif loss & (PixFmtLoss.DEPTH | PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION):
            lost = "depth" if loss & PixFmtLoss.DEPTH else "colour resolution"
            self._remarks.append(
                f"{self._name} has less {lost} than its source: {self._encoder} wrote {found.name} for {wanted}."
            )
        return found.name

    def _encode(self, frame: Frame) -> None:
        assert self._video is not None
        time_base = self._timing.time_base
        pts = round(frame.time / time_base)
        if self._last_pts is not None and pts <= self._last_pts:
            raise OutputError(
                f"{self._name} cannot tell two frames at {float(frame.time):.6f} s apart; choose a lower rate."
            )
        self._first_pts = pts if self._last_pts is None else self._first_pts
        self._last_pts = pts
        self._end_pts = max(pts + 1, round((frame.time + frame.duration) / time_base))
        self._durations[pts] = self._end_pts - pts
        picture = self._picture(frame)
        # The same decoded picture may be written again at another time, so it gets its own labels back. The encoder
        # holds a reference of its own, with the labels of this moment.
        before = picture.pts, picture.duration, picture.time_base, picture.pict_type
        picture.pts, picture.duration, picture.time_base = pts, self._durations[pts], time_base
        picture.pict_type = PictureType.NONE  # else x264 repeats the source's choice of key frames
        try:
            packets = self._video.encode(picture)
        finally:
            picture.pts, picture.duration, picture.time_base, picture.pict_type = before
        self._mux(packets)

    def _picture(self, frame: Frame) -> av.VideoFrame:
        """Return the frame as the encoder wants it, from the decoder's own picture where there is one."""
        original = frame.original
        size = (self._info.width, self._info.height)
        if (
            self._traits is not None
            and isinstance(original, av.VideoFrame)
            and (original.width, original.height) == size
        ):
            if original.format.name == self._pixel_format:
                return original
            if not original.format.is_rgb and not _is_rgb(self._pixel_format):
                colour_range = FULL_RANGE if self._full_range else LIMITED_RANGE
                return self._reformatter.reformat(
                    original,
                    format=self._pixel_format,
                    interpolation=SCALER_FLAGS,
                    src_color_range=colour_range,
                    dst_color_range=colour_range,
                )
        if frame.image.shape[2] == 4 and not self._alpha_dropped:
            self._alpha_dropped = True
            self._remarks.append(f"{self._name} cannot hold an alpha channel, which was left out.")
        return from_bgr(
            frame.image,
            self._pixel_format,
            self._color_space,
            self._full_range,
            chroma_location=self._chroma_location,
            reformatter=self._reformatter,
        )

    def _mux(self, packets: list[av.Packet[Any]]) -> None:
        """Hand packets to the file, one behind, since the last one's duration is known only at the end."""
        assert self._output is not None
        for packet in packets:
            packet.duration = self._durations.pop(packet.pts, 0) if packet.pts is not None else 0
            if self._held is None:
                self._first_dts = packet.dts or 0
            else:
                self._mux_held()
            self._held = packet

    def _mux_held(self) -> None:
        assert self._output is not None
        assert self._held is not None
        if self._others is not None and self._held.dts is not None:
            self._others.copy_until(self._held.dts * self._timing.time_base)
        self._output.mux(self._held)

    def _finish(self) -> None:
        if self._video is None or self._last_pts is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        assert self._output is not None
        assert self._temporary is not None
        self._mux(self._video.encode(None))
        if self._held is not None:
            if self._format in EXACT_CLOCKS and self._held.dts is not None:
                # The length of an mp4 track is a sum over decoding times, of which only the last summand is free.
                left = (self._end_pts - self._first_pts) - (self._held.dts - self._first_dts)
                self._held.duration = left if left > 0 else self._held.duration
            self._mux_held()
            self._held = None
        if self._others is not None:
            self._others.copy_until(None)
            self._others.close()
        self._output.close()
        self._output = None
        os.replace(self._temporary, self._path)
        self._temporary = None

    def _discard(self) -> None:
        """Let go of everything; the unfinished file goes first, lest FFmpeg rewrites it for fast starting."""
        if self._others is not None:
            self._others.close()
        if self._temporary is not None:
            with contextlib.suppress(OSError):  # Windows does not remove an open file: see below
                self._temporary.unlink(missing_ok=True)
        if self._output is not None:
            output, self._output = self._output, None
            with contextlib.suppress(av.error.FFmpegError, OSError, ValueError):
                output.close()
        if self._temporary is not None:
            temporary, self._temporary = self._temporary, None
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn what FFmpeg and the system raise into a sentence about the file."""
        try:
            yield
        except (av.error.FFmpegError, OSError) as error:
            raise OutputError(_explain(error, self._name)) from error


class OtherStreams:
    """Sound, subtitles, attachments and titles on their way from the source file to the output, unchanged.

    The source is opened a second time, so that these packets are read when they are due and memory stays flat.

    Parameters
    ----------
    source : VideoSource
    output : av.container.OutputContainer
        Not started yet.
    video : av.VideoStream
        The output's video stream.
    encoding : Encoding
    container, name : str
        FFmpeg's name of the output's container, and the path for messages.
    """

    def __init__(
        self,
        source: VideoSource,
        output: av.container.OutputContainer,
        video: av.VideoStream,
        *,
        encoding: Encoding,
        container: str,
        name: str,
    ) -> None:
        self.remarks: list[str] = []
        self._output, self._name, self._container, self._source = output, name, container, source
        self._input = open_video(source.path, source.info.name)
        self._targets: dict[int, av.stream.Stream] = {}
        self._last_dts: dict[int, int] = {}
        self._covers: list[av.stream.Stream] = []
        _copy_titles(self._input, output)
        _copy_labels(self._input.streams[source.stream_index], video)
        for stream in self._input.streams:
            if stream.index != source.stream_index:
                self._add(stream, encoding)
        self.clock = _clock_of_starts(self._input)
        self._packets = self._read()
        self._ahead: av.Packet[av.stream.Stream] | None = None

    def close(self) -> None:
        self._packets.close()  # type: ignore[attr-defined]
        self._input.close()

    def copy_until(self, time: Fraction | None) -> None:
        """Write what is due before `time` in seconds; everything for None."""
        while True:
            packet, self._ahead = self._ahead or next(self._packets, None), None
            if packet is None:
                return
            if time is not None and packet.dts is not None and packet.dts * Fraction(packet.time_base) > time:
                self._ahead = packet
                return
            self._copy(packet)

    def copy_cover(self) -> None:
        """Write pictures attached to the file, which mp4 wants right after its header."""
        for stream in self._covers:
            packet = _attached_picture(self._source, stream.index)
            if packet is not None:
                packet.stream = self._targets[stream.index]
                self._output.mux(packet)

    def _add(self, stream: av.stream.Stream, encoding: Encoding) -> None:
        """Give a stream its counterpart in the output, or remark that there is none."""
        if stream.type == "video" and is_cover_art(stream):
            self._add_cover(stream)
        elif (stream.type == "audio" and encoding.audio) or (stream.type == "subtitle" and encoding.subtitles):
            target = self._output.add_stream_from_template(stream)
            _copy_labels(stream, target)
            self._targets[stream.index] = target
        elif stream.type == "attachment" and self._container == "matroska":
            self._output.add_stream_from_template(stream)
        elif stream.type in ("data", "attachment") and stream.discard != av.stream.Discard.all:
            self.remarks.append(f"{self._name} does not hold stream {stream.index} ({stream.type}) of its source.")

    def _add_cover(self, stream: av.stream.Stream) -> None:
        picture = stream.metadata
        if self._container == "matroska":
            packet = _attached_picture(self._source, stream.index)
            if packet is not None:
                kind = "png" if stream.name == "png" else "jpeg"
                self._output.add_attachment(
                    picture.get("filename", f"cover.{kind}"), picture.get("mimetype", f"image/{kind}"), bytes(packet)
                )
                return
        elif self._container == "mp4" and stream.name in ("png", "mjpeg"):
            target = self._output.add_stream_from_template(stream, opaque=True)
            target.disposition = av.stream.Disposition.attached_pic
            self._targets[stream.index] = target
            self._covers.append(stream)
            return
        self.remarks.append(f"{self._name} does not hold the cover picture of its source.")

    def _read(self) -> Iterator[av.Packet[av.stream.Stream]]:
        covers = {stream.index for stream in self._covers}
        wanted = [self._input.streams[index] for index in self._targets if index not in covers]
        if not wanted:
            return
        try:
            for packet in self._input.demux(wanted):
                if packet.size and packet.dts is not None:
                    yield packet
        except av.error.FFmpegError:
            self.remarks.append(
                f"{self._source.info.name} is damaged, so sound and subtitles end early in {self._name}; listen to it."
            )

    def _copy(self, packet: av.Packet[av.stream.Stream]) -> None:
        """Mux one packet, unless its time runs backwards, which no container takes."""
        assert packet.dts is not None
        index, kind = packet.stream.index, packet.stream.type
        last = self._last_dts.get(index)
        equal_is_fine = kind == "subtitle" or self._container not in EXACT_CLOCKS
        if last is not None and (packet.dts < last or (packet.dts == last and not equal_is_fine)):
            sentence = f"{self._source.info.name} has sound or subtitle packets out of order, which were left out."
            if sentence not in self.remarks:
                self.remarks.append(sentence)
            return
        self._last_dts[index] = packet.dts
        packet.stream = self._targets[index]
        self._output.mux(packet)


def choose_encoder(encoding: Encoding, container: str, name: str) -> tuple[str, dict[str, str]]:
    """Find FFmpeg's encoder and its options for what was asked.

    Returns
    -------
    str, dict of str
        Encoder name and options.

    Raises
    ------
    OptionError
        Unknown codec, not allowed in this container, or a quality or preset that it does not know.
    """
    asked = encoding.codec or ("vp9" if container == "webm" else "h264")
    known = encoders.get(asked.lower()) or next((e for e in encoders.values() if e.name == asked), None)
    encoder = known.name if known else asked
    try:
        codec = av.Codec(encoder, "w")
    except UnknownCodecError:
        codec = None
    if codec is None or codec.type != "video" or codec.name != encoder:
        raise OptionError(
            f"--codec {asked} is unknown here; use {', '.join(encoders)}, or the exact name of an FFmpeg video encoder."
        )
    if not _holds(container, encoder):
        fitting = [friendly for friendly, e in encoders.items() if _holds(container, e.name)]
        others = [suffix for suffix, other in containers.items() if _holds(other, encoder)]
        instead = f", or write {' or '.join(others)}" if others else ""
        raise OptionError(f"--codec {asked} cannot go into {name}; use {' or '.join(fitting)}{instead}.")
    if known is None:
        return encoder, _options_of_other(codec, encoding)
    crf = known.crf if encoding.crf is None else encoding.crf
    if not 0 <= crf <= known.largest_crf:
        raise OptionError(f"--crf must be 0 to {known.largest_crf} for {asked}, not {crf}.")
    preset = encoding.preset or known.preset
    if preset not in known.presets:
        raise OptionError(f"--preset {preset} is unknown to {asked}; use one of {', '.join(known.presets)}.")
    return encoder, {"crf": str(crf), known.preset_option: preset, **dict(known.fixed_options)}


def check_streams(source: VideoSource, encoding: Encoding, encoder: str, container: str, name: str) -> None:
    """Raise `OutputError` where the container cannot hold the source's sound or subtitles."""
    with open_video(source.path, source.info.name) as file:
        streams = [
            stream
            for stream in file.streams
            if (stream.type == "audio" and encoding.audio) or (stream.type == "subtitle" and encoding.subtitles)
        ]
        codecs = [stream.codec_context.codec.name if stream.codec_context else "" for stream in streams]
        for stream, codec in zip(streams, codecs, strict=True):
            if codec and _holds(container, codec) and _takes(container, stream):
                continue
            what, option = ("sound", "--no-audio") if stream.type == "audio" else ("subtitles", "--no-subtitles")
            video = encoder if encoding.codec else None
            others = [
                suffix
                for suffix, other in containers.items()
                if all(codec and _holds(other, codec) for codec in codecs) and (video is None or _holds(other, video))
            ]
            instead = f"write {' or '.join(others)}, or " if others else ""
            called = stream.codec_context.codec.canonical_name if codec else "unknown"
            raise OutputError(
                f"{name} cannot hold the {called} {what} of {source.info.name}; {instead}leave the {what} "
                f"out with {option}."
            )


def from_bgr(
    image: Image,
    pixel_format: str,
    color_space: int,
    full_range: bool,
    *,
    chroma_location: str = "left",
    reformatter: VideoReformatter | None = None,
) -> av.VideoFrame:
    """Convert an image into a picture for an encoder; the inverse of `to_bgr` of the source.

    Parameters
    ----------
    image : (H, W, 1, 3 or 4) uint8, uint16 or float32
        Gray, BGR or BGRA; alpha is dropped, float32 is clipped to [0, 1].
    pixel_format : str
        FFmpeg's name, ``yuv420p10le``.
    color_space : int
        AVColorSpace whose matrix to use.
    full_range : bool
        Black is 0 rather than 16 (in 8 bits).
    chroma_location : str
        Where a subsampled chroma sample sits.
    reformatter : VideoReformatter, optional
        Keeps the scaler's tables from one frame to the next.
    """
    scaler = reformatter or VideoReformatter()
    image = _as_bgr(image)
    height, width = image.shape[:2]
    target = av.VideoFormat(pixel_format)
    if target.is_rgb:
        packed = "bgr24" if image.dtype == np.uint8 else "bgr48le"
        frame = av.VideoFrame.from_ndarray(image, format=packed)
        return scaler.reformat(frame, format=pixel_format, interpolation=SCALER_FLAGS)
    bits = target.components[0].bits
    if bits > 8 and image.dtype == np.uint8:  # the matrix product keeps the type, and needs room for its result
        image = image.astype(np.uint16) * 257
    planar = av.VideoFrame(width, height, full_chroma(bits))
    bits = planar.format.components[0].bits
    top = 255 if image.dtype == np.uint8 else 65535
    matrix = bgr_to_ycc(color_space, full_range, bits, top)
    codes = np.minimum(cv2.transform(image, matrix), 2**bits - 1)  # a pure colour of full range is one half above
    for channel, plane in enumerate(plane_arrays(planar)):
        plane[:] = codes[..., channel]
    colour_range = FULL_RANGE if full_range else LIMITED_RANGE
    return scaler.reformat(
        _with_chroma_location(planar, chroma_location),
        format=pixel_format,
        interpolation=SCALER_FLAGS,
        src_color_range=colour_range,
        dst_color_range=colour_range,
    )


def _as_bgr(image: Image) -> Image:
    """Three contiguous integer channels."""
    if image.dtype == np.float32:
        image = np.rint(np.clip(image, 0, 1) * np.float32(65535)).astype(np.uint16)
    if image.shape[2] == 1:
        return np.repeat(image, 3, axis=2)
    return np.ascontiguousarray(image[..., :3])


def _with_chroma_location(picture: av.VideoFrame, location: str) -> av.VideoFrame:
    """Label a picture with its chroma location, which PyAV can do only through a filter; no pixel is copied."""
    graph = av.filter.Graph()
    entry = graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=Fraction(1, 1000)
    )
    graph.link_nodes(entry, graph.add("setparams", f"chroma_location={location}"), graph.add("buffersink")).configure()
    graph.push(picture)
    labelled = graph.pull()
    assert isinstance(labelled, av.VideoFrame)
    return labelled


def _options_of_other(codec: av.Codec, encoding: Encoding) -> dict[str, str]:
    """Options for an encoder without an entry in the table, if it knows them."""
    known = {option.name for option in codec.create("video").supported_options.private}
    options = {}
    for option, value in (("crf", encoding.crf), ("preset", encoding.preset)):
        if value is None:
            continue
        if option not in known:
            raise OptionError(f"--{option} means nothing to {codec.name}; leave it out.")
        options[option] = str(value)
    return options


def _check_target(path: Path, name: str, source: VideoSource | None, overwrite: bool) -> None:
    if path.is_dir():
        raise OutputError(f"{name} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise OutputError(f"{name} cannot be written because its folder does not exist; create it first.")
    if path.exists():
        if source is not None and source.path.exists() and path.samefile(source.path):
            raise OutputError(f"{name} is the input itself; write to another name.")
        if not overwrite:
            raise OutputError(f"{name} exists already; choose another name or pass --overwrite.")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{name} cannot be written because its folder may not be written to; choose another folder.")


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


def _holds(container: str, codec: str) -> bool:
    """Whether a container takes a codec, by the name of its encoder or decoder."""
    with av.open(BytesIO(), "w", format=container) as probe:
        return codec in probe.supported_codecs


def _takes(container: str, stream: av.stream.Stream) -> bool:
    """Whether a container takes this very stream: some names are in its list and still refused."""
    try:
        with av.open(BytesIO(), "w", format=container) as probe:
            target = probe.add_stream_from_template(stream)
            probe.start_encoding()
            packet = av.Packet(bytes(64))
            packet.stream, packet.pts, packet.dts, packet.duration = target, 0, 0, 1
            packet.time_base = target.time_base or Fraction(1)
            probe.mux(packet)
    except (av.error.FFmpegError, ValueError):
        return False
    return True


def _traits_of_image(image: Image | None) -> VideoTraits:
    """What to write for images, which carry no tags: BT.709, limited range, 4:2:0, 10 bits for deep images."""
    deep = image is not None and image.dtype != np.uint8
    return VideoTraits(
        pixel_format="yuv420p10le" if deep else "yuv420p",
        color_space=BT709,
        tagged_color_space=BT709,
        color_range=LIMITED_RANGE,
        color_primaries=BT709,
        color_transfer=BT709,
        full_range=False,
        chroma_location="left",
        tagged_chroma_location=True,
        sample_aspect_ratio=None,
        display_matrix=None,
        interlaced=False,
        has_mastering_data=False,
    )


def _output_color(traits: VideoTraits, pixel_format: str) -> tuple[int, bool]:
    """Matrix and range to convert with; a source of RGB has neither, and gets what its size suggests."""
    if _is_rgb(traits.pixel_format) and not _is_rgb(pixel_format):
        return traits.color_space, False
    return traits.color_space, traits.full_range


def _is_rgb(pixel_format: str) -> bool:
    return av.VideoFormat(pixel_format).is_rgb


def _divides(pixel_format: str, width: int, height: int) -> bool:
    """Whether chroma planes come out whole."""
    layout = av.VideoFormat(pixel_format, 16, 16)
    across, down = 16 // max(1, layout.chroma_width()), 16 // max(1, layout.chroma_height())
    return width % across == 0 and height % down == 0


def _bounded(rate: Fraction) -> Fraction:
    """FFmpeg keeps a rate in two 32-bit numbers; it is only a label here, since times are exact."""
    return rate if rate.numerator < 2**31 else rate.limit_denominator(1000)


def _copy_titles(file: av.container.InputContainer, output: av.container.OutputContainer) -> None:
    """Title, artist and chapters; not what describes the old file's making."""
    skipped = {"major_brand", "minor_version", "compatible_brands", "encoder", "timecode", "duration"}
    output.metadata.update({key: value for key, value in file.metadata.items() if key.lower() not in skipped})
    output.set_chapters(file.chapters())


def _copy_labels(stream: av.stream.Stream, target: av.stream.Stream) -> None:
    """Language, title and role of a stream."""
    skipped = (
        "encoder",
        "duration",
        "vendor_id",
        "rotate",
        "timecode",
        "alpha_mode",
        "number_of",
        "bps",
        "_statistics",
    )
    labels = {key: value for key, value in stream.metadata.items() if not key.lower().startswith(skipped)}
    target.metadata.update(labels)
    target.disposition = stream.disposition


def _clock_of_starts(file: av.container.InputContainer) -> int:
    """Ticks per second that tell exactly when each stream starts, which mp4 otherwise rounds to milliseconds."""
    starts = [
        stream.start_time * Fraction(stream.time_base)
        for stream in file.streams
        if stream.start_time is not None and stream.time_base
    ]
    ticks = math.lcm(1000, *(start.denominator for start in starts))
    return ticks if ticks < 2**31 else 1000


def _attached_picture(source: VideoSource, index: int) -> av.Packet[Any] | None:
    """Read a picture attached to the file, which FFmpeg delivers as the first packet of a stream of its own.

    The file is opened for it alone: going back to the start afterwards would lose sound from before time 0.
    """
    with open_video(source.path, source.info.name) as file:
        try:
            packet = next(iter(file.demux(file.streams[index])), None)
        except av.error.FFmpegError:
            return None
    return packet if packet is not None and packet.size else None


@contextlib.contextmanager
def _quiet_encoder() -> Iterator[None]:
    """SVT-AV1 prints on its own, past FFmpeg's log, unless this variable is set while it starts."""
    before = os.environ.get("SVT_LOG")
    os.environ["SVT_LOG"] = before or "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["SVT_LOG"]
