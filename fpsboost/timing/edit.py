"""Edits as data: which frame of a clip is shown when."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate

from fpsboost.media import ClipInfo, Segment, TimeMap

BLOCK = 16
"""Frames that are in memory at a time where a clip plays backwards."""


@dataclass(frozen=True)
class Edit:
    """Edit decision list: frames of a clip in the order in which they are shown, and the time of each.

    Examples
    --------
    >>> clip = Edit.whole([Fraction(0), Fraction(1), Fraction(2)])
    >>> [int(time) for time in clip.with_gaps([0, 2], Fraction(1)).times]
    [0, 1, 4]
    >>> clip.looped(Fraction(3), 2).frames
    [1, 2, 0, 1, 2, 0, 1]
    """

    frames: Sequence[int]
    """Numbers of the clip's frames, counted from 0."""
    times: Sequence[Fraction]
    """Times at which they are shown, increasing seconds."""
    after_gaps: AbstractSet[int] = frozenset()
    """Places in the list before which frames are missing."""

    @classmethod
    def whole(cls, times: Sequence[Fraction]) -> Edit:
        """Return the edit that shows all frames of a clip, at their own times."""
        return cls(range(len(times)), times)

    def with_gaps(self, missing: Sequence[int], interval: Fraction) -> Edit:
        """Return the edit with each frame later by those that are missing before it.

        `missing` are their numbers behind each frame but the last, and `interval` is the time for each, seconds.
        """
        before = accumulate(missing, initial=0)
        later = [time + count * interval for time, count in zip(self.times, before, strict=True)]
        return replace(self, times=later, after_gaps={place for place, count in enumerate(missing, 1) if count})

    def looped(self, duration: Fraction, context: int) -> Edit:
        """Return one round of a loop, with as many frames of the rounds before and after it as `context`.

        `duration` is that of a round, seconds.
        """
        count = len(self.frames)
        places = [divmod(number, count) for number in range(-context, count + context)]
        times = [self.times[place] + turn * duration for turn, place in places]
        return Edit([self.frames[place] for _, place in places], times)

    def unfolded(self, curve: TimeMap) -> tuple[Edit, TimeMap]:
        """Return the edit with its frames as often as a curve passes them, and the curve, which then never falls.

        Times count from 0 on. The clip turns behind the frame that encloses the turn.
        """
        times = self.times
        # beyond the last frame, that one is shown
        last = len(times) - 1
        ends = [*times, curve.top]
        stop = last if curve.is_open or curve.top <= times[-1] else last + 1
        first = curve.segments[0]
        sign = -1 if first.source1 < first.source0 else 1
        place = min(bisect_left(times, first.source0), stop) if sign < 0 else bisect_right(times, first.source0) - 1
        places = [place]
        displayed = [Fraction(0)]
        segments = list[Segment]()
        for each in curve.segments:
            if each.source1 != each.source0:
                sign = -1 if each.source1 < each.source0 else 1
            offset = displayed[-1] - sign * ends[places[-1]]
            target = bisect_left(times, each.source1) if sign > 0 else bisect_right(times, each.source1) - 1
            for place in range(places[-1] + sign, min(target, stop) + sign, sign):
                places.append(place)
                displayed.append(offset + sign * ends[place])
            source0, source1, *slopes = (sign * x for x in (each.source0, each.source1, each.slope0, each.slope1))
            segments.append(Segment(each.begin, each.end, offset + source0, offset + source1, *slopes))
        frames = [self.frames[min(place, last)] for place in places]
        return Edit(frames, displayed), TimeMap(tuple(segments), curve.is_open)

    def of_info(self, info: ClipInfo) -> ClipInfo:
        """Return the properties of the edited clip, whose last frame lasts one interval."""
        length = self.times[-1] - self.times[0] if self.times else Fraction(0)
        return replace(info, frame_count=len(self.frames), duration=length + 1 / info.rate)

    def runs(self, first: int) -> Iterator[Sequence[int]]:
        """Yield the frames from a place on in runs, each of which is read at once: rising, or falling and short.

        Examples
        --------
        >>> list(Edit([0, 2, 3, 3, 2, 1, 5], [Fraction(0)] * 7).runs(1))
        [[2, 3], [3, 2, 1], [5]]
        """
        run = list[int]()
        for number in self.frames[first:]:
            if len(run) == 1:
                goes_on = number != run[0]
            elif run and run[0] < run[1]:
                goes_on = number > run[-1]
            else:
                goes_on = bool(run) and number < run[-1] and len(run) < BLOCK
            if run and not goes_on:
                yield run
                run = []
            run.append(number)
        if run:
            yield run
