"""Methods that interpolate hidden frames in a comparison: those of this package, and FFmpeg's `minterpolate`.

A method of a comparison (`ComparedMethod`) gets the intervals of a clip in order and yields the hidden frames with the
time that they took. Frames of other tools are in `fpsboost.evaluation.peers`.
"""

import re
import time
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar, NamedTuple, Protocol, Self

import av.error
import av.filter
import cv2
import numpy as np

from fpsboost.colour import has_alpha, normalised
from fpsboost.errors import OptionError
from fpsboost.evaluation.hidden_frames import HeldOutFrame, Interval
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, view
from fpsboost.interpolator import Interpolator
from fpsboost.media import graph_of, pulled
from fpsboost.method_table import methods, vector_methods
from fpsboost.pair import Pair, items_with_neighbours

MINTERPOLATE = "minterpolate"
"""Name of FFmpeg's filter among the methods."""


def method_names() -> list[str]:
    """Return the names of all methods that can be compared; no other tool may have one of them."""
    return [*methods, *vector_methods, MINTERPOLATE]


class InterpolatedFrame(NamedTuple):
    """A hidden frame as a method interpolated it, and its cost."""

    number: int
    """Number of the frame in the clip, counted from 0."""
    image: Image
    """Interpolated image, of the size and type of the true one."""
    seconds: float
    """Elapsed time, seconds; NaN if unknown."""
    cpu_seconds: float
    """CPU time of all threads, seconds; NaN if unknown."""
    search_radius: int | None = None
    """Search radius of its motion, pixels; None if the method has none."""


class ComparedMethod(Protocol):
    """Contract: a method that interpolates the hidden frames of a clip, in order."""

    any_time: ClassVar[bool]
    """Whether frames are interpolated at their own times, and not in equal steps only."""

    def interpolate(
        self, intervals: Iterable[Interval], wanted: Container[int] | None = None
    ) -> Iterator[InterpolatedFrame]:
        """Yield the hidden frames of a clip in order; `intervals` are all of it, which a method may look at.

        With `wanted`, only the frames with these numbers are yielded.
        """

    def describe(self) -> str:
        """Return the method's options in one line, for the page."""


@dataclass(frozen=True)
class ComparedInterpolator:
    """A method of this package. The time of the first frame of an interval includes the motion search."""

    interpolator: Interpolator
    """The method, with its cut policy and other settings."""
    follows_guides: bool = False
    """Whether frames follow their guides, if they have some."""
    any_time: ClassVar[bool] = True

    def interpolate(
        self, intervals: Iterable[Interval], wanted: Container[int] | None = None
    ) -> Iterator[InterpolatedFrame]:
        """Yield the hidden frames; see `ComparedMethod.interpolate`."""
        for interval, pair in items_with_neighbours(self._pairs(intervals)):
            chosen = [hidden for hidden in interval.hidden if wanted is None or hidden.number in wanted]
            if chosen:
                yield from self._timed(pair, chosen)
            pair.release_caches()

    def _timed(self, pair: Pair, chosen: Sequence[HeldOutFrame]) -> Iterator[InterpolatedFrame]:
        """Yield the chosen frames of an interval with the time that each took."""
        guides = [hidden.source.guide for hidden in chosen] if self.follows_guides else ()
        images = self.interpolator.images(pair, [hidden.t for hidden in chosen], guides=guides)
        for hidden in chosen:
            begin = time.perf_counter()
            begin_cpu = time.process_time()
            image = next(images)
            seconds = time.perf_counter() - begin
            cpu = time.process_time() - begin_cpu
            yield InterpolatedFrame(hidden.number, view(image.image).array(), seconds, cpu, pair.search_radius)

    def _pairs(self, intervals: Iterable[Interval]) -> Iterator[tuple[Interval, Pair]]:
        """Yield the intervals with pairs of their shown frames, each of which two pairs share."""
        last: FrameCache | None = None
        for interval in intervals:
            first, image = interval.prepared(with_layers=self.interpolator.takes_layers)
            yield interval, self.interpolator.pair(last or first, image, interval.shown1.time - interval.shown0.time)
            last = image

    def describe(self) -> str:
        return f"{self.interpolator.estimator}, {self.interpolator.synthesizer}"


