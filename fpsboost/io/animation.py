"""Animation files: GIF, APNG and WebP, read with 8 bits per channel, and written frame by frame.

Pillow reads APNG and animated WebP, PyAV GIF. PyAV writes all of them, whole under their names or not at all. What its
muxers do not write is corrected here: how a GIF disposes of frames with alpha, and that frames of a WebP with alpha
replace each other. FFmpeg gives the last frame of an APNG the delay of the one before.
"""

from __future__ import annotations

import math
import os
import secrets
import struct
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import accumulate, count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Self, cast

import av
import av.filter
import numpy as np
from av import VideoFrame, VideoStream
from av.filter import Graph

from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.contracts import ClosesOnExit
from fpsboost.errors import InputError, OutputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Image, view
from fpsboost.io.images.encoder import colours_of
from fpsboost.io.images.files import PNG_SIGNATURE, ImageMetadata, content_of, png_chunks
from fpsboost.io.output import Output, StreamInfo, check_frame_size
from fpsboost.io.video.ycc import straight_16_bit
from fpsboost.media import MASTERING, StagedSink, as_fraction, check_writable, counted, measure_rate, missing_codecs
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage  # whoever reads no animation does not wait for Pillow

DEFAULT_DELAY = Fraction(1, 10)
"""Time for which players show a frame without a delay, seconds."""
SHORTEST_GIF_DELAY = Fraction(1, 50)
"""Delay in a GIF below which players take `DEFAULT_DELAY`, seconds."""

MAX_DELAY_TERM = 65535
"""Largest numerator and denominator of an APNG's delay."""

WEBP_ANIMATED = 0x02
HEADER_SIZE = 30
"""Bytes in which a PNG declares its depth, and a WebP its size."""


