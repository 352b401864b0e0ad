"""Frames that show one moment: animation on twos and threes, repeats of pulldown, what a capture missed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from typing import NamedTuple

from fpsboost.frame import Frame
from fpsboost.prepared import PreparedImage
from fpsboost.scenes import DuplicateDetector


class Shown(NamedTuple):
    """A frame of the source, and what is computed from it."""

    frame: Frame
    image: PreparedImage


Held = tuple[Shown, ...]
"""Frames that follow each other and show the same; nearly always one."""


def one_by_one(frames: Iterable[Shown]) -> Iterator[Held]:
    """Every frame is a moment of its own."""
    for shown in frames:
        yield (shown,)


def by_moments(frames: Iterable[Shown], detector: DuplicateDetector) -> Iterator[Held]:
    """Put the frames together that show the same; a still, and whatever the clip ends with, come one by one.

    Parameters
    ----------
    frames : iterable of Shown
    detector : DuplicateDetector

    Yields
    ------
    tuple of Shown
        All frames, in order. No more are read ahead than a held picture may consist of.
    """
    for picture in find_pictures(frames, detector):
        yield from one_by_one(picture.frames) if picture.is_still else [picture.frames]


class Picture(NamedTuple):
    """Frames that follow each other and show one picture, or a part of them where it lasts long."""

    frames: Held
    is_still: bool
    """It lasts longer than the detector allows, or until the clip ends, so that nothing moves on from it."""
    repeats: int
    """So many of the frames, the last ones, show again what the frame before each of them shows."""


def find_pictures(frames: Iterable[Shown], detector: DuplicateDetector) -> Iterator[Picture]:
    """Tell which frames show the same.

    Frames are compared with the first of their kind and not with the one before, so that a slow fade or pan does not
    pass for a held picture.

    Parameters
    ----------
    frames : iterable of Shown
    detector : DuplicateDetector

    Yields
    ------
    Picture
        All frames, in order. No more are read ahead than a held picture may consist of.
    """
    arriving = iter(frames)
    waiting: deque[Shown] = deque()
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
    first: Shown, step: float, waiting: deque[Shown], arriving: Iterator[Shown], detector: DuplicateDetector
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
    first: Shown, repeats: bool, waiting: deque[Shown], arriving: Iterator[Shown], detector: DuplicateDetector
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
