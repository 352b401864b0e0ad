"""Which frames are hidden, where they lie between those that are shown, and which of them are a truth."""

from fractions import Fraction

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fpsboost import DecodeOptions, InputError, OptionError
from fpsboost.evaluation.hidden_frames import HoldOut, parse_range
from fpsboost.timing.position import Position, Trim
from support.comparison_truth import save_clip
from support.truth import moved_waves
from support.video_truth import write_clip


@pytest.fixture
def folder(tmp_path, save_images):
    """A folder of eleven images."""
    save_images(tmp_path / "clip", count=11)
    return str(tmp_path / "clip")


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(skip=st.integers(1, 4), first=st.integers(0, 5), length=st.integers(6, 12))
def test_shown_and_hidden_frames_follow_each_other_without_gaps(folder, skip, first, length):
    """Every interval begins where the last one ended; hidden frames lie evenly in it; only a rest is left out."""
    intervals = list(HoldOut(skip, first, first + length).intervals(folder))
    assert [each.shown0.position.number for each in intervals] == list(
        range(first, first + len(intervals) * (skip + 1), skip + 1)
    )
    assert len(intervals) == (min(11, first + length) - first - 1) // (skip + 1)
    for interval in intervals:
        assert [each.number - interval.shown0.position.number for each in interval.hidden] == list(range(1, skip + 1))
        assert [each.t for each in interval.hidden] == [Fraction(k, skip + 1) for k in range(1, skip + 1)]


def test_a_clip_that_is_too_short_is_refused(tmp_path, save_images):
    """In one sentence that says how many frames it takes."""
    save_images(tmp_path / "short", count=3)
    assert len(list(HoldOut().intervals(str(tmp_path / "short")))) == 1
    with pytest.raises(InputError, match=r"too few frames to hide 2 .* 4 are needed"):
        list(HoldOut(skip=2).intervals(str(tmp_path / "short")))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused(tmp_path, value):
    """The sentence names the frame."""
    for number in range(3):
        image = np.zeros((8, 9, 3), np.float32)
        image[2, 3, 1] = value if number == 1 else 0
        cv2.imwrite(str(tmp_path / f"{number}.tif"), image)
    with pytest.raises(InputError, match=r"Frame 1 of .* contains NaN or infinity"):
        list(HoldOut().intervals(str(tmp_path)))


def test_what_is_no_range_is_refused():
    """The sentence shows how ranges are written; too small a range, nothing to skip, or a frame before the first."""
    assert parse_range("2f:40f") == (2, 40)
    for text in ("", "3", "a:b", "1:2:3", "1.5:4", "2s:4s", "-1:"):
        with pytest.raises(OptionError, match="write it like"):
            parse_range(text)
    for options in ({"skip": 0}, {"first": -1}, {"first": 4, "last": 6}, {"skip": 3, "last": 4}):
        with pytest.raises(OptionError, match=r"`skip`|`range"):
            HoldOut(**options)


def save_pan(folder, positions):
    """A smooth texture at these places, one image each."""
    images = (np.rint(255 * moved_waves((48, 64), place, seed=3)).astype(np.uint8) for place in positions)
    return save_clip(folder, images)


def what_counts(intervals):
    """Number, place and whether it counts, of every hidden frame."""
    return [(each.number, each.t, interval.is_known) for interval in intervals for each in interval.hidden]


def test_a_repeat_is_neither_shown_nor_a_truth(tmp_path):
    """Frame 7 repeats frame 6: it is gone, and the frame after it does not count, since nobody knows its time."""
    path = save_pan(tmp_path / "clip", [0, 2, 4, 6, 8, 10, 12, 12, 14, 16, 18])
    intervals = list(HoldOut().intervals(path))
    half = Fraction(1, 2)
    assert what_counts(intervals) == [*((number, half, True) for number in (1, 3, 5)), (8, Fraction(2, 3), False)]
    fourth = intervals[3]
    assert (fourth.shown0.position.number, fourth.shown1.position.number, fourth.repeats) == (6, 9, (7,))
    kept = list(HoldOut(duplicates="keep").intervals(path))
    assert [each.hidden[0].number for each in kept] == [1, 3, 5, 7, 9]
    assert all(each.is_known and not each.repeats for each in kept)


