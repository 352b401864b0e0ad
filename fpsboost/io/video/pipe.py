"""Uncompressed video from standard input and to standard output, as YUV4MPEG2.

A line of text says size, rate and pixel format, and every frame is a short line and its planes. Frames go out as they
are made, so a pipe is the one target that does not appear as a whole.

The lines are read here, because FFmpeg's demuxer says nothing of a frame that is cut off, takes a pixel format that it
does not know for 4:2:0 and a rate that it cannot read for 25, and knows no gray of 14 bits; its muxer writes more into
the first line. The samples become pictures in FFmpeg.
"""

from __future__ import annotations

import io
import os
import re
import select
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from threading import Event
from types import TracebackType
from typing import BinaryIO, Self, cast

import av
import numpy as np
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list
from av.video.reformatter import VideoReformatter

from fpsboost.errors import InputError, OptionError, OutputError, ReaderGoneError
from fpsboost.frame import ClipInfo, Frame, Pixels, describe
from fpsboost.io import ClosesOnExit
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.output import Output
from fpsboost.io.stream_info import StreamInfo
from fpsboost.io.video.clock import ASSUMED_RATE, assumed_rate_remark
from fpsboost.io.video.planes import as_picture, coding_of, in_planes
from fpsboost.io.video.remarks import interlaced_remark, lost_companions_remark, lost_shape_remark
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import (
    FULL_RANGE,
    LIMITED_RANGE,
    UNSPECIFIED,
    assumed_color_space,
    chroma_location_of,
    plane_arrays,
    to_bgr,
)

INPUT_NAME, OUTPUT_NAME = "standard input", "standard output"

MAGIC = b"YUV4MPEG2"
MAX_LINE = 1024
MAX_SIDE = 32768
MAX_RATE = 100_000
POLL_INTERVAL = 0.1
"""Seconds between two looks at whether to go on waiting for the program at the other end."""

DEPTHS = (9, 10, 12, 14, 16)

formats: dict[str, str] = {
    "420jpeg": "yuv420p",
    "420mpeg2": "yuv420p",
    "420paldv": "yuv420p",
    "420": "yuv420p",
    "411": "yuv411p",
    "422": "yuv422p",
    "444": "yuv444p",
    "mono": "gray",
    **{f"{chroma}p{bits}": f"yuv{chroma}p{bits}le" for chroma in ("420", "422", "444") for bits in DEPTHS},
    **{f"mono{bits}": f"gray{bits}le" for bits in DEPTHS},
}
"""FFmpeg's pixel format by the name that a header gives it."""

chroma_locations = {"420jpeg": "center", "420": "center", "420mpeg2": "left", "420paldv": "topleft"}
"""Where the chroma samples of a format sit, if its name says that."""

SDR_PRIMARIES = (1, UNSPECIFIED, 5, 6)
HDR_TRANSFERS = (16, 18)  # PQ and HLG


