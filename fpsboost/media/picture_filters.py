"""Pictures passed through FFmpeg's filters: fields made into frames, and margins cut off."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain, groupby
from typing import Any

import av.filter
from av import VideoFrame
from av.video.reformatter import VideoReformatter

from fpsboost.media.errors import InputError
from fpsboost.media.pixels import (
    SCALER_FLAGS,
    chroma_location_of,
    full_chroma,
    graph_of,
    has_alpha,
    kind_of_picture,
)
from fpsboost.media.pyav import REFUSALS, pulled
from fpsboost.media.side_data import CAPTIONS, Crop

DEINTERLACING = (
    ("bwdif", "mode=send_field:parity=auto:deint=all"),
    ("sidedata", f"mode=delete:type={CAPTIONS}:enable='mod(n,2)'"),
)
"""FFmpeg's filters that make two pictures of each."""


def frames_of_fields(pictures: Iterable[VideoFrame], time_base: Fraction, name: str) -> Iterator[VideoFrame]:
    """Yield two progressive pictures for each interlaced one, by FFmpeg's bwdif, in the field order of its flag.

    The second is presented halfway to the next picture, and has no closed captions. If no order is flagged, the top
    field is first, as in FFmpeg. The time base of the output is half of the pictures' own, or of `time_base`. Raises
    `InputError` for pictures that are too small or in a pixel format that cannot be deinterlaced.
    """
    for _, alike in groupby(pictures, kind_of_picture):
        first = next(alike)
        try:
            graph = graph_of(first, *DEINTERLACING, time_base=time_base)
        except REFUSALS:
            raise InputError(
                f"{name} holds pictures of {first.width}x{first.height} {first.format.name}, which cannot be "
                "deinterlaced; leave `deinterlace` out."
            ) from None
        for count, picture in enumerate(chain([first], alike), 1):  # noqa: B007 (used after the loop)
            graph.vpush(picture)
            yield from pulled(graph)
        graph.vpush(None)
        rest = list(pulled(graph))
        if count == 1 and len(rest) == 2 and rest[0].pts is not None:
            rest[1].pts = rest[0].pts + rest[0].duration  # without a neighbour, bwdif gives both the same time
        yield from rest


class FilterGraphs:
    """Cache of FFmpeg's filter graphs that make one picture of one, by format of the picture and filters."""

    def __init__(self, time_base: Fraction) -> None:
        self._time_base = time_base
        self._graphs: dict[Any, av.filter.Graph] = {}

    def passed(self, picture: VideoFrame, *filters: tuple[str, str]) -> VideoFrame:
        """Return a picture passed through filters, which are given by their names and options."""
        key = kind_of_picture(picture), filters
        if key not in self._graphs:
            self._graphs[key] = graph_of(picture, *filters, time_base=self._time_base)
        self._graphs[key].vpush(picture)
        return self._graphs[key].vpull()


def cropped(pictures: Iterable[VideoFrame], crop: Crop, time_base: Fraction, name: str) -> Iterator[VideoFrame]:
    """Yield what a crop leaves of pictures, by resampling chroma alone where it begins inside a sample of it."""
    scaler = VideoReformatter()
    graphs = FilterGraphs(time_base)
    margins = f"iw-{crop.left + crop.right}:ih-{crop.top + crop.bottom}:{crop.left}:{crop.top}:exact=1"
    for picture in pictures:
        coded = picture.format
        filters = [("crop", margins)]
        if crop.left % (16 // coded.chroma_width(16)) or crop.top % (16 // coded.chroma_height(16)):
            whole = full_chroma(coded.components[0].bits).replace("yuv", "yuva" if has_alpha(coded.name) else "yuv")
            place = chroma_location_of(picture, scaler)
            scaling = ("scale", f"flags={SCALER_FLAGS}:in_chroma_loc={place}:out_chroma_loc={place}")
            filters = [scaling, ("format", whole), *filters, scaling, ("format", coded.name)]
        try:
            yield graphs.passed(picture, *filters)
        except REFUSALS:
            raise InputError(
                f"{name} holds pictures of {picture.width}x{picture.height} {coded.name}, which cannot be cropped as "
                "it asks for; remove its crop first."
            ) from None