def is_animation(path: Path) -> bool:
    """Return whether a file is a GIF, an APNG or an animated WebP by its content; False if it cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(HEADER_SIZE)
        return (
            start.startswith(b"GIF8") or bool(_webp_size(start)) or any(name == b"acTL" for name, _ in png_chunks(path))
        )
    except OSError:
        return False


def _webp_size(start: bytes) -> tuple[int, int] | None:
    """Return the width and height that an animated WebP declares in its first bytes; None for other files."""
    if len(start) < HEADER_SIZE or start[8:16] != b"WEBPVP8X" or not start[20] & WEBP_ANIMATED:
        return None
    return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")


def opened(file: BinaryIO) -> PillowImage:
    """Open an animation without decoding it; its warnings become remarks or errors of the source."""
    from PIL import Image as Pillow  # noqa: PLC0415

    with warnings.catch_warnings(action="ignore"):
        return Pillow.open(file, formats=("GIF", "PNG", "WEBP"))


class AnimationSource(ClosesOnExit):
    """Source of the frames of a GIF, APNG or animated WebP, composited as players show them.

    The file is kept in memory as it is stored, so that nothing stays open. Opening decodes the whole of it once,
    because nothing else gives all delays; iterating decodes it again. `plays` is the number of times that players show
    it, 0 for ever; `remarks` say what is damaged or not read.

    Parameters
    ----------
    path : str
        File to read; messages name it so.
    keeps_alpha : bool
        Yield BGRA if there are transparent parts; otherwise these are composited over white, with a remark.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Raises
    ------
    InputError
        The file cannot be read, is too large, or has no frame that can be decoded.
    """

    def __init__(self, path: str, *, keeps_alpha: bool = True, limit: MemoryLimit | None = None) -> None:
        data = content_of(Path(path))
        limit = limit or MemoryLimit()
        self._file = BytesIO(data)
        self._keeps_alpha = keeps_alpha
        self._has_alpha = False
        self._begin = 0
        declared = _webp_size(data[:HEADER_SIZE])
        if declared is not None:  # Pillow allocates the canvas of a WebP when it opens the file
            limit.check(path, *declared)
        try:
            image = opened(self._file)
        except Exception as error:  # damage makes Pillow raise nearly anything
            raise InputError(f"{path} is damaged or no animation; replace it.") from error
        self._format, (width, height) = image.format, image.size
        limit.check(path, width, height)
        self._first = int(getattr(image, "default_image", False))  # which an APNG has for viewers without animation
        self._delays = list[Fraction]()
        is_whole = self._survey(image)
        if not self._delays:
            raise InputError(f"{path} is damaged or no animation; replace it.")
        profile = image.info.get("icc_profile", b"")
        self.remarks = Remarks()
        colours = colours_of(self.remarks, Path(path), ImageMetadata(profile, chunks=tuple(png_chunks(Path(path)))))
        if data.startswith(PNG_SIGNATURE) and data[24] == 16:
            self.remarks.add("eight-bits-read", name=path)
        if not is_whole:
            self.remarks.add("animation-damaged", name=path, frames=counted(len(self._delays), "frame"))
        if self._has_alpha and not keeps_alpha:
            self.remarks.add("alpha-over-white", name=path)
        self.plays = _plays_of(image)
        self.stream_info = StreamInfo(colours=colours, plays=self.plays, files=[Path(path)])
        per_second = 100 if self._format == "GIF" else 1000
        tick = Fraction(1, math.lcm(per_second, *(delay.denominator for delay in self._delays)))
        times = list(accumulate(self._delays, initial=Fraction(0)))
        measured = measure_rate([int(time / tick) for time in times], tick)
        assert measured is not None, "every delay is above 0"
        self.info = ClipInfo(path, height, width, 1 / measured.interval, tick, len(self._delays), times[-1])

    def _survey(self, image: PillowImage) -> bool:
        """Read delays and alpha up to the end or the first damage; return whether all frames could be decoded.

        A GIF does not tell the number of its frames, and ends where it ends.
        """
        try:
            for pixels, delay in self._decoded():
                self._has_alpha |= bool((pixels[..., 3] < 255).any())
                self._delays.append(delay)
            return self._format == "GIF" or self._first + len(self._delays) == getattr(image, "n_frames", 1)
        except Exception:  # damage, as above
            return False

    def frame_times(self) -> Sequence[Fraction]:
        """Return the times of all frames, seconds, by the delays that opening has found."""
        return list(accumulate(self._delays[:-1], initial=Fraction(0)))

    def begin_at(self, number: int) -> None:
        """Begin iterating at a frame, counted from 0; those before it are decoded, as each is drawn over the last."""
        self._begin = number

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames, BGR or BGRA uint8, with the times and delays that opening has found.

        Each is decoded when it is due. Damaged files end with the last frame that opening could decode.
        """
        time = sum(self._delays[: self._begin], Fraction(0))
        for image, delay in islice(self._decoded(), self._begin, len(self._delays)):
            pixels = image
            if not self._has_alpha:
                pixels = np.ascontiguousarray(image[..., :3])
            elif not self._keeps_alpha:  # over white
                white = np.float32(255)
                pixels = np.rint(white - (white - image[..., :3]) * (image[..., 3:] / white)).astype(np.uint8)
            yield Frame(pixels, time, delay)
            time += delay

    def _decoded(self) -> Iterator[tuple[Image, Fraction]]:
        """Decode the composited frames from the first on, BGRA, with their delays in seconds.

        FFmpeg decodes GIF, because Pillow fills with a colour what browsers clear after an opaque frame; Pillow decodes
        others.
        """
        self._file.seek(0)
        if self._format == "GIF":
            with av.open(self._file, "r", format="gif") as container:
                for picture in container.decode(video=0):
                    delay = picture.duration * (as_fraction(picture.time_base) or Fraction(0))
                    image = np.ascontiguousarray(picture.to_ndarray(format="bgra"))
                    yield image, delay if delay >= SHORTEST_GIF_DELAY else DEFAULT_DELAY
            return
        file = opened(self._file)
        with suppress(EOFError):
            for index in count(self._first):
                file.seek(index)
                # of 16-bit gray Pillow would clip all that is no 8-bit level
                shown = file.point(lambda level: level * (1 / 256)) if file.mode == "I;16" else file
                image = np.ascontiguousarray(np.asarray(shown.convert("RGBA"))[..., [2, 1, 0, 3]])
                milliseconds = Fraction(file.info.get("duration") or 100)
                # of an APNG, the quotient of two 16-bit numbers as float
                yield image, (milliseconds / 1000).limit_denominator(MAX_DELAY_TERM)


