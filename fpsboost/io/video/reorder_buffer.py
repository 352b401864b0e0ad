"""Correct the presentation times of pictures that a decoder outputs with interchanged times.

AVI, and MP4 without composition offsets, store decoding times and no presentation times; the presentation times that
FFmpeg derives from them are wrong where pictures are reordered. The order in which a decoder outputs pictures is right.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import Generic, Protocol, TypeVar

MAX_REORDERED = 16
"""Maximum reordering of H.264 and HEVC, pictures; a packet that is later than this produced no picture."""


class Timed(Protocol):
    """Picture with a presentation time in ticks, or None."""

    pts: int | None


P = TypeVar("P", bound=Timed)


class ReorderBuffer(Generic[P]):
    """Buffer that keeps pictures in decoder output order and assigns their presentation times in increasing order.

    Pictures are held only while the decoder still has to output one with an earlier time.

    Parameters
    ----------
    interval : float
        Usual picture interval, ticks. If sorted times are closer than half of it, they were not interchanged but
        damaged, and are left unchanged.

    Attributes
    ----------
    has_interchanged : bool
        Whether pictures have come with interchanged times.
    """

    def __init__(self, interval: float) -> None:
        self.has_interchanged = False
        self._interval = interval
        self._owed: Counter[int] = Counter()
        self._waiting: list[P] = []
        self._last: int | None = None

    def expect(self, pts: int | None) -> None:
        """Record that a packet with this time is sent to the decoder."""
        if pts is not None:
            self._owed[pts] += 1

    def drop(self, pts: int | None) -> None:
        """Record that the packet with this time produced no picture."""
        if pts is not None and self._owed[pts]:
            self._owed[pts] -= 1

    def push(self, picture: P) -> list[P]:
        """Record a picture that the decoder has output, and return the pictures that need not be held any longer."""
        self.drop(picture.pts)
        self._waiting.append(picture)
        times = [each.pts for each in self._waiting if each.pts is not None]
        if not times:
            return self.flush()
        self._owed = +self._owed
        if any(owed < max(times) for owed in self._owed):
            if len(self._waiting) <= MAX_REORDERED:
                return []
            self._owed = Counter({owed: count for owed, count in self._owed.items() if owed > max(times)})
        return self.flush()

    def flush(self) -> list[P]:
        """Return all held pictures in decoder output order, with their times in increasing order."""
        ready, self._waiting = self._waiting, []
        times = [picture.pts for picture in ready if picture.pts is not None]
        rising = sorted(times)
        self.has_interchanged |= times != rising
        if times != rising and self._are_plausible(rising):
            following = iter(rising)
            for picture in ready:
                if picture.pts is not None:
                    picture.pts = next(following)
        if times:
            self._last = rising[-1]
        return ready

    def _are_plausible(self, rising: list[int]) -> bool:
        before = [] if self._last is None else [self._last]
        return all(after - one >= self._interval / 2 for one, after in pairwise([*before, *rising]))
