"""Conversion loop: groups source frames into pairs, interpolates them, and writes the output frames in order.

All steps stream over a few frames, so memory does not grow with length. Source frames that fall on an output time go to
the sink unchanged, with the decoder's own frame; but duplicate frames are replaced by interpolated ones.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import chain, islice, pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.analysis.duplicates import DuplicateDetector, FrameGroup, SourceFrame, group_duplicates, group_singly
from fpsboost.contracts import Cancellable, FrameSink, FrameSource, HasBeginning, TakesSideData
from fpsboost.errors import InputError, OptionError
from fpsboost.frame import ClipInfo, Frame, FrameImage, Image, PairMotion
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.interpolator import Interpolator, Pair, with_neighbours
from fpsboost.observer import LowestMatch, Observer, SilentObserver, SourceMoment, Summary
from fpsboost.synthesis.exposure import Exposure
from fpsboost.threads import available_cores, nothing, read_ahead, run_in_parallel, write_behind
from fpsboost.timing.rate import stretched
from fpsboost.timing.schedule import Schedule, Step, rising_time

FRAMES_PER_TASK = 4
"""Maximum number of output frames that one task makes."""

READ_AHEAD = 1
WRITE_BEHIND = 2


@dataclass(frozen=True)
class Entry:
    """State in which the loop begins in the middle of a clip, and goes on as if it had read the clip from its start.

    Attributes
    ----------
    number : int
        Source frame that is read first, counted from 0.
    start : Fraction
        Time of the clip's first frame, seconds.
    outputs_before : int
        Number of output frames before that source frame.
    step : float
        Difference of the frame from the picture before it, for the detector of duplicates; infinite at the start.
    """

    number: int
    start: Fraction
    outputs_before: int
    step: float = math.inf


@dataclass(frozen=True)
class OutputRange:
    """Output frames that a run writes, of all that the whole clip gives.

    Attributes
    ----------
    first : int
        Number of the first one, counted from 0.
    stop : int or None
        Number of the first one that follows; None for all to the end.
    skip : int
        Number of frames, from the first, that the sink has already; see `fpsboost.io.Resumable`. They are counted and
        passed on in order, but instead of an interpolated image they carry one of the source.
    entry : Entry or None
        Where the source begins, early enough for the first one; None for its start.
    """

    first: int = 0
    stop: int | None = None
    skip: int = 0
    entry: Entry | None = None

    def __contains__(self, number: int) -> bool:
        return self.first <= number and not self.is_past(number)

    def is_past(self, number: int) -> bool:
        """Return whether an output frame comes after the range."""
        return self.stop is not None and number >= self.stop


def run_conversion(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    stretch: Fraction = Fraction(1),
    threads: int | None = None,
    outputs: OutputRange | None = None,
) -> Summary:
    """Run the loop over objects: read, interpolate, write. The caller opens and closes source and sink.

    Parameters
    ----------
    source : FrameSource
    interpolator : Interpolator
    sink : FrameSink
        Entered already. One with the attributes ``needs_confidence`` and ``needs_motion`` gets frames with what it
        needs; see `fpsboost.Frame`.
    schedule : Schedule
        Determines the output times. Of an `fpsboost.timing.shutter.ExposureSchedule`, every output frame is the mean of
        several that are made around its time, in one scene; images must be arrays.
    observer : Observer, optional
        Informed of the progress.
    stretch : Fraction
        Duration of the output as a multiple of the source's; not included in the schedule.
    threads : int, optional
        Pairs of frames processed in parallel; as many as there are cores by default. Frames are the same with any
        number.
    outputs : OutputRange, optional
        Output frames that the sink gets; all by default.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError
        `duplicates` is unknown, or `threads` is below 1.
    InputError
        The source has fewer than two frames. Errors of source and sink are passed on.
    """
    outputs = outputs or OutputRange()
    summary = Summary(completed_frames=outputs.skip)
    observer = observer or SilentObserver()
    with (
        making_frames(
            source,
            interpolator,
            schedule,
            summary,
            stretch=stretch,
            threads=threads,
            holds_last_frame=sink.holds_last_frame,
            needs=_needs_of(sink),
            outputs=outputs,
        ) as frames,
        write_behind(sink.write, WRITE_BEHIND, _cancel_of(sink)) as write,
    ):
        observer.ready()
        begin = time.perf_counter()
        for frame in frames:
            write(frame)
            summary.frames_out += 1
            summary.seconds = time.perf_counter() - begin
            observer.wrote(summary)
    summary.remarks += [*source.remarks, *sink.remarks]
    summary.details = getattr(sink, "details", "")
    return summary


class Needs(NamedTuple):
    """What frames that are made are to have beside their pixels; see `fpsboost.contracts.TakesSideData`."""

    confidence: bool = False
    motion: bool = False


@contextmanager
def making_frames(
    source: FrameSource,
    interpolator: Interpolator,
    schedule: Schedule,
    summary: Summary,
    *,
    holds_last_frame: bool,
    stretch: Fraction = Fraction(1),
    threads: int | None = None,
    needs: Needs | None = None,
    outputs: OutputRange | None = None,
) -> Generator[Iterator[Frame]]:
    """Read ahead and make frames while the block lasts.

    Parameters
    ----------
    source, interpolator, schedule, stretch, threads, outputs
        See `run_conversion`.
    summary : Summary
        Updated with the numbers of frames read and made.
    holds_last_frame : bool
        See `fpsboost.contracts.FrameSink`.
    needs : Needs, optional
        What frames are to have beside their pixels; nothing by default.

    Yields
    ------
    iterator of Frame
        The output frames in order, each as soon as it is made. Kernels are compiled already.
    """
    if threads is not None and threads < 1:
        raise OptionError(f"`threads` must be at least 1, not {threads}.")
    detector = None if interpolator.needs_every_frame else interpolator.duplicates
    with (
        read_ahead(source, READ_AHEAD, _cancel_of(source)) as arriving,
        run_in_parallel(threads or available_cores(), _cancel_of(source)) as in_order,
    ):
        first = next(arriving, None)
        if first is not None:
            interpolator.compile_for(first.image)
        frames = arriving if first is None else chain([first], arriving)
        outputs = outputs or OutputRange()
        place = beginning(source)
        clip = _LoopState(source.info, schedule, interpolator, summary, place, needs or Needs(), outputs, stretch)
        made = _exposed(_output_frames(frames, clip, detector, holds_last_frame, in_order))
        before, start = clip.outputs_before, None if outputs.entry is None else outputs.entry.start
        part = islice(
            _with_durations(made), outputs.first - before, None if outputs.stop is None else outputs.stop - before
        )
        yield stretched(part, stretch, start)


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Keep OpenCV from using several threads in this process while the block lasts.

    Pairs of frames are worked on side by side, and threads that wait for parts of them take 1 % more CPU. For processes
    that do nothing else, as OpenCV has one setting for all.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def beginning(source: FrameSource) -> SourcePosition:
    """Return the position of a source's first frame in its clip; valid when that has been read."""
    return source.beginning if isinstance(source, HasBeginning) else SourcePosition(0, Fraction(0))


