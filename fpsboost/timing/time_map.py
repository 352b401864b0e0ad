"""Time maps: exact curves that say which time of the source every output time shows."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise

FOREVER = Fraction(10**9)
"""Seconds for which a curve goes on that has no end of its own; any clip is shorter."""
SOUND_SPEEDS = Fraction(1, 2), Fraction(2)
"""Lowest and highest speed at which sound is stretched at its pitch, unless that is asked for at all speeds."""
ALL_SPEEDS = Fraction(1, 1000), Fraction(1000)
"""Lowest and highest speed at which sound can be stretched."""
MIN_SOUND = Fraction(1, 4)
"""Shortest time of a constant speed for which sound is stretched, seconds: a few windows of the filter."""


@dataclass(frozen=True)
class Segment:
    """Part of a time map: a line, or a cubic that never turns, between two output times, seconds."""

    begin: Fraction
    end: Fraction
    source0: Fraction
    source1: Fraction
    slope0: Fraction
    slope1: Fraction
    """Speed at the ends: seconds of the source per second of the output."""

    @property
    def speed(self) -> Fraction | None:
        """The speed if it is constant."""
        mean = (self.source1 - self.source0) / (self.end - self.begin)
        return mean if self.slope0 == self.slope1 == mean else None

    def source(self, time: Fraction) -> Fraction:
        """Return the source time at an output time."""
        length, rise = self.end - self.begin, self.source1 - self.source0
        u = (time - self.begin) / length
        bend = u * (1 - u) * length * ((1 - u) * self.slope0 - u * self.slope1)
        return self.source0 + (u * rise if self.speed is not None else u * u * (3 - 2 * u) * rise + bend)


@dataclass(frozen=True)
class TimeMap:
    """Exact map of output times to source times, both in seconds from the first frame."""

    segments: tuple[Segment, ...]
    is_open: bool = False
    """Whether the output ends with the source, in the last segment."""
    sound_speeds: tuple[Fraction, Fraction] = SOUND_SPEEDS
    """Lowest and highest constant speed at which sound is stretched."""

    @classmethod
    def through(
        cls, points: Sequence[tuple[Fraction, Fraction]], *, smooth: bool = False, onward: Fraction | None = None
    ) -> TimeMap:
        """Return the map through points, whose output begins at 0 with the first one."""
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
        """The latest source time."""
        return self._tops[-1]

    @property
    def is_steady(self) -> bool:
        """Whether all of the source plays at one speed, to its end."""
        return len(self.segments) == 1 and self.is_open

    @property
    def reverses(self) -> bool:
        """Whether the source plays backwards somewhere."""
        return any(each.source1 < each.source0 for each in self.segments)

    def is_plain(self, duration: Fraction | None) -> bool:
        """Return whether a clip is shown from beginning to end, at its own speed."""
        first, ends = self.segments[0], self.is_open or self.segments[0].source1 == duration
        return len(self.segments) == 1 and first.speed == 1 and not first.source0 and ends

    def unfolded(self, times: Sequence[Fraction]) -> tuple[list[int], list[Fraction], TimeMap]:
        """Return a clip whose frames are those at `times` as often as they are passed, which never plays backwards.

        These are the numbers of the frames in the order of the output, the times of the unfolded clip, from 0 on, and
        its time map. The source turns behind the frame that encloses the turn.
        """
        last, ends = len(times) - 1, [*times, self.top]  # what is beyond the last frame shows that one
        stop = last if self.is_open or self.top <= times[-1] else last + 1
        first, sign = self.segments[0], -1 if self.segments[0].source1 < self.segments[0].source0 else 1
        place = min(bisect_left(times, first.source0), stop) if sign < 0 else bisect_right(times, first.source0) - 1
        places, shown, segments = [place], [Fraction(0)], list[Segment]()
        for each in self.segments:
            if each.source1 != each.source0:
                sign = -1 if each.source1 < each.source0 else 1
            offset = shown[-1] - sign * ends[places[-1]]
            target = bisect_left(times, each.source1) if sign > 0 else bisect_right(times, each.source1) - 1
            for place in range(places[-1] + sign, min(target, stop) + sign, sign):
                places.append(place)
                shown.append(offset + sign * ends[place])
            source0, source1, *slopes = (sign * x for x in (each.source0, each.source1, each.slope0, each.slope1))
            segments.append(Segment(each.begin, each.end, offset + source0, offset + source1, *slopes))
        return [min(place, last) for place in places], shown, TimeMap(tuple(segments), self.is_open)

    def source(self, time: Fraction) -> Fraction:
        """Return the time of the source that an output time shows, which does not change after the end."""
        segment = self.segments[max(0, bisect_right(self.segments, time, key=lambda each: each.begin) - 1)]
        return segment.source(min(time, segment.end))

    def time_of(self, source: Fraction) -> Fraction:
        """Return when the source first reaches a time; to a millisecond while speed changes, else exactly."""
        return self._place(source, Fraction(1000)) / 1000

    def end_of(self, begin: Fraction, end: Fraction) -> Fraction:
        """Return when the source first reaches `end`; if it turns back before, when it is last not before `begin`."""
        if not begin <= self.top < end:
            return self.time_of(end)
        mirrored, length = list[Segment](), self.length
        for each in reversed(self.segments):
            slopes = -each.slope1, -each.slope0
            mirrored.append(Segment(length - each.end, length - each.begin, each.source1, each.source0, *slopes))
        return length - TimeMap(tuple(mirrored)).time_of(begin)

    def frames_before(self, source: Fraction, rate: Fraction) -> int:
        """Return how many output frames are shown before the source reaches a time."""
        return math.ceil(self._place(source, rate))

    def _place(self, source: Fraction, rate: Fraction) -> Fraction:
        """Return when the source reaches a time, in output frames; while speed changes, the next whole one."""
        place = bisect_left(self._tops, source)
        if place == len(self.segments):
            return self.length * rate
        segment = self.segments[place]
        if segment.source0 >= source:
            return segment.begin * rate
        if segment.speed is not None:
            return (segment.begin + (source - segment.source0) / segment.speed) * rate
        numbers = range(math.ceil(segment.begin * rate), math.ceil(segment.end * rate))
        return Fraction(numbers.start + bisect_left(numbers, source, key=lambda number: segment.source(number / rate)))

    @cached_property
    def _tops(self) -> list[Fraction]:
        """Latest source time up to the end of each segment."""
        return list(accumulate((max(each.source0, each.source1) for each in self.segments), max))

    @cached_property
    def sounding(self) -> list[Segment]:
        """Segments, or their ends, whose sound can be stretched at its pitch; what is shown again is silent."""
        if self.is_steady:
            return list(self.segments)
        slowest, fastest = self.sound_speeds
        heard = list[Segment]()
        for each, top in zip(self.segments, [Fraction(0), *self._tops], strict=False):
            if each.speed is None or not slowest <= each.speed <= fastest:
                continue
            source0 = max(top, each.source0)
            begin = each.begin + (source0 - each.source0) / each.speed
            if each.end - begin >= MIN_SOUND:
                heard.append(replace(each, begin=begin, source0=source0))
        return heard

    @property
    def silences(self) -> list[tuple[Fraction, Fraction, list[str]]]:
        """Passages of the output without sound: where each begins and ends, seconds, and the reasons for it."""
        times = [Fraction(0), *(time for each in self.sounding for time in (each.begin, each.end)), self.length]
        return [
            (begin, end, [self._why_silent(each) for each in self.segments if each.begin < end and begin < each.end])
            for begin, end in zip(times[::2], times[1::2], strict=True)
            if begin < end
        ]

    def _why_silent(self, segment: Segment) -> str:
        speed, (slowest, fastest) = segment.speed, self.sound_speeds
        if speed is None:
            return "changing speed"
        return "shown again, or too short" if slowest <= speed <= fastest else f"speed {float(speed):.4g}"


def _slopes(lengths: Sequence[Fraction], speeds: Sequence[Fraction]) -> list[Fraction]:
    """Return the slopes of a monotone cubic at its points (PCHIP: F. N. Fritsch and J. Butland, 1984)."""
    inner = []
    for (h0, h1), (before, after) in zip(pairwise(lengths), pairwise(speeds), strict=True):
        w0, w1 = h0 + 2 * h1, 2 * h0 + h1
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
