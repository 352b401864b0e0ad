"""Compilation of kernels: told of in time, and in a second process that is started once and never in the way."""

import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise, starmap
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from truth import noise, prepared

from fpsboost import methods
from fpsboost.interpolator import _rehearse_synthesis
from fpsboost.kernels.compiling import compiled_aside, tell_listeners, told_of_compiling
from fpsboost.kernels.jit import JIT, Kernel, delete_outdated

compiles = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


def double(values):
    values *= 2


@compiles
def test_listeners_hear_of_what_the_cache_lacks(tmp_path, monkeypatch):
    """Before the first compilation, before another for other types, and not of what an earlier process has compiled."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    told = []

    def run(kernel: Kernel, dtype: str) -> list[int]:
        values = np.ones(3, dtype)
        with told_of_compiling(lambda: told.append(len(kernel.dispatcher.signatures))):
            kernel(values)
        assert (values == 2).all()
        return told.copy()

    kernel = Kernel(double, JIT)
    assert [run(kernel, each) for each in ("f4", "f4", "i4", "i4")] == [[0], [0], [0, 1], [0, 1]]
    again = Kernel(double, JIT)
    assert [run(again, each) for each in ("f4", "i4", "f8")] == [[0, 1], [0, 1], [0, 1, 2]]


@compiles
def test_kernels_of_other_sources_are_deleted(tmp_path):
    """Once, when sources have changed; what is compiled from these stays."""
    old, new = tmp_path / "kernel.old-1.py311.nbi", tmp_path / "kernel.new-1.py311.nbi"
    old.touch()
    (tmp_path / "0123.sources").touch()
    delete_outdated(tmp_path)
    assert [path.suffix for path in tmp_path.iterdir()] == [".sources"]
    new.touch()
    delete_outdated.__wrapped__(tmp_path)
    assert new.exists()
    delete_outdated(tmp_path / "missing")


@compiles
def test_a_kernel_runs_where_nothing_can_be_cached():
    """Every process compiles it; here it has no file beside which it could be kept."""
    names: dict[str, Any] = {}
    exec("def double(values): values *= 2", names)
    kernel, values, told = Kernel(names["double"], JIT), np.ones(3), []
    with told_of_compiling(lambda: told.append(True)):
        kernel(values)
        kernel(values)
    assert (values == 4).all()
    assert told == [True]


def test_two_threads_are_told_of_once():
    """Also where the second one compiles while the first one asks whether it was told already."""
    told, others = [], [threading.Thread(target=tell_listeners)]

    def interrupted(frame, event, _):
        if event == "line" and frame.f_lineno > frame.f_code.co_firstlineno + 1 and others:
            other = others.pop()
            other.start()
            other.join()
        return interrupted if frame.f_code.co_name == "listen" else None

    with told_of_compiling(lambda: told.append(True)):
        sys.settrace(interrupted)
        try:
            tell_listeners()
        finally:
            sys.settrace(None)
    assert (told, others) == ([True], [])


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
        tell_listeners()
        tell_listeners()
    assert (tmp_path / "done").exists()


def test_nothing_is_started_in_vain(started, monkeypatch):
    """All kernels come from the cache; the task cannot be pickled; Python is part of a program, which would start."""
    with compiled_aside(partial(time.sleep, 600)):
        pass
    with compiled_aside(lambda: None):
        tell_listeners()
    for executable in ("/usr/bin/vspipe", "", None):
        monkeypatch.setattr(sys, "executable", executable)
        with compiled_aside(partial(time.sleep, 600)):
            tell_listeners()
    assert not started


def test_a_task_that_fails_is_ignored():
    """Its kernels are compiled here."""
    with compiled_aside(partial(Path.touch, Path("no", "such", "folder"))):
        tell_listeners()


def test_the_process_is_stopped_by_an_error_here(started):
    """It would go on compiling for nobody."""

    def stop() -> None:
        with compiled_aside(partial(time.sleep, 600)):
            tell_listeners()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert started[0].returncode


@compiles
@pytest.mark.parametrize("method", ["nlm", "nlm-fast", "dis", "blend"])
def test_the_rehearsal_of_the_synthesis_compiles_nothing_else(method):
    """What it compiles in the second process is what a conversion needs."""
    image, compiled = np.full((2, 3, 3), 7, np.uint8), []
    methods[method].compile_for(image)
    with told_of_compiling(lambda: compiled.append(True)):
        _rehearse_synthesis(methods[method], np.zeros((48, 480, 3), np.uint8))
    assert not compiled


def test_all_kernels_of_a_conversion_stay_within_their_arrays():
    """Uncompiled, an index beyond an array is an error; the frames are long enough for all kinds of levels."""
    method = replace(methods["nlm"], cuts=None)
    before, pair = starmap(method.pair, pairwise(prepared(*(noise(8, 256, seed=seed) for seed in range(3)))))
    assert next(method.between(pair, [0.5], before).images).shape == (8, 256, 3)
