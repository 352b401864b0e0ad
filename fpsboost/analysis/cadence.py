"""Cadence of repeated frames: pulldown, captures faster than what they show, animation on twos and threes.

Frames that repeat a picture are found by `group_duplicates`. Where the numbers of repeats form a pattern, the clip
holds pictures of a lower, constant rate, and one frame of each picture gives that rate back.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import groupby

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, group_duplicates
from fpsboost.timing.edit import Edit

NUMBERS = dict(
    enumerate(["two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"], 2)
)
CYCLES = (*((p, q) for q in NUMBERS for p in range(1, q) if math.gcd(p, q) == 1), (24, 25))
"""Numbers of pictures and of frames of all cadences that are looked for."""
MIN_CYCLES = 5  # number of cycles that must be seen
MIN_SHARE = 0.9
"""Least share of the stretches that follow a certain cadence; edits after the pulldown break it."""
MAX_BREAK = 3
"""Longest break of a certain cadence, in cycles; a longer one is a part with another rate."""


@dataclass(frozen=True)
class Cadence:
    """Cadence of a clip: of so many consecutive frames, wherever they begin, so many show a new picture.

    Examples
    --------
    >>> cycles = (1, 2, 30), (1, 2, 12), (2, 5, 24), (4, 5, 24), (5, 12, 25)
    >>> [Cadence(pictures, frames, Fraction(rate), 1.0, True).name for pictures, frames, rate in cycles]
    ['2:2', 'on twos', '3:2', 'one of five repeated', '5 pictures in 12 frames']
    """

    pictures: int
    frames: int
    rate: Fraction
    """Pictures per second."""
    share: float
    """Share of the stretches of so many frames that have so many new pictures, of those in which motion shows it."""
    is_certain: bool
    """Whether the whole clip follows it, but for short breaks."""

    @property
    def name(self) -> str:
        """What the cadence is called."""
        number = NUMBERS.get(self.frames, self.frames)
        if self.pictures == 1:  # no film has fewer than 20 pictures per second, and hardly any animation more
            return f"on {number}s" if self.rate < 20 else f"{self.frames}:{self.frames}"
        if self.pictures == self.frames - 1:
            return f"one of {number} repeated"
        return "3:2" if (self.pictures, self.frames) == (2, 5) else f"{self.pictures} pictures in {self.frames} frames"


@dataclass
class Repeats:
    """Repeated frames of a clip, collected while its frames pass through `groups`."""

    detector: DuplicateDetector
    times: list[Fraction] = field(default_factory=list)
    """Times of all frames, seconds."""
    differences: list[float] = field(default_factory=list)
    """Difference of every frame from the one before it, 8-bit levels; infinite for the first one."""
    are_repeats: list[bool] = field(default_factory=list)
    """Whether a frame repeats the one before it; False in a still, which is kept."""

    def groups(self, frames: Iterable[SourceFrame]) -> Iterator[tuple[SourceFrame, ...]]:
        """Yield the groups of `group_duplicates`, and note them."""
        for group in group_duplicates(self._measured(frames), self.detector):
            self.are_repeats += [each is not group[0] for each in group]
            yield group

    def _measured(self, frames: Iterable[SourceFrame]) -> Iterator[SourceFrame]:
        before: SourceFrame | None = None
        for frame in frames:
            self.times.append(frame.time)
            self.differences.append(math.inf if before is None else self.detector.difference(before, frame))
            yield frame
            before = frame

    def cadence(self, rate: Fraction) -> Cadence | None:
        """Return the cadence that most frames follow; None if the rate varies, or too few frames tell.

        `rate` is the nominal one of the clip. Only stretches count whose frames are all either repeats or in clear
        motion: neither stills nor motion that is as small as the noise in repeats tell where a picture begins.
        """
        repeats = np.array(self.are_repeats, bool)
        is_clear = repeats | (np.array(self.differences) > self.detector.noise)
        # the times of a constant rate are off by rounding and jitter alone
        varies = any(abs((time - self.times[0]) * rate - number) > 0.25 for number, time in enumerate(self.times))
        found = list[Cadence]()
        for pictures, frames in (cycle for cycle in CYCLES if MIN_CYCLES * cycle[1] < len(repeats) and not varies):
            counted = sliding_window_view(is_clear, frames).all(axis=1)
            follows = (sliding_window_view(repeats, frames).sum(axis=1) == frames - pictures)[counted]
            if len(follows) >= MIN_CYCLES * frames and follows.any():
                share = float(follows.mean())
                longest = max((sum(1 for _ in run) for value, run in groupby(follows) if not value), default=0)
                is_certain = share >= MIN_SHARE and longest <= MAX_BREAK * frames
                found.append(Cadence(pictures, frames, rate * pictures / frames, share, is_certain))
        return max(found, key=lambda each: each.share, default=None)

    def kept(self, cadence: Cadence | None) -> Edit:
        """Return the edit without repeats.

        With a certain cadence, they are as many as it says, at evenly spaced times, in stills too; otherwise those that
        are no repeats, at their own times.
        """
        if cadence is None or not cadence.is_certain:
            numbers = [number for number, is_repeat in enumerate(self.are_repeats) if not is_repeat]
            return Edit(numbers, [self.times[number] for number in numbers])
        numbers = self._evenly_chosen(cadence.pictures, cadence.frames)
        return Edit(numbers, [self.times[0] + number / cadence.rate for number in range(len(numbers))])

    def _evenly_chosen(self, pictures: int, frames: int) -> list[int]:
        """Return the numbers of so many of every so many frames: those that show a new picture.

        A frame does so if it differs clearly from the one before, or where motion is small, more than most others of
        the cycle around it. So the pattern may begin anywhere, and change where the clip was edited; there, pictures
        are shown up to one interval too early or too late, and beyond that left out or repeated. Once there are
        as many as the clip has room for, a clear difference is taken for noise, as encoders leave it in last frames.
        """
        chosen = list[int]()
        for number, (difference, is_repeat) in enumerate(zip(self.differences, self.are_repeats, strict=True)):
            # the cycle leaves out the first frame, whose difference says nothing
            begin = max(1, min(number - frames // 2, len(self.differences) - frames))
            least = sorted(self.differences[begin : begin + frames])[-pictures:][0]
            lacks = len(chosen) < Fraction(len(self.differences) * pictures, frames)
            is_new = difference >= least or (lacks and difference > self.detector.noise and not is_repeat)
            ahead = len(chosen) - Fraction(number * pictures, frames)
            if (is_new and ahead < 1) or ahead <= -1:
                chosen.append(number)
        return chosen
