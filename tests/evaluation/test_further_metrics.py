"""Metrics that a comparison adds by name: constructed differences whose figures follow by hand."""

import json
import re
from fractions import Fraction
from importlib.util import find_spec

import av.filter
import cv2
import numpy as np
import pytest

from fpsboost.errors import InputError, OptionError
from fpsboost.evaluation import further_metrics
from fpsboost.evaluation.further_metrics import STANDARD, Meters, XpsnrMeter, choose_metrics, flip, metrics, read_vmaf
from support.comparison_truth import pan, save_clip
from support.truth import moved_waves, noise

HERE = tuple(name for name, metric in metrics.items() if metric.missing() is None)  # what can be measured here

needs_flip = pytest.mark.skipif(find_spec("flip_evaluator") is None, reason="there is no flip-evaluator")
needs_xpsnr = pytest.mark.skipif("xpsnr" not in av.filter.filters_available, reason="this FFmpeg has no xpsnr")


def flat(level, dtype=np.uint8, size=(24, 40, 3)):
    """One level everywhere."""
    return np.full(size, level, dtype)


@needs_xpsnr
def test_twice_the_error_takes_6_db_of_xpsnr():
    """Its weights come from the true video alone, and shown frames have their places but no figures."""
    clip = [(0.5 + 0.3 * moved_waves((64, 96), 2 * number, seed=3)).astype(np.float32) for number in range(7)]
    error = noise(64, 96, clip[0].shape[2], seed=4).astype(np.float32) / 255 / 20
    meters = [XpsnrMeter(Fraction(25)) for _ in range(2)]
    for factor, meter in zip((1, 2), meters, strict=True):
        for number, image in enumerate(clip):
            meter.add(image, image + np.float32(number % 2 * factor) * error, counts=number % 2 == 1)
    once, twice = (meter.values() for meter in meters)
    assert len(once) == 3
    assert np.subtract(once, twice) == pytest.approx(20 * np.log10(2), abs=0.05)


@needs_xpsnr
def test_xpsnr_of_equal_frames_is_120_db():
    """And colours that cannot be seen make no difference."""
    image = noise(50, 70, 4).copy()
    image[..., 3] = 0
    other = image.copy()
    other[..., :3] += 9
    meter = XpsnrMeter(Fraction(25))
    meter.add(image, image, counts=False)
    meter.add(image, image)
    meter.add(image, other)
    assert meter.values() == [120.0] * 2


