"""Uncompressed video from standard input and to standard output, as YUV4MPEG2.

FFmpeg reads it, through PyAV. The few lines of text are written here, because PyAV cannot tell FFmpeg's muxer the shape
of pixels. Frames go out at once, so a pipe is the one target that does not appear as a whole.
"""

import re
import sys
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from types import TracebackType
from typing import Any, BinaryIO, Self

import av
import numpy as np
from av import VideoFormat, VideoFrame, VideoStream
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list
from av.video.reformatter import VideoReformatter

from fpsboost.colour import Coding
from fpsboost.contracts import ReadInOrder
from fpsboost.errors import InputError, OptionError, OutputError, ReaderGoneError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Pixels
from fpsboost.io.output import Output, StreamInfo, check_frame_size
from fpsboost.io.video.standard_streams import INPUT_NAME, OUTPUT_NAME, CountingReader, descriptor_of
from fpsboost.io.video.ycc import as_picture, coding_of, in_planes, to_bgr
from fpsboost.media import (
    ASSUMED_RATE,
    VideoTraits,
    as_fraction,
    assumed_color_space,
    depth_of,
    plane_arrays,
    read_traits,
)
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

DEPTHS = (9, 10, 12, 14, 16)

formats = {"420jpeg": "yuv420p", "420mpeg2": "yuv420p", "420paldv": "yuv420p"}
formats |= {"411": "yuv411p", "422": "yuv422p", "444": "yuv444p", "mono": "gray"}
formats |= {f"{chroma}p{bits}": f"yuv{chroma}p{bits}le" for chroma in ("420", "422", "444") for bits in DEPTHS}
formats |= {f"mono{bits}": f"gray{bits}le" for bits in DEPTHS if bits != 14}
"""FFmpeg's pixel format by the name that the first line of a stream gives it."""

chroma_locations = {"420jpeg": "center", "420mpeg2": "left", "420paldv": "topleft"}
"""Chroma sample locations, by the format names that imply one."""


class PipeSource(ReadInOrder):
    """Frames of a YUV4MPEG2 stream at a constant rate, which can be read once; opening waits for the first frame.

    Parameters
    ----------
    stream : BinaryIO, optional
        File object to read from, which stays open afterwards; standard input by default.
    for_images : bool
        Convert frames to BGR and keep no reference to the decoder's pictures; see
        `fpsboost.io.video.source.VideoSource`.
    keeps_planes : bool
        Keep Y'CbCr pictures as `fpsboost.image.YCbCrImage`; without effect with `for_images`.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Raises
    ------
    InputError
        Standard input is closed or a terminal, the stream is empty or no YUV4MPEG2, has no whole frame, or is too
        large. While iterating also: it is read a second time, or something other than a frame follows.
    """

    def __init__(
        self,
        stream: BinaryIO | None = None,
        *,
        for_images: bool = False,
        keeps_planes: bool = False,
        limit: MemoryLimit | None = None,
    ) -> None:
        self._waiting = None if stream else descriptor_of(sys.stdin, InputError, INPUT_NAME)
        self._file = CountingReader(stream or self._waiting)
        self._for_images = for_images
        self._end = 0
        try:
            # the first line describes the stream; to probe for more, FFmpeg would read and keep many frames
            options = {"probesize": "32", "analyzeduration": "0"}
            self._container = av.open(self._file, "r", format="yuv4mpegpipe", options=options)
            video = self._container.streams.video[0]
            (limit or MemoryLimit()).check(INPUT_NAME, video.width, video.height)
            self._pictures = self._decoded(video)
            self._first = next(self._pictures, None)
        except av.error.FFmpegError:
            self._file.check()
            what = "no YUV4MPEG2 stream, or one that FFmpeg cannot read" if self._file.count else "empty"
            raise InputError(
                f"{INPUT_NAME} is {what}; pipe a YUV4MPEG2 stream into it, as ffmpeg -f yuv4mpegpipe - writes one."
            ) from None
        self._file.check()
        if self._first is None:
            raise InputError(f"{INPUT_NAME} holds no whole frame; check the program that writes it.")
        # FFmpeg takes 25 for a rate that is missing, 0:0 or no ratio
        says_rate = re.match(rb"[^\n]* F0*[1-9][0-9]*:0*[1-9]", self._file.start)
        self._reformatter = VideoReformatter()
        rate = as_fraction(video.average_rate) or ASSUMED_RATE
        self.info = ClipInfo(INPUT_NAME, video.height, video.width, rate, 1 / rate, None)
        traits = read_traits(self._first, video, self._reformatter, INPUT_NAME)
        self.stream_info = StreamInfo(traits=traits)
        self._coding = coding_of(traits) if keeps_planes and not for_images else None
        self.remarks = Remarks()
        if not says_rate:
            self.remarks.add("rate-assumed", name=INPUT_NAME, rate=ASSUMED_RATE, advice="")
        if self._first.interlaced_frame:
            self.remarks.add("interlaced", name=INPUT_NAME, which="", advice="deinterlace it first")
        if for_images and traits.sample_aspect_ratio not in (None, 1):
            self.remarks.add("shape-lost-in-images", name=INPUT_NAME, shape=traits.sample_aspect_ratio)

    def __iter__(self) -> Iterator[Frame]:
        """Return an iterator over the frames; a second call raises `InputError`."""
        first = self._first
        self._first = None
        if first is None:
            raise InputError(f"{INPUT_NAME} can be read only once; pipe it in again.")
        return islice(self._frames(first), self._begin, None)

    def cancel(self) -> None:
        """Stop waiting for standard input, from another thread; no effect on a stream of the caller."""
        if self._waiting is not None:
            self._waiting.cancel()

    def close(self) -> None:
        """Close FFmpeg's demuxer; the stream belongs to the process or to the caller, and stays open."""
        self._container.close()

    def _decoded(self, video: VideoStream) -> Iterator[VideoFrame]:
        """Yield decoded pictures, and keep in `_end` the stream position behind the last packet."""
        for packet in self._container.demux(video):
            if packet.pos is not None and packet.size:
                self._end = packet.pos + packet.size
            yield from packet.decode()

    def _frames(self, picture: VideoFrame | None) -> Iterator[Frame]:
        """Yield the frames, numbered from 0 at the rate of the header; remark on a last frame that is cut off."""
        number = 0
        while picture is not None:
            picture.pts = number
            picture.time_base = self.info.time_base
            image = to_bgr(picture, self._reformatter) if self._coding is None else in_planes(picture, self._coding)
            yield Frame(image, number / self.info.rate, 1 / self.info.rate, None if self._for_images else picture)
            number += 1
            try:
                picture = next(self._pictures, None)
            except av.error.FFmpegError:
                self._file.check()
                raise InputError(
                    f"{INPUT_NAME} holds something else where frame {number + 1} should begin; check its writer."
                ) from None
        self._file.check()
        if self._file.count > self._end:
            self.remarks.add("frame-cut-off", name=INPUT_NAME, number=number + 1)


