"""Frames that show one moment: animation on twos and threes, repeats of pulldown, what a capture missed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame import Frame, Pixels
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.colour import Components, colour_components, gray
from fpsboost.ycbcr import YCbCrImage


@dataclass(frozen=True)
class DuplicateDetector:
    """A duplicate is a frame that shows the same as one before, up to the noise of an encoder.

    Two frames differ by as much as their most different block does, so that a mouth that moves in a still picture
    counts. What encoders do to a repeated frame reaches a few levels there and is not to be told from a slow fade by
    itself; but where a picture is held between moves, those are several times as large.

    Parameters
    ----------
    noise : float
        Largest difference of a duplicate, in levels of 8 bits. Of the duplicates of two clips found in the wild,
        the noisiest differed by 5 levels, and pairs in motion by 10 and more.
    share : float
        Largest difference of a duplicate, as a share of the steps before and after it. Same clips: below 0.1.
    smallest_step : float
        Levels by which a picture that moves on differs at least; below it, nobody sees the difference.
    block : int
        Side of the blocks, pixels.
    longest : Fraction
        Seconds that a held picture may last; one that lasts longer is a still. Animation on fours lasts 1/6.
    most : int
        Frames that a held picture may consist of; so many are kept in memory.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    noise: float = 6.0
    share: float = 0.25
    smallest_step: float = 3.0
    block: int = 16
    longest: Fraction = Fraction(1, 4)
    most: int = 8

    def __post_init__(self) -> None:
        if not 0 <= self.noise <= 255:
            raise OptionError(f"noise must be 0 to 255 levels, not {self.noise}.")
        if not 0 <= self.share < 1:
            raise OptionError(f"share must be at least 0 and below 1, not {self.share}.")
        if not 0 < self.smallest_step <= 255:
            raise OptionError(f"smallest_step must be above 0 and at most 255 levels, not {self.smallest_step}.")
        if self.block < 1 or self.most < 1 or self.longest < 0:
            raise OptionError("block and most must be at least 1, and longest not below 0; change the detector.")

    def difference(self, image0: FrameCache, image1: FrameCache) -> float:
        """Mean difference of brightness in the block where it is largest, in levels of 8 bits."""
        difference = cv2.absdiff(image0.cached(brightness), image1.cached(brightness))
        return float(cv2.boxFilter(difference, cv2.CV_32F, (self.block, self.block)).max())

    def is_held(self, noise: float, before: float, after: float) -> bool:
        """Whether frames show one picture that was held.

        Parameters
        ----------
        noise : float
            The largest difference of one of them from the first; see `difference`.
        before, after : float
            The differences to where the picture came from, and to where it moves on.
        """
        return noise <= self.noise and noise <= self.share * min(before, after) and self.smallest_step <= after

    def repeats_still(self, noise: float, before: float) -> bool:
        """Whether frames that go on to differ little repeat one picture; in slow motion they differ as little.

        Parameters
        ----------
        noise : float
            The largest difference of one of them from the first; see `difference`.
        before : float
            The difference to where the picture came from; infinite where the clip begins with it.
        """
        return noise <= (self.smallest_step if math.isinf(before) else min(self.noise, self.share * before))


def brightness(image: Pixels) -> Components:
    """Levels of 8 bits; whole ones for images of 8 bits, exact and beyond white for others."""
    if image.dtype == np.uint8:
        return gray(image)
    if isinstance(image, YCbCrImage):
        black, span, _, _ = image.coding.levels
        return (image.planes[0].astype(np.float32) - np.float32(black)) * np.float32(255 / span)
    colours = colour_components(image)
    luma = colours[..., 0] if image.shape[2] < 3 else cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    return np.asarray(luma * np.float32(255))


class SourceFrame(NamedTuple):
    """A frame of the source, and what is computed from it."""

    frame: Frame
    image: FrameCache


FrameGroup = tuple[SourceFrame, ...]
"""Frames that follow each other and show the same; nearly always one."""


