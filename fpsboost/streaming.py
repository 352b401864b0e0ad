"""Conversion loop: groups source frames into pairs, interpolates them, and writes the output frames in order.

All steps stream over a few frames, so memory does not grow with length. Source frames that fall on an output time go to
the sink unchanged, with the decoder's own frame; but duplicate frames are replaced by interpolated ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.analysis.duplicates import DuplicateDetector, FrameGroup, SourceFrame, group_duplicates, group_singly
from fpsboost.errors import InputError, OptionError
from fpsboost.frame import ClipInfo, Frame, FrameImage, PairMotion
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.interpolator import Interpolator, Pair, with_neighbours
from fpsboost.io import Cancellable, FrameSink, FrameSource, TakesSideData
from fpsboost.io.prefetch import available_cores, nothing, read_ahead, run_in_parallel, write_behind
from fpsboost.io.trim import beginning
from fpsboost.observer import Observer, SilentObserver, Summary
from fpsboost.synthesis.exposure import Exposure
from fpsboost.timing.rate import stretched
from fpsboost.timing.schedule import Schedule, Step, rising_time

FRAMES_PER_TASK = 4
"""Maximum number of output frames that one task makes."""

READ_AHEAD = 4
WRITE_BEHIND = 4


def run_conversion(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    stretch: Fraction = Fraction(1),
    skip: int = 0,
    threads: int | None = None,
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
    skip : int
        Number of output frames, from the first, that the sink has already; see `fpsboost.io.Resumable`. They are
        counted and passed on in order, but instead of an interpolated image they carry one of the source.
    threads : int, optional
        Pairs of frames processed in parallel; as many as there are cores by default. Frames are the same with any
        number.

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
    summary = Summary(completed_frames=skip)
    observer = observer or SilentObserver()
    with (
        making_frames(
            source,
            interpolator,
            schedule,
            summary,
            stretch=stretch,
            skip=skip,
            threads=threads,
            holds_last_frame=sink.holds_last_frame,
            needs=_needs_of(sink),
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
    """What frames that are made are to have beside their pixels; see `fpsboost.io.TakesSideData`."""

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
    skip: int = 0,
    threads: int | None = None,
    needs: Needs | None = None,
) -> Generator[Iterator[Frame]]:
    """Read ahead and make frames while the block lasts.

    Parameters
    ----------
    source, interpolator, schedule, stretch, skip, threads
        See `run_conversion`.
    summary : Summary
        Updated with the numbers of frames read and made.
    holds_last_frame : bool
        See `fpsboost.io.FrameSink`.
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
        needed = needs or Needs()
        clip = _LoopState(source.info, schedule, interpolator, summary, beginning(source), needed, skip)
        made = _exposed(_output_frames(frames, clip, detector, holds_last_frame, in_order))
        yield stretched(_with_durations(made), stretch)


def _cancel_of(end: FrameSource | FrameSink) -> Callable[[], None]:
    """Return the function that stops a source or sink that waits for another program."""
    return end.cancel if isinstance(end, Cancellable) else nothing


def _needs_of(sink: FrameSink) -> Needs:
    """Return what a sink asks for beside frames."""
    return Needs(sink.needs_confidence, sink.needs_motion) if isinstance(sink, TakesSideData) else Needs()


class _Interval(NamedTuple):
    """Interval from a held picture, nearly always one frame, to the next: its frames, and each one's output steps."""

    held: FrameGroup
    steps: list[list[Step]]
    end: Fraction
    pair: Pair
    places: tuple[int, int]
    """Places of the pair's frames among those that are read, from 0."""


