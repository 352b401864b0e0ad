"""The frame rate of a stream, by its header and by the presentation times of its first pictures."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from av import VideoStream

from fpsboost.media.info import MAX_DISPLAY_RATE, is_implausible
from fpsboost.media.pyav import as_fraction

MAX_RATE = 1000
"""Highest rate that is believed of a header: most higher ones count a clock's ticks. Times may tell a higher one."""


ASSUMED_RATE = Fraction(25)


MAX_DRIFT = Fraction(1, 8)  # maximum deviation of the end of a clip from its time at the declared rate, frames


JITTER_DIVISOR = 8
"""Intervals within 1/8 (the reciprocal of this) of the median count as usual ones, since cameras have jitter."""


MIN_USUAL_SHARE = Fraction(3, 4)
"""Minimum share of usual intervals at which the rate counts as constant with frames missing."""


MIN_ROUNDED_SHARE = Fraction(9, 10)
"""Minimum share of intervals that differ only by rounding at which the others count as faults and are excluded."""


MAX_DENOMINATORS = (1, 100, 10_000)
"""Maximum denominators of measured rates, tried in this order until a rate matches the times."""


@dataclass(frozen=True)
class MeasuredRate:
    """Usual interval between frames, seconds, as measured by `measure_rate`.

    Parameters
    ----------
    interval : Fraction
        Mean of the usual intervals, seconds.
    error : Fraction
        Largest deviation of `interval` that rounding and jitter can cause, seconds.
    count : int
        Number of usual intervals.
    is_constant : bool
        Whether nearly all intervals are usual ones.
    mean_rate : Fraction
        Frames per second, pauses included.
    tick : Fraction
        Seconds per tick of the times.
    """

    interval: Fraction
    error: Fraction
    count: int
    is_constant: bool
    mean_rate: Fraction
    tick: Fraction

    def is_exactly(self, rate: Fraction) -> bool:
        """Return whether the interval of a rate, frames per second, is the measured one within its error."""
        return abs(1 / rate - self.interval) <= self.error

    def is_nearly(self, rate: Fraction) -> bool:
        """Return whether a declared rate is less than `MAX_DRIFT` frames off at the end, or than 1 % if it varies."""
        missed = abs(self.interval * rate - 1)
        return missed * self.count < MAX_DRIFT if self.is_constant else missed < Fraction(1, 100)


def nominal_rate(stream: VideoStream, measured: MeasuredRate | None, *, raw: bool = False) -> tuple[Fraction, bool]:
    """Return the frame rate of a stream, or its most frequent rate if it varies, and whether it is known.

    Of the rates that agree with the presentation times, the declared rate is chosen, else a standard rate, else the
    measured rate. FFmpeg's mean includes pauses and damage, so it is used only if it is a standard rate, or if no other
    rate fits. A single interval that is too long or too short has no effect. Without enough times nothing is measured.

    Of a `raw` stream only the codec's own headers count, since FFmpeg gives 25 where they say nothing. There, a number
    that no display and no camera reaches, such as 1000 or 90000, counts ticks of a clock.
    """
    rates = [stream.codec_context.framerate] if raw else [stream.guessed_rate, stream.average_rate]
    declared = [
        rate
        for rate in map(as_fraction, rates)
        if rate is not None and 0 < rate <= (MAX_DISPLAY_RATE if raw else MAX_RATE)
    ]
    if measured is None:
        return (declared[0], True) if declared else (ASSUMED_RATE, False)
    # the nearest integer rate and NTSC rate (14.985, 23.976, 29.97 and their multiples), then the nearest half
    rate = 1 / measured.interval
    ntsc = 3 * round(rate * 1001 / 3000) * Fraction(1000, 1001)
    standard = sorted([Fraction(round(rate)), ntsc], key=lambda usual: abs(usual - rate))
    usual = [each for each in (*standard, Fraction(round(2 * rate), 2)) if each > 0]
    # A frame duration that is no whole number of ticks was rounded: 19001/317 is 59.94 in Matroska's nanoseconds.
    countable = [rate for rate in declared[:1] if (1 / rate / measured.tick).denominator == 1]
    preferred = [*countable, *(rate for rate in declared if rate in usual), *usual, *declared[:1]]
    exact = [rate for rate in preferred if measured.is_exactly(rate)]
    considered = declared if measured.is_constant else [*declared, *usual]
    near = [rate for rate in considered if measured.is_nearly(rate)]
    simple = [rate.limit_denominator(most) for most in MAX_DENOMINATORS]
    simplest = next((rate for rate in simple if rate > 0 and measured.is_exactly(rate)), simple[-1])
    candidates = [*exact, *near, simplest, *declared[:1]]
    return next((rate for rate in candidates if not is_implausible(rate, measured.mean_rate)), candidates[0]), True


def measure_rate(times: Sequence[int], tick: Fraction) -> MeasuredRate | None:
    """Measure the rate of presentation times in increasing order, ticks; None for fewer than two different times."""
    intervals = [after - before for before, after in pairwise(times) if after > before]
    if not intervals:
        return None
    middle = statistics.median_low(intervals)
    # If frames are one tick apart, times are exact, and an interval of two ticks is a missing frame.
    # The margin is whole, as the intervals are: with fractions, those of a long film would take seconds to compare.
    margin = 0 if middle == 1 else 1
    if sum(abs(interval - middle) <= margin for interval in intervals) < MIN_ROUNDED_SHARE * len(intervals):
        margin = max(margin, middle // JITTER_DIVISOR)
    usual = [interval for interval in intervals if abs(interval - middle) <= margin]
    # Along a sequence of usual intervals the errors of the times cancel out, except at its two ends.
    rows = 1 + sum(
        abs(after - middle) <= margin < abs(before - middle) for before, after in pairwise([middle, *intervals])
    )
    jitter = max(1, statistics.median_high([abs(interval - middle) for interval in usual]))
    interval = Fraction(sum(usual), len(usual)) * tick
    error = Fraction(rows * jitter, len(usual)) * tick
    is_constant = len(usual) >= MIN_USUAL_SHARE * len(intervals)
    return MeasuredRate(interval, error, len(usual), is_constant, len(intervals) / (sum(intervals) * tick), tick)
