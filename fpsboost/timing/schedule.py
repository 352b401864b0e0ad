"""Schedules: the presentation times of output frames, and their positions between source frames.

All arithmetic is on exact fractions, without rounding, so hours of 23.976 frames per second stay exact. Nothing here
depends on images or files.

A schedule is asked pair by pair for the output frames in the half-open interval [time0, time1), so that a stream needs
only two frames at a time. With a shutter, there are further times within an output frame's exposure, which are averaged
into motion blur.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, NamedTuple, Protocol, Self, runtime_checkable

from fpsboost.errors import OptionError
from fpsboost.media import FOREVER, ClipInfo, TimeMap
from fpsboost.options import Checked, Range, check_type
from fpsboost.timing.shutter import Shutter

MAX_FACTOR = 1000
"""Largest number of output frames per source frame."""
MAX_RATE = 100_000
"""Highest output rate, frames per second."""
MAX_TICKS_PER_SECOND = 2**31 - 1  # containers store the time scale in 32 bits
MAX_FILLED = Fraction(600)
"""Maximum duration of a pause that is filled by repeats of a frame, seconds; a longer pause, probably a damaged
timestamp, becomes one frame."""


class Step(NamedTuple):
    """Output frame: its presentation time, and its position between its two source frames."""

    time: Fraction
    """Presentation time on the source's clock, seconds."""
    t: Fraction
    """Position between the source frames, 0 to below 1: 0 is the earlier frame itself."""
    frame_number: int | None = None
    """Number of the output frame, counted from 0, if several steps are averaged into one."""
    is_sample: bool = False
    """Whether it is a further sample of that frame's exposure, at another time than the frame's own."""


@runtime_checkable
class Schedule(Protocol):
    """Contract: determines the times of output frames. Implementations: `ByFactor`, `ByRate`, `RetimeSchedule`.

    All its results depend on their arguments alone, so that a part of a conversion has the same frames as the whole.
    """

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        """Return the presentation time of a source frame: its own time, or the nominal time if it is near that.

        `start` and `time` are those of source frame 0 and of this one as given by the source, seconds. All other
        methods take times returned by this one.
        """

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames in [time0, time1), in order; one whose t is 0 shows the source frame itself.

        Parameters
        ----------
        index : int
            Number of the source frame at `time0`, counted from 0.
        start : Fraction
            Time of source frame 0, seconds.
        time0, time1 : Fraction
            Times of this source frame and the next one, seconds.
        """

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """Return the position of a source frame among the output frames, counted from 0; parameters as in `steps`."""

    def rate(self, source_rate: Fraction) -> Fraction:
        """Return the nominal output frames per second, of a source with a nominal rate."""

    def time_base(self, source_time_base: Fraction) -> Fraction:
        """Return the seconds per tick that represent every output time exactly (where 32 bits suffice)."""


@dataclass(frozen=True)
class ExposedSchedule:
    """Base of schedules whose output frames may be exposed for a while.

    A frame whose exposure reaches beyond an interval has samples in two intervals, which carry its number
    (`Step.frame_number`). Before the first source frame and across pauses there are no samples but the output frames
    themselves.
    """

    shutter: Shutter | None = field(default=None, kw_only=True)

    @abstractmethod
    def frames(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames of an interval, without samples; see `Schedule.steps`."""

    @abstractmethod
    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """See `Schedule.output_position`."""

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames in an interval, or the samples of their exposures; see `Schedule.steps`."""
        steps = list(self.frames(index, start, time0, time1))
        if self.shutter is None:
            yield from steps
            return
        first = self.output_position(index, start, time0)
        last = self.output_position(index + 1, start, time1)
        is_short = len(steps) < math.ceil(last) - math.ceil(first)  # too long to be filled
        if is_short or any(step.t == 0 and step.time > time0 for step in steps):  # a pause: one picture is held
            yield from (Step(time, t, math.ceil(first) + number) for number, (time, t, *_) in enumerate(steps))
            return
        offsets = self.shutter.offsets
        for number in range(math.ceil(first) - 1, math.ceil(last) + 1):
            for offset in offsets:
                position = number + offset
                if first <= position < last:
                    t = (position - first) / (last - first)
                    yield Step(time0 + t * (time1 - time0), t, number, is_sample=offset != 0)


@dataclass(frozen=True)
class ByFactor(ExposedSchedule, Checked):
    """Schedule that multiplies the frames: each source interval is divided evenly, whatever its length.

    Output frame k lies at source position k / factor, so a variable frame rate stays variable, and every source frame
    that becomes an output frame keeps its exact time.

    Parameters
    ----------
    factor : Fraction
        Output frames per source frame, 0 < factor <= 1000.
    longest : Fraction
        Maximum seconds between two source frames for which frames are made between them; see `ByRate`.
    shutter : Shutter, optional
        Shutter for motion blur.

    Examples
    --------
    >>> [float(step.time) for step in ByFactor(Fraction(5, 2)).steps(0, Fraction(0), Fraction(0), Fraction(1))]
    [0.0, 0.4, 0.8]
    """

    factor: Annotated[Fraction, Range(above=0, most=MAX_FACTOR)]
    longest: Fraction = FOREVER

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        """Return `time`: no frame is moved."""
        return time

    def frames(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames of an interval; see `Schedule.steps`. In a pause, all repeat the earlier frame."""
        first = math.ceil(index * self.factor)
        is_pause = time1 - time0 > self.longest
        for k in range(first, math.ceil((index + 1) * self.factor)):
            t = k / self.factor - index
            at = Fraction(0) if is_pause and k == first else t
            yield Step(time0 + at * (time1 - time0), Fraction(0) if is_pause else t)

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """Return ``index * factor``; see `Schedule.output_position`."""
        return index * self.factor

    def rate(self, source_rate: Fraction) -> Fraction:
        return source_rate * self.factor

    def time_base(self, source_time_base: Fraction) -> Fraction:
        """Return the source's seconds per tick divided by the factor's numerator, if 32 bits hold it."""
        return representable(source_time_base / self.factor.numerator, source_time_base)


