"""Hidden folders in which outputs are written, when several runs want the same one."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from types import FrameType

import pytest

from fpsboost.errors import InUseError
from fpsboost.media.staging import JobFingerprint, StagingDirectory

PACKAGE = str(Path(sys.modules["fpsboost"].__file__ or "").parent)


def test_no_run_loses_its_folder_to_another_that_lets_go(tmp_path):
    """While a run holds the folder, all that it has written is there, however often others take and remove it."""
    folder = tmp_path / ".made.unfinished"

    def take_often(number: int) -> int:
        held = 0
        for _ in range(100):
            staging = StagingDirectory(folder, "output", "made", None)
            try:
                staging.open()
            except InUseError:
                continue
            held += 1
            staging.staged.mkdir()
            (staging.staged / str(number)).touch()
            assert os.listdir(staging.staged) == [str(number)]
            staging.close(keep=False)
        return held

    with ThreadPoolExecutor(4) as pool:
        assert sum(pool.map(take_often, range(4))) > 0
    assert os.listdir(tmp_path) == []


class InterruptedAt:
    """Trace function that raises KeyboardInterrupt once, where the package is about to run its line of that number."""

    def __init__(self, line: int) -> None:
        self.lines_left = line

    def __call__(self, frame: FrameType, event: str, _: object) -> "InterruptedAt | None":
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            self.lines_left -= 1
            if self.lines_left == 0:
                raise KeyboardInterrupt
        return self


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # Python closes a file that is open then
@pytest.mark.parametrize("resume", [False, True])
def test_nothing_stays_of_a_folder_whose_opening_is_interrupted(tmp_path, resume):
    """At whichever line of the package Ctrl-C comes, the folder is gone, and can be taken again."""
    tracing = sys.gettrace()
    job = JobFingerprint({"crf": "18"}, resume)
    for line in count(1):
        staging = StagingDirectory(tmp_path / ".made.unfinished", "output", "made", job)
        sys.settrace(InterruptedAt(line))
        try:
            staging.open()
        except KeyboardInterrupt:
            assert os.listdir(tmp_path) == [], line
        else:
            break
        finally:
            sys.settrace(tracing)
    assert line > 20
    staging.close(keep=False)
