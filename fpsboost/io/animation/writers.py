"""Encoders and muxers of GIF, APNG and animated WebP, frame by frame.

What FFmpeg's muxers do not write is corrected here: how a GIF disposes of frames with alpha, and that frames of a WebP
with alpha replace each other. FFmpeg gives the last frame of an APNG the delay of the one before.
"""

from __future__ import annotations

import os
import struct
from abc import ABC, abstractmethod
from fractions import Fraction
from typing import Any, BinaryIO, cast

import av
import av.filter
import numpy as np
from av import VideoFrame, VideoStream
from av.filter import Graph

from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.errors import OutputError
from fpsboost.image import Image, view

SHORTEST_GIF_DELAY = Fraction(1, 50)
"""Delay in a GIF below which players take `DEFAULT_DELAY`, seconds."""


MAX_DELAY_TERM = 65535
"""Largest numerator and denominator of an APNG's delay."""


WEBP_ANIMATED = 0x02


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
            self._stream.height = picture.height
            self._stream.width = picture.width
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
