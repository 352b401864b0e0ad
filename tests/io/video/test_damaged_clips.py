"""Damaged copies of clips of every kind: converted or refused with a sentence, never a crash and never a hang."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzzing import KINDS

TESTS = Path(__file__).parents[2]
SEED = 20260
COPIES = 10


@pytest.mark.parametrize("part", range(2))
def test_damaged_copies(tmp_path, part):
    """In a process of its own: every copy ends in an output that can be read or in a sentence that names a file."""
    kinds = KINDS[part::2]
    done = subprocess.run(
        [sys.executable, str(TESTS / "fuzzing.py"), str(tmp_path), str(SEED), str(COPIES), *kinds],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])},
        capture_output=True,
        timeout=110,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{lines[-1:]}\n{done.stderr.decode()[-4000:]}"
    outcomes = lines[1::2]
    assert len(outcomes) == COPIES * len(kinds)
    assert outcomes.count("converted") > len(kinds)
    refusals = [outcome for outcome in outcomes if outcome.startswith("refused: ")]
    assert len(refusals) + outcomes.count("converted") == len(outcomes)
    assert len(refusals) > len(kinds)
    assert all(outcome.endswith(".") and "\n" not in outcome and str(tmp_path) in outcome for outcome in refusals)