def _cancel_of(end: FrameSource | FrameSink) -> Callable[[], None]:
    """Return the function that stops a source or sink that waits for another program."""
    return end.cancel if isinstance(end, Cancellable) else nothing


def _needs_of(sink: FrameSink) -> Needs:
    """Return what a sink asks for beside frames."""
    return Needs(sink.needs_confidence, sink.needs_motion) if isinstance(sink, TakesSideData) else Needs()


@dataclass
class _Interval:
    """Interval from a held picture, nearly always one frame, to the next: its frames, and each one's output steps."""

    held: FrameGroup
    steps: list[list[Step]]
    numbers: list[int]
    """Number of the output frame of each step."""
    first_output: int
    """Number of its first output frame, or of the next one if it has none."""
    end: Fraction
    pair: Pair
    places: tuple[int, int]
    """Places of the pair's frames in the clip, from 0."""
    _shown: _ShownInterval | None = None

    def shown(self, neighbours: tuple[Pair | None, Pair | None]) -> _ShownInterval:
        """Return what is shown at each step, given the pairs before and after; computed once for all its parts."""
        if self._shown is None:
            self._shown = _show(self, neighbours)
        return self._shown


class _ShownInterval(NamedTuple):
    """What is shown at each step of an interval."""

    steps: list[tuple[SourceFrame, Step]]
    """The frame that is held or left, and the step, with t relative to the whole interval if it moves."""
    moves: list[bool]
    """Whether a frame is made, rather than one repeated."""
    first_move: int | None
    """Place of the first of these."""
    is_held: bool
    """Whether duplicates are repeated because no motion follows them."""


