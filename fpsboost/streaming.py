"""Conversion loop: groups source frames into pairs, interpolates them, and writes the output frames in order.

All steps stream over a few frames, so memory does not grow with length. Source frames that fall on an output time go to
the sink unchanged, with the decoder's own frame; but duplicate frames are replaced by interpolated ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import chain, groupby, islice, pairwise
from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.analysis.duplicates import SourceFrame, group_duplicates
from fpsboost.contracts import (
    Cancellable,
    Entry,
    FrameSink,
    FrameSource,
    HasDetails,
    HasPositions,
    LowestMatch,
    NeedsConfidence,
    NeedsMotion,
    Observer,
    OutputRange,
    SilentObserver,
    SourceMoment,
    Summary,
)
from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame, PairMotion
from fpsboost.frame_cache import SourcePosition
from fpsboost.interpolator import FrameMask, Interpolator
from fpsboost.options import Range, checked
from fpsboost.pair import Pair, triplewise
from fpsboost.repair import group_replaced
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.exposure import Exposure
from fpsboost.threads import available_cores, nothing, read_ahead, run_in_parallel, write_behind
from fpsboost.timing.position import format_time
from fpsboost.timing.rate import stretched
from fpsboost.timing.schedule import ExposureSchedule, RetimeSchedule, Schedule, Step, rising_time

LONG = 2
"""Least number of frame intervals between two frames across which a cut is named in a remark."""
MOST_NOTED = 10
"""Number of remarks from which no more are added."""
FRAMES_PER_TASK = 4  # maximum number of output frames that one task makes


@checked
def run_conversion(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    stretch: Fraction = Fraction(1),
    threads: Annotated[int, Range(1)] | None = None,
    outputs: OutputRange | None = None,
) -> Summary:
    """Run the loop over objects: read, interpolate, write. The caller opens and closes source and sink.

    Parameters
    ----------
    source : FrameSource
    interpolator : Interpolator
    sink : FrameSink
        Must have been entered. A sink with an attribute ``needs_confidence`` or ``needs_motion`` that is True gets
        frames with these; see `fpsboost.Frame`.
    schedule : Schedule
        Determines the output times. Of an `ExposureSchedule`, every output frame is the mean of several that are
        interpolated around its time, in one scene; images must be arrays.
    observer : Observer, optional
        Informed of the progress.
    stretch : Fraction
        Duration of the output as a multiple of the source's; not included in the schedule.
    threads : int, optional
        Pairs of frames processed in parallel; as many as there are cores by default. Frames are the same with any
        number.
    outputs : OutputRange, optional
        Output frames that the sink gets; all by default.

    Raises
    ------
    OptionError
        `threads` is below 1.
    InputError
        The source has fewer than two frames, or more than 8 in a row are to be replaced. Errors of source and sink are
        passed on.
    """
    outputs = outputs or OutputRange()
    summary = Summary(completed_frames=outputs.skip)
    observer = observer or SilentObserver()
    with (
        interpolate_frames(
            source,
            interpolator,
            schedule,
            summary,
            sink=sink,
            stretch=stretch,
            threads=threads,
            outputs=outputs,
        ) as frames,
        write_behind(sink.write, 2, _cancel_of(sink)) as write,
    ):
        observer.ready()
        begin = time.perf_counter()
        for frame in frames:
            write(frame)
            summary.frames_out += 1
            summary.seconds = time.perf_counter() - begin
            observer.wrote(summary)
    summary.remarks += [*source.remarks, *sink.remarks]
    summary.details = sink.details if isinstance(sink, HasDetails) else ""
    return summary


@contextmanager
def interpolate_frames(
    source: FrameSource,
    interpolator: Interpolator,
    schedule: Schedule,
    summary: Summary,
    *,
    sink: FrameSink | None = None,
    stretch: Fraction = Fraction(1),
    threads: int | None = None,
    outputs: OutputRange | None = None,
) -> Generator[Iterator[Frame]]:
    """Yield the output frames in order, made while the block lasts; see `run_conversion`.

    The first frame is read when the block begins. The summary is updated with the numbers of frames read and made.
    Without a sink, the last frame is held, and frames have neither confidence nor motion.
    """
    outputs = outputs or OutputRange()
    with (
        read_ahead(source, 1, _cancel_of(source)) as arriving,
        run_in_parallel(threads or available_cores(), _cancel_of(source)) as in_order,
    ):
        first = list(islice(arriving, 1))
        frames = chain(first, arriving)
        clip = _LoopState(
            *(source.info, schedule, interpolator, summary, positions_of(source)),
            needs_confidence=isinstance(sink, NeedsConfidence) and sink.needs_confidence,
            needs_motion=isinstance(sink, NeedsMotion) and sink.needs_motion,
            outputs=outputs,
            stretch=stretch,
        )
        before = clip.outputs_before
        start = None if outputs.entry is None else outputs.entry.start
        stop = None if outputs.stop is None else outputs.stop - before
        made = _output_frames(frames, clip, sink is None or sink.holds_last_frame, in_order)
        exposed = _exposed(made, interpolator.mask) if clip.has_exposures else map(_Output.finished, made)
        timed = _completed(exposed, clip)
        if clip.curve is not None:  # the times of frames are those of the source so far
            numbered = enumerate(timed, before)
            rate = schedule.rate(source.info.rate)
            timed = (replace(frame, time=clip.start + number / rate, duration=1 / rate) for number, frame in numbered)
        if outputs.first > before or stop is not None:
            timed = islice(timed, outputs.first - before, stop)
        yield timed if stretch == 1 else stretched(timed, stretch, start)


def positions_of(source: FrameSource) -> Callable[[int, Fraction], SourcePosition]:
    """Return the function that tells the position of a source's frame in its clip; see `HasPositions`."""
    return source.position_of if isinstance(source, HasPositions) else SourcePosition


