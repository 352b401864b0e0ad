"""Metrics that a comparison adds by name: constructed differences whose figures follow by hand."""

from __future__ import annotations

import json
from fractions import Fraction
from importlib.util import find_spec
from itertools import product

import av.filter
import cv2
import numpy as np
import pytest
from truth import noise, waves

from fpsboost.errors import InputError, OptionError
from fpsboost.evaluation import filter_metrics, flip_metric
from fpsboost.evaluation.filter_metrics import XpsnrMeter, read_vmaf
from fpsboost.evaluation.flip_metric import FlipMeter
from fpsboost.evaluation.further_metrics import choose_metrics, metrics
from fpsboost.evaluation.grid_metric import PERIODS, count_steps, grid_ratios
from fpsboost.evaluation.metrics import score
from fpsboost.evaluation.temporal_metrics import DifferenceMeter, FlowMeter

HERE = tuple(name for name, metric in metrics.items() if metric.missing() is None)
"""What can be measured here."""

needs_flip = pytest.mark.skipif(find_spec("flip_evaluator") is None, reason="there is no flip-evaluator")
needs_xpsnr = pytest.mark.skipif("xpsnr" not in av.filter.filters_available, reason="this FFmpeg has no xpsnr")


def flat(level, dtype=np.uint8, size=(24, 40, 3)):
    """One level everywhere."""
    return np.full(size, level, dtype)


# ---------------------------------------------------------------- dtSSD and tOF


def test_between_two_true_frames_dtssd_is_the_root_of_the_mse():
    """The frame before is the same on both sides and drops out, whatever it is."""
    truth, made = noise(24, 40, seed=1), noise(24, 40, seed=2)
    meter = DifferenceMeter()
    meter.shown(noise(24, 40, seed=3))
    meter.made(truth, made)
    meter.shown(noise(24, 40, seed=4))
    meter.made(truth, made)
    for row in meter.values():
        assert row["dtssd"] ** 2 == pytest.approx(score(truth, made).mse, rel=1e-5)


def test_dtssd_forgives_an_error_that_stays():
    """Of three made frames in a row 5, 5 and -5 levels off, the changes are 5, 0 and 10 levels off."""
    meter = DifferenceMeter()
    meter.shown(flat(100))
    for level in (105, 105, 95):
        meter.made(flat(100), flat(level))
    assert [row["dtssd"] for row in meter.values()] == pytest.approx([5, 0, 10], abs=1e-4)


def pan(shift, level=0.5):
    """A smooth texture that is moved to the right, pixels."""
    y, x = np.mgrid[:96, :128].astype(float)
    return np.rint((level + 0.4 * waves(x - shift, y, seed=3)) * 255).astype(np.uint8)


def test_tof_is_how_far_things_are_from_their_places():
    """Moved by 2 pixels: 0 in the right place, 1 where it is 1 pixel too far; the next one is judged from there."""
    meter = FlowMeter()
    for made in (2, 3):
        meter.shown(pan(0))
        meter.made(pan(2), pan(made))
    meter.made(pan(4), pan(5))
    right, wrong, after = (row["tof"] for row in meter.values())
    assert right == 0
    assert wrong == pytest.approx(1, abs=0.2)
    assert after < 0.2


# ---------------------------------------------------------------- edges of blocks