@dataclass(frozen=True)
class Header:
    """The first line of a stream.

    Parameters
    ----------
    width, height : int
        Pixels, 1 to 32768 each.
    rate : Fraction or None
        Frames per second; None where the stream does not say.
    format : str
        A name of `formats`, ``420jpeg``.
    full_range : bool or None
        Black is 0 rather than 16 (in 8 bits); None where the stream does not say.
    aspect : Fraction or None
        Width of a pixel over its height; None where the stream does not say.
    interlaced : bool
        Two fields in one picture.
    """

    width: int
    height: int
    rate: Fraction | None
    format: str = "420jpeg"
    full_range: bool | None = None
    aspect: Fraction | None = None
    interlaced: bool = False

    @property
    def pixel_format(self) -> str:
        """FFmpeg's name of the pixel format."""
        return formats[self.format]

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame without its line."""
        components = av.VideoFormat(self.pixel_format, self.width, self.height).components
        return sum(each.width * each.height * (2 if each.bits > 8 else 1) for each in components)

    def line(self) -> bytes:
        """Return the header as it is written: never interlaced, because frames are written as progressive."""
        colour_range = {None: "", True: " XCOLORRANGE=FULL", False: " XCOLORRANGE=LIMITED"}[self.full_range]
        rate, aspect = (_ratio(value) for value in (self.rate, self.aspect))
        text = f"W{self.width} H{self.height} F{rate} Ip A{aspect} C{self.format}{colour_range}"
        return MAGIC + b" " + text.encode("ascii") + b"\n"


def parse_header(line: bytes, name: str) -> Header:
    """Read the first line of a stream.

    Parameters
    ----------
    line : bytes
        With its line break.
    name : str
        Of the stream, for messages.

    Raises
    ------
    InputError
        Not YUV4MPEG2, or something in it that cannot be read.
    """
    if not line:
        raise InputError(f"{name} is empty; pipe a YUV4MPEG2 stream into it, as ffmpeg -f yuv4mpegpipe - writes one.")
    magic, *words = line.removesuffix(b"\n").split(b" ")
    if magic != MAGIC or not line.endswith(b"\n"):
        raise InputError(f"{name} is no YUV4MPEG2 stream; let ffmpeg -f yuv4mpegpipe - write one.")
    texts = [word.decode("ascii", "replace") for word in words if word]
    fields = {text[0]: text[1:] for text in texts if text[0] != "X"}
    extensions = dict(text[1:].partition("=")[::2] for text in texts if text[0] == "X")
    width, height = (_side(fields.get(key, ""), name) for key in "WH")
    if 8 * (width + 128) * (height + 128) >= 2**31:
        raise InputError(f"{name} is {width}x{height}, more than FFmpeg holds in one picture; scale it down first.")
    # writers of old said the format only in an extension
    format = fields.get("C") or extensions.get("YSCSS", "420jpeg").lower()
    if format not in formats:
        raise InputError(f"{name} has the pixel format {format!r}, which cannot be read; use {', '.join(formats)}.")
    rate = _fraction(fields.get("F", ""), name)
    if rate is not None and rate > MAX_RATE:
        raise InputError(f"{name} has {rate} frames per second, and {MAX_RATE} are the most that can be read.")
    return Header(
        width,
        height,
        rate,
        format,
        {"FULL": True, "LIMITED": False}.get(extensions.get("COLORRANGE", "")),
        _fraction(fields.get("A", ""), name),
        interlaced=fields.get("I", "") in ("t", "b", "m"),
    )


def _side(text: str, name: str) -> int:
    if not re.fullmatch("[0-9]{1,5}", text) or not 1 <= int(text) <= MAX_SIDE:
        raise InputError(f"{name} must say a width and a height of 1 to {MAX_SIDE}, not {text!r}.")
    return int(text)


def _fraction(text: str, name: str) -> Fraction | None:
    """Parse a ratio such as ``30000:1001``; return None for an empty one and for 0:0, which mean unknown."""
    found = re.fullmatch("([0-9]{1,10}):([0-9]{1,10})", text)
    if text and (found is None or max(int(found[1]), int(found[2])) >= 2**31):
        raise InputError(f"{name} has the ratio {text!r} in its first line, which is none; write it like 30000:1001.")
    if found is None or not int(found[1]) or not int(found[2]):
        return None
    return Fraction(int(found[1]), int(found[2]))


def _ratio(value: Fraction | None) -> str:
    return "0:0" if value is None else f"{value.numerator}:{value.denominator}"


def format_name(pixel_format: str, chroma_location: str) -> str:
    """Return the name of a pixel format in headers; `formats` has it."""
    names = [name for name, other in formats.items() if other == pixel_format]
    return next((name for name in names if chroma_locations.get(name) == chroma_location), names[0])


class PipeSource(ClosesOnExit):
    """Frames of a YUV4MPEG2 stream.

    Parameters
    ----------
    stream : binary stream, optional
        By default standard input. Opening reads its first line, and waits for it.
    for_images : bool
        For targets that hold pictures and nothing else: remark what is left behind; frames keep no picture of FFmpeg's.
    keeps_planes : bool
        Yield pictures of Y, Cb and Cr as they are, as `YCbCrImage`; others, and all without it, become BGR.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Raises
    ------
    InputError
        Empty, a terminal, or not YUV4MPEG2; while iterating also: something else between two frames.
    """

    def __init__(
        self,
        stream: BinaryIO | io.BufferedReader | None = None,
        *,
        for_images: bool = False,
        keeps_planes: bool = False,
        limit: MemoryLimit | None = None,
    ) -> None:
        self._waiting = _standard_input() if stream is None else None
        self._stream = stream or io.BufferedReader(cast(Descriptor, self._waiting))
        self._for_images = for_images
        self._header = parse_header(self._stream.readline(MAX_LINE), INPUT_NAME)
        (limit or MemoryLimit()).check(INPUT_NAME, self._header.width, self._header.height)
        self._started = False
        self._remarks: list[str] = []
        if self._header.rate is None:
            self._remarks.append(assumed_rate_remark(INPUT_NAME))
        if self._header.interlaced:
            self._remarks.append(interlaced_remark(INPUT_NAME))
        if for_images and self._header.aspect not in (None, 1):
            self._remarks.append(lost_shape_remark(INPUT_NAME, self._header.aspect))
        self._reformatter = VideoReformatter()
        self._rate = self._header.rate or ASSUMED_RATE
        self._info = ClipInfo(INPUT_NAME, self._header.height, self._header.width, self._rate, 1 / self._rate, None)
        self._traits = _traits(self._header)
        self._coding = coding_of(self._traits) if keeps_planes and not for_images else None

    @property
    def info(self) -> ClipInfo:
        return self._info

    @property
    def remarks(self) -> list[str]:
        return list(self._remarks)

    @property
    def stream_info(self) -> StreamInfo:
        """See `fpsboost.io.DescribedSource.stream_info`; colour and pixel shape are those of the first line."""
        return StreamInfo(traits=self._traits)

    def __iter__(self) -> Iterator[Frame]:
        if self._started:
            raise InputError(f"{INPUT_NAME} can be read only once; pipe it in again.")
        self._started = True
        return self._frames()

    def cancel(self) -> None:
        """See `fpsboost.contracts.Cancellable.cancel`."""
        if self._waiting is not None:
            self._waiting.cancel()

    def close(self) -> None:
        """Let go of the stream; standard input itself stays open, since it belongs to the process."""
        self._stream.close()

    def _frames(self) -> Iterator[Frame]:
        decoder = self._open_decoder()
        for number, samples in enumerate(self._samples()):
            (picture,) = decoder.decode(av.Packet(samples))
            picture.pts, picture.time_base = number, self._info.time_base
            image = to_bgr(picture, self._reformatter) if self._coding is None else in_planes(picture, self._coding)
            yield Frame(image, number / self._rate, 1 / self._rate, None if self._for_images else picture)

    def _open_decoder(self) -> av.VideoCodecContext:
        """Return a decoder that turns raw samples into pictures, with a demuxer's tags."""
        decoder = av.CodecContext.create("rawvideo", "r")
        decoder.width, decoder.height = self._header.width, self._header.height
        decoder.pix_fmt, decoder.color_range = self._header.pixel_format, self._traits.color_range
        decoder.options = {"chroma_sample_location": chroma_locations.get(self._header.format, "unspecified")}
        return decoder

    def _samples(self) -> Iterator[bytes]:
        """Yield the samples of each frame up to the end, which may come too early."""
        for number in count(1):
            line = self._stream.readline(MAX_LINE)
            if not line:
                return
            is_cut = not line.endswith(b"\n") and len(line) < MAX_LINE
            if not is_cut and not re.fullmatch(rb"FRAME( [^\n]*)?\n", line):
                raise InputError(
                    f"{INPUT_NAME} holds something else where frame {number} should begin; check its writer."
                )
            samples = b"" if is_cut else self._stream.read(self._header.frame_bytes)
            if len(samples) < self._header.frame_bytes:
                self._remarks.append(f"{INPUT_NAME} ended within frame {number}, which was left out.")
                return
            yield samples


