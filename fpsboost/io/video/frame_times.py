"""Repair presentation times so that they strictly increase, where damaged or faulty files allow it.

Decoders output frames in presentation order, so that order is trusted more than the times.
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
"""Number of consecutive frames, each not later than the last good one, that ends the wait for a later frame.

If the times of these frames increase, the clock has jumped back.
"""


def in_rising_order(
    timed: Iterable[tuple[T, Fraction]], interval: Fraction, tick: Fraction, damage: Damage
) -> Iterator[tuple[T, Fraction, bool]]:
    """Yield frames at strictly increasing times, each as soon as the next valid time is known; say which is the last.

    A frame far ahead of the next one is moved back to follow the frame before it. Frames not later than the frame
    before them are spread over the gap that follows, as many as fit; the others are left out. If the clock jumps back,
    as in joined recordings, all later times are offset to continue from there.

    Parameters
    ----------
    timed : iterable of (frame, Fraction)
        Frames in presentation order with their times, seconds.
    interval : Fraction
        Usual frame interval, seconds.
    tick : Fraction
        Seconds per tick; repaired times are offset by multiples of it.
    damage : Damage
        Counts of the frames that were repaired and left out, which are updated.
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
                fitting = _spread_evenly([each for each, _ in strays], last[1], time, interval, tick)
                damage.displaced += len(fitting)
                damage.misplaced += len(strays) - len(fitting)
                following = [*fitting, *following]
        strays = []
        for each in following:
            if last is not None:
                yield *last, False
                before = last[1]
            last = each
    damage.misplaced += len(strays)
    if last is not None:
        yield *last, True


def _is_far_ahead(before: Fraction | None, time: Fraction, after: Fraction, interval: Fraction) -> bool:
    """Return whether `time`, between `before` and `after`, is damaged: far ahead, so that `after` seems too early."""
    far = max(Fraction(1), 10 * interval)
    return after <= time and (time - after > far if before is None else before < after and time - before > far)


def _spread_evenly(
    strays: list[T], begin: Fraction, end: Fraction, interval: Fraction, tick: Fraction
) -> list[tuple[T, Fraction]]:
    """Return the frames that fit between two times, with times spread evenly between them."""
    room = round((end - begin) / interval) - 1
    fitting = strays[: max(room, 0)]
    step = (end - begin) / (len(fitting) + 1)
    places = [begin + math.floor(step * (number + 1) / tick) * tick for number in range(len(fitting))]
    return list(zip(fitting, places, strict=True)) if step > tick else []
