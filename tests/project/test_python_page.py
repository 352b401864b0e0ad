"""The page about Python: its code about progress is run."""

import re
from pathlib import Path

import pytest

import fpsboost
from support.video_truth import write_clip

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def code_with(text: str) -> str:
    """Return the block of code of the page that contains a text."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (found,) = (block for block in blocks if text in block)
    return found


@pytest.fixture(autouse=True)
def clip(tmp_path, monkeypatch):
    """A clip of ten frames, in the folder where the code is run."""
    monkeypatch.chdir(tmp_path)
    write_clip(tmp_path / "in.mp4")


def test_progress_and_cancel_are_functions():
    """Progress is called for each frame; a conversion that is cancelled leaves no output, and can be run again."""
    told = []
    names = {"fpsboost": fpsboost, "print": lambda *words: told.append(words), "told": told}
    exec(code_with("cancel=").replace("stop.is_set", "lambda: len(told) == 3"), names)
    assert told[:3] == [(1, 20), (2, 20), (3, 20)]
    assert str(told[3][0]) == "The conversion was cancelled."
    assert not Path("out.mp4").exists()
    exec(code_with("cancel="), names)
    assert told[-1] == (20, 20)
    assert Path("out.mp4").exists()


def test_observer_learns_of_clip_and_frames(capsys):
    """Once of the clip and of the first frame, and of every frame that is written."""
    exec(code_with("observer="), {"fpsboost": fpsboost})
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["in.mp4: 64x48, 20 frames follow", "the first frame comes next"]
    assert len(lines) == 22
    assert lines[-1].startswith("20 frames, 0 scene cuts")
