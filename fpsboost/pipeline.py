"""The one loop: source -> held pictures -> pairs -> interpolator -> sink.

Everything is a stream over a few frames, so memory does not grow with length. Source frames that fall on an output time
go to the sink as they are, decoder's picture and all; but those that only show again what was there before give way to
frames that are made.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import chain, pairwise
from typing import Literal, NamedTuple, Protocol, get_args

from fpsboost.errors import InputError, OptionError, check_choice
from fpsboost.frame import ClipInfo, Frame
from fpsboost.held import Held, Shown, by_moments, one_by_one
from fpsboost.interpolator import Interpolator, Pair, with_neighbours
from fpsboost.media import FrameSink, FrameSource, OutputTiming, Waiting
from fpsboost.media.encoding import Encoding
from fpsboost.media.opening import makes_video, open_sink, open_source
from fpsboost.method_table import find_method
from fpsboost.overlap import nothing, read_ahead, write_behind
from fpsboost.prepared import PreparedImage
from fpsboost.scenes import DuplicateDetector
from fpsboost.timing import ByFactor, ByRate, Schedule, Step

READ_AHEAD = 4
WRITE_BEHIND = 4

Duplicates = Literal["interpolate", "keep"]


@dataclass
class Summary:
    """What a conversion did.

    Attributes
    ----------
    frames_in, frames_out : int
        Frames read and written.
    frames_made : int
        Frames written that are none of the source's: interpolated, or repeated across a cut.
    scene_cuts : int
        Pairs in which a scene ends; they were not interpolated across.
    duplicates : int
        Frames that showed the same as the one before, and were interpolated across.
    seconds : float
        Wall time of the loop, without compiling.
    remarks : list of str
        Sentences about everything that was lost or guessed.
    details : str
        How the target was written, for someone who wants to know; empty where there was no choice.
    """

    frames_in: int = 0
    frames_out: int = 0
    frames_made: int = 0
    scene_cuts: int = 0
    duplicates: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)
    details: str = ""


class Observer(Protocol):
    """Contract: told how a conversion goes."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """Source and target are open; `expected_frames` will be written if the source's header is right."""
        ...

    def ready(self) -> None:
        """The kernels are compiled, or loaded from the cache; the first frame comes next."""
        ...

    def wrote(self, summary: Summary) -> None:
        """Another frame is on its way to the target."""
        ...


