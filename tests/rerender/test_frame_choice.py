"""Which frames to render at all: few where motion is simple, all where nothing can be predicted."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost.errors import InputError, OptionError
from fpsboost.rerender.frame_choice import LONGEST, as_ranges, choose_frames

HEIGHT, WIDTH = 48, 64
FIRST_WILD, LAST_WILD = 17, 25
"""Numbers between which each frame of `clip` is new."""


def clip(folder, numbers):
    """A gray level that rises by one a number, and noise from `FIRST_WILD` to `LAST_WILD`."""
    folder.mkdir()
    for number in numbers:
        image = np.full((HEIGHT, WIDTH, 3), 40 + number, np.uint8)
        if FIRST_WILD <= number <= LAST_WILD:
            image = np.random.default_rng(number).integers(0, 256, image.shape).astype(np.uint8)
        (folder / f"{number:04d}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    return folder


def test_frames_are_chosen_where_they_are_needed(tmp_path):
    """A level that rises evenly is mixed, however far apart; what is new in every frame is rendered."""
    choice = choose_frames(str(clip(tmp_path / "in", range(1, 34))), str(tmp_path / "out"), 35, method="blend")
    needed = set(range(FIRST_WILD, LAST_WILD + 1))
    assert needed <= set(choice.numbers)
    assert {1, 33} <= set(choice.numbers)
    assert len(choice.numbers) <= len(needed) + 5
    assert choice.lowest >= 35


def test_what_is_written(tmp_path):
    """Plain data, and a list as Blender takes it."""
    clip(tmp_path / "in", range(1, 34))
    choice = choose_frames(str(tmp_path / "in"), str(tmp_path / "out"), 35, method="blend")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["frames.json", "frames.txt"]
    data = json.loads((tmp_path / "out" / "frames.json").read_bytes())
    assert data["numbers"] == list(choice.numbers)
    assert data["total"] == choice.total == 33
    assert (tmp_path / "out" / "frames.txt").read_text() == data["ranges"].replace("-", "..") + "\n"


@given(numbers=st.sets(st.integers(0, 40), min_size=1))
def test_lists_hold_all_numbers(numbers):
    """Ranges and single numbers together are the numbers, in order."""
    parts = [list(map(int, part.split(".."))) for part in as_ranges(sorted(numbers), "..").split(",")]
    assert [number for part in parts for number in range(part[0], part[-1] + 1)] == sorted(numbers)


def test_what_cannot_be_chosen_from(tmp_path, snapshot):
    """Two images, names without numbers, every fourth frame, a quality that is none: one sentence, nothing written."""
    clip(tmp_path / "few", range(2))
    clip(tmp_path / "fourth", range(1, 14, 4))
    (tmp_path / "names").mkdir()
    for name in "abc":
        (tmp_path / "names" / f"{name}.png").write_bytes((tmp_path / "few" / "0000.png").read_bytes())
    before = snapshot(tmp_path)
    for folder, error, said in (
        ("few", InputError, "at least"),
        ("names", OptionError, "numbers"),
        ("fourth", OptionError, "rise by 4"),
    ):
        with pytest.raises(error, match=said):
            choose_frames(str(tmp_path / folder), str(tmp_path / "out"), 35)
    with pytest.raises(OptionError, match="quality"):
        choose_frames(str(tmp_path / "few"), str(tmp_path / "out"), 0)
    assert snapshot(tmp_path) == before


def test_the_command_says_what_it_chose(tmp_path, fpsboost_):
    """How many frames, and which; the options of regions do not go with it."""
    clip(tmp_path / "in", range(1, 2 * LONGEST))
    told = fpsboost_("plan", "in", "out", "--quality", "30dB", "-m", "blend")
    assert (told.code, told.err) == (0, "")
    assert f"of {2 * LONGEST - 1} frames" in told.out
    told = fpsboost_("plan", "in", "other", "--quality", "30", "--budget", "20%")
    assert (told.code, len(told.lines)) == (2, 1)
    assert "--quality" in told.err
    assert fpsboost_("plan", "in", "other", "--quality", "good").code == 2
