"""Pictures that come out of a decoder with each other's times.

AVI, and MP4 without composition offsets, say when a picture is decoded and not when it is shown; what FFmpeg makes of
that is wrong wherever pictures are reordered. The order in which a decoder hands pictures out is right.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import Generic, Protocol, TypeVar

MAX_REORDERED = 16
"""Pictures by which H.264 and HEVC may reorder; a packet that is later than this became no picture."""


class Timed(Protocol):
    """A picture with a time in ticks, or without one."""

    pts: int | None


P = TypeVar("P", bound=Timed)


class ShowingOrder(Generic[P]):
    """Hands pictures on in the order of the decoder, at their times in rising order.

    Pictures wait only while the decoder still owes one of an earlier time.

    Parameters
    ----------
    interval : float
        Usual distance of two pictures, ticks. Times that would lie closer than half of it when they are put in order
        were not exchanged but damaged, and are left as they are.
    """

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._owed: Counter[int] = Counter()
        self._waiting: list[P] = []
        self._last: int | None = None

    def expect(self, pts: int | None) -> None:
        """Note that a packet of this time goes into the decoder."""
        if pts is not None:
            self._owed[pts] += 1

    def lose(self, pts: int | None) -> None:
        """Note that a packet of this time became no picture."""
        if pts is not None and self._owed[pts]:
            self._owed[pts] -= 1

    def take(self, picture: P) -> list[P]:
        """Note that a picture came out; return those that need not wait any more."""
        self.lose(picture.pts)
        self._waiting.append(picture)
        times = [each.pts for each in self._waiting if each.pts is not None]
        if not times:
            return self.rest()
        self._owed = +self._owed
        if any(owed < max(times) for owed in self._owed):
            if len(self._waiting) <= MAX_REORDERED:
                return []
            self._owed = Counter({owed: count for owed, count in self._owed.items() if owed > max(times)})
        return self.rest()

    def rest(self) -> list[P]:
        """Return all that wait, in order."""
        ready, self._waiting = self._waiting, []
        times = [picture.pts for picture in ready if picture.pts is not None]
        rising = sorted(times)
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
