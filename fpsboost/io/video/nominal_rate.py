"""How fast a video plays, and how long: what its file says, as far as the times of its frames bear that out."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import av
import av.stream

from fpsboost.timing.schedule import is_implausible

MAX_RATE = 1000
ASSUMED_RATE = Fraction(25)
MAX_DRIFT = Fraction(1, 8)
"""Frames by which the end of a clip may miss the rate that its file declares."""
MAX_JITTER = 8
"""Intervals that differ from the usual one by up to one part in so many are the usual one, as cameras time it."""
MIN_SHARE = Fraction(3, 4)
"""Share of intervals that are the usual one where the rate is constant, but for frames that are missing."""
SHARE_OF_A_CLOCK = Fraction(9, 10)
"""Share of intervals that differ by their rounding alone, from which on the others are faults and not counted."""
MAX_DENOMINATORS = (1, 100, 10_000)


@dataclass(frozen=True)
class Cadence:
    """How fast frames follow each other most of the time.

    Attributes
    ----------
    interval : Fraction
        Mean of the usual intervals, seconds.
    error : Fraction
        Seconds by which that may be wrong, because times are rounded and jitter.
    count : int
        Usual intervals.
    is_constant : bool
        Nearly all intervals are usual ones.
    mean_rate : Fraction
        Frames per second over everything, with all pauses.
    tick : Fraction
        Seconds per tick of the clock.
    """

    interval: Fraction
    error: Fraction
    count: int
    is_constant: bool
    mean_rate: Fraction
    tick: Fraction

    def is_exactly(self, rate: Fraction) -> bool:
        """Whether a rate gives these times, but for their rounding."""
        return abs(1 / rate - self.interval) <= self.error

    def is_nearly(self, rate: Fraction) -> bool:
        """Whether a declared rate is near enough for all frames to pass; where the rate varies, about right."""
        missed = abs(self.interval * rate - 1)
        return missed * self.count < MAX_DRIFT if self.is_constant else missed < Fraction(1, 100)


def nominal_rate(stream: av.VideoStream, cadence: Cadence | None) -> tuple[Fraction, bool]:
    """Return the rate that a stream has or, where it varies, most of it; and whether that is more than a guess.

    Real times decide: of the rates that they bear out, the one that is declared, else a usual one, else what was
    measured. FFmpeg's mean counts pauses and damage, so it is believed only where it is a usual rate, or nothing else
    fits. One interval that is too long or too short changes nothing.

    Parameters
    ----------
    stream : av.VideoStream
    cadence : Cadence or None
        From the stream's times; None where there are too few.
    """
    rates = (as_fraction(stream.guessed_rate), as_fraction(stream.average_rate))
    declared = [rate for rate in rates if rate is not None and 0 < rate <= MAX_RATE]
    if cadence is None or cadence.interval * MAX_RATE < 1:
        return (declared[0], True) if declared else (ASSUMED_RATE, False)
    usual = _usual_rates_near(1 / cadence.interval)
    # What the clock cannot count was rounded on its way: 19001/317 is 59.94 in the nanoseconds of Matroska.
    countable = [rate for rate in declared[:1] if (1 / rate / cadence.tick).denominator == 1]
    preferred = [*countable, *(rate for rate in declared if rate in usual), *usual, *declared[:1]]
    exact = [rate for rate in preferred if cadence.is_exactly(rate)]
    near = [rate for rate in declared if cadence.is_nearly(rate)]
    if not cadence.is_constant:
        near += [rate for rate in usual if cadence.is_nearly(rate)]
    found = [*exact, *near, _simplest(cadence), *declared[:1]]
    return next((rate for rate in found if not is_implausible(rate, cadence.mean_rate)), found[0]), True


def measured_cadence(times: Sequence[int], tick: Fraction) -> Cadence | None:
    """Return how fast frames follow each other; None for fewer than two.

    Parameters
    ----------
    times : sequence of int
        In ticks, rising.
    tick : Fraction
        Seconds.
    """
    intervals = [after - before for before, after in pairwise(times) if after > before]
    if not intervals:
        return None
    middle = statistics.median_low(intervals)
    # Where frames are one tick apart, times are exact, and two ticks are two frames.
    rounding = 0 if middle == 1 else 1
    margin = Fraction(rounding)
    if sum(abs(interval - middle) <= margin for interval in intervals) < SHARE_OF_A_CLOCK * len(intervals):
        margin = max(margin, Fraction(middle, MAX_JITTER))
    usual = [interval for interval in intervals if abs(interval - middle) <= margin]
    # The errors of times cancel out along a row of usual intervals, but for those at its two ends.
    rows = 1 + sum(
        abs(after - middle) <= margin < abs(before - middle) for before, after in pairwise([middle, *intervals])
    )
    jitter = max(1, statistics.median_high([abs(interval - middle) for interval in usual]))
    return Cadence(
        interval=Fraction(sum(usual), len(usual)) * tick,
        error=Fraction(rows * jitter, len(usual)) * tick,
        count=len(usual),
        is_constant=len(usual) >= MIN_SHARE * len(intervals),
        mean_rate=len(intervals) / (sum(intervals) * tick),
        tick=tick,
    )


def listed_times(stream: av.stream.Stream) -> list[int]:
    """Return the times of all frames by the index of the file, ticks, rising; none where it does not list them all."""
    if not stream.frames or len(stream.index_entries) != stream.frames:
        return []
    return sorted({entry.timestamp for entry in stream.index_entries})


def _usual_rates_near(rate: Fraction) -> list[Fraction]:
    """The nearest whole number and the nearest rate like NTSC's, the nearer one first; then the nearest half."""
    ntsc = 3 * round(rate * 1001 / 3000) * Fraction(1000, 1001)  # 14.985, 23.976, 29.97 and their multiples
    near = sorted([Fraction(round(rate)), ntsc], key=lambda each: abs(each - rate))
    return [each for each in (*near, Fraction(round(2 * rate), 2)) if each > 0]


def _simplest(cadence: Cadence) -> Fraction:
    rates = [(1 / cadence.interval).limit_denominator(most) for most in MAX_DENOMINATORS]
    return next((rate for rate in rates if rate > 0 and cadence.is_exactly(rate)), rates[-1])


def declared_duration(stream: av.VideoStream) -> Fraction | None:
    """Seconds that the header promises, if it does."""
    if stream.duration is None or stream.time_base is None or stream.duration <= 0:
        return None
    return stream.duration * Fraction(stream.time_base)


def assumed_rate_remark(name: str) -> str:
    """What to say of a clip that does not tell its rate."""
    return f"{name} does not say its frame rate; {ASSUMED_RATE} frames per second assumed."


def as_fraction(value: Any) -> Fraction | None:
    """An exact Fraction of FFmpeg's rational, which may also be absent, 0/1 or 1/0."""
    if not value:
        return None
    return Fraction(value.numerator, value.denominator)