class _OutputPart(NamedTuple):
    """Output frames of a part of an interval, made by one task."""

    interval: _Interval
    frames: list[Frame]
    steps: list[Step]
    """The step of each frame."""
    past_cut: list[bool]
    """Whether each frame shows the scene after a cut."""
    new: int
    """Number of frames, of those that are written, that are not from the source."""
    scene_cut: bool
    duplicates: int
    """Frames of the interval that are interpolated across."""
    match: LowestMatch | None
    """How well the two frames match, with the frame of the output halfway between them; None if nothing is made."""
    begins: bool
    """Whether it is the first part of the interval."""
    ends: bool
    """Whether it is the last part of the interval."""


class _Shown(NamedTuple):
    """Frame of the output, or a sample of its exposure."""

    frame: Frame
    step: Step
    scene: int
    """Number of the scene that it shows."""


@dataclass
class _LoopState:
    """Constants and current state of the loop."""

    info: ClipInfo
    schedule: Schedule
    interpolator: Interpolator
    summary: Summary
    beginning: SourcePosition
    needs: Needs
    outputs: OutputRange
    stretch: Fraction
    start: Fraction = Fraction(0)
    number: int = 0
    """Number of the next source frame to be read."""
    index: int = 0
    """Number of the next source frame to become part of an interval."""
    outputs_before: int = 0
    """Number of output frames so far."""
    exposed: int | None = None
    """`Step.frame_number` of the last of them."""
    step: float = math.inf
    last: FrameGroup | None = None
    """Previous group of frames."""

    def __post_init__(self) -> None:
        entry = self.outputs.entry
        if entry is not None:
            self.start, self.step, self.outputs_before = entry.start, entry.step, entry.outputs_before
            self.number = self.index = entry.number

    def shown(self, frames: Iterator[Frame]) -> Iterator[SourceFrame]:
        """Yield the source's frames with their positions, at the schedule's presentation times, and count them."""
        last: Fraction | None = None
        for frame in frames:
            if self.number == 0:
                self.start = frame.time
            self.summary.frame_intervals.note(frame.time, self.start)
            number = self.number
            self.number += 1
            self.summary.frames_in += 1
            moment = rising_time(self.schedule, self.start, frame.time, last)
            if moment is None:
                continue
            last = moment
            place = self.schedule.output_position(number, self.start, moment)
            shown = SourcePosition(self.beginning.number + number, self.beginning.seconds + frame.time - self.start)
            yield SourceFrame(replace(frame, time=moment), FrameCache(frame.image, place, shown))

    def intervals(self, moments: Iterable[FrameGroup]) -> Iterator[_Interval]:
        """Yield the interval from each held picture to the next."""
        for held in moments:
            if self.last is not None:
                yield self.interval(self.last, held)
            self.last = held

    def makes(self, number: int) -> bool:
        """Return whether the pixels of an output frame are needed."""
        return number in self.outputs and number >= self.outputs.first + self.outputs.skip

    def counts(self, interval: _Interval) -> bool:
        """Return whether an interval belongs to this run, of all that write a part of the output."""
        return interval.first_output in self.outputs

    def interval(self, held: FrameGroup, following: FrameGroup) -> _Interval:
        """Return the interval from one held picture to the next; must be called in order."""
        frames = [*(shown.frame for shown in held), following[0].frame]
        first_output = self.outputs_before
        steps, numbers = list[list[Step]](), list[int]()
        for shown, (frame, after) in zip(held, pairwise(frames), strict=True):
            steps.append(list(self.schedule.steps(self.index, self.start, frame.time, after.time)))
            numbers += [self.output_number(step, shown) for step in steps[-1]]
            self.index += 1
        end = frames[-1].time
        pair = self.interpolator.pair(held[0].image, following[0].image, end - frames[0].time)
        places = self.place(held[0]), self.place(following[0])
        return _Interval(held, steps, numbers, first_output, end, pair, places)

    def output_number(self, step: Step, shown: SourceFrame) -> int:
        """Return the number of the output frame that a step belongs to; must be called in order."""
        if step.is_sample:  # of the exposure of the frame before or of the next one
            return self.outputs_before - (step.frame_number == self.exposed)
        number, self.exposed = self.outputs_before, step.frame_number
        self.outputs_before += 1
        if number in (self.outputs.first, self.outputs.stop):
            self.summary.boundaries[number] = SourceMoment(self.place(shown), shown.frame.time)
        return number

    def match(self, interval: _Interval, shown: list[tuple[SourceFrame, Step]], moves: list[bool]) -> LowestMatch:
        """Return how well the frames of an interval match, with the frame halfway of those that are made."""
        places = [index for index, is_made in enumerate(moves) if is_made]
        middle = min(places, key=lambda index: (abs(shown[index][1].t - Fraction(1, 2)), index))
        time = (shown[middle][1].time - self.start) * self.stretch
        return LowestMatch(interval.pair.detected_match_score, interval.numbers[middle], time)

    def place(self, shown: SourceFrame) -> int:
        """Return the place of a frame in the clip, from 0."""
        position = shown.image.source_position
        assert position is not None, "known of every frame of a clip"
        return position.number - self.beginning.number


