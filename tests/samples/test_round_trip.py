"""The round trip of rendering: half of the frames by Mitsuba, the rest made, doubtful regions rendered and merged."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fpsboost.cli.app import app

SCRIPT = Path(__file__).parents[2] / "samples" / "round_trip.py"


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed")
@pytest.mark.skipif("merge" not in app, reason="fpsboost has no command merge")
def test_the_round_trip_makes_frames_better(tmp_path):
    """At a small size on the glass cube: within the budget, and with a smaller error of the frames between."""
    size = ["--size", "96x54", "--frames", "5", "--samples", "4", "--budget", "25%"]
    command = [sys.executable, SCRIPT, tmp_path / "out", "--scene", "glass", *size]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    found = re.search(r"error ([\d.]+) -> ([\d.]+), ([\d.]+)% of the pixels", told.stdout)
    assert found, told.stdout + told.stderr
    before, after, share = map(float, found.groups())
    assert after < before
    assert 0 < share <= 25
    assert sorted(path.name for path in (tmp_path / "out" / "merged").iterdir()) == [f"{n:04d}.exr" for n in range(5)]
