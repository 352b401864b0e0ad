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
    """Put the frames together that show the same.

    Frames are compared with the first of their kind and not with the one before, so that a slow fade or pan does not
    pass for a held picture. A still, which lasts longer than the detector allows, and whatever the clip ends with come
    one by one.

    Parameters
    ----------
    frames : iterable of Shown
    detector : DuplicateDetector

    Yields
    ------
    tuple of Shown
        All frames, in order. No more are read ahead than a held picture may consist of.
    """
    arriving = iter(frames)
    waiting: deque[Shown] = deque()
    step = math.inf
    while True:
        first = waiting.popleft() if waiting else next(arriving, None)
        if first is None:
            return
        count, is_still, step = _length(first, step, waiting, arriving, detector)
        repeats = [waiting.popleft() for _ in range(count - 1)]
        if is_still:
            yield from one_by_one([first, *repeats])
            step = yield from _rest_of_still(first, waiting, arriving, detector)
        else:
            yield (first, *repeats)


def _length(
    first: Shown, step: float, waiting: deque[Shown], arriving: Iterator[Shown], detector: DuplicateDetector
) -> tuple[int, bool, float]:
    """How many frames show the same as `first`, itself included, whether they are a still, and the step after them.

    `step` is the one that led to `first`. What is read waits.
    """
    differences: list[float] = []
    while True:
        count = len(differences) + 1
        noise = max(differences, default=0.0)
        if count > len(waiting):
            following = next(arriving, None)
            if following is None:  # nothing moves on any more
                return count, True, 0.0
            waiting.append(following)
        following = waiting[count - 1]
        lasts = following.frame.time - first.frame.time
        difference = detector.difference(first.image, following.image)
        if differences and detector.is_held(noise, step, difference):
            return count, lasts > detector.longest, difference
        differences.append(difference)
        if difference > detector.noise:  # motion, or a slow change that has added up
            return 1, False, differences[0]
        if count == detector.most or lasts > detector.longest:
            return count, True, difference


def _rest_of_still(
    first: Shown, waiting: deque[Shown], arriving: Iterator[Shown], detector: DuplicateDetector
) -> Generator[Held, None, float]:
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
        yield (waiting.popleft(),)