def _cancel_of(end: FrameSource | FrameSink) -> Callable[[], None]:
    """Return the function that stops a source or sink that waits for another program."""
    return end.cancel if isinstance(end, Cancellable) else nothing


class _Output(NamedTuple):
    """Frame of the output, or a sample of its exposure."""

    source: SourceFrame
    """The frame of the source that is repeated, or left for the next picture."""
    step: Step
    """Its time, with t relative to the next picture if it is interpolated."""
    number: int
    is_interpolated: bool = False
    frame: Frame | None = None
    """The frame, without its duration, when it is finished."""
    scene: int = 0
    nearest: SourceFrame | None = None
    """The frame of the source that is nearest in time, of which a mask keeps areas."""

    @property
    def is_new(self) -> bool:
        """Whether it is an output frame that is not from the source."""
        step = self.step
        return not step.is_sample and (step.frame_number is not None or step.time != self.source.frame.time)

    def finished(self) -> Frame:
        """Return the frame, which must be finished."""
        assert self.frame is not None, "finished"
        return self.frame

    def repeated(self, confidence: float | None) -> _Output:
        """Return it with the frame of the source, and this confidence unless it is shown at its own time."""
        frame = self.source.frame
        time = self.step.time
        is_unknown = confidence is None or time == frame.time
        values = None if is_unknown else np.full(frame.image.shape[:2], confidence, np.float32)
        return self._replace(frame=replace(frame, time=time, confidence=values))


@dataclass
class _Interval:
    """Interval from a picture, nearly always of one frame, to the next."""

    group: tuple[SourceFrame, ...]
    """Frames of the source that show the picture, or a good frame and those after it that are replaced."""
    outputs: list[_Output]
    """Frames of the output that fall into it; until it is resolved, with t relative to the next frame of the source."""
    first_output: int
    """Number of the first of them, or of the next one if there is none."""
    following: SourceFrame
    """The next picture."""
    pair: Pair
    is_still: bool | None = None
    """Whether duplicates are repeated because no motion follows them; None until it is resolved."""
    scene_cut: bool = False
    match: LowestMatch | None = None
    """How well the two frames match, with the output frame halfway between; None if nothing is interpolated."""
    done: int = 0
    """Number of outputs that have been made and passed on."""

    def resolve(self, pair: Pair, *, may_be_still: bool) -> None:
        """Find out which frames are interpolated and between what; the same whichever task does it.

        `pair` is that of the interval, with its neighbours. The group may be a still unless its frames are damaged ones
        that are replaced.
        """
        if self.is_still is not None:
            return
        first = self.group[0]
        last = self.group[-1]
        outputs = self.outputs
        is_still = may_be_still and len(self.group) > 1 and pair.is_discontinuous
        if len(self.group) > 1 and not is_still:
            begin = first.frame.time
            end = self.following.frame.time
            steps = (each.step._replace(t=(each.step.time - begin) / (end - begin)) for each in outputs)
            outputs = [each._replace(source=first, step=step) for each, step in zip(outputs, steps, strict=True)]
        # a still is shown until the cut at the end of its last frame
        moving = last if is_still else first
        self.outputs = [each._replace(is_interpolated=each.source is moving and each.step.t > 0) for each in outputs]
        self.is_still = is_still


