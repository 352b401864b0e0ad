"""The frame at which reading may begin, so that the loop yields the same frames as if it had read all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from fractions import Fraction

from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, find_synchronised
from fpsboost.contracts import Entry
from fpsboost.frame import Frame
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.timing.output_numbers import OutputNumbers
from fpsboost.timing.schedule import Schedule, rising_time

LEAD_IN = 24
"""Number of frames that are searched first, before those that are needed, for one to begin at."""

GROWTH = 4
"""Factor by which that number grows until there is one."""


def find_entry(
    times: Sequence[Fraction],
    schedule: Schedule,
    detector: DuplicateDetector | None,
    first_output: int,
    read_from: Callable[[int], AbstractContextManager[Iterator[Frame]]],
) -> Entry:
    """Find where to begin reading for an output frame and all later ones.

    The pair of frames around it is needed, and the pair before, which has a say in it; nothing farther away has. Their
    frames may be groups of duplicates, and grouping remembers what came before: it begins at a frame from which it is
    certain; see `fpsboost.analysis.duplicates.find_synchronised`. If there is none, that is the clip's first one.

    `times` are those of all frames of the clip; output frames are counted from 0; without a detector, duplicates are
    not looked for. `read_from` opens the clip once more at a frame, and yields that and the following ones.
    """
    numbers = OutputNumbers(times, schedule)
    # the exposure of a frame begins after the frame before
    around = numbers.source_frame(max(0, first_output - 1))
    latest = around - (1 if detector is None else 2 * detector.most)
    if detector is None:
        number = numbers.certain_at_most(max(0, latest))
        return Entry(number, times[0], numbers.before(number))
    lead_in = LEAD_IN
    while latest - lead_in > 0:
        first = numbers.certain_at_most(latest - lead_in)
        entry: tuple[int, float] | None = None
        with read_from(first) as frames:
            for source_frame, step in find_synchronised(_presented(frames, first, latest, times, schedule), detector):
                assert source_frame.image.source_position is not None
                number = source_frame.image.source_position.number
                if numbers.is_certain(number):
                    entry = number, step
        if entry is not None:
            return Entry(entry[0], times[0], numbers.before(entry[0]), entry[1])
        lead_in *= GROWTH
    return Entry(0, times[0], 0)


def _presented(
    frames: Iterator[Frame], first: int, last: int, times: Sequence[Fraction], schedule: Schedule
) -> Iterator[SourceFrame]:
    """Yield frames up to a number as the loop presents them, from one on whose presentation time is certain."""
    before: Fraction | None = None
    for number, frame in enumerate(frames, first):
        if number > last:
            return
        time = rising_time(schedule, times[0], frame.time, before)
        if time is not None:
            before = time
            place = SourcePosition(number, frame.time)
            yield SourceFrame(replace(frame, time=time), FrameCache(frame.image, source_position=place))
