"""The same bits at all levels of processors, and as when `recorded_calls.py` recorded them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded_calls import ARGUMENTS, DIGESTS, KERNELS, digest

from fpsboost.kernels import binding

LEVELS = os.environ.get("FPSBOOST_CPU", "").split() or list(binding.LEVELS[: binding.library().count_levels()])


@pytest.fixture(scope="module")
def arrays():
    """All arrays of the recorded calls, by name."""
    with np.load(ARGUMENTS) as held:
        return dict(held)


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_gives_the_recorded_bits_at_every_level(name, arrays, monkeypatch):
    """Of all `LEVELS`: what calls return, and every array after them."""
    calls, expected = json.loads(arrays["calls"].tobytes())[name], json.loads(DIGESTS.read_text())[name]
    for level in LEVELS:
        monkeypatch.setattr(binding, "processor_level", lambda level=level: level)
        assert [digest(name, text, arrays) for text in calls] == expected, level


@pytest.mark.slow
def test_scenes_of_any_size_are_converted_alike_at_every_level():
    """From 1x1 to 40x40 pixels, of all kinds of images by all methods, but a few at the lowest level, which is slow."""
    program = Path(__file__).with_name("drawn_scenes.py")
    few, *many = (
        subprocess.check_output(
            [sys.executable, program, "11" if level == "baseline" else "22"],
            env={**os.environ, "FPSBOOST_CPU": level},
            text=True,
        )
        for level in LEVELS
    )
    assert all(made.startswith(few) for made in many)
    assert many == many[:1] * len(many)
