"""How near the default and its quicker sibling come to the rendered scenes, which no change may lose unseen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from truth import SCENES, needs_scenes

from fpsboost.evaluation.contestants import InterpolatorContestant
from fpsboost.evaluation.hidden_frames import Hiding
from fpsboost.evaluation.results import mean, score
from fpsboost.method_table import find_method

GOLDEN = json.loads(Path(__file__).parents[1].joinpath("golden_scores.json").read_text())
"""Mean PSNR in dB, by method and scene; to be raised with the change that earns it."""

HIDING = Hiding(first=8, last=15, duplicates="keep")
LOSS = 0.05
"""dB, more than processors and libraries differ by."""


def psnr_of(method, scene):
    """Mean PSNR of the three frames that are hidden of seven."""
    path = str(SCENES / scene / "####.png")
    truths = [hidden.truth for interval in HIDING.intervals(path) for hidden in interval.hidden]
    made = InterpolatorContestant(find_method(method)).interpolate(HIDING.intervals(path))
    return mean([score(truth, each.image).psnr for truth, each in zip(truths, made, strict=True)])


@needs_scenes
@pytest.mark.parametrize("scene", GOLDEN["nlm"])
@pytest.mark.parametrize("method", GOLDEN)
def test_no_quality_is_lost(method, scene):
    """Hidden frames of a rendered scene are made as well as they were, to a twentieth of a decibel."""
    assert psnr_of(method, scene) >= GOLDEN[method][scene] - LOSS