def _plays_of(image: PillowImage) -> int:
    """Return how often players show an animation, 0 for ever; a GIF counts the repeats after the first time."""
    loop = image.info.get("loop")
    if image.format != "GIF":
        return loop or 0
    return 1 if loop is None else loop + 1 if loop else 0


OPAQUE = 128  # minimum alpha of a visible pixel of a GIF

WEBP_ALPHA = 0x10
"""Flag in the header of a WebP: frames have alpha."""
WEBP_REPLACES = 0x02
"""Flag at a frame of a WebP: it replaces the one before."""


class AnimationWriter(ABC):
    """Encoder and muxer of one type of animation, frame by frame; a subclass describes the type by class attributes.

    Frames are BGR or BGRA, uint8, or uint16 where the type `is_deep`, all of one shape.

    Parameters
    ----------
    file : BinaryIO
        Empty file, open for reading and writing, which stays open; some types are corrected in it at the end.
    plays : int
        Number of times that the animation is shown; 0 for ever.
    tick : Fraction
        Seconds per tick of the delays.
    code_points : tuple of int
        Primaries and transfer function, by ITU-T H.273, for types that store them.

    Attributes
    ----------
    ticks : int
        Sum of the delays of all frames so far.
    """

    muxer = codec = ""
    loop_option = "loop"
    tick: Fraction | None = None
    """Resolution of delays, seconds; None for that of the output."""
    shortest: Fraction
    longest: Fraction
    """Delays that the type can hold, seconds."""
    largest_side: int
    """Maximum width and height, pixels."""
    most_plays: int
    """Maximum number of plays that the type can store."""
    is_deep = False
    """Whether the type holds 16 bits per channel as well as 8."""
    has_tags = False
    """Whether the type stores primaries and transfer function."""

    def __init__(self, file: BinaryIO, plays: int, tick: Fraction, code_points: tuple[int, int]) -> None:
        self._file = file
        self._tick = tick
        self._code_points = code_points
        self._container = av.open(file, "w", format=self.muxer, options={self.loop_option: str(self.loops(plays))})
        self._stream: VideoStream | None = None
        self._shape: tuple[int, ...] = ()
        self.ticks = 0

    def loops(self, plays: int) -> int:
        """Return the value of FFmpeg's option for a number of plays, 0 for ever."""
        return plays

    @abstractmethod
    def picture(self, image: Image) -> VideoFrame:
        """Convert an image to the encoder's pixel format."""

    @abstractmethod
    def encoder_options(self) -> dict[str, str]:
        """Return the encoder's options for frames of the first one's shape."""

    def add(self, image: Image, ticks: int) -> None:
        """Encode the next frame and write its packet.

        Parameters
        ----------
        image : NDArray
            Image, (H, W, 3) or (H, W, 4); uint8, or uint16 if the type `is_deep`.
        ticks : int
            Delay after which the next frame is shown.

        Raises
        ------
        OutputError
            The image has another shape than the first one.
        """
        self._shape = self._shape or image.shape
        if image.shape != self._shape:
            raise OutputError(f"One frame is {view(image).describe()}, unlike the first; make all frames alike.")
        picture = self.picture(image)
        if self._stream is None:
            self._stream = cast(VideoStream, self._container.add_stream(self.codec, options=self.encoder_options()))
            self._stream.height, self._stream.width = picture.height, picture.width
            self._stream.pix_fmt = picture.format.name
            self._stream.time_base = self._stream.codec_context.time_base = self._tick
        picture.pts = self.ticks
        picture.time_base = self._tick
        picture.color_primaries, picture.color_trc = self._code_points
        for packet in self._stream.encode(picture):
            packet.duration = ticks
            self.mux(packet)
        self.ticks += ticks

    def mux(self, packet: av.Packet[Any]) -> None:
        """Write a packet, whose duration is set; a subclass may correct its bytes."""
        self._container.mux(packet)

    def finish(self) -> None:
        """Flush the encoder and write the end of the animation; the file stays open."""
        if self._stream is not None:
            for packet in self._stream.encode(None):
                self._container.mux(packet)
        self._container.close()


