"""Times of frames made to rise: what a damaged or careless file says wrong is put right where that can be known.

Decoders hand out frames in the order of showing, so that order is trusted more than the times.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import pairwise
from typing import TypeVar

from fpsboost.io.video.damage import Damage

T = TypeVar("T")

MAX_WAITING = 8
"""Frames with times no later than the one before that wait for what follows; so many in good order are a jump."""


def in_rising_order(
    timed: Iterable[tuple[T, Fraction]], interval: Fraction, tick: Fraction, damage: Damage
) -> Iterator[tuple[T, Fraction]]:
    """Yield frames at times that strictly increase, each when the next good time is known.

    A frame far ahead of all that follows goes back behind the one before it. Frames no later than the one before fill
    the gap that follows, as many as would have fitted; the others are left out. Where the clock jumps back, as in
    recordings that were joined, everything behind goes on from there.

    Parameters
    ----------
    timed : iterable of (frame, Fraction)
        In the order of showing.
    interval : Fraction
        Usual distance of two frames, seconds.
    tick : Fraction
        Times that are made up are multiples of it.
    damage : Damage
        Counts what was put right, and what was left out.
    """
    before: Fraction | None = None
    last: tuple[T, Fraction] | None = None
    strays: list[tuple[T, Fraction]] = []
    shift = Fraction(0)
    for frame, said in timed:
        time = said + shift
        if last is not None and _is_far_ahead(before, last[1], time, interval):
            last = last[0], time - interval if before is None else before + min(interval, (time - before) / 2)
            damage.far_ahead += 1
        if last is not None and time <= last[1]:
            strays.append((frame, time))
            if len(strays) < MAX_WAITING:
                continue
            rising = all(one < other for (_, one), (_, other) in pairwise(strays))
            ahead = last[1] + math.ceil(interval / tick) * tick - strays[0][1]
            following = [(each, at + ahead) for each, at in strays] if rising else strays[:0]
            shift += ahead if rising else 0
            damage.jumps += rising
            damage.misplaced += 0 if rising else len(strays)
        else:
            following = [(frame, time)]
            if last is not None:
                fitting = _filling([each for each, _ in strays], last[1], time, interval, tick)
                damage.displaced += len(fitting)
                damage.misplaced += len(strays) - len(fitting)
                following = [*fitting, *following]
        strays = []
        for each in following:
            if last is not None:
                yield last
                before = last[1]
            last = each
    damage.misplaced += len(strays)
    if last is not None:
        yield last


def _is_far_ahead(before: Fraction | None, time: Fraction, after: Fraction, interval: Fraction) -> bool:
    """Whether the time of the frame in the middle is damaged, so that the one after it seems to come too early."""
    far = max(Fraction(1), 10 * interval)
    return after <= time and (time - after > far if before is None else before < after and time - before > far)


def _filling(
    strays: list[T], begin: Fraction, end: Fraction, interval: Fraction, tick: Fraction
) -> list[tuple[T, Fraction]]:
    """The frames that would have fitted between two times, evenly between them."""
    room = round((end - begin) / interval) - 1
    fitting = strays[: max(room, 0)]
    step = (end - begin) / (len(fitting) + 1)
    places = [begin + math.floor(step * (number + 1) / tick) * tick for number in range(len(fitting))]
    return list(zip(fitting, places, strict=True)) if step > tick else []
