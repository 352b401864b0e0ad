"""The comparison: every method on constructed motion, the same frames as in a conversion, and the command."""

from __future__ import annotations

import json
import shutil

import cv2
import numpy as np
import pytest
from truth import waves

from fpsboost.errors import InputError
from fpsboost.evaluation.compare import compare, pick
from fpsboost.evaluation.hiding import Hiding
from fpsboost.evaluation.making import InterpolatorMaker, Minterpolate
from fpsboost.evaluation.regions import find_regions
from fpsboost.method_table import find_method, methods
from fpsboost.pipeline import convert

# said only under pytest
pytestmark = pytest.mark.filterwarnings("ignore:Cyclopts application invoked without tokens")

HEIGHT, WIDTH = 48, 64
STEP = 2
"""Pixels that everything moves from frame to frame."""


class Nobody:
    """An observer that notes what it is told."""

    def __init__(self):
        self.told = []

    def begun(self, name, frames):
        """A method begins."""
        self.told.append((name, frames))

    def made(self):
        """A frame is done."""
        self.told.append("made")


def pan(number, dtype=np.uint8):
    """A smooth texture that moves to the right."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    white = np.iinfo(dtype).max
    return np.rint((0.5 + 0.4 * waves(x - STEP * number, y, seed=3)) * white).astype(dtype)


@pytest.fixture
def folder(tmp_path):
    """Seven frames of the pan."""
    (tmp_path / "pan").mkdir()
    for number in range(7):
        cv2.imwrite(str(tmp_path / "pan" / f"{number:03}.png"), pan(number))
    return str(tmp_path / "pan")


def psnr(truth, made):
    """Away from the sides, where what comes into view cannot be known."""
    inner = slice(8, -8), slice(12, -12)
    error = (truth[inner].astype(float) - made[inner]) ** 2
    return 10 * np.log10(255**2 / max(error.mean(), 1e-9))


@pytest.mark.parametrize("name", methods)
def test_every_method_makes_what_is_known_to_lie_between(folder, name):
    """A pan by whole pixels, far better than mixing does; mixing and repeating are what their names say."""
    (picked,) = pick(folder, Hiding(), [3])
    made = picked.make(InterpolatorMaker(find_method(name)))
    if name == "blend":
        np.testing.assert_allclose(made, (pan(2).astype(float) + pan(4)) / 2, atol=0.51)
    elif name == "nearest":
        assert any(np.array_equal(made, pan(number)) for number in (2, 4))
    else:
        mixed = psnr(pan(3), (pan(2).astype(float) + pan(4)) / 2)
        assert psnr(pan(3), made) > mixed + 6


def test_a_comparison_makes_the_frames_of_a_conversion(folder, tmp_path):
    """Bit by bit: every second image of a folder, converted, gives what was compared."""
    (tmp_path / "half").mkdir()
    for number in (0, 2, 4, 6):
        shutil.copy(f"{folder}/{number:03}.png", tmp_path / "half" / f"{number // 2:03}.png")
    convert(str(tmp_path / "half"), str(tmp_path / "whole"), factor=2, method="nlm")
    converted = [cv2.imread(str(path)) for path in sorted((tmp_path / "whole").iterdir())]
    intervals = Hiding().intervals(folder)
    made = list(InterpolatorMaker(find_method("nlm")).make(intervals))
    assert [each.number for each in made] == [1, 3, 5]
    for each in made:
        np.testing.assert_array_equal(each.image, converted[each.number])
    for picked, each in zip(pick(folder, Hiding(), [1, 3, 5]), made, strict=True):
        np.testing.assert_array_equal(picked.make(InterpolatorMaker(find_method("nlm"))), each.image)


def test_a_comparison_knows_who_is_better(folder):
    """Figures of every frame and method, their means, and no more said than asked."""
    observer = Nobody()
    makers = {name: InterpolatorMaker(find_method(name)) for name in ("dis", "blend")}
    comparison = compare(folder, makers, Hiding(), observer, skipped={"other": "it is not there"})
    dis, blend = comparison.methods
    assert comparison.hidden == [1, 3, 5] == [frame.number for frame in dis.frames]
    assert comparison.means(dis).psnr > comparison.means(blend).psnr + 5
    assert comparison.means(dis).mae < comparison.means(blend).mae
    assert comparison.shares["moving"] > 0.9
    assert comparison.mean_error(blend, "moving") == pytest.approx(comparison.means(blend).mae, rel=0.2)
    assert comparison.cuts == []
    assert all(frame.seconds > 0 for frame in dis.frames)
    assert observer.told == ["made" if k % 4 else each for k, each in enumerate(expected_calls())]
    plain = json.loads(json.dumps(comparison.as_json(), allow_nan=False))
    assert plain["skipped"] == {"other": "it is not there"}
    assert plain["methods"][0]["mean"]["psnr"] == pytest.approx(comparison.means(dis).psnr)
    assert len(plain["methods"][1]["frames"]) == 3


def expected_calls():
    """Each method begins and makes three frames, and the first reading looks at as many."""
    return [each for name, count in (("reading", None), ("dis", 3), ("blend", 3)) for each in [(name, count), *"123"]]


def test_frames_across_a_cut_are_not_counted(tmp_path):
    """They are made and listed, but no method can know them."""
    for number in range(7):
        image = pan(number) if number < 4 else 255 - pan(number)[::-1]
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    comparison = compare(str(tmp_path), {"blend": InterpolatorMaker(find_method("blend"))}, Hiding(), Nobody())
    (blend,) = comparison.methods
    assert comparison.cuts == [3]
    assert [frame.number for frame in blend.frames] == [1, 3, 5]
    assert [frame.number for frame in comparison.counted(blend)] == [1, 5]


def test_several_frames_can_be_hidden_at_once(folder):
    """Two of three, at a third and at two thirds."""
    intervals = list(Hiding(skip=2).intervals(folder))
    made = list(InterpolatorMaker(find_method("dis")).make(intervals))
    assert [each.number for each in made] == [1, 2, 4, 5]
    for each in made:
        assert psnr(pan(each.number), each.image) > 25


def test_areas_tell_what_moves(tmp_path):
    """A bright square over a still background: its way is moving, the far side is not, and its edges are hidden."""
    rng = np.random.default_rng(0)
    background = cv2.GaussianBlur(rng.integers(0, 120, (96, 128, 3)).astype(np.uint8), (0, 0), 1)
    thing = cv2.GaussianBlur(rng.integers(130, 256, (32, 32, 3)).astype(np.uint8), (0, 0), 1)
    for number in range(3):
        image = background.copy()
        image[32:64, 30 + 6 * number : 62 + 6 * number] = thing
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    (interval,) = Hiding().intervals(str(tmp_path))
    (regions,) = find_regions(interval)
    assert regions.moving[36:60, 40:64].mean() > 0.9
    assert regions.moving[:, 100:].mean() < 0.05
    assert regions.occluded[36:60].mean() > 3 * regions.occluded[:20].mean()


@pytest.mark.skipif(Minterpolate.missing() is not None, reason="there is no ffmpeg on the PATH")
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_minterpolate_joins(tmp_path, dtype):
    """FFmpeg's filter makes every hidden frame, in the clip's own type, and only those wanted if so told."""
    for number in range(5):
        cv2.imwrite(str(tmp_path / f"{number}.png"), pan(number, dtype))
    made = list(Minterpolate().make(Hiding().intervals(str(tmp_path))))
    assert [each.number for each in made] == [1, 3]
    scale = np.iinfo(dtype).max / 255
    for each in made:
        assert each.image.dtype == dtype
        assert psnr(pan(each.number), each.image / scale) > 22
    (wanted,) = Minterpolate().make(Hiding().intervals(str(tmp_path)), {3})
    np.testing.assert_array_equal(wanted.image, made[1].image)


def test_a_filter_that_fails_says_why(folder):
    """The last line of what ffmpeg said."""
    if Minterpolate.missing() is None:
        with pytest.raises(InputError, match="minterpolate failed"):
            list(Minterpolate("no_such_option=1").make(Hiding().intervals(folder)))


def test_the_command_prints_tables_and_writes_figures(fpsboost_, folder, tmp_path):
    """Exit code 0, every method by name, and JSON that says the same."""
    result = fpsboost_("compare", folder, "-m", "dis,blend", "--json", "figures.json")
    assert result.code == 0
    assert result.err == ""
    for word in ("dis", "blend", "PSNR", "occluded"):
        assert word in result.out
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert [method["name"] for method in figures["methods"]] == ["dis", "blend"]
    assert f"{figures['methods'][0]['mean']['psnr']:.2f}" in result.out


def test_a_missing_program_is_said_and_no_error(fpsboost_, folder, monkeypatch):
    """minterpolate needs ffmpeg; without it the other methods are compared all the same."""
    monkeypatch.setenv("PATH", "")
    result = fpsboost_("compare", folder, "-m", "blend,minterpolate")
    assert result.code == 0
    assert "minterpolate was skipped, there is no ffmpeg on the PATH." in result.out


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (("-m", "magic"), 2, "There is no method 'magic'; choose from nlm"),
        (("--range", "0:2"), 2, "leaves nothing to hide"),
        (("--range", "x"), 2, "is no range"),
        (("--depth", "pan"), 2, "--depth goes with --vectors"),
        (("--vectors", "nowhere"), 1, "nowhere"),
        (("--skip", "0"), 2, "--skip must be at least 1"),
        (("--skip", "6"), 1, "too few frames"),
        (("--json", "taken"), 1, "taken exists"),
        (("--report", "taken"), 1, "taken exists"),
        (("--json", "no/such/folder.json"), 1, "is in no folder that exists"),
    ],
)
def test_what_cannot_be_compared_is_one_sentence(fpsboost_, folder, tmp_path, snapshot, arguments, code, sentence):
    """And nothing is written."""
    (tmp_path / "taken").write_text("precious")
    before = snapshot(tmp_path)
    result = fpsboost_("compare", folder, *(arguments if "-m" in arguments else ("-m", "blend", *arguments)))
    assert result.code == code
    assert len(result.lines) == 1
    assert sentence in result.err
    assert snapshot(tmp_path) == before
