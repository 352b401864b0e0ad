"""Tuning: what is swept, which setting is taken, on which frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from comparison_truth import Nobody, save_clip
from truth import noise

from fpsboost.errors import InputError, OptionError, OutputError
from fpsboost.evaluation import tune as tuning_module
from fpsboost.evaluation.hidden_frames import Hiding
from fpsboost.evaluation.tune import AS_GOOD, Trial, Tuning, choose_frames, draw_tuning, sweep_around, tune

STEPS = (0, 1, 3, 5, 8, 11, 14, 15, 16)
"""Places of the frames: motion grows, and slows down in the end."""


def moved(step):
    """A noisy texture, moved by so many pixels."""
    return cv2.GaussianBlur(noise(48, 100), (0, 0), 0.8)[:, 16 - step : 80 - step]


@pytest.fixture
def folder(tmp_path):
    """A noisy texture that moves faster and faster; frames 1, 3, 5 and 7 are hidden."""
    return save_clip(tmp_path / "clip", map(moved, STEPS))


@pytest.fixture
def few(monkeypatch):
    """Fewer settings, as each patch size compiles a kernel of its own; one of them is refused by every method."""
    monkeypatch.setattr(tuning_module, "RADII", (2, 5, 30))
    monkeypatch.setattr(tuning_module, "WIDTHS", (0.1, 0.25))


def test_frames_are_chosen_for_their_motion(folder):
    """The one that moves most first of all, the others down to the middle of the clip's."""
    for count, expected in ((1, [5]), (2, [1, 5]), (3, [1, 3, 5])):
        chosen = choose_frames(folder, Hiding(), count, Nobody())
        assert [each.hidden.number for each in chosen] == expected


def test_no_frame_is_tuned_on_where_nothing_moves(tmp_path):
    """Repeats are no truth: of seven frames the one in motion is taken, and in a still none."""
    clip = save_clip(tmp_path, map(moved, (0, 4, 8, 8, 8, 8, 8)))
    assert [sample.hidden.number for sample in choose_frames(clip, Hiding(), 3, Nobody())] == [1]
    with pytest.raises(InputError, match="`duplicates='keep'`"):
        choose_frames(clip, Hiding(first=2), 1, Nobody())


@pytest.mark.usefixtures("few")
def test_every_option_is_swept_with_the_best_of_those_before(folder):
    """The search radius goes first: too small a one loses the motion and is not chosen."""
    tuning = tune(folder, "nlm-exhaustive", Hiding(), 1, Nobody())
    assert list(tuning.sweeps) == ["search_radius", "patch_radius", "v"]
    assert len(tuning.sweeps["patch_radius"]) == 4
    options = {}
    for name, trials in tuning.sweeps.items():
        for trial in trials:
            assert options.items() <= trial.options.items()
        best = next(trial for trial in trials if trial.mse <= AS_GOOD * min(trial.mse for trial in trials))
        options = best.options
        assert {name: tuning.best.options[name]} == {name: options[name]}
    assert tuning.best.options == options
    radii = [trial.options["search_radius"] for trial in tuning.sweeps["search_radius"]]
    assert radii == sorted(set(radii))
    assert radii[0] < tuning.best.options["search_radius"] < radii[-1]
    assert tuning.sweeps["search_radius"][0].mse > 1.5 * tuning.best.mse
    assert tuning.default == replace(tuning.default, options={})
    assert tuning.default.mse < tuning.sweeps["search_radius"][0].mse
    assert all(trial.cpu_seconds > 0 for trials in tuning.sweeps.values() for trial in trials)


@pytest.mark.parametrize(
    ("best", "usual", "radii"),
    [
        pytest.param(None, 20, [1, 2, 3, 4, 5, 7, 10, 14, 20, 28, 40], id="all the same"),
        pytest.param(7, 20, [4, 5, 7, 10, 14, 20, 28, 40], id="smaller"),
        pytest.param(40, 20, [10, 14, 20, 28, 40, 57, 81], id="larger"),
        pytest.param(500, 20, [10, 14, 20, 28, 40, 57, 81], id="larger than the method takes"),
        pytest.param(1, 1, [1, 2, 3], id="the smallest"),
    ],
)
def test_search_radii_are_tried_around_the_usual_one(best, usual, radii):
    """Two below and two above, and farther where that pays; as far as the method takes them; the cheapest as good."""

    def attempt(radius):
        mse = 1.0 if best is None else abs(radius - best) + 1
        return Trial({"search_radius": radius}, mse, 1.0) if radius <= 100 else None

    trials = sweep_around(usual, attempt)
    assert [trial.options["search_radius"] for trial in trials] == radii
    assert tuning_module._best(trials).options == {"search_radius": min(best or 1, radii[-1])}


def test_methods_without_a_patch_are_refused(folder):
    """One sentence says which to take; so does one for no frame at all."""
    with pytest.raises(OptionError, match="no patch to tune"):
        tune(folder, "dis", Hiding(), 1, Nobody())
    with pytest.raises(OptionError, match="`frames` must be at least 1"):
        tune(folder, "nlm", Hiding(), 0, Nobody())


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_the_curves_are_drawn(tmp_path, suffix):
    """Into a new file, which appears whole."""
    trials = [Trial({"patch_radius": r, "window": w}, 9.0 - r, 0.1) for w in ("box", "gaussian") for r in (1, 3)]
    tuning = Tuning("clip", "nlm-exhaustive", [1], {"patch_radius": trials}, trials[1], trials[0])
    draw_tuning(tuning, tmp_path / f"figure{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"figure{suffix}"]
    with pytest.raises(OutputError, match="ends in"):
        draw_tuning(tuning, tmp_path / "figure.txt")
    with pytest.raises(OutputError, match="cannot be written"):
        draw_tuning(tuning, tmp_path / "no" / "figure.png")


@pytest.mark.usefixtures("few")
def test_the_command_prints_what_can_be_pasted(fpsboost_, folder):
    """The last line behind a conversion, which with --quiet is the only one, and another behind a comparison."""
    result = fpsboost_("tune", folder, "-m", "nlm", "--frames", 1, "--figure", "curves.svg")
    assert result.code == 0, result.err
    lines = result.out.splitlines()
    assert lines[-1].split()[:5:2] == ["--method", "--patch-radius", "--v"]  # no window and no search radius
    assert Path("curves.svg").exists()
    assert "with its own values" in result.out
    assert "CPU s a frame" in result.out.replace("\n", " ")
    compared = lines[lines.index("In a comparison:") + 1].split()
    assert compared[0] == "-m"
    assert fpsboost_("compare", folder, *compared, "-q").code == 0
    assert fpsboost_("tune", folder, "-m", "nlm", "--frames", 1, "-q").out.splitlines() == [lines[-1]]
    assert fpsboost_(folder, "doubled", *lines[-1].split(), "-q").code == 0
    assert len(list(Path("doubled").iterdir())) == 2 * len(STEPS) - 1
