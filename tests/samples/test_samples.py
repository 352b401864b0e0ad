"""The rendered scenes under samples/: what is there, that depth and vectors mean what samples/README.md says.

The round trip of rendering: half of the frames by Mitsuba, the rest interpolated, doubtful regions rendered.
And the constructed clips: that all can be made, and each frame by itself as it is among others.
"""

import importlib.util
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost.cli.app import app
from fpsboost.method_table import find_method
from support.comparison_truth import save_clip
from support.truth import SCENES, inside, needs_scenes

SAMPLES = Path(__file__).parents[2] / "samples"

sys.path.insert(0, str(SAMPLES))
import construct_clips  # noqa: E402
from constructed import raster  # noqa: E402
from stage import geometry  # noqa: E402
from stage.scenes import scenes  # noqa: E402

NAMES = ["reflective", "texture", "glass"]
WIDTH, HEIGHT, FRAMES = 384, 216, 25
MIDDLE = 12


def read_exr(name: str, kind: str, number: int) -> dict[str, NDArray[Any]]:
    """The channels of a committed file by their names."""
    exr = pytest.importorskip("OpenEXR")
    with exr.File(str(SCENES / name / kind / f"{number:04d}.exr")) as file:
        return {key: channel.pixels.astype(np.float64) for key, channel in file.channels().items()}


def read_flow(name: str, number: int, x: str, y: str, sign: int) -> NDArray[Any]:
    """Two channels of a vector file as a displacement with y down."""
    vectors = read_exr(name, "vectors", number)
    return np.stack([sign * vectors[x], -sign * vectors[y]], axis=-1)


def read_colour(name: str, number: int) -> NDArray[Any]:
    """A committed frame as floats from 0 to 1."""
    image = cv2.imread(str(SCENES / name / f"{number:04d}.png"), cv2.IMREAD_UNCHANGED)
    return image.astype(np.float32) / 255