@dataclass
class _LoopState:
    """Constants and current state of the loop."""

    info: ClipInfo
    schedule: Schedule
    interpolator: Interpolator
    summary: Summary
    position_of: Callable[[int, Fraction], SourcePosition]
    needs_confidence: bool
    needs_motion: bool
    outputs: OutputRange
    stretch: Fraction
    exposed: int | None = None
    """`Step.frame_number` of the last output frame so far."""
    last: tuple[SourceFrame, ...] | None = None
    """Previous group of frames."""
    end: Fraction = Fraction(0)
    """Time at which the clip ends, when all frames are read."""
    captions: list[tuple[Fraction, bytes]] = field(default_factory=list)
    """Closed captions of the frames read, with their times, that no output frame has yet."""

    def __post_init__(self) -> None:
        schedule = self.schedule
        self.curve = schedule.curve if isinstance(schedule, RetimeSchedule) else None
        is_blurred = isinstance(schedule, RetimeSchedule) and schedule.shutter is not None
        self.has_exposures = is_blurred or isinstance(schedule, ExposureSchedule)
        entry = self.outputs.entry or Entry(number=0, start=Fraction(0), outputs_before=0)
        # the number of output frames so far, and those of the source frames to be read, and to become part of an
        # interval, next
        self.outputs_before, self.number, self.index = entry.outputs_before, entry.number, entry.number
        self.start = entry.start
        self.step = entry.step

    def presented(self, frames: Iterator[Frame]) -> Iterator[SourceFrame]:
        """Yield the source's frames with their positions, at the schedule's presentation times, and count them."""
        last: Fraction | None = None
        for frame in frames:
            if self.number == 0:
                self.start = frame.time
            number = self.number
            self.number += 1
            if self.outputs.end is None or self.start <= frame.time < self.outputs.end:  # of a loop, one round counts
                self.summary.frame_intervals.note(frame.time, self.start)
                self.summary.frames_in += 1
            time = rising_time(self.schedule, self.start, frame.time, last)
            self.captions.append((time or frame.time, frame.captions))
            if time is None:
                continue
            last = time
            position = self.position_of(number, frame.time - self.start)
            output_position = self.schedule.output_position(number, self.start, time)
            yield SourceFrame(replace(frame, time=time), output_position, position)

    def groups(self, frames: Iterator[SourceFrame]) -> Iterable[tuple[SourceFrame, ...]]:
        """Return the frames in groups of which one picture is left: of damaged frames, or else of duplicates."""
        detector = None if self.interpolator.needs_every_frame else self.interpolator.duplicates
        replacement = self.interpolator.replacement
        if replacement is not None:
            return group_replaced(frames, replacement, self.summary.remarks, begins_clip=self.outputs.entry is None)
        return zip(frames) if detector is None else group_duplicates(frames, detector, self.step)

    def count_outputs(self, interval: _Interval, outputs: Sequence[_Output]) -> None:
        """Count the output frames of a part of an interval, when they are made."""
        self.summary.frames_made += sum(each.is_new for each in outputs if each.number in self.outputs)
        if interval.pair.unsure_share > 0:
            made = sum(map(self.makes, outputs))
            self.summary.unsure_frames += made
            self.summary.unsure_pixels += made * interval.pair.unsure_share

    def count_interval(self, interval: _Interval) -> None:
        """Count the frames of an interval's group that are interpolated, and its cut, unless another run does."""
        if not self.counts(interval):
            return
        if self.interpolator.replacement is not None:
            self.summary.replaced += [each.position.number for each in interval.group[1:]]
        elif not interval.is_still:
            self.summary.duplicates += len(interval.group) - 1
        self.summary.scene_cuts += interval.scene_cut
        apart = interval.pair.apart
        end = interval.following.position.seconds
        if interval.scene_cut and apart * self.info.rate >= LONG and len(self.summary.remarks) < MOST_NOTED:
            self.summary.remarks.append(
                f"A scene seems to end between {format_time(end - apart)} and {format_time(end)}, so that no motion is "
                "followed there; if it goes on, use `no_cuts`."
            )
        self.summary.note_match(interval.match)

    def intervals(self, groups: Iterable[tuple[SourceFrame, ...]]) -> Iterator[_Interval]:
        """Yield the interval from each picture to the next."""
        for group in groups:
            if self.last is not None:
                yield self.interval(self.last, group)
            self.last = group

    def makes(self, output: _Output) -> bool:
        """Return whether the pixels of an output frame must be interpolated."""
        first_missing = self.outputs.first + self.outputs.skip
        return output.is_interpolated and output.number in self.outputs and output.number >= first_missing

    def counts(self, interval: _Interval) -> bool:
        """Return whether an interval belongs to this run, of all that write a part of the output."""
        return interval.first_output in self.outputs

    def interval(self, group: tuple[SourceFrame, ...], following: tuple[SourceFrame, ...]) -> _Interval:
        """Return the interval from one picture to the next; must be called in order."""
        first_output = self.outputs_before
        outputs = list[_Output]()
        shown = *(group if self.interpolator.replacement is None else group[:1]), following[0]  # not what is damaged
        for source, after in pairwise([*group, following[0]]):
            for step in self.schedule.steps(self.index, self.start, source.frame.time, after.frame.time):
                nearest = min(shown, key=lambda each, time=step.time: abs(each.frame.time - time))  # type: ignore[misc]
                outputs.append(_Output(source, step, self.output_number(step, source), nearest=nearest))
            self.index += 1
        duration, apart = (following[0].frame.time - each.frame.time for each in (group[0], shown[-2]))
        is_gap = following[0].frame.ends_gap
        pair = self.interpolator.pair(group[0], following[0], duration, apart=apart, is_gap=is_gap)
        return _Interval(group, outputs, first_output, following[0], pair)

    def output_number(self, step: Step, source: SourceFrame) -> int:
        """Return the number of the output frame that a step belongs to; must be called in order."""
        if step.is_sample:  # of the exposure of the frame before or of the next one
            return self.outputs_before - (step.frame_number == self.exposed)
        number = self.outputs_before
        self.exposed = step.frame_number
        self.outputs_before += 1
        if number in (self.outputs.first, self.outputs.stop):
            self.summary.boundaries[number] = SourceMoment(self.place(source), source.frame.time)
        return number

    def measure_match(self, interval: _Interval) -> LowestMatch | None:
        """Return how well the frames of an interval match, with the interpolated frame halfway; None without one."""
        interpolated = [each for each in interval.outputs if each.is_interpolated]
        if not interpolated:
            return None
        middle = min(interpolated, key=lambda output: abs(output.step.t - Fraction(1, 2)))
        shown = (middle.step.time - self.start) * self.stretch
        time = shown if self.curve is None else middle.number / self.schedule.rate(self.info.rate)
        return LowestMatch(interval.pair.detected_match_score, middle.number, time)

    def motion(self, interval: _Interval, pair: Pair, output: _Output) -> PairMotion | None:
        """Return the motion of an interval if an output frame is the first interpolated one, else None.

        It is also None if no motion connects the two frames.
        """
        first = next(each for each in interval.outputs if each.is_interpolated)
        if output.step != first.step or pair.is_discontinuous:
            return None
        places = self.place(interval.group[0]), self.place(interval.following)
        return PairMotion(*places, *(field.flow for field in pair.fields))

    def place(self, source: SourceFrame) -> int:
        """Return the place of a frame in the clip, from 0."""
        return source.position.number - self.position_of(0, Fraction(0)).number


