"""Metrics that a comparison adds by name: constructed differences whose figures follow by hand."""

import json
import os
import re
import shlex
import subprocess
import sys
from fractions import Fraction
from html import unescape
from importlib.util import find_spec
from pathlib import Path
from textwrap import dedent

import av.filter
import cv2
import numpy as np
import pytest

from fpsboost.cli.compare import name_others
from fpsboost.errors import InputError, OptionError
from fpsboost.evaluation import further_metrics, video_metrics
from fpsboost.evaluation.further_metrics import STANDARD, Meters, choose_metrics, command_metric, flip, metrics
from fpsboost.evaluation.video_metrics import HIGHEST, LibvmafMeter, XpsnrMeter
from support.comparison_truth import pan, save_clip
from support.truth import moved_waves, noise

HERE = tuple(name for name, metric in metrics.items() if metric.missing() is None)  # what can be measured here

needs_flip = pytest.mark.skipif(find_spec("flip_evaluator") is None, reason="there is no flip-evaluator")
needs_libvmaf = pytest.mark.skipif(metrics["vmaf"].missing() is not None, reason="there is no libvmaf")
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
    with pytest.raises(InputError, match=rf"Frames of {width}x{height} are too small for xpsnr, .* leave it out"):
        XpsnrMeter(Fraction(25)).add(flat(1, size=(height, width, 3)), flat(1, size=(height, width, 3)), counts=False)


@needs_libvmaf
@pytest.mark.parametrize("size", [(96, 128), (97, 129)])
def test_libvmaf_gets_the_made_frames_alone_as_ffmpeg_converts_them(tmp_path, size):
    """The same figures as by FFmpeg on raw pictures of even sides: VMAF, and PSNR-HVS without VMAF."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    height, width = size
    truths = [255 * moved_waves(size, 3 * number, seed=3) for number in range(3)]
    truths = [np.broadcast_to(each, (*size, 3)).astype(np.uint8) for each in truths]
    made = [cv2.GaussianBlur(each, (0, 0), 1 + number) for number, each in enumerate(truths)]
    meters = Meters(choose_metrics(["vmaf,psnr_hvs"]), Fraction(24))
    for truth, image in zip(truths, made, strict=True):
        meters.add(image, image, counts=False)  # shown frames are left out
        meters.add(truth, image)
    for name, images in (("truth", truths), ("made", made)):
        raw = (np.ascontiguousarray(each[: height // 2 * 2, : width // 2 * 2]).tobytes() for each in images)
        (tmp_path / name).write_bytes(b"".join(raw))
    kind = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{width // 2 * 2}x{height // 2 * 2}"]
    graph = "[0]format=yuv444p[a];[1]format=yuv444p[b];[a][b]libvmaf=log_fmt=json:log_path=log:feature=name=psnr_hvs"
    inputs = [*kind, "-i", "made", *kind, "-i", "truth"]
    subprocess.run([ffmpeg, "-v", "error", *inputs, "-lavfi", graph, "-f", "null", "-"], check=True, cwd=tmp_path)
    expected = [frame["metrics"] for frame in json.loads((tmp_path / "log").read_text())["frames"]]
    for row, wanted in zip(meters.values(3), expected, strict=True):
        assert row == pytest.approx({name: wanted[name] for name in row}, abs=1e-6)


@needs_libvmaf
def test_equal_frames_have_the_best_figures_of_libvmaf():
    """Whatever their depth; 120 dB stand for infinity."""
    image = cv2.resize(noise(32, 48, seed=1), (96, 64)).astype(np.uint16) * 257
    for figure, best in (("vmaf", 90), ("psnr_hvs", HIGHEST)):
        meter = LibvmafMeter(figure)
        meter.add(image, image)
        (value,) = meter.values()
        assert value >= best


@pytest.mark.parametrize(("height", "width"), [(45, 44), (600, 31)])
@pytest.mark.parametrize("name", ["vmaf", "psnr_hvs"])
def test_frames_too_small_for_libvmaf_are_refused(name, height, width):
    """Rather than handed to a library that ends the process."""
    with pytest.raises(InputError, match=f"Frames of {width}x{height} are too small for {name}, .* leave it out"):
        LibvmafMeter(name).add(flat(1, size=(height, width, 3)), flat(1, size=(height, width, 3)))


COUNTING = "import os, sys; [print(k / 2) for k, _ in enumerate(sorted(os.listdir(sys.argv[1])))]"
"""A metric that numbers its pictures."""

READING = """
import os, sys
from PIL import Image
for name in sorted(os.listdir(sys.argv[1])):
    assert name.endswith(".png")
    true, made = (Image.open(os.path.join(folder, name)).convert("RGB").getpixel((0, 0)) for folder in sys.argv[1:])
    print(true[0] - made[0])
