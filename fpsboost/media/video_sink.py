"""Write a video file: new pictures encoded, everything else of the source carried over untouched.

The output keeps exact times, orientation, pixel shape, colour tags, titles and chapters; sound and subtitles are copied
packet by packet. It is written under a hidden name beside its final place and renamed when it is complete.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import av
import av.container
import av.error
import numpy as np
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list
from av.video.frame import PictureType
from av.video.reformatter import VideoReformatter

from fpsboost.errors import OptionError, OutputError
from fpsboost.frame import ClipInfo, Frame, Image, describe
from fpsboost.media import OutputTiming
from fpsboost.media.encoding import (
    CLOCK_OF_MATROSKA,
    EXACT_CLOCKS,
    VIDEO_SUFFIXES,
    Encoding,
    choose_encoder,
    containers,
    encoders,
    encodes_alpha,
    needs_hardware,
    pixel_formats,
)
from fpsboost.media.other_streams import OtherStreams, check_streams
from fpsboost.media.pipe import PipeSource
from fpsboost.media.video_source import VideoSource, VideoTraits
from fpsboost.media.ycc import BT709, FULL_RANGE, LIMITED_RANGE, RGB, as_picture, has_alpha


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
        source: VideoSource | PipeSource | None,
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
        file = source if isinstance(source, VideoSource) else None
        check_target(self._path, self._name, [] if file is None else [file.path], overwrite)
        self._encoder, self._options = choose_encoder(encoding, self._format, self._name)
        if self._format not in EXACT_CLOCKS and 1 / timing.rate < CLOCK_OF_MATROSKA:
            raise OutputError(
                f"{self._name} counts time in milliseconds and cannot hold {float(timing.rate):g} frames per second; "
                "write an .mp4 or .mov instead."
            )
        self._remarks: list[str] = []
        self._source, self._traits = file, source.traits if source is not None else None
        if file is not None:
            check_streams(file, encoding, self._encoder, self._format, self._name)
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

    @property
    def details(self) -> str:
        """Encoder, pixel format and options."""
        options = " ".join(f"{name}={value}" for name, value in self._options.items())
        return "" if self._video is None else f"{self._name}: {self._encoder}, {self._pixel_format}, {options}"

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
        self._color_space, self._full_range = traits.color_space, traits.full_range
        self._chroma_location = traits.chroma_location
        stream: av.VideoStream = self._output.add_stream(  # type: ignore[assignment]
            self._encoder, rate=_bounded(self._timing.rate), width=self._info.width, height=self._info.height
        )
        context = stream.codec_context
        stream.time_base = context.time_base = self._timing.time_base
        context.pix_fmt = self._pixel_format
        self._tag_colours(context, traits)
        if traits.sample_aspect_ratio is not None:
            context.sample_aspect_ratio = traits.sample_aspect_ratio
            if traits.sample_aspect_ratio != 1 and not self._keeps_pixel_shape():
                self._remarks.append(
                    f"{self._name} lost the pixel shape {traits.sample_aspect_ratio} of its source, which "
                    f"{self._encoder} cannot say in this container; write an .mp4 or .mov to keep it."
                )
        is_default = traits.chroma_location == "left" and self._encoder in ("libx264", "libx265")  # need not be said
        if traits.tagged_chroma_location and not is_default:
            self._options["chroma_sample_location"] = traits.chroma_location
        if self._encoder == "libx265" and self._format in EXACT_CLOCKS:
            context.codec_tag = "hvc1"  # the only tag of HEVC that Apple's players take
        if has_alpha(self._pixel_format) and self._encoder.startswith("libvpx"):
            self._options["auto-alt-ref"] = "0"  # libvpx cannot hide frames of a picture and of its alpha alike
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

    def _tag_colours(self, context: av.VideoCodecContext, traits: VideoTraits) -> None:
        """Say what the numbers mean: as the source does, or as the pixel format demands."""
        context.color_primaries, context.color_trc = traits.color_primaries, traits.color_transfer
        context.color_range = traits.color_range
        context.colorspace = traits.tagged_color_space
        if _is_rgb(traits.pixel_format) and not _is_rgb(self._pixel_format):
            # RGB has neither matrix nor range, and gets what its size suggests.
            self._full_range = False
            context.colorspace, context.color_range = self._color_space, LIMITED_RANGE
        elif _is_rgb(self._pixel_format) and not _is_rgb(traits.pixel_format):
            context.colorspace, context.color_range = RGB, FULL_RANGE
        elif self._pixel_format.startswith("yuvj"):
            self._full_range = True
            context.color_range = FULL_RANGE

    def _keeps_pixel_shape(self) -> bool:
        """PyAV does not reach the container's own entry in Matroska, so there the coded stream must hold it."""
        return self._format in EXACT_CLOCKS or self._encoder in ("libx264", "libx265")

    def _open_encoder(self, context: av.VideoCodecContext) -> None:
        try:
            with _quiet_encoder():
                context.open()
        except av.error.FFmpegError:
            given = " ".join(f"{name}={value}" for name, value in self._encoding.encoder_options)
            check = f"check --encoder-option {given}, or " if given else ""
            missing = ", and its device or driver may be missing here" if needs_hardware(self._encoder) else ""
            raise OutputError(
                f"{self._name} cannot be encoded by {self._encoder} at {self._info.width}x{self._info.height}, "
                f"{float(self._timing.rate):g} frames per second, {self._pixel_format}{missing}; {check}choose another "
                "--codec."
            ) from None

    def _choose_pixel_format(self, traits: VideoTraits) -> str:
        """Take the source's format, or the one among the encoder's that loses least; say what is lost."""
        wanted = self._encoding.pixel_format or traits.pixel_format
        offered = pixel_formats(av.Codec(self._encoder, "w"))
        if not offered:
            return wanted
        whole_only = any(e.name == self._encoder and e.needs_whole_chroma for e in encoders.values())
        fitting = [name for name in offered if not whole_only or _divides(name, self._info.width, self._info.height)]
        if wanted in fitting:
            return wanted
        if self._encoding.pixel_format:
            raise OptionError(
                f"--pix-fmt {wanted} halves an odd size, which {self._encoder} cannot do for {self._name} at "
                f"{self._info.width}x{self._info.height}; use yuv444p, or crop to an even size."
            )
        keeps_alpha = encodes_alpha(self._encoding, self._format) and has_alpha(wanted)
        fitting = [name for name in fitting if has_alpha(name) or not keeps_alpha] or fitting
        found, loss = find_best_pix_fmt_of_list(fitting, wanted, has_alpha=keeps_alpha)
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
        before = picture.pts, picture.duration, picture.time_base or time_base, picture.pict_type
        picture.pts, picture.duration, picture.time_base = pts, self._durations[pts], time_base
        picture.pict_type = PictureType.NONE  # else x264 repeats the source's choice of key frames
        try:
            packets = self._video.encode(picture)
        finally:
            picture.pts, picture.duration, picture.time_base, picture.pict_type = before
        self._mux(packets)

    def _picture(self, frame: Frame) -> av.VideoFrame:
        """Return the frame as the encoder wants it, from the decoder's own picture where there is one."""
        if frame.image.shape[2] == 4 and not self._alpha_dropped and not has_alpha(self._pixel_format):
            self._alpha_dropped = True
            self._remarks.append(f"{self._name} cannot hold an alpha channel, which was left out.")
        picture = as_picture(
            frame,
            self._pixel_format,
            self._color_space,
            self._full_range,
            chroma_location=self._chroma_location,
            reformatter=self._reformatter,
            keeps_original=self._traits is not None,
        )
        if picture is not frame.original:  # ProRes looks here and not at the encoder's context
            assert self._video is not None
            context = self._video.codec_context
            picture.colorspace, picture.color_range = context.colorspace, context.color_range
            picture.color_primaries, picture.color_trc = context.color_primaries, context.color_trc
        return picture

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


def check_target(path: Path, name: str, inputs: Iterable[Path], overwrite: bool) -> None:
    """Raise `OutputError` unless a file can be written under this path.

    Parameters
    ----------
    path : Path
    name : str
        What to call it in messages.
    inputs : iterable of Path
        Files that are being read.
    overwrite : bool
        Replace what exists.
    """
    if path.is_dir():
        raise OutputError(f"{name} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise OutputError(f"{name} cannot be written because its folder does not exist; create it first.")
    if path.exists():
        if any(each.exists() and path.samefile(each) for each in inputs):
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


def _traits_of_image(image: Image | None) -> VideoTraits:
    """What to write for images, which carry no tags: BT.709, limited range, 4:2:0, 10 bits for deep images."""
    deep = image is not None and image.dtype != np.uint8
    transparent = image is not None and image.shape[2] in (2, 4)
    return VideoTraits(
        pixel_format=("yuva420p" if transparent else "yuv420p") + ("10le" if deep else ""),
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
