"""Timeline of a conversion: source frames at their presentation times, and the output frames in the intervals between.

Nothing is interpolated here: this is the plan of the loop in `fpsboost.streaming`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, group_duplicates
from fpsboost.analysis.guide_order import CLEAR, relative_misfit
from fpsboost.contracts import Entry, FrameSource, HasPositions, OutputRange, SourceMoment, Summary
from fpsboost.errors import InputError
from fpsboost.frame import Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.interpolator import Interpolator
from fpsboost.layered import FrameImage
from fpsboost.pair import Pair, triplewise
from fpsboost.repair import group_replaced
from fpsboost.timing.position import Replacement
from fpsboost.timing.schedule import RetimeSchedule, Schedule, Step, rising_time


def positions_of(source: FrameSource) -> Callable[[int, Fraction], SourcePosition]:
    """Return the function that tells the position of a source's frame in its clip; see `HasPositions`."""
    return source.position_of if isinstance(source, HasPositions) else SourcePosition


class FramePlace(NamedTuple):
    """Where a frame is among the output frames and in time, by which its guide is found."""

    number: Fraction
    """Position among the output frames, counted from 0."""
    seconds: Fraction
    """Time on the source's clock, seconds after the clip's first frame."""
    interval: Fraction
    """Time from an output frame to the next there, on that clock."""
    source: SourceFrame | None
    """The source's own frame of that time, if there is one."""


Guides = Callable[[FramePlace], FrameImage | None]
"""Function that gives the guide of a frame that is made, or of one around it, if there is one; see
`fpsboost.synthesis.guided`. It is called for frames in order."""


class ScheduledFrame(NamedTuple):
    """Frame of the output, or a sample of its exposure, before it is made."""

    number: int
    """Number of the output frame, counted from 0."""
    step: Step
    """Its time on the source's clock; where its t is 0, the frame of the source is repeated."""
    shown: Fraction
    """When it is shown, seconds after the first output frame."""
    source: SourceFrame
    """The frame of the source at or before it."""
    nearest: SourceFrame
    """The frame of the source that is nearest in time, of which a mask keeps areas."""
    is_missing: bool
    """Whether this run writes it, and no earlier run has."""
    guide: FrameImage | None = None
    """Picture of it that its synthesis follows."""

    @property
    def is_new(self) -> bool:
        """Whether it is an output frame that is not from the source."""
        step = self.step
        return not step.is_sample and (step.frame_number is not None or step.time != self.source.time)

    @property
    def is_interpolated(self) -> bool:
        """Whether it lies between two pictures, and is none of them."""
        return self.step.t > 0

    @property
    def is_made(self) -> bool:
        """Whether this run interpolates it."""
        return self.is_interpolated and self.is_missing

    def at(self, t: Fraction) -> ScheduledFrame:
        """Return it with another position between the pictures."""
        return self._replace(step=self.step._replace(t=t))


@dataclass(frozen=True)
class Interval:
    """Interval from a picture, nearly always of one frame, to the next."""

    group: tuple[SourceFrame, ...]
    """Frames of the source that show the picture, or a good frame and those after it that are replaced."""
    following: SourceFrame
    """The next picture."""
    pair: Pair
    """The two pictures."""
    first_output: int
    """Number of the first output frame that falls into it, or of the next one if there is none."""
    scheduled: list[ScheduledFrame]
    """Output frames that fall into it, with t relative to the next frame of the source."""
    is_repair: bool
    """Whether frames of the group are replaced because they are damaged."""
    is_counted: bool
    """Whether it belongs to this run, of all that write a part of the output."""

    def between(self, before: Interval | None, after: Interval | None) -> Interval:
        """Return the same interval, whose pair knows those of the intervals before and after."""
        pair = self.pair.between(None if before is None else before.pair, None if after is None else after.pair)
        return replace(self, pair=pair)

    @cached_property
    def is_still(self) -> bool:
        """Whether duplicates are repeated because no motion follows them."""
        return len(self.group) > 1 and not self.is_repair and self.pair.is_discontinuous

    @cached_property
    def outputs(self) -> list[ScheduledFrame]:
        """Output frames that fall into it, with t relative to the next picture."""
        first = self.group[0]
        last = self.group[-1]
        if first is last:
            return self.scheduled
        if self.is_still:  # it is shown until the cut at the end of its last frame
            return [each if each.source is last else each.at(Fraction(0)) for each in self.scheduled]
        begin = first.time
        duration = self.following.time - begin
        return [each._replace(source=first).at((each.step.time - begin) / duration) for each in self.scheduled]

    @cached_property
    def interpolated(self) -> list[ScheduledFrame]:
        """Output frames that lie between the two pictures."""
        return [each for each in self.outputs if each.is_interpolated]

    @cached_property
    def scene_cut(self) -> bool:
        """Whether a scene ends in it; False if nothing is interpolated, or if this run needs nothing of it."""
        is_needed = self.is_counted or any(each.is_missing for each in self.interpolated)
        return bool(self.interpolated) and is_needed and self.pair.is_cut


