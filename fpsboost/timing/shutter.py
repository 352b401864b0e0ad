"""Shutter: the times within an output frame's exposure at which frames are made, to be averaged into motion blur."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from fpsboost.errors import OptionError
from fpsboost.timing.schedule import Schedule, Step

DEFAULT_SAMPLES = 15
MAX_SAMPLES = 99


@dataclass(frozen=True)
class Shutter:
    """Shutter that is open around the time of every output frame.

    Parameters
    ----------
    angle : Fraction
        Shutter angle, degrees: 360 is open for the whole interval from one output frame to the next.
    samples : int
        Number of frames that are averaged, odd, so that the one in the middle has the output frame's own time.

    Raises
    ------
    OptionError
        One is out of range.

    Examples
    --------
    >>> [str(offset) for offset in Shutter(Fraction(180), 3).offsets]
    ['-1/6', '0', '1/6']
    """

    angle: Fraction
    samples: int = DEFAULT_SAMPLES

    def __post_init__(self) -> None:
        if not 0 < self.angle <= 360:
            raise OptionError(f"`shutter` must be above 0 and at most 360 degrees, not {float(self.angle):g}.")
        if not 3 <= self.samples <= MAX_SAMPLES or self.samples % 2 == 0:
            raise OptionError(f"`shutter_samples` must be odd, and from 3 to {MAX_SAMPLES}, not {self.samples}.")

    @property
    def offsets(self) -> list[Fraction]:
        """Times of the samples from that of the output frame, as shares of the interval between output frames."""
        return [self.angle / 360 * Fraction(2 * i + 1 - self.samples, 2 * self.samples) for i in range(self.samples)]


@dataclass(frozen=True)
class ExposureSchedule:
    """Schedule of the samples of another schedule's output frames.

    Before the first source frame and across pauses there are no samples but the output frames themselves.

    Parameters
    ----------
    schedule : Schedule
        Determines the times of the output frames.
    shutter : Shutter

    Examples
    --------
    >>> from fpsboost.timing.schedule import ByFactor
    >>> exposure = ExposureSchedule(ByFactor(Fraction(1)), Shutter(Fraction(180), 3))
    >>> [(str(step.t), step.frame_number) for step in exposure.steps(0, Fraction(0), Fraction(0), Fraction(1))]
    [('0', 0), ('1/6', 0), ('5/6', 1)]
    """

    schedule: Schedule
    shutter: Shutter

    def presentation_time(self, start: Fraction, time: Fraction) -> Fraction:
        return self.schedule.presentation_time(start, time)

    def steps(self, index: int, start: Fraction, time0: Fraction, time1: Fraction) -> Iterator[Step]:
        steps = list(self.schedule.steps(index, start, time0, time1))
        first = self.schedule.output_position(index, start, time0)
        last = self.schedule.output_position(index + 1, start, time1)
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

    def output_position(self, index: int, start: Fraction, time: Fraction) -> Fraction:
        return self.schedule.output_position(index, start, time)

    def rate(self, source_rate: Fraction) -> Fraction:
        return self.schedule.rate(source_rate)

    def time_base(self, source_time_base: Fraction) -> Fraction:
        return self.schedule.time_base(source_time_base)