def _traits(header: Header) -> VideoTraits:
    small = av.VideoFrame(64, 64, header.pixel_format)
    said = chroma_locations.get(header.format)
    return VideoTraits(
        pixel_format=header.pixel_format,
        color_space=assumed_color_space(header.height),
        tagged_color_space=UNSPECIFIED,
        color_range={None: 0, True: FULL_RANGE, False: LIMITED_RANGE}[header.full_range],
        color_primaries=UNSPECIFIED,
        color_transfer=UNSPECIFIED,
        full_range=bool(header.full_range),
        chroma_location=said or chroma_location_of(small, VideoReformatter()),
        tagged_chroma_location=said is not None,
        sample_aspect_ratio=header.aspect,
        display_matrix=None,
    )


class PipeSink:
    """A YUV4MPEG2 stream, written frame by frame as they come.

    What was written cannot be taken back, so unlike other sinks this one does not appear whole or not at all.

    Parameters
    ----------
    output : Output
        Pixel format and range of its source are kept where the stream can say them; of the encoding only the pixel
        format applies.
    stream : binary stream, optional
        By default standard output.

    Raises
    ------
    OptionError
        An option of an encoder, or a pixel format that the stream cannot hold.
    OutputError
        Standard output is a terminal.
    """

    holds_last_frame = True

    def __init__(self, output: Output, stream: BinaryIO | None = None) -> None:
        encoding = output.encoding
        others = [option for option in encoding.given if option != "`pixel_format`"]
        if others:
            raise OptionError(f"{OUTPUT_NAME} is not encoded and takes no {' or '.join(others)}; leave that out.")
        held = dict.fromkeys(formats.values())
        if encoding.pixel_format not in (None, *held):
            raise OptionError(
                f"`pixel_format={encoding.pixel_format!r}` is nothing that YUV4MPEG2 holds; use one of "
                f"{', '.join(held)}."
            )
        self._timing, self._encoding, self._info = output.timing, encoding, output.info
        self._traits = output.stream.traits
        self._waiting = _standard_output() if stream is None else None
        self._stream = stream or cast(Descriptor, self._waiting)
        self._header: Header | None = None
        self._reformatter = VideoReformatter()
        self._remarks: list[str] = []
        self._start = Fraction(0)
        self._count = 0
        self._is_uneven = self._alpha_dropped = False
        if output.stream.video is not None:
            wanted = {"sound": encoding.audio, "subtitles": encoding.subtitles}
            lost = [kind for kind in output.stream.video.companions if wanted[kind]]
            self._remarks += [lost_companions_remark(output.stream.video.name, lost, "YUV4MPEG2")] * bool(lost)

    @property
    def remarks(self) -> list[str]:
        return list(self._remarks)

    @property
    def details(self) -> str:
        """The stream's first line, which says what was chosen."""
        return "" if self._header is None else f"{OUTPUT_NAME}: {self._header.line().decode('ascii').strip()}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._header is None:
            raise OutputError(f"{OUTPUT_NAME} was not written because there were no frames.")

    def cancel(self) -> None:
        """See `fpsboost.contracts.Cancellable.cancel`."""
        if self._waiting is not None:
            self._waiting.cancel()

    def write(self, frame: Frame) -> None:
        """Write one frame, before the line about the stream if it is the first.

        Raises
        ------
        OutputError
            The frame does not fit the clip, or the stream cannot be written.
        ReaderGoneError
            Nobody reads any more.
        """
        if frame.image.shape[:2] != (self._info.height, self._info.width):
            raise OutputError(
                f"{OUTPUT_NAME} is {self._info.width}x{self._info.height} and cannot take a frame of "
                f"{describe(frame.image)}; make all frames one size first."
            )
        header = self._header
        if header is None:
            header = self._header = self._choose_header(frame.pixels)
            self._start = frame.time
            self._send(header.line())
        self._remark_on(frame)
        picture = as_picture(
            frame,
            header.pixel_format,
            self._traits.color_space if self._traits is not None else assumed_color_space(header.height),
            bool(header.full_range),
            chroma_location=self._chroma_location(header.pixel_format),
            reformatter=self._reformatter,
            keeps_original=self._traits is not None,
        )
        self._send(b"FRAME\n")
        for plane in plane_arrays(picture):
            self._send(np.ascontiguousarray(plane, plane.dtype.newbyteorder("<")).tobytes())
        self._count += 1

    def _choose_header(self, image: Pixels) -> Header:
        """Choose the source's pixel format or the nearest one; images keep all of their colour and depth."""
        traits = self._traits
        gray, deep = image.shape[2] < 3, image.dtype != np.uint8
        aspect = None
        full_range: bool | None = gray  # as FFmpeg takes gray to be
        wanted = ("gray" if gray else "yuv444p") + "16le" * deep
        if traits is not None:
            wanted, aspect = traits.pixel_format, traits.sample_aspect_ratio
            is_rgb = av.VideoFormat(wanted).is_rgb
            full_range = False if is_rgb else traits.full_range or (None if traits.color_range == 0 else False)
            self._remark_on_traits(traits)
        pixel_format = self._encoding.pixel_format or self._nearest(wanted)
        name = format_name(pixel_format, self._chroma_location(pixel_format))
        rate = self._timing.rate.limit_denominator((2**31 - 1) // (int(self._timing.rate) + 1))
        return Header(self._info.width, self._info.height, rate, name, full_range, aspect)

    def _nearest(self, wanted: str) -> str:
        found, loss = find_best_pix_fmt_of_list(list(formats.values()), wanted)
        if found is None:
            return "yuv444p16le"
        if loss & (PixFmtLoss.DEPTH | PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION):
            self._remarks.append(f"{OUTPUT_NAME} cannot hold all of {wanted} and was written as {found.name}.")
        return found.name

    def _chroma_location(self, pixel_format: str) -> str:
        """Return where the source has its chroma samples; for images where the name of 8-bit 4:2:0 usually says."""
        if self._traits is not None:
            return self._traits.chroma_location
        return "center" if pixel_format == "yuv420p" else "left"

    def _remark_on_traits(self, traits: VideoTraits) -> None:
        lost = {
            "colour matrix": traits.color_space != assumed_color_space(self._info.height),
            "colour primaries": traits.color_primaries not in SDR_PRIMARIES,
            "transfer function": traits.color_transfer in HDR_TRANSFERS,
            "HDR mastering data": traits.has_hdr_data,
            "rotation": traits.display_matrix is not None,
        }
        words = " and ".join(word for word, is_lost in lost.items() if is_lost)
        if words:
            self._remarks.append(
                f"{OUTPUT_NAME} cannot say the {words} of {self._info.name}; say it again behind the pipe."
            )

    def _remark_on(self, frame: Frame) -> None:
        if frame.image.shape[2] in (2, 4) and not self._alpha_dropped:
            self._alpha_dropped = True
            self._remarks.append(f"{OUTPUT_NAME} cannot hold an alpha channel, which was left out.")
        due = self._start + self._count / self._timing.rate
        if not self._is_uneven and abs(frame.time - due) * self._timing.rate > Fraction(1, 2):
            self._is_uneven = True
            self._remarks.append(
                f"{OUTPUT_NAME} shows every frame equally long, which those of {self._info.name} are not; give `fps` "
                "to keep their times."
            )

    def _send(self, data: bytes) -> None:
        """Write all of `data`, which may take several turns."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._stream.write(view) :]
        except BrokenPipeError:
            raise ReaderGoneError(f"{OUTPUT_NAME} was closed by the program that reads it.") from None
        except OSError as error:
            raise OutputError(
                f"{OUTPUT_NAME} could not be written ({error.strerror or error}); check where it leads."
            ) from error


class Descriptor(io.RawIOBase):
    """A standard stream that can be told not to wait any longer for the program at its other end."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._given_up = Event()
        # a pipe that has room has it for this much, and takes it without waiting
        self._portion = 1 << 20 if stat.S_ISREG(os.fstat(number).st_mode) else getattr(select, "PIPE_BUF", 1 << 16)

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def cancel(self) -> None:
        """Let the thread that waits in this stream go on, with an OSError."""
        self._given_up.set()

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        while True:
            self._wait(to_read=True)
            try:
                data = os.read(self._number, min(len(buffer), 1 << 20))
            except BlockingIOError:
                continue
            buffer[: len(data)] = data
            return len(data)

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        while True:
            self._wait(to_read=False)
            try:
                return os.write(self._number, data[: self._portion])
            except BlockingIOError:
                continue

    def _wait(self, *, to_read: bool) -> None:
        ready = os.name == "nt"  # where only sockets can be asked
        while not ready:
            if self._given_up.is_set():
                raise OSError("given up")
            ends = ([self._number], []) if to_read else ([], [self._number])
            ready = any(select.select(*ends, [], POLL_INTERVAL))


def _standard_input() -> Descriptor:
    if sys.stdin is None or sys.stdin.closed:
        raise InputError(f"{INPUT_NAME} is closed; pipe a YUV4MPEG2 stream into it.")
    if sys.stdin.isatty():
        raise InputError(f"{INPUT_NAME} is a terminal; pipe a YUV4MPEG2 stream into it, or name a file.")
    return Descriptor(sys.stdin.fileno())


def _standard_output() -> Descriptor:
    if sys.stdout is None or sys.stdout.closed:
        raise OutputError(f"{OUTPUT_NAME} is closed; pipe it into a program, or name a file.")
    if sys.stdout.isatty():
        raise OutputError(f"{OUTPUT_NAME} is a terminal, which cannot show it; pipe it into a program, or name a file.")
    return Descriptor(sys.stdout.fileno())
