"""Edits as data: which frame is shown when."""

from fractions import Fraction

import pytest

from fpsboost.media import ClipInfo, TimeMap
from fpsboost.timing.edit import BLOCK, Edit

TIMES = [Fraction(number, 4) for number in range(8)]


def test_gaps_move_all_later_frames():
    """Each missing frame takes an interval, and the frame behind a gap is known by its place."""
    edit = Edit.whole(TIMES[:4]).with_gaps([0, 2, 1], Fraction(1, 4))
    assert [time * 4 for time in edit.times] == [0, 1, 4, 6]
    assert (list(edit.frames), edit.after_gaps) == ([0, 1, 2, 3], {2, 3})
    info = edit.of_info(ClipInfo("in.mp4", 2, 2, Fraction(4), Fraction(1, 4), 4, Fraction(1)))
    assert (info.frame_count, info.duration) == (4, Fraction(7, 4))


@pytest.mark.parametrize("context", [2, 5])
def test_a_loop_goes_on_beyond_both_ends(context):
    """With frames of the rounds around it, even where a round has fewer, and times that rise without a step."""
    edit = Edit.whole(TIMES[:3]).looped(Fraction(3, 4), context)
    assert list(edit.frames) == [number % 3 for number in range(-context, 3 + context)]
    assert [time * 4 for time in edit.times] == list(range(-context, 3 + context))


def test_a_curve_that_falls_shows_frames_again():
    """There and back at the same speed: each frame twice, and a curve that only rises."""
    there_and_back = TimeMap.through([(Fraction(number), Fraction(number % 2)) for number in range(3)])
    edit, curve = Edit.whole(TIMES).unfolded(there_and_back)
    assert edit.frames == [0, 1, 2, 3, 4, 3, 2, 1, 0]
    assert edit.times == sorted(edit.times)
    assert not curve.reverses
    assert [curve.source(time) for time in (Fraction(1, 2), Fraction(3, 2))] == [Fraction(1, 2), Fraction(3, 2)]


@pytest.mark.parametrize(
    ("frames", "runs"),
    [
        ([0, 1, 3, 7], [[0, 1, 3, 7]]),
        ([4, 3, 2, 3, 4], [[4, 3, 2], [3, 4]]),
        ([1, 1, 1], [[1], [1], [1]]),
        ([*range(BLOCK + 2, 0, -1)], [[*range(BLOCK + 2, 2, -1)], [2, 1]]),
    ],
)
def test_runs_rise_or_are_short(frames, runs):
    """What rises is read at once; what falls is kept in memory, and so comes in blocks."""
    assert list(Edit(frames, [Fraction(0)] * len(frames)).runs(0)) == runs
    assert list(Edit(frames, [Fraction(0)] * len(frames)).runs(len(frames))) == []
