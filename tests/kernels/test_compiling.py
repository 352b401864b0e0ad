"""Compilation in a second process: started by the first compilation only, waited for, and never in the way."""

from __future__ import annotations

import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numba.core import event

from fpsboost import methods
from fpsboost.interpolator import _rehearse_synthesis
from fpsboost.kernels.compiling import compiled_aside, told_of_compiling
from fpsboost.kernels.deferred import COMPILE_EVENT, compiler


def compile_something() -> None:
    """Send the event of a compilation."""
    with compiler.ready(), event.trigger_event(COMPILE_EVENT):
        pass


@pytest.fixture
def started(monkeypatch):
    """The processes that are started."""
    processes, popen = [], subprocess.Popen

    def start(*arguments, **options):
        processes.append(popen(*arguments, **options))
        return processes[-1]

    monkeypatch.setattr(subprocess, "Popen", start)
    return processes


def test_the_task_has_run_at_the_end(tmp_path):
    """In one other process, however many kernels are compiled here."""
    with compiled_aside(partial(Path.touch, tmp_path / "done", exist_ok=False)):
        compile_something()
        compile_something()
    assert (tmp_path / "done").exists()


def test_the_process_is_started_before_numba_is_imported():
    """Which takes as long here as there."""
    code = """
import sys
import numpy as np
from fpsboost.kernels import compiling, machine_code
from fpsboost.kernels.shrink import shrink

machine_code.folder = lambda: None
with compiling.told_of_compiling(lambda: sys.exit("numba" in sys.modules)):
    shrink(np.zeros((8, 8), np.uint8), np.zeros((4, 4, 1), np.float32))
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_nothing_is_started_if_nothing_is_compiled(started):
    """All kernels come from the cache."""
    with compiled_aside(partial(time.sleep, 600)):
        pass
    assert not started


def test_nothing_is_started_where_python_is_part_of_another_program(started, monkeypatch):
    """That program would be started in its place."""
    for executable in ("/usr/bin/vspipe", "", None):
        monkeypatch.setattr(sys, "executable", executable)
        with compiled_aside(partial(time.sleep, 600)):
            compile_something()
    assert not started


def test_a_task_that_cannot_be_sent_is_left_out(started):
    """As with an estimator of the caller's own that cannot be pickled."""
    with compiled_aside(lambda: None):
        compile_something()
    assert not started


def test_a_task_that_fails_is_ignored():
    """Its kernels are compiled here."""
    with compiled_aside(partial(Path.touch, Path("no", "such", "folder"))):
        compile_something()


def test_the_process_is_stopped_by_an_error_here(started):
    """It would go on compiling for nobody."""

    def stop() -> None:
        with compiled_aside(partial(time.sleep, 600)):
            compile_something()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert started[0].returncode


@pytest.mark.parametrize("method", ["nlm", "nlm-fast", "dis", "blend"])
def test_the_rehearsal_of_the_synthesis_compiles_nothing_else(method):
    """What it compiles in the second process is what a conversion needs."""
    image, compiled = np.full((2, 3, 3), 7, np.uint8), []
    methods[method].compile_for(image)
    with told_of_compiling(lambda: compiled.append(True)):
        _rehearse_synthesis(methods[method], np.zeros((48, 480, 3), np.uint8))
    assert not compiled