def _output_frames(
    frames: Iterator[Frame],
    clip: _LoopState,
    detector: DuplicateDetector | None,
    holds_last_frame: bool,
    in_order: Callable[[Iterable[Callable[[], _OutputPart]]], Iterator[_OutputPart]],
) -> Generator[_Shown, None, Fraction]:
    """Yield the output frames without durations, or the samples of each; return when the clip ends."""
    shown, summary = clip.shown(frames), clip.summary
    moments = group_singly(shown) if detector is None else group_duplicates(shown, detector, clip.step)
    scenes = 0
    for made in in_order(_tasks(clip, moments)):
        summary.frames_made += made.new
        if made.begins:
            scenes += made.scene_cut
        if made.begins and clip.counts(made.interval):
            summary.duplicates += made.duplicates
            summary.scene_cuts += made.scene_cut
            summary.note_match(made.match)
        if made.ends:
            if made.interval.pair.search_radius is not None:
                summary.search_radii.add(made.interval.pair.search_radius)
            made.interval.pair.release_caches()
        for frame, step, is_later in zip(made.frames, made.steps, made.past_cut, strict=True):
            # the cuts so far include the one of this interval
            yield _Shown(frame, step, scenes - (made.scene_cut and not is_later))
    if clip.last is None or clip.number < 2:
        count = "one frame" if clip.number else "no frame"
        raise InputError(f"{clip.info.name} holds {count} that can be read, and two are needed to make one in between.")
    last = clip.last[-1].frame
    end = last.time + (last.duration or 1 / clip.info.rate)
    meant = clip.schedule.presentation_time(clip.start, end)
    end = meant if meant > last.time else end
    for step in clip.schedule.steps(clip.index, clip.start, last.time, end):
        if step.t == 0 or holds_last_frame:
            number = clip.output_number(step, clip.last[-1])
            clip.summary.frames_made += _is_new(step, last) and number in clip.outputs
            confidence = _certain(last, step, 0) if clip.needs.confidence else None
            yield _Shown(replace(last, time=step.time, confidence=confidence), step, scenes)
    return end


def _exposed(shown: Generator[_Shown, None, Fraction]) -> Generator[Frame, None, Fraction]:
    """Yield the mean of each output frame's samples that show its scene; frames without samples as they are."""
    exposures: dict[int, Exposure] = {}
    number: int | None = None
    held: _Shown | None = None
    while True:
        try:
            each = next(shown)
        except StopIteration as stop:
            end: Fraction = stop.value
            break
        if each.step.frame_number is None:
            yield each.frame
            continue
        if each.step.frame_number != number:
            if held is not None:
                yield _developed(held, exposures[held.scene])
            exposures, number, held = {}, each.step.frame_number, None
        exposures.setdefault(each.scene, Exposure()).add(each.frame.array)
        held = held if each.step.is_sample else each
    if held is not None:
        yield _developed(held, exposures[held.scene])
    return end


def _developed(shown: _Shown, exposure: Exposure) -> Frame:
    """Return an output frame with the mean of its samples; the frame itself if there are no others."""
    return shown.frame if exposure.count == 1 else _replaced(shown.frame, exposure.image())


def _replaced(frame: Frame, image: Image) -> Frame:
    """Return a frame with an image that was made for it."""
    return replace(frame, image=image, original=None, preceding=frame.original or frame.preceding)


def _tasks(clip: _LoopState, moments: Iterable[FrameGroup]) -> Iterator[Callable[[], _OutputPart]]:
    """Yield the tasks in order, one per part of an interval, so that many frames between two take no extra memory.

    Lags one pair behind the source, because the motion of a pair depends on the next one.
    """
    for before, interval, after in with_neighbours(clip.intervals(moments)):
        if clip.outputs.is_past(interval.first_output - 2):  # two frames tell when the last one and its exposure end
            return
        count = len(interval.numbers)
        neighbours = None if before is None else before.pair, None if after is None else after.pair
        for begin in range(0, max(count, 1), FRAMES_PER_TASK):
            part = range(begin, min(begin + FRAMES_PER_TASK, count))
            yield partial(_make, interval, neighbours, clip, part)