Made = tuple[_Interval, list[_Output]]
"""Interval, and those of its outputs that one task has made."""


def _output_frames(
    frames: Iterator[Frame],
    clip: _LoopState,
    holds_last_frame: bool,
    in_order: Callable[[Iterable[Callable[[], Made]]], Iterator[Made]],
) -> Iterator[_Output]:
    """Yield the output frames without durations, or the samples of each; note when the clip ends."""
    scenes = 0
    summary = clip.summary
    for interval, outputs in in_order(_tasks(clip, clip.groups(clip.presented(frames)))):
        clip.count_outputs(interval, outputs)
        if interval.done == 0:
            scenes += interval.scene_cut
            clip.count_interval(interval)
        interval.done += len(outputs)
        if interval.done == len(interval.outputs):
            if interval.pair.search_radius is not None:
                summary.search_radii.add(interval.pair.search_radius)
            interval.pair.release_caches()
        for output in outputs:
            is_past_cut = output.is_interpolated and output.step.t > Fraction(1, 2)
            # the cuts so far include the one of this interval
            yield output._replace(scene=scenes - (interval.scene_cut and not is_past_cut))
    if clip.last is None or clip.number < 2:
        count = "one frame" if clip.number else "no frame"
        raise InputError(f"{clip.info.name} holds {count} that can be read, and two are needed to make one in between.")
    last = clip.last[-1]
    end = last.frame.time + (last.frame.duration or 1 / clip.info.rate)
    nominal = clip.schedule.presentation_time(clip.start, end)
    clip.end = nominal if nominal > last.frame.time else end
    if clip.curve is not None and not clip.curve.is_open:
        if clip.start + clip.curve.top > clip.end:
            summary.remarks.append(f"{clip.info.name} ended before the retime curve, which held its last frame.")
        clip.end = max(clip.end, clip.start + clip.curve.top + 1)
        holds_last_frame = True
    for step in clip.schedule.steps(clip.index, clip.start, last.frame.time, clip.end):
        if step.t == 0 or holds_last_frame:
            output = _Output(last, step, clip.output_number(step, last), scene=scenes, nearest=last)
            summary.frames_made += output.is_new and output.number in clip.outputs
            yield output.repeated(0 if clip.needs_confidence else None)