def sample(image: NDArray[Any], flow: NDArray[Any]) -> NDArray[Any]:
    """An image where the flow points to."""
    y, x = np.mgrid[0 : flow.shape[0], 0 : flow.shape[1]]
    x, y = (x + flow[..., 0]).astype(np.float32), (y + flow[..., 1]).astype(np.float32)
    return cv2.remap(image.astype(np.float32), x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def psnr_where(mask: NDArray[Any], first: NDArray[Any], second: NDArray[Any]) -> float:
    """Likeness of the pixels of a mask, decibels."""
    return -10 * math.log10(np.mean((first[mask] - second[mask]) ** 2))


def find_seen(there: NDArray[Any], back: NDArray[Any]) -> NDArray[Any]:
    """Pixels whose point is inside the other frame and not hidden there: the way back leads home."""
    height, width = there.shape[:2]
    places = np.dstack(np.mgrid[:height, :width][::-1]) + there
    return inside(places, height, width) & (np.linalg.norm(there + sample(back, there), axis=-1) < 0.3)


@needs_scenes
@pytest.mark.parametrize("name", NAMES)
def test_every_frame_has_colour_depth_and_vectors(name):
    """A scene has 25 frames, numbered from 0000, and as many files of depth and of vectors."""
    folder = SCENES / name
    numbers = [f"{number:04d}" for number in range(FRAMES)]
    for place in (folder.glob("*.png"), folder.glob("depth/*.exr"), folder.glob("vectors/*.exr")):
        assert sorted(path.stem for path in place) == numbers
    assert all(read_colour(name, number).shape == (HEIGHT, WIDTH, 3) for number in (0, FRAMES - 1))


@needs_scenes
@pytest.mark.parametrize(("name", "number"), [("reflective", 0), ("texture", MIDDLE), ("glass", FRAMES - 1)])
def test_files_hold_what_the_formulas_say(name, number):
    """Depth is a half float, vectors are rounded to 1/64 of a pixel, and both are those of the scene."""
    scene, around = scenes[name](), (number - 1, number, number + 1)
    depth, vectors = geometry.find_vectors(
        [scene.camera(i) for i in around], [scene.bodies(i) for i in around], (WIDTH, HEIGHT)
    )
    stored = read_exr(name, "depth", number)
    assert list(stored) == ["Z"]
    np.testing.assert_allclose(stored["Z"], depth, rtol=2**-11)
    channels = read_exr(name, "vectors", number)
    assert sorted(channels) == ["W", "X", "Y", "Z"]
    np.testing.assert_allclose(np.dstack([channels[key] for key in "XYZW"]), vectors, atol=1 / 128 + 1e-6)


@needs_scenes
@pytest.mark.parametrize(
    ("step", "there", "back"), [(1, ("Z", "W", -1), ("X", "Y", 1)), (-1, ("X", "Y", 1), ("Z", "W", -1))]
)
def test_vectors_explain_the_matt_scene(step, there, back):
    """The next frame along (-Z, W) and the previous along (X, -Y) are this frame where its points are seen there."""
    flow = read_flow("texture", MIDDLE, *there)
    seen = find_seen(flow, read_flow("texture", MIDDLE + step, *back))
    assert seen.mean() > 0.85
    this, other = read_colour("texture", MIDDLE), read_colour("texture", MIDDLE + step)
    assert psnr_where(seen, sample(other, flow), this) > 30
    assert psnr_where(seen, sample(other, flow * (1, -1)), this) < 24
    assert psnr_where(seen, other, this) < 24


def test_vectors_of_a_shift():
    """A cube that goes right and up has vectors to the left and down: they are old place minus new, with y up."""
    camera = geometry.Camera(np.array([0.0, 0, 5]), np.zeros(3), 90)
    box = geometry.make_box(1, 1, 1)
    bodies = [[(box, geometry.move(0.3 * i, 0.1 * i, 0))] for i in (-1, 0, 2)]
    depth, vectors = geometry.find_vectors([camera] * 3, bodies, (100, 60))
    assert depth[30, 50] == pytest.approx(4)
    assert depth[0, 0] == np.inf
    pixels = 50 / 4  # a length of 1 at this depth
    np.testing.assert_allclose(vectors[30, 50], np.array([-0.3, -0.1, -0.6, -0.2]) * pixels)
    np.testing.assert_allclose(vectors[0, 0], 0, atol=1e-9)


def test_depth_runs_along_the_viewing_axis():
    """A wall that the camera faces is equally deep everywhere; on a floor, depth follows from the camera's height."""
    box = geometry.make_box(50, 0.5, 50)
    camera = geometry.Camera(np.array([0.0, 2, 0]), np.array([0.0, 2, -1]), 60)
    wall, _ = geometry.trace(camera, [(box, geometry.move(0, 0, -9) @ geometry.turn((1, 0, 0), 90))], (40, 30))
    np.testing.assert_allclose(wall, 8.5)
    floor, _ = geometry.trace(camera, [(box, geometry.move(0, -0.5, 0))], (40, 30))
    down = (np.arange(30) + 0.5 - 15) / (20 / math.tan(math.radians(30)))
    below = down > 0.05  # nearer than the floor's end
    expected = np.repeat(2 / down[below, None], 40, axis=1)
    np.testing.assert_allclose(floor.reshape(30, 40)[below], expected)


@pytest.mark.slow
@needs_scenes
def test_the_reports_figures_have_numbers_and_verdicts(monkeypatch):
    """Of a frame of glass: errors by patch and by luminance, shares of failed searches, and verdicts on a page."""
    import report_figures  # noqa: PLC0415 (which needs Matplotlib)

    monkeypatch.setattr(report_figures, "OTHERS", {"scene-assisted": "reproject-scene"})
    frame = report_figures.measure(report_figures.read_clip(SCENES, "glass", 1, frames=3), 1, [5])
    assert frame.patches["box"] == [frame.mse["iterative"]]
    assert 0 < frame.failed["iterative, both"] < frame.failed["iterative"] < 1
    of_glass = {"glass": [frame]}
    assert json.loads(report_figures.as_json(of_glass))["glass"][0]["luminance"] == frame.luminance
    page = report_figures.page_of([report_figures.failures(of_glass), report_figures.luminance(of_glass)])
    assert len(re.findall(r"<h2>[^<]+ <span class='verdict (?:agrees|partly|differs)'", page)) == 2


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed")
@pytest.mark.skipif("merge" not in app, reason="fpsboost has no command merge")
def test_the_round_trip_makes_frames_better(tmp_path):
    """At a small size on the glass cube: within the budget, and with a smaller error of the frames between."""
    size = ["--size", "96x54", "--frames", "5", "--samples", "4", "--budget", "25%"]
    command = [sys.executable, SAMPLES / "round_trip.py", tmp_path / "out", "--scene", "glass", *size]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    found = re.search(r"error ([\d.]+) -> ([\d.]+), ([\d.]+)% of the pixels", told.stdout)
    assert found, told.stdout + told.stderr
    before, after, share = map(float, found.groups())
    assert after < before
    assert 0 < share <= 25
    assert sorted(path.name for path in (tmp_path / "out" / "merged").iterdir()) == [f"{n:04d}.exr" for n in range(5)]


SIZE = (48, 27)
TABLE = (SAMPLES / "README.md").read_text(encoding="utf-8").split("## Constructed clips")[1].split("\n## ")[0]
CLIPS = [line.split("`")[1] for line in TABLE.splitlines() if line.startswith("| `")]


@pytest.mark.parametrize("name", CLIPS)
def test_a_frame_depends_on_its_number_alone(name):
    """Drawn after others or by itself, a frame is the same to the byte, and time does not stand still."""
    first, second = construct_clips.construct(name, SIZE, range(2))
    (alone,) = construct_clips.construct(name, SIZE, [1])
    assert first.shape == (27, 48, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(alone, second)
    assert not np.array_equal(first, second)


def test_the_program_writes_what_is_asked_for(monkeypatch, tmp_path):
    """A folder for each clip, numbered frames in it, nothing else."""
    arguments = [str(tmp_path), "--only", "fire", "--only", "titles", "--frames", "3", "--size", "48x27"]
    monkeypatch.setattr(sys, "argv", ["construct_clips.py", *arguments])
    construct_clips.main()
    written = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.png"))
    assert written == [f"{name}/000{k}.png" for name in ("fire", "titles") for k in range(3)]
    (alone,) = construct_clips.construct("titles", SIZE, [2])
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "titles" / "0002.png")), alone)


