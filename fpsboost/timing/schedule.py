"""Which output frame falls between which two source frames, and where.

Pure arithmetic on exact fractions: nothing here knows about images or files, and no rounding ever happens, so hours of
23.976 frames per second stay exact.

A schedule is asked pair by pair for the output frames in the half-open interval [time0, time1), so that a stream needs
to know no more than two frames at a time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, Protocol, Self

from fpsboost.errors import OptionError
from fpsboost.frame import ClipInfo

FASTEST_SHOWN = 300
"""Frames per second beyond which no display shows, and no camera films without keeping its rate."""
MAX_MADE = 10
"""Times as many frames as were asked for, above which nearly all of them would be made where nothing moves on."""
MAX_FACTOR = 1000
MAX_RATE = 100_000
MAX_TICKS_PER_SECOND = 2**31 - 1  # containers keep the time scale in 32 bits
MAX_FILLED = Fraction(600)
"""Seconds that a picture is repeated for at most; one that stands longer, most likely a damaged time, is one frame."""


class Step(NamedTuple):
    """One output frame: when it is shown, and how far it lies between its two source frames."""

    time: Fraction
    t: Fraction


class Schedule(Protocol):
    """Contract: where output frames lie. Implementations are `ByFactor` and `ByRate`."""

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        """When a source frame is taken to be shown: at its time, or where that was meant to be.

        All other methods take times that come from here.

        Parameters
        ----------
        start, time : Fraction
            Times of source frame 0 and of this one as the source says, seconds.
        """
        ...

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        """Yield the output frames in [time0, time1), in order.

        Parameters
        ----------
        index : int
            Number of the source frame at `time0`, counted from 0.
        start : Fraction
            Time of source frame 0, seconds.
        time0, time1 : Fraction
            Times of this source frame and the next one, seconds; time0 < time1.

        Yields
        ------
        Step
            A frame whose t is 0 shows the source frame itself.
        """
        ...

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        """Where a source frame lies among the output frames, counted from 0.

        Parameters
        ----------
        index : int
            Its number among the source frames, counted from 0.
        start, time : Fraction
            Times of source frame 0 and of this one, seconds.
        """
        ...

    def rate(self, source_rate: Fraction) -> Fraction:
        """Nominal output frames per second."""
        ...

    def time_base(self, source_time_base: Fraction) -> Fraction:
        """Seconds per tick that represent every output time exactly (where 32 bits suffice)."""
        ...


@dataclass(frozen=True)
class ByFactor:
    """Multiply the frames: each source interval is divided evenly, whatever its length.

    Output frame k lies at source position k / factor, so variable frame rates keep their rhythm and every source frame
    that is hit keeps its exact time.

    Parameters
    ----------
    factor : Fraction
        Output frames per source frame, 0 < factor <= 1000.

    Raises
    ------
    OptionError
        The factor is out of range.

    Examples
    --------
    >>> [float(step.time) for step in ByFactor(Fraction(5, 2)).steps(0, Fraction(0), Fraction(0), Fraction(1))]
    [0.0, 0.4, 0.8]
    """

    factor: Fraction

    def __post_init__(self) -> None:
        if not 0 < self.factor <= MAX_FACTOR:
            raise OptionError(f"--factor must be above 0 and at most {MAX_FACTOR}, not {self.factor}.")

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        return time

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        for k in range(math.ceil(index * self.factor), math.ceil((index + 1) * self.factor)):
            t = k / self.factor - index
            yield Step(time0 + t * (time1 - time0), t)

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        return index * self.factor

    def rate(self, source_rate: Fraction) -> Fraction:
        return source_rate * self.factor

    def time_base(self, source_time_base: Fraction) -> Fraction:
        return representable(source_time_base / self.factor.numerator, source_time_base)


@dataclass(frozen=True)
class ByRate:
    """A constant output rate, counted from the first source frame; real source times decide t.

    Parameters
    ----------
    frames_per_second : Fraction
        Output rate, above 0 and at most 100000.
    source_rate : Fraction, optional
        Nominal rate of the source, for `tolerance`.
    tolerance : Fraction
        Seconds by which a source frame may miss its place in the nominal rate and still be taken to be shown there.
    longest : Fraction, optional
        Seconds between two source frames up to which frames are made between them; across a longer pause the first is
        repeated. No limit where it is not given.

    Raises
    ------
    OptionError
        The rate is out of range.

    Examples
    --------
    >>> [str(step.t) for step in ByRate(Fraction(60)).steps(0, Fraction(0), Fraction(0), Fraction(1, 24))]
    ['0', '2/5', '4/5']
    """

    frames_per_second: Fraction
    source_rate: Fraction | None = None
    tolerance: Fraction = Fraction(0)
    longest: Fraction | None = None

    def __post_init__(self) -> None:
        if not 0 < self.frames_per_second <= MAX_RATE:
            raise OptionError(f"--fps must be above 0 and at most {MAX_RATE}, not {self.frames_per_second}.")

    @classmethod
    def forgiving(cls, frames_per_second: Fraction, source_rate: Fraction, tick: Fraction) -> Self:
        """For a source whose clock rounds, jitters or pauses.

        A frame may miss its place by a tick of the clock, or by an eighth of a frame, as phones and browsers do; never
        by half a frame of the source or of the output. Across more than a second that is ten frames too, nothing is
        made: whatever happened there, it was no motion from the one picture to the other.

        Parameters
        ----------
        frames_per_second, source_rate : Fraction
            Of the output and of the source.
        tick : Fraction
            Seconds per tick of the source's clock.
        """
        shorter = min(1 / source_rate, 1 / frames_per_second)
        tolerance = min(max(tick, 1 / source_rate / 8), shorter * 2 / 5)
        return cls(frames_per_second, source_rate, tolerance, max(Fraction(1), 10 / source_rate))

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        if self.source_rate is None:
            return time
        nominal = start + round((time - start) * self.source_rate) / self.source_rate
        return nominal if abs(time - nominal) <= self.tolerance else time

    def is_pause(self, interval: Fraction) -> bool:
        """Whether nothing is made between two frames, because they lie too far apart."""
        return self.longest is not None and interval > self.longest

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        first = math.ceil((time0 - start) * self.frames_per_second)
        last = math.ceil((time1 - start) * self.frames_per_second)
        is_pause = self.is_pause(time1 - time0)
        if is_pause and time1 - time0 > MAX_FILLED:
            last = min(last, first + 1)
        for k in range(first, last):
            time = start + k / self.frames_per_second
            yield Step(time, Fraction(0) if is_pause else (time - time0) / (time1 - time0))

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        return (time - start) * self.frames_per_second

    def rate(self, source_rate: Fraction) -> Fraction:
        return self.frames_per_second

    def time_base(self, source_time_base: Fraction) -> Fraction:
        ticks = Fraction(1, self.frames_per_second.numerator)
        return representable(Fraction(1, math.lcm(ticks.denominator, source_time_base.denominator)), ticks)


def rising_time(schedule: Schedule, start: Fraction, time: Fraction, last: Fraction | None) -> Fraction | None:
    """`Schedule.presentation_time` of a source frame, but never before the one of the frame before.

    Parameters
    ----------
    schedule : Schedule
    start, time : Fraction
        Times of source frame 0 and of this one as the source says, seconds.
    last : Fraction or None
        What this function gave for the frame before; None for the first.

    Returns
    -------
    Fraction or None
        None where there is no place left for it: two frames came at once.
    """
    snapped = schedule.presentation_time(start, time)
    if last is None or snapped > last:
        return snapped
    return time if time > last else None  # the second of two at one place comes late


def is_implausible(rate: Fraction, mean_rate: Fraction) -> bool:
    """Whether a rate is faster than anything is shown, and the frames are far from keeping it."""
    return rate > FASTEST_SHOWN and rate > MAX_MADE * mean_rate


def count_frames(schedule: Schedule, info: ClipInfo, holds_last_frame: bool) -> int | None:
    """How many frames the output will have, if the source's header is right; None where it does not say."""
    if isinstance(schedule, ByRate) and info.duration is not None:
        end = schedule.presentation_time(Fraction(0), info.duration)
        if holds_last_frame:
            return math.ceil(end * schedule.frames_per_second)
        return math.floor((end - 1 / info.rate) * schedule.frames_per_second) + 1
    if info.frame_count is None:
        return None
    intervals = info.frame_count if holds_last_frame else info.frame_count - 1
    whole, rest = divmod(intervals * schedule.rate(info.rate) / info.rate, 1)
    return int(whole) + bool(rest) + (not holds_last_frame and not rest)