class Silent:
    """An `Observer` that keeps quiet."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """See `Observer.opened`."""

    def ready(self) -> None:
        """See `Observer.ready`."""

    def wrote(self, summary: Summary) -> None:
        """See `Observer.wrote`."""


def convert(
    input: str,
    output: str,
    *,
    factor: Fraction | int | None = None,
    fps: Fraction | int | None = None,
    method: str | Interpolator = "nlm",
    input_fps: Fraction | int | None = None,
    duplicates: Duplicates = "interpolate",
    encoding: Encoding | None = None,
    overwrite: bool = False,
    observer: Observer | None = None,
) -> Summary:
    """Convert a clip to a higher frame rate.

    Parameters
    ----------
    input, output : str
        Each a video file, a folder of images, a pattern of images (``shot_%04d.png``, ``shot_####.png``), or ``-`` for
        YUV4MPEG2 from standard input or to standard output.
    factor : Fraction or int, optional
        Output frames per source frame; 2 where neither `factor` nor `fps` is given.
    fps : Fraction or int, optional
        Output frames per second, instead of `factor`.
    method : str or Interpolator
        A name of `fpsboost.methods`, or an object.
    input_fps : Fraction or int, optional
        Frames per second of input images.
    duplicates : {'interpolate', 'keep'}
        Frames that show the same as the one before, as in animation on threes, pulldown and captures that missed some:
        make the moving picture at their times, or keep them. Stills, and pictures held until a cut, are always kept.
        Not looked for where a renderer's motion vectors say what moves.
    encoding : Encoding, optional
        How to encode video, and which streams to keep.
    overwrite : bool
        Replace an existing output.
    observer : Observer, optional
        Told how it goes.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError, InputError, OutputError
        See `fpsboost.errors`.

    Examples
    --------
    >>> convert("in.mp4", "out.mp4", factor=2)  # doctest: +SKIP
    """
    check_choice("--duplicates", duplicates, get_args(Duplicates))
    schedule = make_schedule(factor, fps)
    interpolator = find_method(method) if isinstance(method, str) else method
    to_video = makes_video(output)
    needs_rate = to_video or fps is not None
    with open_source(input, _fraction(input_fps), needs_rate=needs_rate, for_images=not to_video) as source:
        info = source.info
        timing = OutputTiming(schedule.rate(info.rate), schedule.time_base(info.time_base))
        sink = open_sink(
            output,
            source=source,
            timing=timing,
            encoding=encoding or Encoding(),
            expected_frames=count_frames(schedule, info, holds_last_frame=False),
            overwrite=overwrite,
        )
        observer = observer or Silent()
        observer.opened(info, count_frames(schedule, info, sink.holds_last_frame))
        with sink:
            return boost(source, interpolator, sink, schedule, observer, duplicates=duplicates)


def boost(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    duplicates: Duplicates = "interpolate",
) -> Summary:
    """Run the loop over objects: read, interpolate, write. The caller opens and closes source and sink.

    Parameters
    ----------
    source : FrameSource
    interpolator : Interpolator
    sink : FrameSink
        Entered already.
    schedule : Schedule
        Which output times there are.
    observer : Observer, optional
        Told how it goes.
    duplicates : {'interpolate', 'keep'}
        See `convert`.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError
        There is no such way to treat duplicates.
    InputError
        Fewer than two frames, and whatever source and sink raise.
    """
    check_choice("--duplicates", duplicates, get_args(Duplicates))
    detector = DuplicateDetector() if duplicates == "interpolate" and not interpolator.needs_every_frame else None
    summary = Summary()
    observer = observer or Silent()
    with (
        read_ahead(source, READ_AHEAD, _give_up(source)) as arriving,
        write_behind(sink.write, WRITE_BEHIND, _give_up(sink)) as write,
    ):
        first = next(arriving, None)
        if first is not None:
            interpolator.compile_for(first.image)
        observer.ready()
        begin = time.perf_counter()
        frames = arriving if first is None else chain([first], arriving)
        clip = _Clip(source.info, schedule, interpolator, summary)
        outputs = _output_frames(frames, clip, detector, sink.holds_last_frame)
        for frame in _with_durations(outputs):
            write(frame)
            summary.frames_out += 1
            summary.seconds = time.perf_counter() - begin
            observer.wrote(summary)
    summary.remarks += [*source.remarks, *sink.remarks]
    summary.details = getattr(sink, "details", "")
    return summary


def _give_up(end: FrameSource | FrameSink) -> Callable[[], None]:
    """How to stop a source or sink that waits for another program."""
    return end.give_up if isinstance(end, Waiting) else nothing


class _Interval(NamedTuple):
    """From a held picture, nearly always one frame, to the next: the frames, and what falls into each one's time."""

    held: Held
    steps: list[list[Step]]
    end: Fraction
    pair: Pair


@dataclass
class _Clip:
    """What stays the same throughout the loop, and where it is."""

    info: ClipInfo
    schedule: Schedule
    interpolator: Interpolator
    summary: Summary
    start: Fraction = Fraction(0)
    index: int = 0
    """Number of the next frame to become part of an interval."""
    last: Held | None = None
    """What was shown last."""

    def shown(self, frames: Iterator[Frame]) -> Iterator[Shown]:
        """The source's frames with their places, counted."""
        for frame in frames:
            if self.summary.frames_in == 0:
                self.start = frame.time
            place = self.schedule.place(self.summary.frames_in, self.start, frame.time)
            self.summary.frames_in += 1
            yield Shown(frame, PreparedImage(frame.image, place))

    def intervals(self, moments: Iterable[Held]) -> Iterator[_Interval]:
        """From each held picture to the next."""
        for held in moments:
            if self.last is not None:
                yield self.interval(self.last, held)
            self.last = held

    def interval(self, held: Held, following: Held) -> _Interval:
        """From one held picture to the next; asked for in order."""
        frames = [*(shown.frame for shown in held), following[0].frame]
        steps = []
        for frame, after in pairwise(frames):
            steps.append(list(self.schedule.steps(self.index, self.start, frame.time, after.time)))
            self.index += 1
        end = frames[-1].time
        return _Interval(
            held, steps, end, self.interpolator.pair(held[0].image, following[0].image, end - frames[0].time)
        )


def _output_frames(
    frames: Iterator[Frame], clip: _Clip, detector: DuplicateDetector | None, holds_last_frame: bool
) -> Generator[Frame, None, Fraction]:
    """Yield the output frames without durations; return when the clip ends.

    Runs one pair behind the source: how a pair's motion goes on is seen in the next.
    """
    shown = clip.shown(frames)
    moments = one_by_one(shown) if detector is None else by_moments(shown, detector)
    for before, interval, after in with_neighbours(clip.intervals(moments)):
        yield from _between(interval, before, after, clip)
        interval.pair.settle()
    if clip.last is None or clip.summary.frames_in < 2:
        count = "one frame" if clip.summary.frames_in else "no frame"
        raise InputError(f"{clip.info.name} holds {count} that can be read, and two are needed to make one in between.")
    last = clip.last[-1].frame
    end = last.time + (last.duration or 1 / clip.info.rate)
    for step in clip.schedule.steps(clip.index, clip.start, last.time, end):
        if step.t == 0 or holds_last_frame:
            clip.summary.frames_made += step.t > 0
            yield replace(last, time=step.time)
    return end


def _between(interval: _Interval, before: _Interval | None, after: _Interval | None, clip: _Clip) -> Iterator[Frame]:
    """The output frames from one held picture to the next."""
    neighbours = [each and each.pair for each in (before, after)]
    *repeats, last = zip(interval.held, interval.steps, strict=True)
    if repeats and interval.pair.breaks_off(*neighbours):
        # nothing leads on from it, so it stays held until the last of its frames ends in the cut
        for shown, steps in repeats:
            for step in steps:
                clip.summary.frames_made += step.t > 0
                yield replace(shown.frame, time=step.time)
        shown, steps = last
    else:
        shown, steps = interval.held[0], _in_one(interval)
        clip.summary.duplicates += len(repeats)
    inner = [step.t for step in steps if step.t > 0]
    images, scene_cut = clip.interpolator.between(interval.pair, inner, *neighbours) if inner else (iter(()), False)
    clip.summary.scene_cuts += scene_cut
    for step in steps:
        if step.t == 0:
            yield replace(shown.frame, time=step.time)
        else:
            clip.summary.frames_made += 1
            yield Frame(next(images), step.time)


def _in_one(interval: _Interval) -> list[Step]:
    """The steps of all frames of a held picture, each at its place on the way to the next."""
    if len(interval.held) == 1:
        return interval.steps[0]
    begin = interval.held[0].frame.time
    lasts = interval.end - begin
    return [Step(step.time, (step.time - begin) / lasts) for steps in interval.steps for step in steps]


def _with_durations(frames: Generator[Frame, None, Fraction]) -> Iterator[Frame]:
    """Every frame lasts until the next one, and the last one until the clip ends."""
    held: Frame | None = None
    while True:
        try:
            frame = next(frames)
        except StopIteration as stop:
            end = stop.value
            break
        if held is not None:
            yield replace(held, duration=frame.time - held.time)
        held = frame
    if held is not None:
        yield replace(held, duration=end - held.time)


def make_schedule(factor: Fraction | int | None, fps: Fraction | int | None) -> Schedule:
    """The schedule for one of the two ways to say a rate; doubling where none is given.

    Raises
    ------
    OptionError
        Both are given, or one is out of range.
    """
    if factor is not None and fps is not None:
        raise OptionError("--factor and --fps say the same thing in two ways; give one of them.")
    if fps is not None:
        return ByRate(Fraction(fps))
    return ByFactor(Fraction(2 if factor is None else factor))


def count_frames(schedule: Schedule, info: ClipInfo, holds_last_frame: bool) -> int | None:
    """How many frames the output will have, if the source's header is right; None where it does not say."""
    if info.frame_count is None:
        return None
    intervals = info.frame_count if holds_last_frame else info.frame_count - 1
    whole, rest = divmod(intervals * schedule.rate(info.rate) / info.rate, 1)
    return int(whole) + bool(rest) + (not holds_last_frame and not rest)


def _fraction(value: Fraction | int | None) -> Fraction | None:
    return None if value is None else Fraction(value)