def test_every_clip_is_in_the_table():
    """samples/README.md names each clip, and none besides."""
    assert list(construct_clips.clips) == CLIPS


def test_samples_show_the_place_that_the_matrix_takes_there():
    """A texture whose colours are places comes out as the places that the inverse matrix says."""
    view = raster.Raster(96, 54)
    x, y = raster.find_places((600, 400), view.density)
    texture = raster.Texture(np.dstack([x, y, x]).astype(np.float32), view.density)
    matrix = raster.shift(7.3, -4) @ raster.turn(5) @ raster.tilt(10, -6) @ raster.enlarge(1.1)
    x, y = view.places
    from_x, from_y, one = np.linalg.inv(matrix) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    filled = view.fill(texture, matrix).reshape(-1, 3)
    np.testing.assert_allclose(filled[:, 0], from_x / one, atol=0.1)  # a sixteenth of a sample
    np.testing.assert_allclose(filled[:, 1], from_y / one, atol=0.1)
    seen = view.look_up(texture, x + 3.25, y - 1.5)
    np.testing.assert_allclose(seen[..., 0], x + 3.25, atol=0.1)
    np.testing.assert_allclose(seen[..., 1], y - 1.5, atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("edge_weight", [0, 4], ids=["squares", "edges"])
def test_the_table_of_weights_is_what_the_fit_makes(tmp_path, edge_weight):
    """A short fit to small scenes improves on plain weights, its gradient is right, and the table improves on them."""
    fit = importlib.import_module("fit_fusion")
    for name in ("titles", "tiles", "growing"):
        save_clip(tmp_path / name, construct_clips.construct(name, (192, 128), range(5), seed=9))
    clips, method = sorted(tmp_path.iterdir()), find_method("nlm")
    frames = [frame for clip in clips for frame in fit.draw_clip(clip, method, 16, 1)]
    objective = fit.Objective(frames, edge_weight)
    start, random = fit.find_start(objective, "random"), np.random.default_rng(1)
    start = fit.Numbers(*(each + random.normal(size=each.shape) * 0.1 for each in start))
    every = range(len(frames))
    _, slopes = objective(start, every)
    length = 1e-3 / math.sqrt(sum((slope**2).sum() for slope in slopes))
    ahead, behind = (
        objective(fit.Numbers(*(at + sign * length * slope for at, slope in zip(start, slopes, strict=True))), every)[0]
        for sign in (1, -1)
    )
    assert ahead - behind == pytest.approx(2 * length * sum((slope**2).sum() for slope in slopes), rel=0.1)
    *_, fitted = fit.fit(objective, fit.find_start(objective, "random"), 0.03, 10)
    for numbers in (fitted, fit.find_start(objective, "current")):
        assert objective.gain(numbers).mean() > 0.05


@pytest.mark.slow
@needs_scenes
def test_the_published_benchmark_measured_these_scenes(monkeypatch):
    """The pixels that the benchmark reads have the hash that it compares with and that the page of results names."""
    monkeypatch.syspath_prepend(SAMPLES.parent / "benchmarks")
    quality = importlib.import_module("quality")
    found = quality.measure(
        quality.argparse.Namespace(clip=[SCENES], methods="nearest", peer=[], metrics=[], frames=40, crops=None),
        quality.Console(quiet=True),
    )["sha256"]["scenes"]
    assert found == quality.PUBLISHED["scenes"]
    assert f"`{found}`, as published" in (SAMPLES.parent / "docs" / "benchmark.md").read_text(encoding="utf-8")
