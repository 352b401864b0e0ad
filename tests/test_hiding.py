"""Which frames are hidden, and where they lie between those that are shown."""

from __future__ import annotations

from fractions import Fraction

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fpsboost.errors import InputError, OptionError
from fpsboost.evaluation.hiding import Hiding, parse_range


@pytest.fixture
def folder(tmp_path, save_images):
    """A folder of eleven images."""
    save_images(tmp_path / "clip", count=11)
    return str(tmp_path / "clip")


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(skip=st.integers(1, 4), first=st.integers(0, 5), length=st.integers(6, 12))
def test_shown_and_hidden_frames_follow_each_other_without_gaps(folder, skip, first, length):
    """Every interval begins where the last one ended; hidden frames lie evenly in it; only a rest is left out."""
    intervals = list(Hiding(skip, first, first + length).intervals(folder))
    assert [each.number for each in intervals] == list(range(first, first + len(intervals) * (skip + 1), skip + 1))
    available = min(11, first + length) - first
    assert len(intervals) == (available - 1) // (skip + 1)
    for interval in intervals:
        assert [each.number - interval.number for each in interval.hidden] == list(range(1, skip + 1))
        assert [each.t for each in interval.hidden] == [Fraction(k, skip + 1) for k in range(1, skip + 1)]


def test_frames_are_those_of_the_clip(folder, tmp_path):
    """Pixel for pixel."""
    images = [cv2.imread(str(path)) for path in sorted((tmp_path / "clip").iterdir())]
    for interval in Hiding().intervals(folder):
        np.testing.assert_array_equal(interval.shown0.image, images[interval.number])
        np.testing.assert_array_equal(interval.hidden[0].truth, images[interval.number + 1])
        np.testing.assert_array_equal(interval.shown1.image, images[interval.number + 2])


def test_a_clip_that_is_too_short_is_refused(tmp_path, save_images):
    """In one sentence that says how many frames it takes."""
    save_images(tmp_path / "short", count=3)
    assert len(list(Hiding().intervals(str(tmp_path / "short")))) == 1
    with pytest.raises(InputError, match=r"too few frames to hide 2 .* 4 are needed"):
        list(Hiding(skip=2).intervals(str(tmp_path / "short")))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused(tmp_path, value):
    """The sentence names the frame."""
    for number in range(3):
        image = np.zeros((8, 9, 3), np.float32)
        image[2, 3, 1] = value if number == 1 else 0
        cv2.imwrite(str(tmp_path / f"{number}.tif"), image)
    with pytest.raises(InputError, match=r"Frame 1 of .* no numbers"):
        list(Hiding().intervals(str(tmp_path)))


def test_frames_of_several_sizes_are_refused(tmp_path):
    """In the source's own sentence."""
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros((8, 9 + number, 3), np.uint8))
    with pytest.raises(InputError, match="9x8"):
        list(Hiding().intervals(str(tmp_path)))


@pytest.mark.parametrize(("text", "expected"), [(":", (0, None)), ("3:", (3, None)), (":9", (0, 9)), ("3:9", (3, 9))])
def test_ranges_are_read(text, expected):
    """Either end may be left out."""
    assert parse_range(text) == expected


@pytest.mark.parametrize("text", ["", "3", "a:b", "1:2:3", "1.5:4"])
def test_what_is_no_range_is_refused(text):
    """The sentence shows how ranges are written."""
    with pytest.raises(OptionError, match="write it like"):
        parse_range(text)


@pytest.mark.parametrize("options", [{"skip": 0}, {"first": -1}, {"first": 4, "last": 6}, {"skip": 3, "last": 4}])
def test_hiding_nothing_is_refused(options):
    """Too small a range, nothing to skip, or a frame before the first."""
    with pytest.raises(OptionError, match=r"--skip|--range"):
        Hiding(**options)