class _OutputPart(NamedTuple):
    """Output frames of a part of an interval, made by one task."""

    interval: _Interval
    frames: list[Frame]
    steps: list[Step]
    """The step of each frame."""
    past_cut: list[bool]
    """Whether each frame shows the scene after a cut."""
    new: int
    """Number of frames that are not from the source."""
    scene_cut: bool
    duplicates: int
    """Frames of the interval that are interpolated across."""
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
    skip: int = 0
    """Number of output frames still to come that the sink has already."""
    start: Fraction = Fraction(0)
    index: int = 0
    """Number of the next source frame to become part of an interval."""
    last: FrameGroup | None = None
    """Previous group of frames."""

    def shown(self, frames: Iterator[Frame]) -> Iterator[SourceFrame]:
        """Yield the source's frames with their positions, at the schedule's presentation times, and count them."""
        last: Fraction | None = None
        for frame in frames:
            if last is None:
                self.start = frame.time
            self.summary.frame_intervals.note(frame.time)
            number = self.summary.frames_in
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

    def skipped(self, steps: Iterable[Step]) -> int:
        """Return how many of the next steps are of frames that the sink has already; must be called in order."""
        count = 0
        for step in steps:
            if not self.skip:
                break
            self.skip -= not step.is_sample
            count += 1
        return count

    def interval(self, held: FrameGroup, following: FrameGroup) -> _Interval:
        """Return the interval from one held picture to the next; must be called in order."""
        frames = [*(shown.frame for shown in held), following[0].frame]
        steps = []
        for frame, after in pairwise(frames):
            steps.append(list(self.schedule.steps(self.index, self.start, frame.time, after.time)))
            self.index += 1
        end = frames[-1].time
        pair = self.interpolator.pair(held[0].image, following[0].image, end - frames[0].time)
        return _Interval(held, steps, end, pair, (self.place(held[0]), self.place(following[0])))

    def place(self, shown: SourceFrame) -> int:
        """Return the place of a frame among those that are read, from 0."""
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
    moments = group_singly(shown) if detector is None else group_duplicates(shown, detector)
    for made in in_order(_tasks(clip, moments)):
        summary.frames_made += made.new
        if made.begins:
            summary.duplicates += made.duplicates
            summary.scene_cuts += made.scene_cut
        for frame, step, is_later in zip(made.frames, made.steps, made.past_cut, strict=True):
            # the cuts so far include the one of this interval
            yield _Shown(frame, step, summary.scene_cuts - (made.scene_cut and not is_later))
        if made.ends:
            if made.interval.pair.search_radius is not None:
                summary.search_radii.add(made.interval.pair.search_radius)
            made.interval.pair.release_caches()
    if clip.last is None or clip.summary.frames_in < 2:
        count = "one frame" if clip.summary.frames_in else "no frame"
        raise InputError(f"{clip.info.name} holds {count} that can be read, and two are needed to make one in between.")
    last = clip.last[-1].frame
    end = last.time + (last.duration or 1 / clip.info.rate)
    meant = clip.schedule.presentation_time(clip.start, end)
    end = meant if meant > last.time else end
    for step in clip.schedule.steps(clip.index, clip.start, last.time, end):
        if step.t == 0 or holds_last_frame:
            clip.summary.frames_made += _is_new(step, last)
            confidence = _certain(last, step, 0) if clip.needs.confidence else None
            yield _Shown(replace(last, time=step.time, confidence=confidence), step, summary.scene_cuts)
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
    return shown.frame if exposure.count == 1 else replace(shown.frame, image=exposure.image(), original=None)


def _tasks(clip: _LoopState, moments: Iterable[FrameGroup]) -> Iterator[Callable[[], _OutputPart]]:
    """Yield the tasks in order, one per part of an interval, so that many frames between two take no extra memory.

    Lags one pair behind the source, because the motion of a pair depends on the next one.
    """
    for before, interval, after in with_neighbours(clip.intervals(moments)):
        count = sum(map(len, interval.steps))
        skipped = clip.skipped(chain.from_iterable(interval.steps))
        neighbours = before and before.pair, after and after.pair
        for begin in range(0, max(count, 1), FRAMES_PER_TASK):
            part = range(begin, min(begin + FRAMES_PER_TASK, count))
            yield partial(_make, interval, neighbours, clip.interpolator, part, skipped, clip.needs)


def _make(
    interval: _Interval,
    neighbours: tuple[Pair | None, Pair | None],
    interpolator: Interpolator,
    part: range,
    skipped: int,
    needs: Needs,
) -> _OutputPart:
    """Make the output frames of a part of an interval; the first `skipped` of the interval may carry any image."""
    is_held = len(interval.held) > 1 and interval.pair.is_discontinuous(*neighbours)
    if is_held:
        # no motion follows the held picture, so it stays held until the cut at the end of its last frame
        shown = [(each, step) for each, steps in zip(interval.held, interval.steps, strict=True) for step in steps]
        first_to_move = len(shown) - len(interval.steps[-1])
    else:
        shown, first_to_move = [(interval.held[0], step) for step in _merge_steps(interval)], 0
    moves = [index >= first_to_move and step.t > 0 for index, (_, step) in enumerate(shown)]
    inner = [shown[index][1].t for index in part if moves[index] and index >= skipped]
    made, scene_cut = (
        _between(interpolator, interval.pair, inner, neighbours, needs) if any(moves) else (iter(()), False)
    )
    frames = []
    for index in part:
        each, step = shown[index]
        if moves[index]:
            image, confidence = (each.frame.image, None) if index < skipped else next(made)
            frames.append(Frame(image, step.time, confidence=confidence))
        else:  # between frames that show the same, a repeated one is certain
            confidence = _certain(each.frame, step, 1) if needs.confidence else None
            frames.append(replace(each.frame, time=step.time, confidence=confidence))
    if needs.motion and True in moves and moves.index(True) in part and not interval.pair.is_discontinuous(*neighbours):
        first = moves.index(True) - part.start
        field01, field10 = interval.pair.fields
        frames[first] = replace(frames[first], motion=PairMotion(*interval.places, field01.flow, field10.flow))
    new = sum(_is_new(shown[index][1], shown[index][0].frame) for index in part)
    steps = [shown[index][1] for index in part]
    past_cut = [scene_cut and moves[index] and shown[index][1].t > Fraction(1, 2) for index in part]
    duplicates = 0 if is_held else len(interval.held) - 1
    return _OutputPart(
        interval, frames, steps, past_cut, new, scene_cut, duplicates, part.start == 0, part.stop == len(shown)
    )


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
