"""Where a part of a conversion begins to read its source, so that the loop certainly does the same as in one run."""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from fractions import Fraction
from functools import cached_property
from itertools import islice

from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, find_synchronised
from fpsboost.contracts import Entry
from fpsboost.frame import Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.timing.schedule import MAX_FILLED, Schedule, rising_time

LEAD_IN = 24
"""Number of frames before those that are needed in which the first search looks for a frame where reading may begin."""
GROWTH = 4
"""Factor by which that number grows until the search succeeds."""


def find_entry(
    times: Sequence[Fraction],
    schedule: Schedule,
    detector: DuplicateDetector | None,
    first_output: int,
    read_from: Callable[[int], AbstractContextManager[Iterable[Frame]]],
    before: int = 1,
) -> Entry:
    """Find where to begin reading for an output frame and all later ones.

    The pair of frames around it is needed, and the pair before, which influences its motion; no other does. Their
    frames may be groups of duplicates, and grouping depends on earlier frames: it begins at a frame from which it is
    certain; see `fpsboost.analysis.duplicates.find_synchronised`. If there is none, that is the clip's first one.

    Parameters
    ----------
    times : sequence of Fraction
        Times of all frames of the clip, seconds.
    schedule : Schedule
        Times of the output frames.
    detector : DuplicateDetector or None
        Detector of duplicates; None if they are not looked for.
    first_output : int
        Number of the output frame, counted from 0.
    read_from : callable
        Opens the clip once more at a frame, and yields a source of that and the following ones.
    before : int
        Number of frames before that around the output frame which influence it.
    """
    numbers = OutputNumbers(times, schedule)
    # the exposure of a frame begins after the frame before
    latest = numbers.source_frame(max(0, first_output - 1)) - (before if detector is None else 2 * detector.most)
    if detector is None:
        number = numbers.certain_at_most(max(0, latest))
        return Entry(number, times[0], numbers.before(number))
    lead_in = LEAD_IN
    while latest - lead_in > 0:
        first = numbers.certain_at_most(latest - lead_in)
        entry: Entry | None = None
        with read_from(first) as frames:
            for source_frame, step in find_synchronised(_presented(frames, first, latest, times, schedule), detector):
                number = source_frame.position.number
                if numbers.is_certain(number):
                    entry = Entry(number, times[0], numbers.before(number), step)
        if entry is not None:
            return entry
        lead_in *= GROWTH
    return Entry(0, times[0], 0)


def _presented(
    frames: Iterable[Frame], first: int, last: int, times: Sequence[Fraction], schedule: Schedule
) -> Iterator[SourceFrame]:
    """Yield the frames from `first` to `last` as the loop presents them; the time of the first must be certain."""
    before: Fraction | None = None
    for number, frame in enumerate(islice(frames, last + 1 - first), first):
        time = rising_time(schedule, times[0], frame.time, before)
        if time is not None:
            before = time
            yield SourceFrame(frame, time, source_position=SourcePosition(number, frame.time))


class OutputNumbers:
    """Numbers of the output frames, counted from 0, of a clip whose frames are at `times`, increasing seconds."""

    def __init__(self, times: Sequence[Fraction], schedule: Schedule) -> None:
        self._times = times
        self._schedule = schedule

    def is_certain(self, number: int) -> bool:
        """Return whether the presentation time of a frame does not depend on those of earlier frames.

        A frame is shown at its nominal or at its own time, and nominal times do not decrease: all earlier frames are
        shown before this one if that is so of the frame before it, at either time.
        """
        if number == 0:
            return True
        start = self._times[0]
        time = self._times[number]
        before = self._times[number - 1]
        nominal = self._schedule.presentation_time(start, before)
        return self._schedule.presentation_time(start, time) > max(nominal, before)

    def certain_at_most(self, number: int) -> int:
        """Return the last frame up to a number whose presentation time is certain."""
        return next(each for each in range(number, -1, -1) if self.is_certain(each))

    def presented(self, number: int) -> Fraction:
        """Return the presentation time of a frame, or of the last one before it that is presented, seconds."""
        last: Fraction | None = None
        for each in range(self.certain_at_most(number), number + 1):
            time = rising_time(self._schedule, self._times[0], self._times[each], last)
            last = last if time is None else time
        assert last is not None, "the first one is certain"
        return last

    def before(self, number: int) -> int:
        """Return the number of output frames before a source frame."""
        return self._position(number) - sum(lost for pause, lost in self._pauses if pause < number)

    def source_frame(self, output: int) -> int:
        """Return the frame of the source at or before an output frame; the last one for those after the end."""
        return max(0, bisect_right(range(len(self._times)), output, key=self.before) - 1)

    def _position(self, number: int) -> int:
        """Return the number of output frames before a source frame if no pause were shortened."""
        return math.ceil(self._schedule.output_position(number, self._times[0], self.presented(number)))

    @cached_property
    def _pauses(self) -> list[tuple[int, int]]:
        """Frames before pauses that are not filled, and the number of output frames that each pause lacks."""
        pauses = []
        number = 0
        last = len(self._times) - 1
        while number < last:
            following = bisect_right(self._times, self._times[number] + MAX_FILLED - 1)  # snapping may lengthen a pause
            if following == number + 1:
                time0 = self.presented(number)
                time1 = self.presented(following)
                steps = self._schedule.steps(number, self._times[0], time0, time1)
                made = sum(not step.is_sample for step in steps)
                pauses.append((number, self._position(following) - self._position(number) - made))
            number = max(number + 1, following - 1)
        return [pause for pause in pauses if pause[1]]