def test_animation_on_twos_is_compared_by_its_drawings(tmp_path):
    """Every picture is shown twice: each drawing lies in the middle of the ones around it, and all count."""
    path = save_pan(tmp_path / "clip", [2 * (number // 2) for number in range(15)])
    half = Fraction(1, 2)
    assert what_counts(HoldOut().intervals(path)) == [(2, half, True), (6, half, True), (10, half, True)]


def test_a_still_does_not_count_and_slow_motion_does(tmp_path):
    """Where nothing moves for long there is nothing to make; a slow pan counts to its end."""
    still = save_pan(tmp_path / "still", [0, 2, 4, 6] + [8] * 10 + [10, 12, 14])
    assert [number for number, _, counts in what_counts(HoldOut().intervals(still)) if counts] == [1, 3, 15]
    y, x = np.mgrid[:48, :64].astype(float)
    images = (128 + 40 * np.sin((x + 0.3 * number) / 9) * np.cos(y / 11) for number in range(15))
    slow = save_clip(tmp_path / "slow", (np.rint(image).astype(np.uint8) for image in images))
    assert all(counts for *_, counts in what_counts(HoldOut().intervals(slow)))


@pytest.mark.parametrize(
    ("times", "ticks", "rate", "expected"),
    [
        ([0, 4, 8, 12, 16, 18, 24, 27, 32], 100, 25, [(0.5, True), (0.5, True), (0.25, True), (0.375, True)]),
        ([0, 33, 67, 100, 133, 167, 200], 1000, 30, [(0.5, True)] * 3),
        ([0, 4, 8, 12, 16, 216, 220], 100, 25, [(0.5, True), (0.5, True), (200 / 204, False)]),
    ],
    ids=["uneven", "rounded", "a pause"],
)
def test_frames_are_made_at_their_own_times(tmp_path, times, ticks, rate, expected):
    """Evenly where a clock has rounded, else where the clip says; a pause does not count."""
    path = write_clip(tmp_path / "a.mkv", times=times, time_base=Fraction(1, ticks), rate=Fraction(rate))
    assert [(float(t), counts) for _, t, counts in what_counts(HoldOut().intervals(str(path)))] == expected


@pytest.mark.parametrize(("start", "end"), [("10f", "17f"), ("0.4", "0.68"), ("0.4", "17f")])
@pytest.mark.parametrize("counts_frames", [False, True])
def test_a_part_by_times_is_that_by_frames(tmp_path, start, end, counts_frames):
    """--start and --end, gone to at once or read up to, give the frames of --range with their numbers and moments."""
    path = write_clip(tmp_path / "a.mp4", times=range(30), options={"g": "6", "crf": "0"})
    trim = Trim(Position.parse(start, "--start"), Position.parse(end, "--end"))
    by_frames = list(HoldOut(first=10, last=17).intervals(str(path)))
    by_times = list(HoldOut(decoding=DecodeOptions(trim=trim), counts_frames=counts_frames).intervals(str(path)))
    assert [each.hidden[0].number for each in by_times] == [11, 13, 15]
    for one, other in zip(by_frames, by_times, strict=True):
        assert one.shown0.position == other.shown0.position
        assert one.shown1.position == other.shown1.position
        np.testing.assert_array_equal(one.hidden[0].truth, other.hidden[0].truth)


def test_a_part_of_images_keeps_their_numbers(folder):
    """By frames, and by times where the rate is given."""
    for start, rate in (("3f", None), ("0.3", Fraction(10))):
        trim = Trim(Position.parse(start, "`start`"))
        hold_out = HoldOut(decoding=DecodeOptions(trim, input_fps=rate))
        assert [each.shown0.position.number for each in hold_out.intervals(folder)] == [3, 5, 7]
    with pytest.raises(OptionError, match="`input_fps`"):
        list(HoldOut(decoding=DecodeOptions(trim=trim)).intervals(folder))


def test_options_say_what_they_were_made_of():
    """The words of the command line that give the same again, and none for the defaults."""
    trim = Trim(Position.parse("1:30.5", "--start"), Position.parse("2700f", "--end"))
    hold_out = HoldOut(
        2, decoding=DecodeOptions(trim, 24, stream=1, deinterlace=True, size_change="scale"), duplicates="keep"
    )
    words = "--skip 2 --duplicates keep --start 90.5 --end 2700f --input-fps 24 --stream 1 --deinterlace --size-change"
    assert hold_out.as_options() == [*words.split(), "scale"]
    assert HoldOut().as_options() == []
    assert HoldOut(first=3).as_options() == ["--range", "3:"]
    with pytest.raises(OptionError, match="`range` and `start` cannot be combined"):
        HoldOut(first=3, decoding=DecodeOptions(trim=trim))