class GifWriter(AnimationWriter):
    """Writer of GIF: each frame gets the 256 colours that suit it best.

    Of a frame that has no more, `palettegen` rounds some colours, mostly by one level, because it works in OkLab.
    """

    muxer = codec = "gif"
    tick = Fraction(1, 100)
    shortest = SHORTEST_GIF_DELAY
    longest = Fraction(65535, 100)
    largest_side = 65535
    most_plays = 65536

    _graph: Graph | None = None

    def loops(self, plays: int) -> int:
        """Return FFmpeg's number of repeats: 0 for ever, -1 for none."""
        return {0: 0, 1: -1}.get(plays, plays - 1)  # of FFmpeg: 0 for ever again, -1 for no repeat

    def encoder_options(self) -> dict[str, str]:
        """Return options by which the rectangle that has changed is written, or the whole frame if there is alpha.

        "transdiff", which leaves out single pixels, gets some of them wrong where palettes change, and saves nothing
        under dithering.
        """
        return {"global_palette": "0", "gifflags": "offsetting" if self._shape[2] < 4 else "0"}

    def mux(self, packet: av.Packet[Any]) -> None:
        """Write a packet; of a GIF with alpha, let each frame be cleared before the next.

        FFmpeg's encoder decides by the frame itself whether it is cleared, and not by the next one, which may be
        transparent where this one is not.
        """
        if self._shape[2] == 4:
            data = bytearray(bytes(packet))
            control = data.index(b"\x21\xf9\x04") + 3
            data[control] = data[control] & ~0x1C | 2 << 2
            packet.update(bytes(data))
        super().mux(packet)

    def picture(self, image: Image) -> VideoFrame:
        """Convert an image to 256 colours of its own, with dithering."""
        has_alpha = image.shape[2] == 4
        image = _with_binary_alpha(image)
        picture = VideoFrame.from_ndarray(image, format="bgra")
        picture.pts = self.ticks
        picture.time_base = self._tick
        self._graph = self._graph or _palette_graph(picture, has_alpha)
        self._graph.push(picture)
        indices: Any = cast(VideoFrame, self._graph.pull()).to_ndarray()
        # the encoder takes the padding of its first frame's rows for that of all, and writes past its memory otherwise
        return VideoFrame.from_ndarray(indices, format="pal8")


def _with_binary_alpha(image: Image) -> Image:
    """Return BGRA with alpha 0 or 255; transparent pixels take a visible colour, to save palette entries."""
    if image.shape[2] == 3:
        return np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
    visible = image[..., 3] >= OPAQUE
    colours = np.where(visible[..., np.newaxis], image[..., :3], image.reshape(-1, 4)[visible.argmax(), :3])
    return np.dstack([colours, np.where(visible, np.uint8(255), np.uint8(0))])


def _palette_graph(picture: VideoFrame, has_alpha: bool) -> Graph:
    """Build a filter graph that gives every picture a palette of its own; `has_alpha` reserves a transparent entry."""
    graph = Graph()
    entry = graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=picture.time_base
    )
    split = graph.add("split")
    sink = graph.add("buffersink")
    chosen = graph.add("palettegen", f"stats_mode=single:reserve_transparent={int(has_alpha)}")
    used = graph.add("paletteuse", f"new=1:alpha_threshold={OPAQUE}:dither=sierra2_4a")
    graph.link_nodes(entry, split, used, sink)
    split.link_to(chosen, 1, 0)
    chosen.link_to(used, 0, 1)
    graph.configure()
    return graph


class ApngWriter(AnimationWriter):
    """Writer of APNG, lossless, 8 or 16 bits."""

    muxer = codec = "apng"
    loop_option = "plays"
    shortest = Fraction(1, MAX_DELAY_TERM)
    longest = Fraction(MAX_DELAY_TERM)
    largest_side = most_plays = 2**31 - 1
    is_deep = has_tags = True

    def encoder_options(self) -> dict[str, str]:
        """Return options for speed: at a third of the default's time, files grow by a twentieth."""
        return {"pred": "sub", "compression_level": "1"}

    def picture(self, image: Image) -> VideoFrame:
        """Convert an image to RGB or RGBA of its own depth, big-endian as PNG stores it."""
        formats = {np.uint16: ("rgb48be", "rgba64be"), np.uint8: ("rgb24", "rgba")}[image.dtype.type]
        return VideoFrame.from_ndarray(with_red_and_blue_swapped(image), format=formats[image.shape[2] == 4])


