"""Time maps: exact curves from output times to source times.

A map consists of segments, straight where the speed is constant and cubic where it changes, all with exact fractions.
It answers three questions: which source time an output time shows (`TimeMap.source`), when a source time is first
reached (`TimeMap.time_of`), and which parts of the sound can be stretched (`TimeMap.sounding`).
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise

from fpsboost.media.info import FOREVER

SOUND_SPEEDS = Fraction(1, 2), Fraction(2)
"""Lowest and highest speed at which sound is stretched at its pitch by default."""
ALL_SPEEDS = Fraction(1, 1000), Fraction(1000)
"""Lowest and highest speed at which sound can be stretched."""
MILLISECONDS = Fraction(1000)
"""Positions per second to which times are rounded where the speed changes."""
MIN_SOUND = Fraction(1, 4)
"""Shortest duration of a constant speed for which sound is stretched, seconds: a few windows of the filter."""


@dataclass(frozen=True)
class Segment:
    """Part of a time map between two output times: a line, or a monotone cubic."""

    begin: Fraction
    """Output time of the beginning, seconds."""
    end: Fraction
    """Output time of the end, seconds."""
    source0: Fraction
    """Source time at the beginning, seconds."""
    source1: Fraction
    """Source time at the end, seconds."""
    slope0: Fraction = Fraction(1)
    """Speed at the beginning: seconds of the source per second of the output."""
    slope1: Fraction = Fraction(1)
    """Speed at the end."""

    @property
    def speed(self) -> Fraction | None:
        """Constant speed of the segment; None if the speed changes."""
        mean = (self.source1 - self.source0) / (self.end - self.begin)
        return mean if self.slope0 == self.slope1 == mean else None

    def source(self, time: Fraction) -> Fraction:
        """Return the source time at an output time: a cubic Hermite curve through both ends with their slopes."""
        length = self.end - self.begin
        rise = self.source1 - self.source0
        u = (time - self.begin) / length
        bend = u * (1 - u) * length * ((1 - u) * self.slope0 - u * self.slope1)
        return self.source0 + (u * rise if self.speed is not None else u * u * (3 - 2 * u) * rise + bend)

    def place(self, source: Fraction, rate: Fraction) -> Fraction:
        """Return the position, in output frames, at which a source time between both ends is reached.

        While the speed changes, it is the next whole one.
        """
        if self.speed is not None:
            return (self.begin + (source - self.source0) / self.speed) * rate
        numbers = range(math.ceil(self.begin * rate), math.ceil(self.end * rate))
        sign = 1 if self.source1 > self.source0 else -1
        return Fraction(
            numbers.start + bisect_left(numbers, sign * source, key=lambda number: sign * self.source(number / rate))
        )

    def passage(self, begin: Fraction, end: Fraction) -> tuple[Fraction, Fraction] | None:
        """Return when a part of the source, `begin` to before `end`, is shown, from when and to when; None if never."""
        low, high = sorted((self.source0, self.source1))
        if low == high:
            return (self.begin, self.end) if begin <= low < end else None
        if begin >= high or end <= low:
            return None
        first, last = (begin, end) if self.source0 == low else (end, begin)
        return (
            self.place(first, MILLISECONDS) / MILLISECONDS if low < first < high else self.begin,
            self.place(last, MILLISECONDS) / MILLISECONDS if low < last < high else self.end,
        )


@dataclass(frozen=True)
class TimeMap:
    """Exact map of output times to source times, both in seconds from the first frame.

    Examples
    --------
    >>> points = [(Fraction(0), Fraction(0)), (Fraction(2), Fraction(2)), (Fraction(4), Fraction(3))]
    >>> curve = TimeMap.through(points)  # half of the speed from 2 s on
    >>> str(curve.source(Fraction(3))), str(curve.time_of(Fraction(5, 2))), str(curve.length)
    ('5/2', '3', '4')
    """

    segments: tuple[Segment, ...]
    """Segments in the order of the output, the first of which begins at 0, without gaps."""
    is_open: bool = False
    """Whether the output ends with the source, in the last segment."""
    sound_speeds: tuple[Fraction, Fraction] = SOUND_SPEEDS
    """Lowest and highest constant speed at which sound is stretched."""

    @classmethod
    def through(
        cls, points: Sequence[tuple[Fraction, Fraction]], *, smooth: bool = False, onward: Fraction | None = None
    ) -> TimeMap:
        """Return the map through points, whose output begins at 0 with the first one.

        Parameters
        ----------
        points : sequence of (Fraction, Fraction)
            Output time and source time of each point, seconds, with increasing output times.
        smooth : bool
            Whether the speed changes smoothly between points (monotone cubics) instead of at them (lines).
        onward : Fraction, optional
            Speed after the last point, to the end of the source; by default the output ends with the last point.
        """
        lengths, speeds = ([b[axis] - a[axis] for a, b in pairwise(points)] for axis in (0, 1))
        speeds = [rise / length for rise, length in zip(speeds, lengths, strict=True)]
        slopes = _slopes(lengths, speeds) if smooth and speeds else []
        if onward is not None:
            points = [*points, (points[-1][0] + FOREVER, points[-1][1] + FOREVER * onward)]
            speeds.append(onward)
        segments = list[Segment]()
        for k, ((time0, source0), (time1, source1)) in enumerate(pairwise(points)):
            ends = (slopes[k], slopes[k + 1]) if k + 1 < len(slopes) else (speeds[k], speeds[k])
            segment = Segment(time0 - points[0][0], time1 - points[0][0], source0, source1, *ends)
            if segments and segment.speed is not None and segment.speed == segments[-1].speed:
                before = segments.pop()
                segment = replace(segment, begin=before.begin, source0=before.source0)
            segments.append(segment)
        return cls(tuple(segments), onward is not None)

    @property
    def length(self) -> Fraction:
        """Duration of the output, seconds."""
        return self.segments[-1].end

    @property
    def top(self) -> Fraction:
        """Latest source time that is shown, seconds."""
        return self._tops[-1]

    @property
    def is_steady(self) -> bool:
        """Whether the source plays at one speed from the first point to its end."""
        return len(self.segments) == 1 and self.is_open

    @property
    def reverses(self) -> bool:
        """Whether the source plays backwards somewhere."""
        return any(each.source1 < each.source0 for each in self.segments)

    def is_plain(self, duration: Fraction | None) -> bool:
        """Return whether a clip of a duration, seconds, is shown from beginning to end at its own speed."""
        first = self.segments[0]
        ends = self.is_open or self.segments[0].source1 == duration
        return len(self.segments) == 1 and first.speed == 1 and not first.source0 and ends

    def source(self, time: Fraction) -> Fraction:
        """Return the source time that an output time shows, seconds; the last one after the end."""
        segment = self.segments[max(0, bisect_right(self.segments, time, key=lambda each: each.begin) - 1)]
        return segment.source(min(time, segment.end))

    def time_of(self, source: Fraction) -> Fraction:
        """Return the output time at which the source first reaches a time, seconds.

        It is exact where the speed is constant, and rounded up to a millisecond where it changes.
        """
        return self._place(source, MILLISECONDS) / MILLISECONDS

    def passages(self, begin: Fraction, end: Fraction) -> list[tuple[Fraction, Fraction]]:
        """Return the output times, from and to, between which a part of the source, `begin` to `end`, is shown.

        There are several where the source is shown again. They are as exact as those of `time_of`.

        Examples
        --------
        >>> points = [(Fraction(0), Fraction(0)), (Fraction(4), Fraction(4)), (Fraction(8), Fraction(0))]
        >>> passages = TimeMap.through(points).passages(Fraction(1), Fraction(2))
        >>> [(int(begin), int(end)) for begin, end in passages]
        [(1, 2), (6, 7)]
        """
        found = list[tuple[Fraction, Fraction]]()
        for time0, time1 in filter(None, (each.passage(begin, end) for each in self.segments)):
            goes_on = found and time0 <= found[-1][1]
            found.append((found.pop()[0] if goes_on else time0, time1))
        return found

    def frames_before(self, source: Fraction, rate: Fraction) -> int:
        """Return the number of output frames, at a rate, that are shown before the source reaches a time."""
        return math.ceil(self._place(source, rate))

    def _place(self, source: Fraction, rate: Fraction) -> Fraction:
        """Return the position, in output frames, at which the source reaches a time.

        While the speed changes, it is the next whole one.
        """
        place = bisect_left(self._tops, source)
        if place == len(self.segments):
            return self.length * rate
        segment = self.segments[place]
        if segment.source0 >= source:
            return segment.begin * rate
        return segment.place(source, rate)

    @cached_property
    def _tops(self) -> list[Fraction]:
        """Latest source time up to the end of each segment, seconds."""
        return list(accumulate((max(each.source0, each.source1) for each in self.segments), max))

    @cached_property
    def sounding(self) -> list[Segment]:
        """Segments, or the ends of segments, whose sound can be stretched at its pitch.

        Others are silent: those of changing speed, of a speed outside `sound_speeds`, shorter than `MIN_SOUND`, and
        whatever has been shown before.
        """
        if self.is_steady:
            return list(self.segments)
        slowest, fastest = self.sound_speeds
        audible = list[Segment]()
        for each, top in zip(self.segments, [Fraction(0), *self._tops], strict=False):
            if each.speed is None or not slowest <= each.speed <= fastest:
                continue
            source0 = max(top, each.source0)
            begin = each.begin + (source0 - each.source0) / each.speed
            if each.end - begin >= MIN_SOUND:
                audible.append(replace(each, begin=begin, source0=source0))
        return audible

    @property
    def silences(self) -> list[tuple[Fraction, Fraction, list[str]]]:
        """Passages of the output without sound: begin and end, seconds, and the reasons, one per segment."""
        times = [Fraction(0), *(time for each in self.sounding for time in (each.begin, each.end)), self.length]
        return [
            (begin, end, [self._why_silent(each) for each in self.segments if each.begin < end and begin < each.end])
            for begin, end in zip(times[::2], times[1::2], strict=True)
            if begin < end
        ]

    def _why_silent(self, segment: Segment) -> str:
        """Return the reason for which a segment has no sound, for a remark."""
        speed = segment.speed
        slowest, fastest = self.sound_speeds
        if speed is None:
            return "changing speed"
        return "shown again, or too short" if slowest <= speed <= fastest else f"speed {float(speed):.4g}"


def _slopes(lengths: Sequence[Fraction], speeds: Sequence[Fraction]) -> list[Fraction]:
    """Return the slopes of a monotone cubic at its points.

    A slope is the weighted harmonic mean of the speeds on both sides, and 0 at a turn (PCHIP: F. N. Fritsch and J.
    Butland, A Method for Constructing Local Monotone Piecewise Cubic Interpolants, 1984, doi:10.1137/0905021).
    """
    inner = []
    for (h0, h1), (before, after) in zip(pairwise(lengths), pairwise(speeds), strict=True):
        w0 = h0 + 2 * h1
        w1 = 2 * h0 + h1
        inner.append((w0 + w1) / (w0 / before + w1 / after) if before * after > 0 else Fraction(0))
    return [_end_slope(lengths, speeds), *inner, _end_slope(lengths[::-1], speeds[::-1])]


def _end_slope(lengths: Sequence[Fraction], speeds: Sequence[Fraction]) -> Fraction:
    """Return the slope of the parabola through the first three points, limited so that the cubic stays monotone."""
    if len(speeds) == 1:
        return speeds[0]
    slope = speeds[0] + (speeds[0] - speeds[1]) * lengths[0] / (lengths[0] + lengths[1])
    if slope * speeds[0] <= 0:
        return Fraction(0)
    return min(slope, 3 * speeds[0], key=abs) if speeds[0] * speeds[1] <= 0 else slope