def _make(
    interval: _Interval, neighbours: tuple[Pair | None, Pair | None], clip: _LoopState, part: range
) -> _OutputPart:
    """Make the output frames of a part of an interval; those that are not needed carry any image."""
    needs = clip.needs
    shown, moves, first_move, is_held = interval.shown(neighbours)
    is_made = {index: moves[index] and clip.makes(interval.numbers[index]) for index in part}
    inner = [shown[index][1].t for index in part if is_made[index]]
    # an interval of which nothing is made is needed all the same to count its cut, unless another run counts it
    is_needed = bool(inner) or (first_move is not None and clip.counts(interval))
    made, scene_cut = (
        _between(clip.interpolator, interval.pair, inner, neighbours, needs) if is_needed else (iter(()), False)
    )
    frames = []
    for index in part:
        each, step = shown[index]
        if moves[index]:
            image, confidence = next(made) if is_made[index] else (each.frame.image, None)
            frames.append(Frame(image, step.time, preceding=each.frame.original, confidence=confidence))
        else:  # between frames that show the same, a repeated one is certain
            confidence = _certain(each.frame, step, 1) if needs.confidence else None
            frames.append(replace(each.frame, time=step.time, confidence=confidence))
    if (
        needs.motion
        and first_move is not None
        and first_move in part
        and not interval.pair.is_discontinuous(*neighbours)
    ):
        first = first_move - part.start
        field01, field10 = interval.pair.fields
        frames[first] = replace(frames[first], motion=PairMotion(*interval.places, field01.flow, field10.flow))
    written = [index for index in part if interval.numbers[index] in clip.outputs]
    new = sum(_is_new(shown[index][1], shown[index][0].frame) for index in written)
    steps = [shown[index][1] for index in part]
    past_cut = [scene_cut and moves[index] and shown[index][1].t > Fraction(1, 2) for index in part]
    duplicates = 0 if is_held else len(interval.held) - 1
    begins, ends = part.start == 0, part.stop == len(shown)
    is_measured = begins and first_move is not None and clip.counts(interval) and not scene_cut
    match = clip.match(interval, shown, moves) if is_measured else None
    return _OutputPart(interval, frames, steps, past_cut, new, scene_cut, duplicates, match, begins, ends)


def _show(interval: _Interval, neighbours: tuple[Pair | None, Pair | None]) -> _ShownInterval:
    """Return what is shown at each step of an interval."""
    is_held = len(interval.held) > 1 and interval.pair.is_discontinuous(*neighbours)
    if is_held:
        # no motion follows the held picture, so it stays held until the cut at the end of its last frame
        shown = [(each, step) for each, steps in zip(interval.held, interval.steps, strict=True) for step in steps]
        first_to_move = len(shown) - len(interval.steps[-1])
    else:
        shown, first_to_move = [(interval.held[0], step) for step in _merge_steps(interval)], 0
    moves = [index >= first_to_move and step.t > 0 for index, (_, step) in enumerate(shown)]
    return _ShownInterval(shown, moves, moves.index(True) if True in moves else None, is_held)


def _is_new(step: Step, frame: Frame) -> bool:
    """Return whether a step is an output frame that is not from the source."""
    return not step.is_sample and (step.frame_number is not None or step.time != frame.time)


def _between(
    interpolator: Interpolator,
    pair: Pair,
    times: Sequence[Fraction],
    neighbours: tuple[Pair | None, Pair | None],
    needs: Needs,
) -> tuple[Iterator[tuple[FrameImage, NDArray[Any] | None]], bool]:
    """Return the images between two frames, with their confidence if it is needed, and whether a scene ends there."""
    if needs.confidence:
        return interpolator.between_with_confidence(pair, times, *neighbours)
    images, scene_cut = interpolator.between(pair, times, *neighbours)
    return ((image, None) for image in images), scene_cut


def _certain(frame: Frame, step: Step, confidence: float) -> NDArray[Any] | None:
    """Return one confidence for all pixels of a frame that is repeated at another time; None at its own."""
    return None if step.time == frame.time else np.full(frame.image.shape[:2], confidence, np.float32)


def _merge_steps(interval: _Interval) -> list[Step]:
    """Merge the steps of all frames of a held picture, with t relative to the whole interval to the next picture."""
    if len(interval.held) == 1:
        return interval.steps[0]
    begin = interval.held[0].frame.time
    lasts = interval.end - begin
    return [step._replace(t=(step.time - begin) / lasts) for steps in interval.steps for step in steps]


def _with_durations(frames: Generator[Frame, None, Fraction]) -> Iterator[Frame]:
    """Set the duration of every frame to last until the next one, and of the last one until the clip ends."""
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