@needs_xpsnr
@pytest.mark.parametrize(("dtype", "scale"), [(np.uint8, 1), (np.uint16, 257)])
@pytest.mark.parametrize("size", [(65, 97), (64, 99), (1154, 2050)])
def test_xpsnr_takes_any_size_and_depth(dtype, scale, size):
    """As far as a frame of a multiple of 4 goes, the figure is the same: FFmpeg's filter errs on other sizes."""
    height, width = (side // 4 * 4 for side in size)
    truth, made = (cv2.resize(noise(32, 48, seed=seed), size[::-1]).astype(dtype) * dtype(scale) for seed in (1, 2))
    found = []
    for rows, columns in (size, (height, width)):
        meter = XpsnrMeter(Fraction(60))
        meter.add(truth[:rows, :columns], truth[:rows, :columns], counts=False)
        meter.add(truth[:rows, :columns], made[:rows, :columns])
        found += meter.values()
    assert found[0] == found[1]
    assert found[0] < 40


@pytest.mark.parametrize(("height", "width"), [(45, 45), (600, 31)])
def test_frames_too_small_for_xpsnr_are_refused(height, width):
    """Rather than handed to a filter that divides by nothing, or sees no error in a lone column of blocks."""
    with pytest.raises(InputError, match=rf"Frames of {width}x{height} are too small for XPSNR, .* leave xpsnr out"):
        XpsnrMeter(Fraction(25)).add(flat(1, size=(height, width, 3)), flat(1, size=(height, width, 3)), counts=False)


def test_vmaf_comes_from_the_log_of_libvmaf():
    """Frame by frame, in order."""
    frames = [{"frameNum": number, "metrics": {"integer_motion": 0.0, "vmaf": 90.0 + number}} for number in (1, 0, 2)]
    assert read_vmaf(json.dumps({"version": "3.0.0", "frames": frames, "pooled_metrics": {}})) == [90, 91, 92]


@needs_flip
def test_flip_is_0_of_equal_images_and_near_1_of_black_beside_white():
    """And grows with the difference."""
    equal, gray, white = (flip(flat(0), flat(level)) for level in (0, 40, 255))
    assert equal == 0
    assert 0.05 < gray < white
    assert white > 0.9


def test_metrics_are_chosen_by_name_once():
    """Those that are always measured may be named too, and those that are gone are unknown."""
    assert choose_metrics([]) == ()
    assert choose_metrics([f" {HERE[0]}", f"mae,{HERE[0]},psnr_p5"]) == HERE[:1]
    others = r"choose one of psnr, .*, flip, xpsnr, vmaf, .*"
    for name, meant in {"tof": others, "psnrdiv": "did you mean 'psnr_div'", "PSNR": "did you mean 'psnr'"}.items():
        with pytest.raises(OptionError, match=f"There is no metric '{name}'; {meant}"):
            choose_metrics([name])


def test_what_is_missing_is_named(monkeypatch):
    """A filter of FFmpeg, a package, and how to get it."""
    monkeypatch.setattr(further_metrics.av.filter, "filters_available", frozenset())
    monkeypatch.setattr(further_metrics, "find_spec", lambda name: None)
    for name, words in (("xpsnr", "filter xpsnr"), ("vmaf", "filter libvmaf"), ("flip", r"'fpsboost\[flip\]'")):
        with pytest.raises(OptionError, match=f"`metrics={name}` needs the .*{words}"):
            choose_metrics([name])


@pytest.mark.slow
def test_the_command_measures_what_it_is_told(fpsboost_, tmp_path):
    """All that can be measured here, once: in the tables, the data, the page, and the page's command."""
    save_clip(tmp_path / "pan", (pan(2 * number, height=96, width=128) for number in range(7)))
    outputs = ("--json", "a.json", "--csv", "a.csv", "--report", "page")
    names = ",".join(name for name in HERE if name not in STANDARD)
    result = fpsboost_("compare", "pan", "-m", "dis,blend", "--skip", "2", "--metrics", f"missing,{names}", *outputs)
    assert (result.code, result.err) == (0, "")
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["metrics"] == [*STANDARD, *names.split(",")]
    dis, blend = (method["mean"]["metrics"] for method in data["methods"])
    for name in HERE:
        assert metrics[name].title in result.out
        assert (dis[name] > blend[name]) is metrics[name].high_is_good
    frames = data["methods"][0]["frames"]
    assert len(frames) == 4
    page = (tmp_path / "page" / "index.html").read_text()
    assert f"--metrics {names} --report DIR" in page.replace("<span>", "").replace("</span>", "")
    assert 'id="further"' in page
    for name in HERE:
        assert dis[name] == pytest.approx(np.mean([frame["metrics"][name] for frame in frames]))
        assert f'data-value="{dis[name]}"' in page


def test_edges_are_in_every_first_table(fpsboost_, tmp_path, monkeypatch):
    """At 80 columns no number is broken, and terminal and page say in a sentence what both columns mean."""
    monkeypatch.setenv("COLUMNS", "80")
    save_clip(tmp_path / "pan", (pan(2 * number) for number in range(5)))
    result = fpsboost_("compare", "pan", "-m", "minterpolate,blend,nearest", "--report", "page")
    assert ["method", "PSNR", "P5", "SSIM", "MAE", "spurious", "missing", "CPU s"] in [
        [cell.strip() for cell in line.split("┃")[1:-1]] for line in result.out.splitlines()
    ]
    assert re.search(r"^│ minterpolate +(│ +\d+\.\d+ ){7}│$", result.out, re.MULTILINE)
    page = (tmp_path / "page" / "index.html").read_text()
    for name in STANDARD:
        assert metrics[name].meaning in result.out.replace(" \n", " ").replace("\n", " ")
        assert page.count(metrics[name].meaning) == 3  # on the heading, below the table, and among all figures
    assert 'id="further"' not in page


def test_motion_smoothness_is_that_of_vbench():
    """(255 - mean absolute difference) / 255 of 8-bit frames, by its definition: 1 of equal ones."""
    truth, image = noise(20, 30, seed=1), noise(20, 30, seed=2)
    meters = Meters(["motion_smoothness"], Fraction(24))
    for each in (truth, image):
        meters.add(truth, each)
    expected = [1, (255 - cv2.absdiff(truth, image).mean()) / 255]
    assert [row["motion_smoothness"] for row in meters.values(2)] == pytest.approx(expected)