@dataclass(frozen=True)
class ByRate(ExposedSchedule):
    """Schedule with a constant output rate, counted from the first source frame; real source times determine t.

    Parameters
    ----------
    frames_per_second : Fraction
        Output rate, above 0 and at most 100000.
    source_rate : Fraction, optional
        Nominal rate of the source, for `tolerance`.
    tolerance : Fraction
        Maximum distance of a source frame from its nominal time, seconds, at which it is taken to be shown then.
    longest : Fraction
        Maximum seconds between two source frames for which frames are made between them; across a longer pause the
        first is repeated.
    shutter : Shutter, optional
        Shutter for motion blur.

    Examples
    --------
    >>> [str(step.t) for step in ByRate(Fraction(60)).steps(0, Fraction(0), Fraction(0), Fraction(1, 24))]
    ['0', '2/5', '4/5']
    """

    frames_per_second: Fraction
    source_rate: Fraction | None = None
    tolerance: Fraction = Fraction(0)
    longest: Fraction = FOREVER

    def __post_init__(self) -> None:
        check_type("fps", self.frames_per_second, Annotated[Fraction, Range(above=0, most=MAX_RATE)])

    @classmethod
    def forgiving(cls, frames_per_second: Fraction, source_rate: Fraction, tick: Fraction) -> Self:
        """Return a schedule for a source whose clock rounds, jitters or pauses.

        A frame may miss its nominal time by a tick of the clock, or by an eighth of a frame, as with phones and
        browsers; never by half a frame of the source or of the output. Pauses are held. A `tick` is in seconds.
        """
        shorter = min(1 / source_rate, 1 / frames_per_second)
        tolerance = min(max(tick, 1 / source_rate / 8), shorter * 2 / 5)
        return cls(frames_per_second, source_rate, tolerance, longest_interval(source_rate))

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        """Return the nominal time of a source frame if its own is within `tolerance` of it, else its own."""
        if self.source_rate is None:
            return time
        nominal = start + round((time - start) * self.source_rate) / self.source_rate
        return nominal if abs(time - nominal) <= self.tolerance else time

    def frames(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames of an interval; see `Schedule.steps`. In a pause, all repeat the earlier frame."""
        first = math.ceil((time0 - start) * self.frames_per_second)
        last = math.ceil((time1 - start) * self.frames_per_second)
        is_pause = time1 - time0 > self.longest
        if is_pause and time1 - time0 > MAX_FILLED:
            last = min(last, first + 1)
        for k in range(first, last):
            time = start + k / self.frames_per_second
            yield Step(time, Fraction(0) if is_pause else (time - time0) / (time1 - time0))

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """Return the position on the output's clock; see `Schedule.output_position`."""
        return (time - start) * self.frames_per_second

    def rate(self, source_rate: Fraction) -> Fraction:
        return self.frames_per_second

    def time_base(self, source_time_base: Fraction) -> Fraction:
        """Return the largest time base that has both the output's and the source's ticks, if 32 bits hold it."""
        ticks = Fraction(1, self.frames_per_second.numerator)
        return representable(Fraction(1, math.lcm(ticks.denominator, source_time_base.denominator)), ticks)


@dataclass(frozen=True)
class RetimeSchedule(ByRate):
    """Schedule of a time map whose source never plays backwards; the times of its steps are those of the source.

    Output frame k is shown k intervals after the first one. With a `shutter`, there are samples of the time around it,
    whose distance in the source is proportional to the speed at that time.

    Parameters
    ----------
    frames_per_second, source_rate, tolerance, longest, shutter
        As in `ByRate`.
    curve : TimeMap
        Map of output times to source times; one that plays backwards is unfolded before, see `Edit.unfolded`.
    """

    curve: TimeMap = field(kw_only=True)

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames that show source times of an interval; see `Schedule.steps`."""
        rate = self.frames_per_second
        is_pause = time1 - time0 > self.longest
        first, last = (self.curve.frames_before(time - start, rate) for time in (time0, time1))
        offsets = [Fraction(0)] if self.shutter is None or is_pause else self.shutter.offsets
        for number in range(first - 1, last + 1):
            for position in (number + offset for offset in offsets):
                time = start + self.curve.source(position / rate)
                if 0 <= position < self.curve.length * rate and time0 <= time < time1:
                    t = Fraction(0) if is_pause else (time - time0) / (time1 - time0)
                    yield Step(time, t, None if self.shutter is None else number, is_sample=position != number)

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """Return how many output frames are shown before a source frame; see `Schedule.output_position`."""
        return Fraction(self.curve.frames_before(time - start, self.frames_per_second))


def longest_interval(source_rate: Fraction) -> Fraction:
    """Return the seconds between two frames above which no motion connects them: one, and ten frames of a rate."""
    return max(Fraction(1), 10 / source_rate)


def rising_time(schedule: Schedule, start: Fraction, time: Fraction, last: Fraction | None) -> Fraction | None:
    """Return the `Schedule.presentation_time` of a frame if it is later than the `last` one.

    Of two frames with one nominal time, the second keeps its own time. Returns None if two frames have the same time.
    """
    snapped = schedule.presentation_time(start, time)
    if last is None or snapped > last:
        return snapped
    return time if time > last else None  # the second of two frames with one nominal time keeps its own


def count_frames(schedule: Schedule, info: ClipInfo, holds_last_frame: bool) -> int | None:
    """Return the number of output frames as far as the source's header is right; None if the header does not have it.

    `holds_last_frame` is whether the last source frame is repeated for as long as it is shown.
    """
    if isinstance(schedule, RetimeSchedule) and not schedule.curve.is_open:
        return math.ceil(schedule.curve.length * schedule.frames_per_second)
    duration = info.duration
    if isinstance(schedule, RetimeSchedule) and duration is None and info.frame_count is not None:
        duration = info.frame_count / info.rate
    left_out = 0 if holds_last_frame else 1  # number of source intervals, at the end, without output frames
    if isinstance(schedule, ByRate) and duration is not None:
        end = schedule.presentation_time(Fraction(0), duration) - left_out / info.rate
        shown = schedule.curve.time_of(end) if isinstance(schedule, RetimeSchedule) else end
        frames = shown * schedule.frames_per_second
    elif info.frame_count is not None:
        frames = (info.frame_count - left_out) * schedule.rate(info.rate) / info.rate
    else:
        return None
    return math.ceil(frames) if holds_last_frame else math.floor(frames) + 1


def representable(*time_bases: Fraction) -> Fraction:
    """Return the first of the time bases that fits 32 bits, else the finest that does."""
    fitting = (each for each in time_bases if each.denominator <= MAX_TICKS_PER_SECOND)
    return next(fitting, Fraction(1, MAX_TICKS_PER_SECOND))


def parse_rate(text: str, option: str = "frame rate") -> Fraction:
    """Parse a frame rate; 23.976, 29.97, 59.94 and 119.88 mean n x 1000/1001, unlike 2997/50.

    Raises `OptionError`, in which `option` names it, if it is not a number.

    Examples
    --------
    >>> str(parse_rate("29.97")), str(parse_rate("2997/100")), str(parse_rate("25"))
    ('30000/1001', '2997/100', '25')
    """
    value = parse_number(text, option)
    nearest = round(value * 1001 / 1000)
    ntsc = Fraction(nearest * 1000, 1001)
    is_ntsc = (
        "/" not in text
        and value.denominator > 1
        and nearest > 0
        and nearest % 6 == 0
        and abs(value - ntsc) < Fraction(1, 200)
    )
    return ntsc if is_ntsc else value


def parse_number(text: str, option: str) -> Fraction:
    """Parse a number as Python writes it (``2``, ``2.5``, ``1e3``) or a fraction such as ``5/2`` exactly.

    Raises `OptionError`, in which `option` names it, for any other text.
    """
    try:
        if re.search(r"e[+-]?\d{3}", text, re.IGNORECASE):  # an exact fraction of it would take all memory
            raise ValueError
        value = Fraction(text.strip())
    except (ValueError, ZeroDivisionError):
        raise OptionError(f"{option} {text!r} is not a number; write it like 2, 2.5, 5/2 or 60000/1001.") from None
    # programs print 15000/1001 as 14.985014985014985, and no container has such a time base
    return value if value.denominator < MAX_TICKS_PER_SECOND else value.limit_denominator(1_000_000)