"""
"""A metric that prints the difference of red in the first pixels."""


def by_command(program, *, name="own", high_is_good=True):
    words = shlex.join([sys.executable, "-c", program])
    return command_metric(name, f"{words} {{truth}} {{made}}", high_is_good=high_is_good)


def measured_by(program, frames=3):
    """The values of frames by a metric that is a program; of each, the truth is one level brighter than the last."""
    meters = Meters({"own": by_command(program)}, Fraction(24))
    for number in range(frames):
        meters.add(flat(9), flat(9), counts=False)
        meters.add(flat(20 + number), flat(20))
    return [row["own"] for row in meters.values(frames)]


def test_numbers_of_a_command_arrive():
    """One for each frame that counts, or one in all; the pictures are those of the frames, numbered from 0."""
    assert measured_by(COUNTING) == [0, 0.5, 1]
    assert measured_by(READING) == [0, 1, 2]
    assert measured_by("print('-1.5e-1')") == [-0.15] * 3
    assert measured_by("print(7)", frames=1) == [7]


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 4])
def test_a_command_gets_pictures_as_they_are_seen(dtype, channels):
    """Of 8 bits in colour, whatever the clip has: half of the light of float is 188."""
    white = 1 if dtype == np.float32 else 65535
    half, black = (flat(level * white, dtype, (24, 40, channels)) for level in (0.5, 0))
    if channels == 4:
        half[..., 3] = black[..., 3] = white
    meters = Meters({"own": by_command(READING)}, Fraction(24))
    meters.add(half, black)
    assert meters.values(1) == [{"own": 188 if dtype == np.float32 else 127}]


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        (
            "print(1, 2)",
            "metric own printed '1 2'; its command must print 3 numbers, one for each frame, or one in all",
        ),
        ("print('loading'); print(1)", "printed 'loading 1'; its command must print 3 numbers"),
        ("print('nan')", "printed 'nan'; its command"),
        ("import sys; print('no frames', file=sys.stderr)", "printed 'no frames'; its command"),
        ("pass", "printed 'nothing'; its command"),
        ("print(1); raise SystemExit('reading\\nno model\\n')", "metric own failed with exit code 1: no model"),
        ("raise SystemExit(3)", "metric own failed with exit code 3: it printed nothing"),
    ],
)
def test_a_command_that_fails_is_named_with_what_it_printed(program, sentence):
    """The exit code and the last line of its errors, or what it printed instead of numbers; nothing stays behind."""
    with pytest.raises(InputError, match=sentence):
        measured_by(program)


def test_a_program_that_is_missing_is_named():
    """With the option that names it."""
    meters = Meters({"own": command_metric("own", "no-such-program {truth} {made}", high_is_good=True)}, Fraction(24))
    meters.add(flat(1), flat(2))
    with pytest.raises(InputError, match=r"The metric own cannot be run \(.*: no-such-program\); check `metric`"):
        meters.values(1)


@pytest.mark.parametrize("name", ["psnr", "vmaf", "frame", "clip", "a b", "", '"', "a:b"])
def test_a_metric_of_ones_own_has_a_name_of_its_own(name):
    """A word that no other column of the data has."""
    with pytest.raises(OptionError, match=f"`metric` '?\"?{re.escape(name)}.*choose a different name"):
        by_command("", name=name)


@pytest.mark.parametrize(
    ("command", "sentence"),
    [("tool {truth}", "command of the metric own lacks {made}"), ("'tool {truth} {made}", "cannot be read")],
)
def test_a_command_of_a_metric_names_both_folders(command, sentence):
    """Else it could not read them."""
    with pytest.raises(OptionError, match=sentence):
        command_metric("own", command, high_is_good=True)


@needs_flip
def test_flip_is_0_of_equal_images_and_near_1_of_black_beside_white():
    """And grows with the difference."""
    equal, gray, white = (flip(flat(0), flat(level)) for level in (0, 40, 255))
    assert equal == 0
    assert 0.05 < gray < white
    assert white > 0.9


def test_metrics_are_chosen_by_name_once():
    """Those that are always measured may be named too, and those that are gone are unknown."""
    assert choose_metrics([]) == {}
    assert choose_metrics([f" {HERE[0]}", f"mae,{HERE[0]},psnr_p5"]) == {HERE[0]: metrics[HERE[0]]}
    others = r"choose one of psnr, .*, flip, xpsnr, vmaf, .*"
    for name, meant in {"tof": others, "psnrdiv": "did you mean 'psnr_div'", "PSNR": "did you mean 'psnr'"}.items():
        with pytest.raises(OptionError, match=f"There is no metric '{name}'; {meant}"):
            choose_metrics([name])


def test_what_is_missing_is_named(monkeypatch):
    """A filter of FFmpeg, a package, and how to get it."""
    monkeypatch.setattr(video_metrics.av.filter, "filters_available", frozenset())
    monkeypatch.setattr(video_metrics, "find_spec", lambda name: None)
    monkeypatch.setattr(further_metrics, "find_spec", lambda name: None)
    libvmaf = r"filter libvmaf, .*; pip install 'fpsboost\[vmaf\]'"
    needed = {"xpsnr": "filter xpsnr", "vmaf": libvmaf, "psnr_hvs": libvmaf, "flip": r"'fpsboost\[flip\]'"}
    for name, words in needed.items():
        with pytest.raises(OptionError, match=f"`metrics={name}` needs the .*{words}"):
            choose_metrics([name])


STAND_INS = {
    "torch": "from contextlib import nullcontext as no_grad",
    "lpips": """
        import cv2, numpy
        load_image = lambda path: cv2.imread(path)[..., ::-1]
        im2tensor = lambda image: image / 127.5 - 1
        LPIPS = lambda net, verbose: lambda first, second: numpy.abs(first - second).max()
    """,
    "pycvvdp": """
        import numpy
        class cvvdp:
            def __init__(self, display_name): assert display_name == "standard_4k"
            def predict(self, test, reference, dim_order, frames_per_second):
                assert dim_order == "FHWC" and test.dtype == numpy.uint8 and test.shape == (2, 24, 40, 3)
                return numpy.float64(10 - abs(test.astype(int) - reference).max()), None
    """,
}
"""Modules with the functions that the programs in the documentation call."""


@pytest.mark.parametrize(("name", "found"), [("lpips_of", [2 / 127.5, 4 / 127.5]), ("jod", [6, 6])])
def test_programs_in_the_documentation_are_metrics(tmp_path, monkeypatch, name, found):
    """They read both folders in order and print a number for each frame, or one in all."""
    text = (Path(__file__).parents[2] / "docs" / "comparison.md").read_text("utf-8")
    program, usage = re.search(rf"```python\n(# {name}\.py .*?)```\n\n```\n(.*?)```", text, re.DOTALL).groups()
    (tmp_path / f"{name}.py").write_text(program)
    for module, code in STAND_INS.items():
        (tmp_path / f"{module}.py").write_text(dedent(code))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    (tool,) = name_others((), (), [shlex.split(usage)[-1].replace("python", shlex.quote(sys.executable), 1)])
    meters = Meters({"own": command_metric(tool.name, tool.value, high_is_good=tool.better == ":higher")}, Fraction(24))
    for number in (1, 2):
        meters.add(flat(100), flat(100 + 2 * number))
    assert [row["own"] for row in meters.values(2)] == pytest.approx(found)


@pytest.mark.slow
def test_the_command_measures_what_it_is_told(fpsboost_, tmp_path):
    """All that can be measured here, once: in the tables, the data, the page, and the page's command."""
    save_clip(tmp_path / "pan", (pan(2 * number, height=96, width=128) for number in range(7)))
    outputs = ("--json", "a.json", "--csv", "a.csv", "--report", "page")
    names = ",".join(name for name in HERE if name not in STANDARD)
    own = f"levels:lower={shlex.quote(sys.executable)} -c {shlex.quote(READING)} {{truth}} {{made}}"
    chosen = ("--skip", "2", "--metrics", f"missing,{names}", "--metric", own)
    result = fpsboost_("compare", "pan", "-m", "dis,blend", *chosen, *outputs)
    assert (result.code, result.err) == (0, "")
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["metrics"] == [*STANDARD, *names.split(","), "levels"]
    assert data["others"] == ["--metric", own]
    dis, blend = (method["mean"]["metrics"] for method in data["methods"])
    for name in HERE:
        assert metrics[name].title in result.out
        assert (dis[name] > blend[name]) is metrics[name].high_is_good
    frames = data["methods"][0]["frames"]
    assert len(frames) == 4
    page = (tmp_path / "page" / "index.html").read_text()
    assert f"--metrics {names} --metric 'levels:lower=" in unescape(page.replace("<span>", "").replace("</span>", ""))
    for text in (result.out, unescape(page)):
        assert "levels is what `" in text
        assert "prints, lower is better." in re.sub(r"\s+", " ", text)
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
    meters = Meters(choose_metrics(["motion_smoothness"]), Fraction(24))
    for each in (truth, image):
        meters.add(truth, each)
    expected = [1, (255 - cv2.absdiff(truth, image).mean()) / 255]
    assert [row["motion_smoothness"] for row in meters.values(2)] == pytest.approx(expected)
