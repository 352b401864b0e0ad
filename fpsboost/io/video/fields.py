"""Deinterlace pictures with FFmpeg's bwdif, so that each field becomes a frame of its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

import av
import av.error
import av.filter

from fpsboost.errors import InputError


def frames_of_fields(pictures: Iterable[av.VideoFrame], time_base: Fraction, name: str) -> Iterator[av.VideoFrame]:
    """Yield two progressive pictures for each interlaced one, in the field order that it is flagged with.

    The second is presented halfway to the next picture. If no order is flagged, the top field is first, as in FFmpeg.

    Parameters
    ----------
    pictures : iterable of av.VideoFrame
        Decoded pictures; their size and pixel format may change.
    time_base : Fraction
        Time base of pictures without one, seconds per tick. The time base of the output is half of it.
    name : str
        Name of the file in messages.

    Raises
    ------
    InputError
        Pictures are too small, or have a pixel format that cannot be deinterlaced.
    """
    held: _Deinterlacer | None = None
    for picture in pictures:
        if held is not None and held.kind != _kind(picture):
            yield from held.rest()
            held = None
        if held is None:
            try:
                held = _Deinterlacer(picture, time_base)
            except (av.error.FFmpegError, ValueError):
                raise InputError(
                    f"{name} holds pictures of {picture.width}x{picture.height} {picture.format.name}, which cannot be "
                    "deinterlaced; leave `deinterlace` out."
                ) from None
        yield from held.frames_of(picture)
    if held is not None:
        yield from held.rest()


class _Deinterlacer:
    """Deinterlacing filter for pictures of one size, pixel format and colour coding, with a delay of one picture."""

    def __init__(self, picture: av.VideoFrame, time_base: Fraction) -> None:
        self.kind = _kind(picture)
        self._graph = av.filter.Graph()
        clock = Fraction(picture.time_base or time_base)
        # The graph needs the colour tags too, so that a conversion to a format of bwdif does not change the colours.
        entry = self._graph.add(
            "buffer",
            f"video_size={picture.width}x{picture.height}:pix_fmt={picture.format.name}:"
            f"time_base={clock.numerator}/{clock.denominator}:"
            f"colorspace={int(picture.colorspace)}:range={int(picture.color_range)}",
        )
        bwdif = self._graph.add("bwdif", "mode=send_field:parity=auto:deint=all")
        self._graph.link_nodes(entry, bwdif, self._graph.add("buffersink")).configure()
        self._count = 0

    def frames_of(self, picture: av.VideoFrame) -> Iterator[av.VideoFrame]:
        self._count += 1
        self._graph.vpush(picture)
        yield from self._finished()

    def rest(self) -> Iterator[av.VideoFrame]:
        """Flush the filter and yield the frames of the last picture."""
        self._graph.vpush(None)
        frames = list(self._finished())
        if self._count == 1 and len(frames) == 2 and frames[0].pts is not None:
            frames[1].pts = frames[0].pts + frames[0].duration  # without a neighbour, bwdif gives both the same time
        yield from frames

    def _finished(self) -> Iterator[av.VideoFrame]:
        while True:
            try:
                yield self._graph.vpull()
            except (av.error.BlockingIOError, av.error.EOFError):
                return


def _kind(picture: av.VideoFrame) -> tuple[int, int, str, int, int]:
    return picture.width, picture.height, picture.format.name, int(picture.colorspace), int(picture.color_range)
