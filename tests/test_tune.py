"""Tuning: what is swept, which setting is taken, on which frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest
from test_compare import Nobody
from truth import noise

from fpsboost.errors import InputError, OptionError, OutputError
from fpsboost.evaluation import tune as tuning_module
from fpsboost.evaluation.hiding import Hiding
from fpsboost.evaluation.tune import AS_GOOD, Trial, Tuning, choose_frames, tune
from fpsboost.evaluation.tuning_chart import draw_tuning

# said only under pytest
pytestmark = pytest.mark.filterwarnings("ignore:Cyclopts application invoked without tokens")

STEPS = (0, 1, 3, 5, 8, 11, 14, 15, 16)
"""Places of the frames: motion grows, and slows down in the end."""


@pytest.fixture
def folder(tmp_path):
    """A noisy texture that moves faster and faster; frames 1, 3, 5 and 7 are hidden."""
    texture = cv2.GaussianBlur(noise(48, 100), (0, 0), 0.8)
    (tmp_path / "clip").mkdir()
    for number, step in enumerate(STEPS):
        cv2.imwrite(str(tmp_path / "clip" / f"{number}.png"), texture[:, 16 - step : 80 - step])
    return str(tmp_path / "clip")


@pytest.fixture
def few(monkeypatch):
    """Fewer settings: each patch size compiles a kernel of its own."""
    monkeypatch.setattr(tuning_module, "RADII", (1, 3))
    monkeypatch.setattr(tuning_module, "WIDTHS", (0.1, 0.25))
    monkeypatch.setattr(tuning_module, "SHARES", (0.25, 1.0))


def test_frames_are_chosen_for_their_motion(folder):
    """The one that moves most first of all, the others down to the middle of the clip's."""
    for count, expected in ((1, [5]), (2, [1, 5]), (3, [1, 3, 5])):
        chosen = choose_frames(folder, Hiding(), count, Nobody())
        assert [each.hidden.number for each in chosen] == expected


def test_no_frame_is_tuned_on_where_nothing_moves(tmp_path):
    """Repeats are no truth: of seven frames the one in motion is taken, and in a still none."""
    texture = cv2.GaussianBlur(noise(48, 100), (0, 0), 0.8)
    for number, step in enumerate((0, 4, 8, 8, 8, 8, 8)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), texture[:, 16 - step : 80 - step])
    assert [each.hidden.number for each in choose_frames(str(tmp_path), Hiding(), 3, Nobody())] == [1]
    with pytest.raises(InputError, match="--duplicates keep"):
        choose_frames(str(tmp_path), Hiding(first=2), 1, Nobody())


@pytest.mark.usefixtures("few")
def test_every_option_is_swept_with_the_best_of_those_before(folder):
    """Too small a search radius loses the motion, and is not chosen."""
    tuning = tune(folder, "nlm-exhaustive", Hiding(), 1, Nobody())
    assert list(tuning.sweeps) == ["patch_radius", "v", "search_radius"]
    assert len(tuning.sweeps["patch_radius"]) == 4
    for name, trials in tuning.sweeps.items():
        chosen = [trial for trial in trials if trial.options[name] == tuning.best[name]]
        assert min(trial.mse for trial in chosen) <= AS_GOOD * min(trial.mse for trial in trials)
    small, usual = tuning.sweeps["search_radius"]
    assert small.mse > 3 * usual.mse
    assert tuning.best["search_radius"] == usual.options["search_radius"]


@pytest.mark.usefixtures("few")
def test_the_default_method_has_fewer_options(folder):
    """No window and no search radius."""
    tuning = tune(folder, "nlm", Hiding(), 1, Nobody())
    assert list(tuning.sweeps) == ["patch_radius", "v"]
    assert set(tuning.best) == {"patch_radius", "v"}


def test_of_settings_that_are_as_good_the_first_is_taken():
    """Half a percent does not pay for a larger patch."""
    trials = [Trial({"v": 1}, 10.04, 0), Trial({"v": 2}, 10.0, 0), Trial({"v": 3}, 10.2, 0)]
    assert tuning_module._best(trials) == {"v": 1}
    assert tuning_module._best(trials[1:]) == {"v": 2}


def test_methods_without_a_patch_are_refused(folder):
    """One sentence says which to take; so does one for no frame at all."""
    with pytest.raises(OptionError, match="no patch to tune"):
        tune(folder, "dis", Hiding(), 1, Nobody())
    with pytest.raises(OptionError, match="--frames must be at least 1"):
        tune(folder, "nlm", Hiding(), 0, Nobody())


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_the_curves_are_drawn(tmp_path, suffix):
    """Into a new file, which appears whole."""
    trials = [Trial({"patch_radius": r, "window": w}, 9.0 - r, 0.1) for w in ("box", "gaussian") for r in (1, 3)]
    tuning = Tuning("clip", "nlm-exhaustive", [1], {"patch_radius": trials}, {"patch_radius": 3, "window": "box"})
    draw_tuning(tuning, tmp_path / f"figure{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"figure{suffix}"]
    with pytest.raises(OutputError, match="ends in"):
        draw_tuning(tuning, tmp_path / "figure.txt")
    with pytest.raises(OutputError, match="cannot be written"):
        draw_tuning(tuning, tmp_path / "no" / "figure.png")


@pytest.mark.usefixtures("few")
def test_the_command_prints_the_options_to_use(fpsboost_, folder):
    """The last line can be pasted behind a conversion, and with --quiet is the only one."""
    result = fpsboost_("tune", folder, "-m", "nlm", "--frames", 1, "--figure", "curves.svg")
    assert result.code == 0
    last = result.out.splitlines()[-1]
    assert last.startswith("--method nlm --patch-radius ")
    assert Path("curves.svg").exists()
    assert fpsboost_("tune", folder, "-m", "nlm", "--frames", 1, "-q").out.splitlines() == [last]
    options = last.split()
    assert fpsboost_(folder, "doubled", *options, "-q").code == 0
    assert len(list(Path("doubled").iterdir())) == 2 * len(STEPS) - 1
