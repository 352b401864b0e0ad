"""Decoded pictures whose presentation times are put in increasing order."""

from collections import Counter
from itertools import pairwise

from av import VideoFrame

MAX_REORDERED = 16
"""Maximum reordering of H.264 and HEVC, pictures; a packet that is later than this produced no picture."""


class ReorderBuffer:
    """Buffer that keeps pictures in decoder output order and assigns their presentation times in increasing order.

    AVI, and MP4 without composition offsets, store decoding times only; the presentation times that FFmpeg derives from
    them are wrong where pictures are reordered, but the order in which a decoder outputs pictures is right. Pictures
    wait only while the decoder still has to output one with an earlier time. If sorted times are closer than half the
    usual interval, they were not interchanged but damaged, and are left unchanged.

    Parameters
    ----------
    interval : float
        Usual interval between pictures, ticks.
    reorders : bool
        Whether the codec reorders pictures; if not, they pass at once.
    """

    def __init__(self, interval: float, *, reorders: bool = True) -> None:
        self.has_interchanged = False
        self._interval = interval
        self._reorders = reorders
        self._owed: Counter[int] = Counter()
        self._waiting: list[VideoFrame] = []
        self._last: list[int] = []
        """Latest time that was given out."""

    def expect(self, pts: int | None) -> None:
        """Record the time of a packet that was sent to the decoder, ticks."""
        if pts is not None:
            self._owed[pts] += 1

    def drop(self, pts: int | None) -> None:
        """Forget the time of a packet, whose picture came or will never come."""
        if pts is not None:
            self._owed -= Counter([pts])  # which forgets what is no longer owed

    def push(self, picture: VideoFrame) -> list[VideoFrame]:
        """Record a picture that the decoder has output, and return the pictures that need not wait any longer."""
        if not self._reorders:
            return [picture]
        self.drop(picture.pts)
        self._waiting.append(picture)
        latest = max((waiting.pts for waiting in self._waiting if waiting.pts is not None), default=None)
        if latest is not None and any(owed < latest for owed in self._owed):
            if len(self._waiting) <= MAX_REORDERED:
                return []
            self._owed = Counter({owed: count for owed, count in self._owed.items() if owed > latest})
        return self.flush()

    def flush(self) -> list[VideoFrame]:
        """Return all waiting pictures in decoder output order, with their times in increasing order."""
        ready = self._waiting
        self._waiting = []
        times = [picture.pts for picture in ready if picture.pts is not None]
        rising = sorted(times)
        self.has_interchanged |= times != rising
        apart = [after - before for before, after in pairwise([*self._last, *rising])]
        if times != rising and all(interval >= self._interval / 2 for interval in apart):
            following = iter(rising)
            for picture in ready:
                if picture.pts is not None:
                    picture.pts = next(following)
        self._last = rising[-1:] or self._last
        return ready