def steps_one_by_one(truth, made, period):
    """On the lines of a grid and half-way between, pixel by pixel, over images of whole levels."""
    truth, made = truth.astype(int), made.astype(int)
    error = cv2.boxFilter(np.abs(made - truth).mean(axis=2).astype(np.float32), -1, (17, 17))
    found = {period - 1: 0, period // 2 - 1: 0}
    for down in (0, 1):
        height, width = (made.shape[0], made.shape[1] - 1) if not down else (made.shape[0] - 1, made.shape[1])
        for y, x in product(range(height), range(width)):

            def jump(image, off, y=y, x=x, down=down):
                y0, x0 = (y + off, x) if down else (y, x + off)
                y1, x1 = (y0 + 1, x0) if down else (y0, x0 + 1)
                if min(y0, x0) < 0 or y1 >= image.shape[0] or x1 >= image.shape[1]:
                    return 0
                return int(np.abs(image[y1, x1] - image[y0, x0]).max())

            here = jump(made, 0)
            slopes = max(jump(made, -1), jump(made, 1), jump(truth, 0))
            place = (y if down else x) % period
            if place in found and here > 12 and 2 * slopes < here and error[y, x] > 8:
                found[place] += 1
    return {f"grid{period}_lines": found[period - 1], f"grid{period}_between": found[period // 2 - 1]}


def test_blocks_have_their_edges_on_the_lines():
    """Squares of 16 pixels, 20 levels up and down: every edge is counted, and half of them lie between those of 32."""
    y, x = np.mgrid[:48, :64] // 16
    made = np.repeat(np.where((x + y) % 2, 120, 80).astype(np.uint8)[..., None], 3, axis=2)
    counts = count_steps(flat(100, size=(48, 64, 3)), made)
    edges = 3 * 48 + 2 * 64
    assert (counts["grid16_lines"], counts["grid16_between"]) == (edges, 0)
    assert (counts["grid8_lines"], counts["grid8_between"]) == (edges, 0)
    assert (counts["grid32_lines"], counts["grid32_between"]) == (48 + 64, 2 * 48 + 64)
    assert grid_ratios([counts, counts]) == {"grid8": 2 * edges, "grid16": 2 * edges, "grid32": 112 / 160}


def test_steps_agree_with_those_counted_one_by_one():
    """Blocks of many sizes and heights with noise, in the wrong place in part."""
    rng = np.random.default_rng(5)
    truth = noise(40, 72, seed=6)
    blocks = sum(
        np.kron(rng.integers(-30, 30, (40 // side, 72 // side)), np.ones((side, side), int)) for side in (4, 8)
    )
    made = truth // 8 + 90 + blocks[..., None] + rng.integers(-6, 7, truth.shape)
    made[:, 60:] = truth[:, 60:]
    truth = truth // 8 + 90
    truth[:, 60:] = made[:, 60:]
    truth, made = truth.astype(np.uint8), made.clip(0, 255).astype(np.uint8)
    counts = count_steps(truth, made)
    expected = {name: value for period in PERIODS for name, value in steps_one_by_one(truth, made, period).items()}
    assert counts == expected
    assert min(counts[f"grid{period}_lines"] for period in PERIODS[:2]) > 10


@pytest.mark.parametrize(("dtype", "scale"), [(np.uint16, 257), (np.float32, 1 / 255)])
def test_steps_do_not_depend_on_the_type_of_the_image(dtype, scale):
    """Levels of 255 whatever the depth."""
    y, x = np.mgrid[:48, :64] // 8
    made = np.repeat(np.where((x + y) % 2, 120, 90).astype(np.uint8)[..., None], 3, axis=2)
    truth = flat(100, size=made.shape)
    counts = count_steps(truth, made)
    assert counts["grid8_lines"] > 0
    assert count_steps(*(image.astype(dtype) * dtype(scale) for image in (truth, made))) == counts


def test_edges_of_the_true_frame_and_right_places_count_nothing():
    """No ratio comes of nothing."""
    y, x = np.mgrid[:48, :64] // 8
    blocks = np.repeat(np.where((x + y) % 2, 120, 80).astype(np.uint8)[..., None], 3, axis=2)
    for truth, made in ((blocks, blocks), (blocks, blocks + np.uint8(20)), (flat(100), flat(150))):
        counts = count_steps(truth, made)
        assert set(counts.values()) == {0}
        assert np.isnan(list(grid_ratios([counts]).values())).all()


# ---------------------------------------------------------------- XPSNR and VMAF


@needs_xpsnr
def test_twice_the_error_takes_6_db_of_xpsnr():
    """Its weights come from the true video alone, and shown frames have their places but no figures."""
    y, x = np.mgrid[:64, :96].astype(float)
    clip = [(0.5 + 0.3 * waves(x - 2 * number, y, seed=3)).astype(np.float32) for number in range(7)]
    error = noise(64, 96, clip[0].shape[2], seed=4).astype(np.float32) / 255 / 20
    meters = [XpsnrMeter(Fraction(25)) for _ in range(2)]
    for factor, meter in zip((1, 2), meters, strict=True):
        for number, image in enumerate(clip):
            if number % 2:
                meter.made(image, image + np.float32(factor) * error)
            else:
                meter.shown(image)
    once, twice = ([row["xpsnr"] for row in meter.values()] for meter in meters)
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
    meter.shown(image)
    meter.made(image, image)
    meter.made(image, other)
    assert meter.values() == [{"xpsnr": 120.0}] * 2


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
        meter.shown(truth[:rows, :columns])
        meter.made(truth[:rows, :columns], made[:rows, :columns])
        found += meter.values()
    assert found[0] == found[1]
    assert found[0]["xpsnr"] < 40


@pytest.mark.parametrize(("height", "width"), [(45, 45), (600, 31)])
def test_frames_too_small_for_xpsnr_are_refused(height, width):
    """Rather than handed to a filter that divides by nothing, or sees no error in a lone column of blocks."""
    with pytest.raises(InputError, match=rf"Frames of {width}x{height} are too small for XPSNR, .* leave xpsnr out"):
        XpsnrMeter(Fraction(25)).shown(flat(1, size=(height, width, 3)))


def test_vmaf_comes_from_the_log_of_libvmaf():
    """Frame by frame, in order."""
    frames = [{"frameNum": number, "metrics": {"integer_motion": 0.0, "vmaf": 90.0 + number}} for number in (1, 0, 2)]
    assert read_vmaf(json.dumps({"version": "3.0.0", "frames": frames, "pooled_metrics": {}})) == [90, 91, 92]


# ---------------------------------------------------------------- FLIP


@needs_flip
def test_flip_is_0_of_equal_images_and_near_1_of_black_beside_white():
    """And grows with the difference."""
    meter = FlipMeter()
    for level in (0, 40, 255):
        meter.made(flat(0), flat(level))
    equal, gray, white = (row["flip"] for row in meter.values())
    assert equal == 0
    assert 0.05 < gray < white
    assert white > 0.9


# ---------------------------------------------------------------- names


def test_metrics_are_chosen_by_name_once():
    """Those that are always measured may be named too."""
    assert choose_metrics([]) == ()
    assert choose_metrics(["grid, tof", "mae,tof,psnr_p5"]) == ("grid", "tof")
    with pytest.raises(OptionError, match=r"There is no metric 'lpips'; choose from psnr, .*, grid\."):
        choose_metrics(["lpips"])


def test_what_is_missing_is_named(monkeypatch):
    """A filter of FFmpeg, a package, and how to get it."""
    monkeypatch.setattr(filter_metrics.av.filter, "filters_available", frozenset())
    monkeypatch.setattr(flip_metric, "find_spec", lambda name: None)
    for name, words in (("xpsnr", "filter xpsnr"), ("vmaf", "filter libvmaf"), ("flip", r"'fpsboost\[flip\]'")):
        with pytest.raises(OptionError, match=f"`metrics={name}` needs the .*{words}"):
            choose_metrics([name])


def test_the_command_measures_what_it_is_told(fpsboost_, tmp_path):
    """All that can be measured here: in the table, the data, the page, and the page's command."""
    (tmp_path / "pan").mkdir()
    for number in range(7):
        cv2.imwrite(str(tmp_path / "pan" / f"{number}.png"), pan(2 * number))
    outputs = ("--json", "a.json", "--csv", "a.csv", "--report", "page")
    names = ",".join(HERE)
    result = fpsboost_("compare", "pan", "-m", "dis,blend", "--skip", "2", "--metrics", names, *outputs)
    assert (result.code, result.err) == (0, "")
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["metrics"] == list(HERE)
    dis, blend = (method["mean"]["metrics"] for method in data["methods"])
    for name in HERE:
        for figure in metrics[name].figures:
            assert figure.title.split()[0] in result.out
            if name != "grid":
                assert (dis[figure.name] > blend[figure.name]) is figure.high_is_good
    frames = data["methods"][0]["frames"]
    assert len(frames) == 4
    assert dis["tof"] == pytest.approx(np.mean([frame["metrics"]["tof"] for frame in frames]))
    assert frames[1]["metrics"]["dtssd"] != pytest.approx(frames[1]["scores"]["mse"] ** 0.5, rel=1e-3)
    page = (tmp_path / "page" / "index.html").read_text()
    assert f"--metrics {names} --report DIR" in page
    assert f">{dis['tof']:.3f}<" in page
    assert 'id="further"' in page