def representable(*time_bases: Fraction) -> Fraction:
    """The first of the time bases that fits 32 bits, else the finest that does."""
    fitting = (each for each in time_bases if each.denominator <= MAX_TICKS_PER_SECOND)
    return next(fitting, Fraction(1, MAX_TICKS_PER_SECOND))


def parse_rate(text: str, option: str = "frame rate") -> Fraction:
    """Read a frame rate as people write it; 23.976, 29.97, 59.94 and 119.88 mean n x 1000/1001.

    Parameters
    ----------
    text : str
        ``60``, ``59.94`` or ``60000/1001``.
    option : str
        What the message calls it.

    Raises
    ------
    OptionError
        Not a number.

    Examples
    --------
    >>> parse_rate("59.94")
    Fraction(60000, 1001)
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
    """Read a whole number, a decimal or a fraction such as ``5/2`` exactly.

    Raises
    ------
    OptionError
        Not a number; `option` names it in the message.
    """
    try:
        if "e" in text.lower():  # an exponent of many digits would take all memory
            raise ValueError
        value = Fraction(text.strip())
    except (ValueError, ZeroDivisionError):
        raise OptionError(f"{option} {text!r} is not a number; write it like 2, 2.5, 5/2 or 60000/1001.") from None
    # programs print 15000/1001 as 14.985014985014985, and no container counts in such ticks
    return value if value.denominator < MAX_TICKS_PER_SECOND else value.limit_denominator(1_000_000)


@dataclass(frozen=True)
class OutputTiming:
    """The clock of an output.

    Parameters
    ----------
    rate : Fraction
        Nominal frames per second.
    time_base : Fraction
        Seconds per tick; frame times are multiples of it (or rounded to it where the container is coarser).
    """

    rate: Fraction
    time_base: Fraction