def group_singly(frames: Iterable[SourceFrame]) -> Iterator[FrameGroup]:
    """Every frame is a moment of its own."""
    for shown in frames:
        yield (shown,)


def group_duplicates(frames: Iterable[SourceFrame], detector: DuplicateDetector) -> Iterator[FrameGroup]:
    """Put the frames together that show the same; a still, and whatever the clip ends with, come one by one.

    Parameters
    ----------
    frames : iterable of SourceFrame
    detector : DuplicateDetector

    Yields
    ------
    tuple of Shown
        All frames, in order. No more are read ahead than a held picture may consist of.
    """
    for picture in find_pictures(frames, detector):
        yield from group_singly(picture.frames) if picture.is_still else [picture.frames]


class Picture(NamedTuple):
    """Frames that follow each other and show one picture, or a part of them where it lasts long."""

    frames: FrameGroup
    is_still: bool
    """It lasts longer than the detector allows, or until the clip ends, so that nothing moves on from it."""
    repeats: int
    """So many of the frames, the last ones, show again what the frame before each of them shows."""


def find_pictures(frames: Iterable[SourceFrame], detector: DuplicateDetector) -> Iterator[Picture]:
    """Tell which frames show the same.

    Frames are compared with the first of their kind and not with the one before, so that a slow fade or pan does not
    pass for a held picture.

    Parameters
    ----------
    frames : iterable of SourceFrame
    detector : DuplicateDetector

    Yields
    ------
    Picture
        All frames, in order. No more are read ahead than a held picture may consist of.
    """
    arriving = iter(frames)
    waiting: deque[SourceFrame] = deque()
    step = math.inf
    while True:
        first = waiting.popleft() if waiting else next(arriving, None)
        if first is None:
            return
        found = _length(first, step, waiting, arriving, detector)
        step = found.step
        repeats = [waiting.popleft() for _ in range(found.frames - 1)]
        yield Picture((first, *repeats), found.is_still, len(repeats) if found.repeats else 0)
        if found.is_still:
            step = yield from _rest_of_still(first, found.repeats, waiting, arriving, detector)


class _Length(NamedTuple):
    """How many frames show the same, the first included, whether they are a still, and the step after them."""

    frames: int
    is_still: bool
    step: float
    repeats: bool
    """Whether they repeat the first, and do not just differ too little from it, as in slow motion."""


def _length(
    first: SourceFrame,
    step: float,
    waiting: deque[SourceFrame],
    arriving: Iterator[SourceFrame],
    detector: DuplicateDetector,
) -> _Length:
    """How many frames show the same as `first`; `step` is the one that led to it. What is read waits."""
    differences: list[float] = []
    while True:
        count = len(differences) + 1
        noise = max(differences, default=0.0)
        if count > len(waiting):
            following = next(arriving, None)
            if following is None:  # nothing moves on any more
                return _Length(count, True, 0.0, detector.repeats_still(noise, step))
            waiting.append(following)
        following = waiting[count - 1]
        lasts = following.frame.time - first.frame.time
        difference = detector.difference(first.image, following.image)
        if differences and detector.is_held(noise, step, difference):
            return _Length(count, lasts > detector.longest, difference, True)
        differences.append(difference)
        if difference > detector.noise:  # motion, or a slow change that has added up
            return _Length(1, False, differences[0], True)
        if count == detector.most or lasts > detector.longest:
            return _Length(count, True, difference, detector.repeats_still(max(differences), step))


def _rest_of_still(
    first: SourceFrame,
    repeats: bool,
    waiting: deque[SourceFrame],
    arriving: Iterator[SourceFrame],
    detector: DuplicateDetector,
) -> Generator[Picture, None, float]:
    """The frames that still show the same as `first`, one by one; return the step after them."""
    while True:
        if not waiting:
            following = next(arriving, None)
            if following is None:
                return 0.0
            waiting.append(following)
        difference = detector.difference(first.image, waiting[0].image)
        if difference > detector.noise:
            return difference
        yield Picture((waiting.popleft(),), True, int(repeats))