class WebpWriter(AnimationWriter):
    """Writer of WebP, lossless but for colours under full transparency."""

    muxer = "webp"
    codec = "libwebp"
    tick = Fraction(1, 1000)
    shortest = Fraction(1, 1000)
    longest = Fraction(2**24 - 1, 1000)
    largest_side = 16383
    most_plays = 65535

    def encoder_options(self) -> dict[str, str]:
        """Return options for encoding without loss in a quarter of the default's time."""
        return {"lossless": "1", "compression_level": "1", "quality": "20"}

    def picture(self, image: Image) -> VideoFrame:
        """Convert an image to BGRA, which libwebp takes for pictures with alpha and without."""
        return VideoFrame.from_ndarray(image if image.shape[2] == 4 else _with_binary_alpha(image), format="bgra")

    def finish(self) -> None:
        """Write the end of the animation; with alpha, correct the flags of header and frames in the file.

        FFmpeg's muxer lays each frame over the one before, so that what that one showed would stay visible through
        transparent parts.
        """
        super().finish()
        if self._shape[2:] != (4,):
            return
        place = 12  # the flag of alpha, and that each frame replaces the one before instead of being laid over it
        self._file.seek(place)
        while len(head := self._file.read(8)) == 8:
            name, size = struct.unpack("<4sI", head)
            if name == b"VP8X":
                self._file.write(bytes([WEBP_ANIMATED | WEBP_ALPHA]))
            elif name == b"ANMF":
                self._file.seek(15, os.SEEK_CUR)
                self._file.write(bytes([WEBP_REPLACES]))
            place += 8 + size + size % 2
            self._file.seek(place)


types: dict[str, type[AnimationWriter]] = {".gif": GifWriter, ".apng": ApngWriter, ".webp": WebpWriter}
"""Writers by the suffixes of their files."""


ANIMATION_SUFFIXES = tuple(types)
"""Suffixes of the animations that can be written."""

BROWSERS_SLOW_DOWN = Fraction(1, 100)  # browsers show frames of this length and shorter ones for a tenth of a second