def _exposed(outputs: Iterator[_Output], mask: FrameMask | None) -> Iterator[Frame]:
    """Yield the mean of each output frame's samples that show its scene; frames without samples as they are.

    What a mask keeps is that of one frame.
    """
    for _, samples in groupby(outputs, lambda output: output.step.frame_number):
        exposures: dict[int, Exposure] = {}
        frame = None
        scene = 0
        nearest = None
        for output in samples:
            exposures.setdefault(output.scene, Exposure()).add(output.finished().array)
            if not output.step.is_sample:
                frame = output.frame
                scene = output.scene
                nearest = output.nearest
        if frame is not None and exposures[scene].count > 1:
            image = exposures[scene].image()
            preceding = frame.original or frame.preceding
            frame = replace(frame, image=image, original=None, preceding=preceding)
        if frame is not None:
            yield _masked(frame, nearest, mask)


def _masked(frame: Frame, nearest: SourceFrame | None, mask: FrameMask | None) -> Frame:
    """Return a frame with the areas that a mask keeps of the nearest one of the source."""
    return frame if mask is None or mask.parts or nearest is None else mask.keep(frame, nearest)


def _tasks(clip: _LoopState, groups: Iterable[tuple[SourceFrame, ...]]) -> Iterator[Callable[[], Made]]:
    """Yield the tasks in order, one per part of an interval, so that many frames between two take no extra memory."""
    for before, interval, after in triplewise(clip.intervals(groups)):
        if clip.outputs.is_past(interval.first_output - 2):  # two frames tell when the last one and its exposure end
            return
        if clip.curve is not None and before is not None and before.group[0].frame.time - clip.start > clip.curve.top:
            return
        pair = interval.pair.between(None if before is None else before.pair, None if after is None else after.pair)
        for begin in range(0, max(len(interval.outputs), 1), FRAMES_PER_TASK):
            yield partial(_make, clip, interval, pair, begin)


def _make(clip: _LoopState, interval: _Interval, pair: Pair, begin: int) -> Made:
    """Make the output frames of a part of an interval; those that are not needed carry any image."""
    interval.resolve(pair, may_be_still=clip.interpolator.replacement is None)
    outputs = interval.outputs[begin : begin + FRAMES_PER_TASK]
    mask = None if clip.has_exposures else clip.interpolator.mask
    times = [each.step.t for each in outputs if clip.makes(each)]
    images: Iterator[InterpolatedImage] = iter(())
    # an interval of which nothing is made is needed all the same to count its cut, unless another run counts it
    if times or (clip.counts(interval) and any(each.is_interpolated for each in interval.outputs)):
        images = clip.interpolator.images(pair, times, with_confidence=clip.needs_confidence)
        interval.scene_cut = pair.is_cut
    finished = list[_Output]()
    for output in outputs:
        if not output.is_interpolated:  # between frames that show the same, a repeated one is certain
            finished.append(output.repeated(1 if clip.needs_confidence else None))
            continue
        source = output.source.frame
        image, confidence = next(images) if clip.makes(output) else (source.image, None)
        motion = clip.motion(interval, pair, output) if clip.needs_motion else None
        frame = Frame(image, output.step.time, preceding=source.original, confidence=confidence, motion=motion)
        finished.append(output._replace(frame=_masked(frame, output.nearest, mask) if clip.makes(output) else frame))
    if begin == 0 and clip.counts(interval) and not interval.scene_cut:
        interval.match = clip.measure_match(interval)
    return interval, finished


def _completed(frames: Iterator[Frame], clip: _LoopState) -> Iterator[Frame]:
    """Set the duration of every frame to last until the next one, and of the last one until the clip ends.

    Each gets the closed captions since the frame before, and the last one also those behind it.
    """
    for frame, following in pairwise(chain(frames, [None])):
        assert frame is not None, "only the last one is"
        end = clip.end if following is None else min(following.time, clip.outputs.end or following.time)
        latest = clip.end if following is None else frame.time
        captions = [each for time, each in clip.captions if time <= latest]
        del clip.captions[: len(captions)]
        yield replace(frame, duration=end - frame.time, captions=b"".join(captions))