class PipeSink:
    """Sink that writes a YUV4MPEG2 stream, frame by frame, to standard output or a file object.

    Written data cannot be taken back, so unlike other sinks this one gives no guarantee of a whole output. Encoding
    options other than the pixel format are refused, as nothing is encoded.

    Parameters
    ----------
    output : Output
        Size, rate, colours and options of the frames to come.
    stream : BinaryIO, optional
        File object to write to, which stays open afterwards; standard output by default.

    Raises
    ------
    OptionError
        `output.encoding` has an option for an encoder, or a pixel format that YUV4MPEG2 lacks.
    OutputError
        Standard output is closed or a terminal. While writing also: writing fails, or a frame has another size; on
        exit: there was no frame.
    """

    holds_last_frame = True

    def __init__(self, output: Output, stream: BinaryIO | None = None) -> None:
        encoding = output.encoding
        others = [option for option in encoding.given if option != "`pixel_format`"]
        pixel_formats = dict.fromkeys(formats.values())
        if others:
            raise OptionError(f"{OUTPUT_NAME} is not encoded and takes no {' or '.join(others)}; leave that out.")
        if encoding.pixel_format not in (None, *pixel_formats):
            raise OptionError(
                f"YUV4MPEG2 does not hold `pixel_format={encoding.pixel_format!r}`; use one of "
                f"{', '.join(pixel_formats)}."
            )
        self._output = output
        self._info = output.info
        self._waiting = None if stream else descriptor_of(sys.__stdout__, OutputError, OUTPUT_NAME)
        self._stream: Any = stream or self._waiting
        self._header = ""
        self._reformatter = VideoReformatter()
        self.remarks = Remarks()
        self._start = Fraction(0)
        self._count = 0
        if output.stream.video is not None:
            wanted = {"sound": encoding.audio, "subtitles": encoding.subtitles}
            lost = [kind for kind in output.stream.video.auxiliary_streams if wanted[kind]]
            if lost:
                name = output.stream.video.name
                self.remarks.add("beside-left-out", name=name, what=" and ".join(lost), target="YUV4MPEG2")

    @property
    def details(self) -> str:
        """The header line of the stream, for verbose output; empty before the first frame."""
        return f"{OUTPUT_NAME}: {self._header}" if self._header else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and not self._header:
            raise OutputError(f"{OUTPUT_NAME} was not written because there were no frames.")

    def cancel(self) -> None:
        """Stop waiting for the reader of standard output, from another thread; no effect on a caller's stream."""
        if self._waiting is not None:
            self._waiting.cancel()

    def write(self, frame: Frame) -> None:
        """Write the next frame at once, after the header line if it is the first.

        YUV4MPEG2 has a constant rate and no times: a frame whose time differs from its place by more than half an
        interval is written all the same, with a remark. Raises `ReaderGoneError` if the reader has closed the pipe.
        """
        check_frame_size(frame, self._info, OUTPUT_NAME)
        if not self._header:
            self._header = self._choose_header(frame.pixels)
            self._start = frame.time
            self._send(self._header.encode() + b"\n")
        self._remark_on(frame)
        picture = as_picture(
            frame, self._coding, self._reformatter, keeps_original=self._output.stream.traits is not None
        )
        self._send(b"FRAME\n")
        for plane in plane_arrays(picture):
            self._send(np.ascontiguousarray(plane, plane.dtype.newbyteorder("<")).tobytes())
        self._count += 1

    def _choose_header(self, image: Pixels) -> str:
        """Return the header line, and set the coding of the pictures, by the first image.

        Video keeps its pixel format or gets the nearest one; images keep all their colour resolution and depth, as
        4:4:4 or gray.
        """
        stream = self._output.stream
        traits = stream.traits or _traits_of_images(image)
        is_rgb = VideoFormat(traits.pixel_format).is_rgb
        full_range = traits.full_range and not is_rgb
        says_range = is_rgb or traits.full_range or traits.color_range != 0
        pixel_format = self._output.encoding.pixel_format or self._nearest(traits.pixel_format)
        location = traits.chroma_location
        if stream.traits is None and pixel_format == "yuv420p":  # as the name of 8-bit 4:2:0 usually says
            location = "center"
        self._coding = Coding(depth_of(pixel_format), traits.color_space, full_range, location, pixel_format)
        self._remark_on_traits(stream.traits or stream.colours, traits.color_space)
        names = [name for name, other in formats.items() if other == pixel_format]
        name = next((name for name in names if chroma_locations.get(name) == location), names[0])
        rate = self._output.timing.rate.limit_denominator((2**31 - 1) // (int(self._output.timing.rate) + 1))
        aspect = traits.sample_aspect_ratio
        shape = "0:0" if aspect is None else f"{aspect.numerator}:{aspect.denominator}"
        words = f"YUV4MPEG2 W{self._info.width} H{self._info.height} F{rate.numerator}:{rate.denominator} Ip A{shape}"
        limits = f" XCOLORRANGE={'FULL' if full_range else 'LIMITED'}" if says_range else ""
        return f"{words} C{name}{limits}"

    def _nearest(self, wanted: str) -> str:
        """Return the pixel format of YUV4MPEG2 that loses least of another one, and remark on the loss."""
        nearest, loss = find_best_pix_fmt_of_list(list(formats.values()), wanted)
        if nearest is None:
            return "yuv444p16le"
        if loss & (PixFmtLoss.DEPTH | PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION):
            self.remarks.add("format-not-held", name=OUTPUT_NAME, wanted=wanted, format=nearest.name)
        return nearest.name

    def _remark_on_traits(self, traits: VideoTraits, color_space: int) -> None:
        """Remark on the colour matrix, HDR metadata, rotation and side data that the format cannot carry."""
        lost = list[str]()
        if color_space != assumed_color_space(self._info.height):
            lost.append("colour matrix")
        lost += traits.beyond_sdr()
        if traits.display_matrix is not None:
            lost.append("rotation")
        lost += traits.side_data.values()
        if lost:
            words = " and ".join(dict.fromkeys(lost))  # each once
            self.remarks.add("not-said-in-pipe", name=OUTPUT_NAME, what=words, source=self._info.name)

    def _remark_on(self, frame: Frame) -> None:
        """Remark, once each, on alpha and on uneven frame times, which the format cannot carry."""
        due = self._start + self._count / self._output.timing.rate
        if frame.image.shape[2] in (2, 4):
            self.remarks.add("alpha-not-held", name=OUTPUT_NAME)
        if abs(frame.time - due) * self._output.timing.rate > Fraction(1, 2):
            self.remarks.add("uneven-times", name=OUTPUT_NAME, source=self._output.info.name)

    def _send(self, data: bytes) -> None:
        """Write all of `data`, in several calls if need be.

        Raises `ReaderGoneError` if the reader has closed the pipe, and `OutputError` for other failures.
        """
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


def _traits_of_images(image: Pixels) -> VideoTraits:
    """Return the traits of images that keep all their colour resolution and depth; FFmpeg takes gray for full range."""
    gray = image.shape[2] < 3
    depth = "" if image.dtype == np.uint8 else "16le"
    return VideoTraits(f"{'gray' if gray else 'yuv444p'}{depth}", assumed_color_space(image.shape[0]), full_range=gray)