@dataclass(frozen=True)
class TimelineOptions:
    """How the frames of a source are shown, apart from the schedule of the output.

    Parameters
    ----------
    stretch : Fraction
        Duration of the output as a multiple of the source's; not included in the schedule.
    duplicates : DuplicateDetector or None
        Finds frames that show the same as the one before, as in animation on threes, pulldown and captures that missed
        some; they are replaced by frames made for their times. None keeps them. Stills, and frames held until a cut,
        are always kept, as are all frames where motion comes from a renderer's vectors.
    replacement : Replacement or None
        Frames that are replaced because they are damaged; duplicates are then kept.
    guides : callable or None
        Guides of the frames that are made; see `Guides`.
    """

    stretch: Fraction = Fraction(1)
    duplicates: DuplicateDetector | None = DuplicateDetector()
    replacement: Replacement | None = None
    guides: Guides | None = None


@dataclass
class Timeline:
    """Frames of a source at the times at which they are presented, and the intervals that they form."""

    source: FrameSource
    schedule: Schedule
    interpolator: Interpolator
    summary: Summary
    outputs: OutputRange
    options: TimelineOptions
    exposed: int | None = None
    """`Step.frame_number` of the last output frame so far."""
    last: tuple[SourceFrame, ...] | None = None
    """Previous group of frames."""
    end: Fraction = Fraction(0)
    """Time at which the clip ends, when all frames are read."""
    misfit: float = 1.0
    """How much less the frames of the previous pair fit the guides beside their own; see `relative_misfit`."""
    captions: list[tuple[Fraction, bytes]] = field(default_factory=list)
    """Closed captions of the frames read, with their times, that no output frame has yet."""

    def __post_init__(self) -> None:
        self.info = self.source.info
        self.position_of = positions_of(self.source)
        self.curve = self.schedule.curve if isinstance(self.schedule, RetimeSchedule) else None
        entry = self.outputs.entry or Entry(number=0, start=Fraction(0), outputs_before=0)
        # the number of output frames so far, and those of the source frames to be read, and to become part of an
        # interval, next
        self.outputs_before = entry.outputs_before
        self.number = entry.number
        self.index = entry.number
        self.start = entry.start
        self.step = entry.step

    def intervals(self, frames: Iterator[Frame]) -> Iterator[Interval]:
        """Yield the interval from each picture to the next, between those beside it, while frames are needed.

        The frames of the source are read, counted and grouped meanwhile, one interval ahead.
        """
        for before, interval, after in triplewise(self._apart(self._groups(self._presented(frames)))):
            if self.outputs.is_past(interval.first_output - 2):  # two tell when the last one and its exposure end
                return
            if self.curve is not None and before is not None and before.group[0].time - self.start > self.curve.top:
                return
            yield interval.between(before, after)

    def _presented(self, frames: Iterator[Frame]) -> Iterator[SourceFrame]:
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
            yield SourceFrame(frame, time, self.schedule.output_position(number, self.start, time), position)

    def _groups(self, frames: Iterator[SourceFrame]) -> Iterable[tuple[SourceFrame, ...]]:
        """Return the frames in groups of which one picture is left: of damaged frames, or else of duplicates."""
        detector = self.options.duplicates
        replacement = self.options.replacement
        if replacement is not None:
            return group_replaced(frames, replacement, self.summary.remarks, begins_clip=self.outputs.entry is None)
        if detector is None or self.interpolator.needs_every_frame:
            return zip(frames)
        return group_duplicates(frames, detector, self.step)

    def _apart(self, groups: Iterable[tuple[SourceFrame, ...]]) -> Iterator[Interval]:
        """Yield the intervals by themselves, without those beside them."""
        for group in groups:
            if self.last is None:
                self._give_guide(group[0])
            else:
                yield self._interval(self.last, group[0])
            self.last = group

    def _interval(self, group: tuple[SourceFrame, ...], following: SourceFrame) -> Interval:
        """Return the interval from one picture to the next; must be called in order."""
        is_repair = self.options.replacement is not None
        shown = *(group[:1] if is_repair else group), following  # not what is damaged
        first_output = self.outputs_before
        scheduled = list[ScheduledFrame]()
        for source, after in pairwise([*group, following]):
            for step in self.schedule.steps(self.index, self.start, source.time, after.time):
                nearest = min(shown, key=lambda each, time=step.time: abs(each.time - time))  # type: ignore[misc]
                scheduled.append(self._scheduled(step, source, nearest))
            self.index += 1
        duration = following.time - group[0].time
        apart = following.time - shown[-2].time
        is_gap = following.frame.ends_gap
        pair = self.interpolator.pair(group[0], following, duration, apart=apart, is_gap=is_gap)
        is_counted = first_output in self.outputs
        self._give_guide(following)
        guides = [each.guide for each in scheduled if each.is_made]
        if guides and self.misfit < 1 / CLEAR:  # no guide has fitted its own frame yet
            before = self.misfit
            self.misfit = min(relative_misfit(group[0], guides[0]), relative_misfit(following, guides[-1]))
            if max(before, self.misfit) < CLEAR:
                raise InputError(
                    "`guide` shows the frames beside; correct the numbers of its files, or `guide_offset`."
                )
        return Interval(group, following, pair, first_output, scheduled, is_repair, is_counted)

    def _give_guide(self, source: SourceFrame) -> None:
        """Give a frame of the source its own guide; must be called in order."""
        position = source.output_position or Fraction(0)
        # with a curve, it lies before the output frame of that position
        source.guide = self._guide(position if self.curve is None else position - Fraction(1, 2), source.time, source)

    def _guide(self, number: Fraction, time: Fraction, source: SourceFrame) -> FrameImage | None:
        """Return the guide of a frame at a time, and at or behind a frame of the source; must be called in order."""
        guides = self.options.guides
        if guides is None:
            return None
        interval = 1 / self.schedule.rate(self.info.rate)
        if self.curve is not None:
            interval = self.curve.source((number + 1) * interval) - self.curve.source(number * interval)
        seconds = self.position_of(0, Fraction(0)).seconds + time - self.start
        return guides(FramePlace(number, seconds, interval, source if source.time == time else None))

    def _scheduled(self, step: Step, source: SourceFrame, nearest: SourceFrame) -> ScheduledFrame:
        """Return the output frame of a step; must be called in order."""
        number = self.outputs_before
        if step.is_sample:  # of the exposure of the frame before or of the next one
            number -= step.frame_number == self.exposed
        else:
            self.exposed = step.frame_number
            self.outputs_before += 1
            if number in (self.outputs.first, self.outputs.stop):
                self.summary.boundaries[number] = SourceMoment(self.place(source), source.time)
        is_missing = number in self.outputs and number >= self.outputs.first + self.outputs.skip
        guide = self._guide(Fraction(number), step.time, source) if is_missing else None
        return ScheduledFrame(number, step, self._shown(number, step.time), source, nearest, is_missing, guide)

    def last_outputs(self, *, holds_last_frame: bool) -> Iterator[ScheduledFrame]:
        """Yield the output frames from the last frame of the source on; one, or all while it is shown if it is held.

        Must be called when all intervals were taken. Raises `InputError` if there were less than two frames.
        """
        info = self.info
        if self.last is None or self.number < 2:
            count = "one frame" if self.number else "no frame"
            raise InputError(f"{info.name} holds {count} that can be read, and two are needed to make one in between.")
        last = self.last[-1]
        end = last.time + (last.frame.duration or 1 / info.rate)
        nominal = self.schedule.presentation_time(self.start, end)
        self.end = nominal if nominal > last.time else end
        if self.curve is not None and not self.curve.is_open:
            if self.start + self.curve.top > self.end:
                self.summary.remarks.add("retime-behind-end", name=info.name)
            self.end = max(self.end, self.start + self.curve.top + 1)
            holds_last_frame = True
        for step in self.schedule.steps(self.index, self.start, last.time, self.end):
            if step.t == 0 or holds_last_frame:
                yield self._scheduled(step, last, last).at(Fraction(0))

    def place(self, source: SourceFrame) -> int:
        """Return the place of a frame in the clip, from 0."""
        return source.position.number - self.position_of(0, Fraction(0)).number

    def _shown(self, number: int, time: Fraction) -> Fraction:
        """Return when an output frame is shown, seconds after the first one; none of a loop after its round."""
        if self.curve is not None:  # its time is that of the source
            return number / self.schedule.rate(self.info.rate)
        return (min(time, self.outputs.end or time) - self.start) * self.options.stretch

    @property
    def length(self) -> Fraction:
        """When the last output frame is no longer shown, seconds after the first one, when all are scheduled."""
        return self._shown(self.outputs_before, self.end)

    def take_captions(self, time: Fraction) -> bytes:
        """Return the closed captions of the source up to a time that were not taken before."""
        captions = [each for shown, each in self.captions if shown <= time]
        del self.captions[: len(captions)]
        return b"".join(captions)