class AnimationSink(StagedSink):
    """Sink that writes a GIF, APNG or WebP, which appears under its name when it is complete.

    A frame is shown until the next one, rounded to ticks of the file; rounding does not accumulate. Frames longer than
    the type can store are repeated, shorter ones are lengthened, with a remark if others become late by that.

    Parameters
    ----------
    output : Output
        Path, size, rate and plays of the frames to come. Its suffix determines the type, its time base the ticks of an
        APNG; colour tags that the type cannot store are lost with a remark.

    Raises
    ------
    OutputError
        The path cannot be written, exists or is an input; the type cannot hold the size or rate; an encoder is missing.
    """

    holds_last_frame = True

    def __init__(self, output: Output) -> None:
        self._name = output.path
        self._path = Path(output.path)
        self._info = output.info
        self._type = types[self._path.suffix.lower()]
        self._plays = min(output.stream.plays, self._type.most_plays)
        check_writable(self._path, output.path, output.stream.files, output.overwrite)
        self._check_fits(output.timing.rate)
        self._temporary = self._path.with_name(f".{self._path.name}.partial-{secrets.token_hex(4)}")
        self._tick = self._type.tick or output.timing.time_base
        self._shortest = max(1, math.ceil(self._type.shortest / self._tick))
        self._longest = int(self._type.longest / self._tick)
        self._begin: Fraction | None = None
        self._latest = Fraction(0)
        self._ticks = list[int]()
        colours = output.stream.traits or output.stream.colours
        self._code_points = colours.code_points
        lost = " and the ".join(word for word in colours.beyond_sdr if not self._type.has_tags or word == MASTERING)
        self._losses = Remarks()
        if lost:
            self._losses.add("not-said-in-animation", name=self._name, what=lost)

    def _check_fits(self, rate: Fraction) -> None:
        """Raise `OutputError` if the type cannot hold the size or the rate, or FFmpeg lacks its encoder."""
        suffix = self._path.suffix.lower()
        largest = self._type.largest_side
        width = self._info.width
        height = self._info.height
        fastest = 1 / self._type.shortest
        others = {".gif": ", or write .webp or .apng", ".webp": ", or write .apng"}.get(suffix, "")
        if max(width, height) > largest:
            raise OutputError(
                f"{self._name} cannot hold {width}x{height} pixels, {suffix} ends at {largest}; use .apng."
            )
        if missing_codecs([self._type.codec], "w"):
            raise OutputError(
                f"{self._name} needs the encoder {self._type.codec}, which this FFmpeg lacks; install PyAV's wheel."
            )
        if rate > fastest:
            raise OutputError(
                f"{self._name} cannot show {float(rate):.6g} frames per second, {suffix} ends at {fastest}; use "
                f"`fps={fastest}` or less{others}."
            )

    @property
    def remarks(self) -> Remarks:
        """Remarks on losses so far: colour tags, depth, short frames, and frames that come late."""
        remarks = Remarks(self._losses)
        file_type = self._path.suffix.lower()
        before, last = [0, 0, *self._ticks][-2:]
        if self._latest >= self._type.shortest:
            late, shortest = (float(time * 1000) for time in (self._latest, self._type.shortest))
            remarks.add("frames-late", name=self._name, late=late, file_type=file_type, shortest=shortest)
        if any(ticks * self._tick <= BROWSERS_SLOW_DOWN for ticks in self._ticks):
            remarks.add("frames-slowed-by-browsers", name=self._name)
        if file_type == ".apng" and 2 * abs(before - last) > before > 0:
            remarks.add("last-frame-as-before", name=self._name)
        return remarks

    def __enter__(self) -> Self:
        """Create the hidden file that is renamed at the end, and open its muxer; `OutputError` if it cannot be made."""
        with self._explained():
            self._file = self._temporary.open("x+b")
        self._writer = self._type(self._file, self._plays, self._tick, self._code_points)
        return self

    def write(self, frame: Frame) -> None:
        """Encode the next frame, shown from its time for its duration; times must increase.

        Gray becomes colour, and depth that the type cannot hold is lost with a remark. Raises `OutputError` if the
        frame has another size or shape than the first, or if writing fails.
        """
        check_frame_size(frame, self._info, self._name)
        image = self._storable(frame.array)
        if self._begin is None:
            self._begin = frame.time
        end = (frame.time + frame.duration - self._begin) / self._tick
        while True:  # a frame that is longer than the type can store is repeated
            remaining = end - self._writer.ticks
            ticks = min(max(round(remaining), self._shortest), self._longest)
            with self._explained():
                self._writer.add(image, ticks)
            self._ticks.append(ticks)
            if remaining <= self._longest:
                break
        self._latest = max(self._latest, (self._writer.ticks - end) * self._tick)

    def _storable(self, image: Image) -> Image:
        """Convert an image to 3 or 4 channels of a type that the file can hold, and remark on what is lost."""
        if image.dtype == np.float32:
            self._lose("values beyond black and white, and precision beyond 16 bits" if self._type.is_deep else "depth")
            image = straight_16_bit(image)
        if image.dtype == np.uint16 and not self._type.is_deep:
            self._lose("depth")
            image = np.rint(image / np.float32(257)).astype(np.uint8)
        # gray, and gray with alpha, become colour
        return image[..., [0, 0, 0, 1][: image.shape[2] + 2]] if image.shape[2] < 3 else image

    def _lose(self, what: str) -> None:
        """Remark, once, on a property of the frames that the type cannot hold."""
        bits = "16 bits" if self._type.is_deep else "8 bits; write an .apng to keep it"
        self._losses.add("depth-lost", name=self._name, what=what, file_type=self._path.suffix.lower(), bits=bits)

    def _finish(self) -> None:
        """Write the end, read the file back and give it its name; `OutputError` without frames or if it is damaged."""
        if self._begin is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        self._writer.finish()
        self._file.seek(0)
        try:
            opened(self._file).load()
        except Exception as error:  # damage makes Pillow raise nearly anything
            raise OutputError(
                f"{self._name} was not written because it cannot be read back; check the disk."
            ) from error
        self._file.close()
        os.replace(self._temporary, self._path)

    def _leave(self, error: BaseException | None) -> None:
        """Close and remove the hidden file; after `_finish` it has its name, and stays."""
        for clean_up in (self._file.close, self._temporary.unlink):
            with suppress(OSError):
                clean_up()
