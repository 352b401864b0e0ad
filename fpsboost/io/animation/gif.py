"""Animated GIF: FFmpeg reads and writes it, through PyAV; what it does not say of a file is read here.

Every frame gets the 256 colours that suit it best, so that nothing but one frame is in memory; a picture that has no
more of them, such as one of another GIF, comes back as it was. Players show what lasts less
than two hundredths of a second for a tenth of one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from contextlib import closing
from fractions import Fraction
from typing import Any, BinaryIO, cast

import av
import av.error
import av.filter
import numpy as np

from fpsboost.frame import Image
from fpsboost.io.animation.canvas import DEFAULT_DELAY, Outline, TimedImage, outline_of
from fpsboost.io.images.exact_reads import DamagedError, read_exactly, unpacked

CLOCK = 100  # ticks per second
MIN_DELAY = Fraction(2, CLOCK)
MAX_DELAY = Fraction(65535, CLOCK)

HEADER_SIZE = 13
_control_block, _image_block = b"\x21\xf9", b","
_trailer = b";"
_clear = 2
"""How a block of control says that its frame is cleared away afterwards."""

OPAQUE = 128
"""Alpha from which on a pixel is seen, since GIF knows only seen and unseen."""

_smooth = "dither=sierra2_4a"


def read_outline(file: BinaryIO) -> Outline:
    """Read what an animation says of itself; whether it has alpha also asks for the first frame.

    Raises
    ------
    DamagedError
        It is no GIF, or ends too early to tell anything.
    """
    head = read_exactly(file, HEADER_SIZE)
    if head[:4] != b"GIF8":
        raise DamagedError
    width, height, flags = unpacked("<HHB", head[6:])
    _skip_table(file, flags)
    is_whole, plays, delay, clears, delays = True, 1, DEFAULT_DELAY, False, Counter[Fraction]()
    try:
        while (kind := read_exactly(file, 1)) != _trailer:
            if kind == _image_block:
                _skip_table(file, read_exactly(file, 9)[8])
                file.seek(1, 1)
                _skip_blocks(file)
                delays[delay] += 1
                delay = DEFAULT_DELAY
                continue
            label, content = read_exactly(file, 1), _first_block(file)
            if kind + label == _control_block:
                ticks = unpacked("<BH", content)[1]
                delay = Fraction(ticks, CLOCK) if ticks >= 2 else DEFAULT_DELAY
                clears |= content[0] >> 2 & 7 == _clear
            elif content == b"NETSCAPE2.0":
                repeats = unpacked("<BH", _first_block(file))[1]
                plays = repeats + 1 if repeats else 0
            _skip_blocks(file)
    except DamagedError:
        is_whole = False
    file.seek(0)
    if not clears:
        with closing(read_frames(file)) as frames:
            first = next(frames, None)
        clears = first is not None and bool((first.image[..., 3] < 255).any())
    return outline_of((height, width), delays, plays, has_alpha=clears, is_whole=is_whole)


def _skip_table(file: BinaryIO, flags: int) -> None:
    if flags & 0x80:
        read_exactly(file, 3 << (flags & 7) + 1)


def _first_block(file: BinaryIO) -> bytes:
    return read_exactly(file, read_exactly(file, 1)[0])


def _skip_blocks(file: BinaryIO) -> None:
    while length := read_exactly(file, 1)[0]:
        file.seek(length, 1)


def read_frames(file: BinaryIO) -> Generator[TimedImage, None, None]:
    """Decode the frames of an animation one by one.

    Raises
    ------
    DamagedError
        It ends within a frame, or a frame cannot be decoded.
    """
    try:
        with av.open(file, "r", format="gif") as container:
            for picture in container.decode(video=0):
                delay = picture.duration * Fraction(picture.time_base or 0)
                image = np.ascontiguousarray(picture.to_ndarray(format="bgra"))
                yield TimedImage(image, delay if delay >= MIN_DELAY else DEFAULT_DELAY)
    except av.error.FFmpegError as error:
        raise DamagedError from error


class GifWriter:
    """Writes an animated GIF; see `AnimationWriter`.

    Parameters
    ----------
    file : file of bytes
        Open for writing, empty.
    plays : int
        How often the animation is shown; 0 for ever again.
    """

    def __init__(self, file: BinaryIO, plays: int) -> None:
        repeats = {0: 0, 1: -1}.get(plays, plays - 1)  # as FFmpeg counts: 0 for ever again, -1 for none
        self._container = av.open(file, "w", format="gif", options={"loop": str(repeats)})
        self._stream: av.VideoStream | None = None
        self._graphs: dict[bool, av.filter.Graph] = {}
        self._ticks = 0

    def add(self, image: Image, delay: Fraction) -> None:
        if self._stream is None:
            self._stream = self._open_stream(image)
        picture = self._with_palette(image)
        picture.pts, picture.time_base = self._ticks, Fraction(1, CLOCK)
        (packet,) = self._stream.encode(picture)
        packet.duration = int(delay * CLOCK)
        if image.shape[2] == 4:  # the next frame may let more be seen through
            data, control = bytearray(bytes(packet)), 0 if self._ticks else HEADER_SIZE
            data[control + 3] = data[control + 3] & ~0x1C | _clear << 2
            packet.update(bytes(data))
        self._container.mux(packet)
        self._ticks += packet.duration

    def finish(self) -> None:
        self._container.close()

    def _open_stream(self, image: Image) -> av.VideoStream:
        stream = self._container.add_stream("gif", CLOCK)
        stream.height, stream.width, stream.pix_fmt = *image.shape[:2], "pal8"
        # where there is alpha, frames are whole pictures; else the rectangle that changed is written ("transdiff",
        # which leaves out single pixels, gets some of them wrong where palettes change, and saves nothing under
        # dithering)
        flags = "offsetting" if image.shape[2] < 4 else "0"
        stream.codec_context.options = {"global_palette": "0", "gifflags": flags}
        return stream

    def _with_palette(self, image: Image) -> av.VideoFrame:
        """Return the image with its own palette of 256 colours, one of them transparent if needed."""
        image = _plain(image)
        exact = _few_colours(image)
        if exact is not None:
            return exact
        transparent = not image[..., 3].all()
        picture = av.VideoFrame.from_ndarray(image, format="bgra")
        picture.pts, picture.time_base = self._ticks, Fraction(1, CLOCK)
        graph = self._graphs.get(transparent)
        if graph is None:
            graph = self._graphs[transparent] = _palette_graph(picture, transparent)
        graph.push(picture)
        chosen: Any = cast(av.VideoFrame, graph.pull()).to_ndarray()
        # the encoder takes the padding of its first frame's rows for that of all, and writes past its memory otherwise
        return av.VideoFrame.from_ndarray(chosen, format="pal8")


def _plain(image: Image) -> Image:
    """Return BGRA with binary alpha; transparent pixels take a visible colour, to save palette entries."""
    if image.shape[2] == 3:
        return np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
    seen = image[..., 3] >= OPAQUE
    hidden_colour = image.reshape(-1, 4)[seen.argmax(), :3]
    colours = np.where(seen[..., np.newaxis], image[..., :3], hidden_colour)
    return np.dstack([colours, np.where(seen, np.uint8(255), np.uint8(0))])


def _few_colours(image: Image) -> av.VideoFrame | None:
    """Return the image without any loss if 256 colours are enough, else None."""
    pixels = image.view("<u4")[..., 0]
    if np.unique(pixels[::8, ::8]).size > 256:
        return None
    colours, indices = np.unique(pixels, return_inverse=True)
    if colours.size > 256:
        return None
    palette = np.zeros(256, ">u4")  # with alpha in the first byte, then red
    palette[: colours.size] = colours
    entries = palette.view(np.uint8).reshape(256, 4)
    planes: Any = (indices.reshape(pixels.shape).astype(np.uint8), entries)
    return av.VideoFrame.from_ndarray(planes, format="pal8")


def _palette_graph(picture: av.VideoFrame, transparent: bool) -> av.filter.Graph:
    graph = av.filter.Graph()
    entry = graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=Fraction(1, CLOCK)
    )
    split, sink = graph.add("split"), graph.add("buffersink")
    chosen = graph.add("palettegen", f"stats_mode=single:reserve_transparent={int(transparent)}")
    used = graph.add("paletteuse", f"new=1:alpha_threshold={OPAQUE}:{_smooth}")
    entry.link_to(split)
    split.link_to(used, 0, 0)
    split.link_to(chosen, 1, 0)
    chosen.link_to(used, 0, 1)
    used.link_to(sink)
    graph.configure()
    return graph
