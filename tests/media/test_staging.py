"""Hidden folders in which outputs are written, when several runs want the same one."""

import os
from concurrent.futures import ThreadPoolExecutor

from fpsboost.errors import InUseError
from fpsboost.media.staging import StagingDirectory


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
