"""Numbers of output frames, and the frames of the source that they follow, by the times of a clip alone."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property

from fpsboost.timing.schedule import MAX_FILLED, Schedule, rising_time


class OutputNumbers:
    """Numbers of the output frames of a clip whose frames are at `times`, increasing seconds; counted from 0.

    Examples
    --------
    >>> from fpsboost.timing.schedule import ByFactor
    >>> numbers = OutputNumbers([Fraction(0), Fraction(1), Fraction(2)], ByFactor(Fraction(2)))
    >>> numbers.before(1), numbers.source_frame(3)
    (2, 1)
    """

    def __init__(self, times: Sequence[Fraction], schedule: Schedule) -> None:
        self._times, self._schedule = times, schedule

    def is_certain(self, number: int) -> bool:
        """Return whether the presentation time of a frame does not depend on those of earlier frames.

        A frame is shown at its nominal or at its own time, and nominal times do not decrease: all earlier frames are
        shown before this one if that is so of the frame before it, at either time.
        """
        if number == 0:
            return True
        start, time, before = self._times[0], self._times[number], self._times[number - 1]
        nominal = self._schedule.presentation_time(start, before)
        return self._schedule.presentation_time(start, time) > max(nominal, before)

    def certain_at_most(self, number: int) -> int:
        """Return the last frame up to a number whose presentation time does not depend on earlier frames."""
        return next(each for each in range(number, -1, -1) if self.is_certain(each))

    def presented(self, number: int) -> Fraction:
        """Return when a frame is shown, or the last one before it that is, seconds."""
        last: Fraction | None = None
        for each in range(self.certain_at_most(number), number + 1):
            time = rising_time(self._schedule, self._times[0], self._times[each], last)
            last = last if time is None else time
        assert last is not None, "the first one is certain"
        return last

    def before(self, number: int) -> int:
        """Return the number of output frames before a frame of the source."""
        return self._position(number) - sum(lost for pause, lost in self._pauses if pause < number)

    def source_frame(self, output: int) -> int:
        """Return the frame of the source at or before an output frame; the last one for those after the end."""
        return max(0, bisect_right(range(len(self._times)), output, key=self.before) - 1)

    def _position(self, number: int) -> int:
        return math.ceil(self._schedule.output_position(number, self._times[0], self.presented(number)))

    @cached_property
    def _pauses(self) -> list[tuple[int, int]]:
        """Frames before pauses that are not filled, and how many output frames fewer there are for each."""
        pauses = []
        number, last = 0, len(self._times) - 1
        while number < last:
            following = bisect_right(self._times, self._times[number] + MAX_FILLED - 1)  # snapping may lengthen a pause
            if following == number + 1:
                time0, time1 = self.presented(number), self.presented(following)
                steps = self._schedule.steps(number, self._times[0], time0, time1)
                made = sum(not step.is_sample for step in steps)
                pauses.append((number, self._position(following) - self._position(number) - made))
            number = max(number + 1, following - 1)
        return [pause for pause in pauses if pause[1]]