@dataclass(frozen=True)
class Minterpolate:
    """FFmpeg's motion-compensated filter, from the FFmpeg libraries of PyAV.

    It accepts 8 bits per channel only.
    """

    options: str = "mi_mode=mci:mc_mode=aobmc:me_mode=bidir:vsbmc=1:scd=none"
    """Options in FFmpeg's syntax, without the rate."""

    @classmethod
    def with_options(cls, texts: Mapping[str, str]) -> Self:
        """Return the filter with some of its options changed, by FFmpeg's names; the rate is that of the comparison.

        Raises `OptionError` for text that cannot be an option.
        """
        options = dict(pair.split("=") for pair in cls.options.split(":"))
        for text, value in texts.items():
            name = text.replace("-", "_")
            if not re.fullmatch(r"\w+", name) or not re.fullmatch(r"[\w.+-]+", value) or name == "fps":
                raise OptionError(f"minterpolate takes no {name}={value} here; see ffmpeg -h filter=minterpolate.")
            options[name] = value
        return cls(":".join(f"{name}={value}" for name, value in options.items()))

    any_time: ClassVar[bool] = False  # it is fed frames without times

    def describe(self) -> str:
        return f"FFmpeg's minterpolate={self.options}, 4:4:4, 8 bit"

    def interpolate(
        self, intervals: Iterable[Interval], wanted: Container[int] | None = None
    ) -> Iterator[InterpolatedFrame]:
        """Yield the hidden frames; see `ComparedMethod.interpolate`.

        Frames that the filter outputs together share its time evenly.
        """
        graph: av.filter.Graph | None = None
        hidden: dict[int, HeldOutFrame] = {}  # by the place in the filter's output
        place = 0
        last = None
        for interval in intervals:
            factor = len(interval.hidden) + 1
            if graph is None:
                graph = self._graph(interval.shown0.frame.array, factor)
                graph.vpush(_as_picture(interval.shown0.frame.array, 0))
            hidden |= {place * factor + k: each for k, each in enumerate(interval.hidden, start=1)}
            place = place + 1
            last = interval.shown1.frame.array
            yield from _passed(graph, _as_picture(last, place), hidden, wanted)
        if graph is not None and last is not None:
            # the filter holds two frames back and never makes the last interval: the last frame is repeated at the end
            for more in (1, 2):
                yield from _passed(graph, _as_picture(last, place + more), hidden, wanted)

    def _graph(self, shown: Image, factor: int) -> av.filter.Graph:
        """Return a filter graph; raises `OptionError` if the filter rejects its options."""
        filters = ("format", "yuv444p"), ("minterpolate", f"fps={factor}:{self.options}"), ("format", "bgr24")
        try:
            return graph_of(_as_picture(shown, 0), *filters)
        except (av.error.FFmpegError, ValueError) as error:
            raise OptionError(f"minterpolate does not take {self.options} ({error}).") from error


def _as_picture(image: Image, place: int) -> av.VideoFrame:
    """Return an image in 8 bits as a picture of a clip with one frame per second."""
    colours = image[..., :3] if image.shape[2] >= 3 else image[..., :1].repeat(3, axis=2)
    levels = np.rint(normalised(colours).clip(0, 1) * 255).astype(np.uint8)
    picture = av.VideoFrame.from_ndarray(levels, format="bgr24")
    picture.pts = place
    picture.time_base = Fraction(1)
    return picture


def _passed(
    graph: av.filter.Graph, picture: av.VideoFrame, hidden: dict[int, HeldOutFrame], wanted: Container[int] | None
) -> Iterator[InterpolatedFrame]:
    """Push a picture, and yield the hidden frames that come out, which are taken from `hidden`."""
    begin = time.perf_counter()
    begin_cpu = time.process_time()
    graph.vpush(picture)
    pictures = [each for each in pulled(graph) if each.pts in hidden]
    seconds = time.perf_counter() - begin
    cpu_seconds = time.process_time() - begin_cpu
    for each in pictures:
        frame = hidden.pop(each.pts or 0)
        if wanted is None or frame.number in wanted:
            image = as_type_of(each.to_ndarray(), frame.truth)
            yield InterpolatedFrame(frame.number, image, seconds / len(pictures), cpu_seconds / len(pictures))


def as_type_of(image: Image, like: Image) -> Image:
    """Return an image in the type and with the channels of the clip's frames.

    Bit depths are scaled; missing alpha becomes opaque and alpha that the clip lacks is dropped; gray becomes colour,
    and colour the gray of its luma.
    """
    if image.dtype == like.dtype and image.shape == like.shape:
        return image
    values = normalised(image)
    colours = values[..., :-1] if has_alpha(image) else values
    if like.shape[2] <= 2 and colours.shape[2] == 3:
        colours = cv2.cvtColor(np.ascontiguousarray(colours), cv2.COLOR_BGR2GRAY)[..., np.newaxis]
    elif like.shape[2] >= 3 and colours.shape[2] == 1:
        colours = colours.repeat(3, axis=2)
    if has_alpha(like):
        alpha = values[..., -1:] if has_alpha(image) else np.ones_like(values[..., :1])
        colours = np.concatenate([colours, alpha], axis=2)
    if like.dtype == np.float32:
        return np.ascontiguousarray(colours, np.float32)
    return np.ascontiguousarray(np.rint(colours.clip(0, 1) * np.iinfo(like.dtype).max), like.dtype)
