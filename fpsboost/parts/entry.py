"""Where reading may begin so that the loop makes the same frames from a position on as if it had read all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from fractions import Fraction

from fpsboost.analysis.duplicates import DuplicateDetector
from fpsboost.frame import Frame
from fpsboost.streaming import Entry
from fpsboost.timing.schedule import Schedule


def find_entry(
    times: Sequence[Fraction],
    schedule: Schedule,
    detector: DuplicateDetector | None,
    first_output: int,
    read_from: Callable[[int], AbstractContextManager[Iterator[Frame]]],
) -> Entry:
    """Return where to begin: at the first frame, which is always right."""
    return Entry(0, times[0], 0)
