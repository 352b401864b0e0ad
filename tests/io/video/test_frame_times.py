"""Times of frames, put right."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost.io.video.clock import in_rising_order
from fpsboost.io.video.remarks import Damage

TICK = Fraction(1, 1000)
INTERVAL = Fraction(1, 25)


def ordered(milliseconds, damage=None):
    """Numbers and times, in milliseconds, of the frames that come out; only the last says that it is the last."""
    timed = [(number, Fraction(time, 1000)) for number, time in enumerate(milliseconds)]
    found = list(in_rising_order(timed, INTERVAL, TICK, damage or Damage()))
    assert [is_last for _, _, is_last in found] == [number == len(found) for number in range(1, len(found) + 1)]
    return [(number, int(time * 1000)) for number, time, _ in found]


def test_good_times_pass():
    """Whatever rises comes out as it is, however uneven."""
    times = [-40, 0, 1, 2, 500, 90_000, 90_001]
    damage = Damage()
    assert ordered(times, damage) == list(enumerate(times))
    assert damage == Damage()


@pytest.mark.parametrize(
    ("times", "expected", "counts"),
    [
        ([0, 40, 80, 70, 160], [0, 40, 80, 120, 160], {"displaced": 1}),
        ([0, 40, 30, 20, 160], [0, 40, 80, 120, 160], {"displaced": 2}),
        ([0, 40, 40, 80], [0, 40, None, 80], {"misplaced": 1}),
        ([0, 40, 20], [0, 40, None], {"misplaced": 1}),
        ([0, 40, 99_000, 120, 160], [0, 40, 80, 120, 160], {"far_ahead": 1}),
        ([99_000, 40, 80], [0, 40, 80], {"far_ahead": 1}),
    ],
    ids=["late", "two late", "no room", "at the end", "far ahead", "first far ahead"],
)
def test_bad_times_are_put_right(times, expected, counts):
    """A frame with a wrong time goes where its neighbours leave room, or is left out, and is counted."""
    damage = Damage()
    assert ordered(times, damage) == [(number, time) for number, time in enumerate(expected) if time is not None]
    assert damage == Damage(**counts)


def test_a_clock_that_jumps_back():
    """Two recordings joined: the second goes on where the first ends, frame by frame."""
    damage = Damage()
    times = [*range(0, 400, 40), *range(0, 800, 40), *range(0, 400, 40)]
    assert ordered(times, damage) == list(enumerate(range(0, 1600, 40)))
    assert damage == Damage(jumps=2)


@given(st.lists(st.integers(-200, 3000), max_size=60))
def test_times_rise_whatever_comes(times):
    """In any order: times strictly increase, frames keep their order, and each is there or counted."""
    damage = Damage()
    found = ordered(times, damage)
    assert all(one[0] < other[0] and one[1] < other[1] for one, other in pairwise(found))
    assert len(found) + damage.misplaced == len(times)
