"""The comparison: every method on constructed motion, as in a conversion; the command; and its JSON and CSV."""

import csv
import json
import re
import shutil
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from fpsboost import CutDetector, FrameCache, OptionError, VectorFolder, convert, find_method
from fpsboost.evaluation.compare import compare
from fpsboost.evaluation.compared_methods import (
    ComparedInterpolator,
    InterpolatedFrame,
    Minterpolate,
)
from fpsboost.evaluation.export import DATA_VERSION, as_json, write_csv, write_json
from fpsboost.evaluation.further_metrics import metrics
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.regions import AREAS, find_regions
from fpsboost.evaluation.results import ComparedClip, Comparison, FrameResult, MethodResult, Scores
from support.command_line import assert_refused
from support.comparison_truth import HEIGHT, WIDTH, Nobody, pan, save_clip
from support.truth import noise
from support.vector_truth import save_object
from support.video_truth import write_clip

STEP = 2  # pixels that everything moves from frame to frame

FRAMES = ["frame"] * 3


def ours(*names):
    """Methods of this package as a comparison takes them."""
    return {name: ComparedInterpolator(find_method(name)) for name in names}


def panned(number, dtype=np.uint8):
    """A frame of the pan."""
    return pan(STEP * number, dtype)


@pytest.fixture
def folder(tmp_path):
    """Seven frames of the pan."""
    return save_clip(tmp_path / "pan", map(panned, range(7)))


def test_a_comparison_makes_the_frames_of_a_conversion(folder, tmp_path):
    """Bit by bit: every second image of a folder, converted, gives what was compared."""
    (tmp_path / "half").mkdir()
    for number in (0, 2, 4, 6):
        shutil.copy(f"{folder}/{number:04}.png", tmp_path / "half" / f"{number // 2:04}.png")
    convert(str(tmp_path / "half"), str(tmp_path / "whole"), factor=2, method="nlm")
    converted = [cv2.imread(str(path)) for path in sorted((tmp_path / "whole").iterdir())]
    intervals = HoldOut().intervals(folder)
    nlm = ComparedInterpolator(find_method("nlm"))
    frames = list(nlm.interpolate(intervals))
    assert [frame.number for frame in frames] == [1, 3, 5]
    for frame in frames:
        np.testing.assert_array_equal(frame.image, converted[frame.number])
        (again,) = nlm.interpolate(HoldOut().intervals(folder), [frame.number])
        np.testing.assert_array_equal(frame.image, again.image)


@pytest.mark.slow
def test_a_comparison_knows_who_is_better(folder):
    """Figures of every frame and method, their means, and no more said than asked."""
    observer = Nobody()
    comparison = compare(folder, ours("dis", "blend"), HoldOut(), observer, skipped={"other": "it is not there"})
    dis, blend = comparison.methods
    assert comparison.hidden == [1, 3, 5] == [frame.number for frame in dis.frames]
    assert comparison.means(dis)["psnr"] > comparison.means(blend)["psnr"] + 5
    assert comparison.means(dis)["mae"] < comparison.means(blend)["mae"]
    assert comparison.shares["moving"] > 0.9
    assert comparison.mean_error(blend, "moving") == pytest.approx(comparison.means(blend)["mae"], rel=0.2)
    assert comparison.cuts == []
    assert all(frame.seconds > 0 for frame in dis.frames)
    assert observer.told == [("reading", None), *FRAMES, ("dis", 3), *FRAMES, ("blend", 3), *FRAMES]
    plain = json.loads(json.dumps(as_json(comparison), allow_nan=False))
    assert plain["skipped"] == {"other": "it is not there"}
    assert plain["methods"][0]["mean"]["psnr"] == pytest.approx(comparison.means(dis)["psnr"])
    assert len(plain["methods"][1]["frames"]) == 3


def test_a_comparison_knows_the_radius_that_was_searched(folder):
    """Of each frame of a method that has one; it is a number in the data, and null where there is none."""
    comparison = compare(folder, ours("nlm-exhaustive", "blend"), HoldOut(last=3), Nobody())
    searched, blended = as_json(comparison)["methods"]
    (radius,) = (frame["search_radius"] for frame in searched["frames"])
    assert 2 * STEP <= radius <= 2 * (2 * STEP)
    assert [frame["search_radius"] for frame in blended["frames"]] == [None]


def test_frames_across_a_cut_are_not_counted(tmp_path):
    """They are made and listed, but no method can know them."""
    images = [panned(number) if number < 4 else 255 - panned(number)[::-1] for number in range(7)]
    comparison = compare(save_clip(tmp_path, images), ours("blend"), HoldOut(), Nobody())
    (blend,) = comparison.methods
    made, counted = ([frame.number for frame in frames] for frames in (blend.frames, comparison.counted(blend)))
    assert (comparison.cuts, made, counted) == ([3], [1, 3, 5], [1, 5])


class Square:
    """A bright square that moves by 6 pixels a frame over a still background."""

    def __init__(self):
        rng = np.random.default_rng(0)
        self.background = cv2.GaussianBlur(rng.integers(0, 120, (96, 128, 3)).astype(np.uint8), (0, 0), 1)
        self.thing = cv2.GaussianBlur(rng.integers(130, 256, (32, 32, 3)).astype(np.uint8), (0, 0), 1)

    def covered(self, number):
        """Where it is."""
        mask = np.zeros((96, 128), bool)
        mask[32:64, 30 + 6 * number : 62 + 6 * number] = True
        return mask

    def frame(self, number):
        """Background and square."""
        image = self.background.copy()
        image[self.covered(number)] = self.thing.reshape(-1, 3)
        return image


@pytest.mark.parametrize("has_vectors", [False, True])
def test_areas_tell_what_moves_and_what_is_hidden(tmp_path, has_vectors):
    """As constructed: the square moves, and beside it lies what it hides in one of the frames shown."""
    square = Square()
    save_object(tmp_path / "v", tmp_path / "d", (96, 128), (32, 30, 64, 62), 3, (6, 0))
    (interval,) = HoldOut(duplicates="keep").intervals(save_clip(tmp_path / "clip", map(square.frame, range(3))))
    (regions,) = find_regions(interval, VectorFolder(tmp_path / "v") if has_vectors else None)
    now = square.covered(1)
    hidden = (square.covered(0) | square.covered(2)) & ~now
    assert regions.moving[now].mean() > 0.95
    assert regions.moving[:, 90:].mean() < 0.05
    assert regions.occluded[hidden].mean() > (0.9 if has_vectors else 0.4)
    assert regions.occluded[cv2.dilate((hidden | now).astype(np.uint8), np.ones((9, 9))) == 0].mean() < 0.01
    assert regions.uncertain.mean() < 0.02


@pytest.mark.parametrize("change", [(200, 0, 0), (0, 40, -30)], ids=["flare", "colour"])
def test_what_no_frame_has_is_uncertain(tmp_path, change):
    """A flare, or another colour of the same luma, in the hidden frame alone is in neither of those shown."""
    images = [Square().frame(number) for number in range(3)]
    spot = cv2.cvtColor(images[1][8:32, 88:112], cv2.COLOR_BGR2YCrCb) + np.float32(change)
    images[1][8:32, 88:112] = cv2.cvtColor(spot.clip(0, 255).astype(np.uint8), cv2.COLOR_YCrCb2BGR)
    (interval,) = HoldOut().intervals(save_clip(tmp_path, images))
    (regions,) = find_regions(interval)
    assert regions.uncertain[12:28, 92:108].mean() > 0.9
    assert regions.uncertain[60:, :].mean() < 0.02


def test_fast_motion_is_no_cut(tmp_path):
    """A cut is looked for between true frames: two of them are alike where those shown are not."""
    rng = np.random.default_rng(2)
    wide = cv2.GaussianBlur(rng.integers(0, 256, (48, 400, 3)).astype(np.uint8), (0, 0), 3)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)
    images = [wide[:, 12 * number : 12 * number + 96] for number in range(7)]
    caches = [FrameCache(np.ascontiguousarray(image)) for image in images]
    match_score = CutDetector().match_score
    near, far = ([match_score(*pair) for pair in zip(caches, caches[step:], strict=False)] for step in (1, 2))
    assert max(far) < min(near)
    between = CutDetector(threshold=(max(far) + min(near)) / 2, drop=1)
    assert compare(save_clip(tmp_path, images), ours("blend"), HoldOut(), Nobody(), cuts=between).cuts == []


def repeating(folder):
    """The pan, whose seventh frame is shown twice."""
    return save_clip(folder, (panned(number - (number >= 7)) for number in range(12)))


def test_a_repeat_gives_nobody_a_frame_for_nothing(tmp_path):
    """Where frame 7 repeats frame 6, blending has no frame 6 or 7 to win by, and what is beside it does not count."""
    path = repeating(tmp_path / "clip")
    compared_methods = ours("dis", "blend")
    comparison = compare(path, compared_methods, HoldOut(), Nobody())
    assert comparison.repeats == [7]
    assert comparison.hidden == [1, 3, 5, 8, 10]
    assert comparison.doubtful == [8]
    dis, blend = ([frame.scores.psnr for frame in comparison.counted(each)] for each in comparison.methods)
    assert len(dis) == 4
    assert min(np.subtract(dis, blend)) > 3
    plain = as_json(comparison)
    assert (plain["repeats"], plain["doubtful"], plain["times"]) == ([7], [8], [0.5, 0.5, 0.5, 2 / 3, 0.5])
    assert len(ComparedClip(comparison, compared_methods).notes()) == 2


def test_motion_at_uneven_times_is_made_at_them(tmp_path):
    """A pan at constant speed whose frames come when they like: a method that knows the times is as good as ever."""
    times = [0, 4, 8, 9, 16, 22, 24]
    path = str(write_clip(tmp_path / "a.mkv", times=times, time_base=Fraction(1, 100), rate=Fraction(25)))
    intervals = list(HoldOut().intervals(path))
    assert [float(each.hidden[0].t) for each in intervals] == [0.5, 0.125, 0.75]
    compared_methods = {"blend": ComparedInterpolator(find_method("blend")), "rigid": Rigid()}
    comparison = compare(path, compared_methods, HoldOut(), Nobody())
    for interval, frame in zip(intervals, comparison.methods[0].frames, strict=True):
        t = float(interval.hidden[0].t)
        mixed = (1 - t) * interval.shown0.image.astype(float) + t * interval.shown1.image
        mse = float(((np.rint(mixed) - interval.hidden[0].truth) ** 2).mean())
        assert frame.scores.mse == pytest.approx(mse, rel=0.1)
    assert comparison.uneven == [3, 5]
    (note,) = ComparedClip(comparison, compared_methods).notes()
    assert "(even ones with rigid): 3, 5." in note


class Rigid:
    """A method that knows no times."""

    any_time = False

    def interpolate(self, intervals, wanted=None):
        for interval in intervals:
            for hidden in interval.hidden:
                yield InterpolatedFrame(hidden.number, interval.shown0.image, 0.1, 0.1)

    def describe(self):
        return "rigid"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_minterpolate_joins(tmp_path, dtype):
    """FFmpeg's filter makes every hidden frame, in the clip's own type, and only those wanted if so told."""
    clip = save_clip(tmp_path, (panned(number, dtype) for number in range(5)))
    frames = list(Minterpolate().interpolate(HoldOut().intervals(clip)))
    assert [frame.number for frame in frames] == [1, 3]
    scale = np.iinfo(dtype).max / 255
    for frame in frames:
        assert frame.image.dtype == dtype
        # away from the sides, where what comes into view cannot be known
        image, truth = frame.image[8:-8, 12:-12] / scale, panned(frame.number)[8:-8, 12:-12].astype(float)
        assert cv2.PSNR(image, truth) > 22
    (wanted,) = Minterpolate().interpolate(HoldOut().intervals(clip), {3})
    np.testing.assert_array_equal(wanted.image, frames[1].image)


def test_a_filter_that_fails_says_why(folder):
    """In one sentence with its options."""
    with pytest.raises(OptionError, match="minterpolate does not take no_such_option=1"):
        list(Minterpolate("no_such_option=1").interpolate(HoldOut().intervals(folder)))


def test_the_command_prints_tables_and_writes_figures(fpsboost_, folder, tmp_path):
    """Exit code 0, every method by name, JSON that says the same, and a note on the method that lacks its vectors."""
    result = fpsboost_("compare", folder, "-m", "dis,blend,reproject-image", "--json", "figures.json")
    assert (result.code, result.err) == (0, "")
    assert "reproject-image was skipped, it needs the renderer's motion vectors" in result.out
    for word in ("dis", "blend", "PSNR", "occluded"):
        assert word in result.out
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert [method["name"] for method in figures["methods"]] == ["dis", "blend"]
    assert f"{figures['methods'][0]['mean']['psnr']:.2f}" in result.out


@pytest.mark.parametrize("more", [(), ("--report", "page"), ("--json", "figures.json")])
@pytest.mark.parametrize("names", ["reproject-image", "reproject-image,reproject-scene"])
def test_nothing_to_compare_is_an_error(fpsboost_, folder, tmp_path, unchanged, names, more):
    """One sentence says why each method was skipped, exit code 2, and nothing is written."""
    with unchanged(tmp_path):
        sentence = "There is no method to compare; reproject-image was skipped, it needs the renderer's motion"
        assert_refused(fpsboost_("compare", folder, "-m", names, *more), 2, sentence)


def test_no_frame_left_is_an_error(fpsboost_, tmp_path):
    """A still, one frame, one held picture, and a cut in every interval: one sentence each that says what to do."""
    save_clip(tmp_path / "still", [pan(0)] * 9)
    save_clip(tmp_path / "one", [pan(0)])
    save_clip(tmp_path / "cut", [pan(0), pan(10), noise(HEIGHT, WIDTH)])
    for name, words in (
        ("still", "4 beside repeated frames, in stills or pauses (--duplicates keep takes repeats too)"),
        ("one", "has too few frames"),
        ("cut", "1 across a scene cut (--no-cuts takes everything for one scene)"),
    ):
        result = fpsboost_("compare", name, "-m", "blend", "--report", "page")
        assert (result.code, len(result.lines)) == (1, 1)
        assert words in result.err
        assert not (tmp_path / "page").exists()
    assert fpsboost_("compare", "still", "-m", "blend", "--duplicates", "keep").code == 0


def test_a_low_first_method_fails_if_so_told(fpsboost_, folder, tmp_path):
    """Exit code 3 and one sentence below --fail-under, with everything written; 0 at it; 2 if that one was skipped."""
    result = fpsboost_("compare", folder, "-m", "blend,dis", "--fail-under", "60", "--json", "a.json", "-q")
    assert (result.code, result.out, len(result.lines)) == (3, "", 1)
    psnr = json.loads((tmp_path / "a.json").read_text())["methods"][0]["mean"]["psnr"]
    assert f"blend reaches {psnr:.2f} dB, below the 60 dB of --fail-under." in result.err
    assert fpsboost_("compare", folder, "-m", "blend,dis", "--fail-under", psnr, "-q").code == 0
    skipped = fpsboost_("compare", folder, "-m", "reproject-image,blend", "--fail-under", "1")
    assert_refused(skipped, 2, "--fail-under checks reproject-image, which cannot be run here")
    assert fpsboost_("compare", folder, "-m", "blend", "--fail-under", "nan").code == 2


@pytest.mark.slow
def test_a_clip_is_read_as_a_conversion_reads_it(fpsboost_, tmp_path):
    """Part, stream, fields, repeats and cuts by the same options, which the page's command repeats."""

    def figures(*options):
        (tmp_path / "a.json").unlink(missing_ok=True)
        result = fpsboost_("compare", *options, "-m", "blend", "--json", "a.json", "-q")
        assert (result.code, result.err) == (0, "")
        return json.loads((tmp_path / "a.json").read_text())

    clip = write_clip(tmp_path / "a.mkv", times=range(12), second_video=True)
    assert figures(clip, "--start", "0.16", "--end", "11f")["hidden"] == [5, 7, 9]
    assert figures(clip, "--range", "4:11")["hidden"] == [5, 7, 9]
    assert figures(clip, "--deinterlace")["clip_frames"] > 20
    assert figures(repeating(tmp_path / "pan"), "--duplicates", "keep")["repeats"] == []
    (tmp_path / "cuts.txt").write_text("6f\n")
    told = figures(clip, "--cuts", "cuts.txt")
    assert told["cuts"] == [5]
    assert told["cut_options"] == ["--cuts", "cuts.txt"]
    assert_refused(fpsboost_("compare", clip, "--stream", "1", "-m", "blend"), 1, "too few frames")
    assert_refused(
        fpsboost_("compare", clip, "--range", "2:", "--start", "1", "-m", "blend"),
        2,
        "--range and --start cannot be combined",
    )


def test_cuts_that_a_list_names_are_cuts_for_the_methods(fpsboost_, folder, tmp_path):
    """Behind the frame that a list calls a cut, a method repeats instead of moving."""
    (tmp_path / "cuts.txt").write_text("2f\n")
    command = ("compare", folder, "-m", "dis,nearest", "-q")
    assert fpsboost_(*command, "--cuts", "cuts.txt", "--json", "a.json").code == 0
    assert fpsboost_(*command, "--no-cuts", "--json", "b.json").code == 0
    listed, free = (json.loads((tmp_path / name).read_text()) for name in ("a.json", "b.json"))
    assert (listed["cuts"], free["cuts"]) == ([1], [])
    dis, nearest = (method["frames"][0]["scores"]["psnr"] for method in listed["methods"])
    assert dis == nearest
    assert free["methods"][0]["frames"][0]["scores"]["psnr"] > nearest + 3


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (("-m", "magic"), 2, "There is no method 'magic'; choose one of nlm"),
        (("--range", "0:2"), 2, "leaves nothing to hide"),
        (("--range", "x"), 2, "is not a range"),
        (("--start", "0.1"), 2, "say it with --input-fps"),
        (("--deinterlace",), 2, "--deinterlace is for video files"),
        (("--duplicates", "drop"), 2, "duplicates"),
        (("--no-cuts", "--cut-threshold", "0.5"), 2, "cannot be combined"),
        (("--depth", "pan"), 2, "--depth needs --vectors"),
        (("--vectors", "nowhere"), 1, "nowhere"),
        (("--skip", "0"), 2, "--skip must be at least 1"),
        (("--skip", "6"), 1, "too few frames"),
        (("--json", "taken"), 1, "taken exists"),
        (("--report", "taken"), 1, "taken is a file"),
        (("--json", "no/such/folder.json"), 1, "its folder does not exist"),
        (("--report", "loop"), 1, "loop is a link that leads nowhere"),
        (("--csv", "loop"), 1, "loop exists"),
        (("--json", "one", "--csv", "./one"), 2, "./one is already the path of another result"),
        (("--report", "page", "--json", "page"), 2, "page is already the path of another result"),
    ],
)
def test_what_cannot_be_compared_is_one_sentence(fpsboost_, folder, tmp_path, unchanged, arguments, code, sentence):
    """And nothing is written."""
    (tmp_path / "taken").write_text("precious")
    (tmp_path / "loop").symlink_to("loop")
    with unchanged(tmp_path):
        methods = () if "-m" in arguments else ("-m", "blend")
        assert_refused(fpsboost_("compare", folder, *methods, *arguments), code, sentence)


DESCRIPTION = (Path(__file__).parents[2] / "docs" / "comparison.md").read_text(encoding="utf-8")


@pytest.fixture
def comparison():
    """Two methods on three frames, the last of which does not count; of one method nobody knows the time."""

    def frame(number, seconds):
        areas = dict.fromkeys(AREAS, 2.0), dict.fromkeys(AREAS, np.nan)
        radius = None if np.isnan(seconds) else 15
        further = dict.fromkeys(metrics, 1.0)
        return FrameResult(number, Scores(4.0, 42.1, 0.9, 1.5), seconds, seconds, *areas, radius, further)

    methods = [
        MethodResult("nlm:v=0.1,patch-radius=4", "options", [frame(number, 0.5) for number in (1, 3, 5)]),
        MethodResult("other, tool", "images", [frame(number, np.nan) for number in (1, 3, 5)]),
    ]
    shares = dict.fromkeys(AREAS, 0.3)
    more = {"times": [0.5, 0.25, 0.5], "clip_frames": 7, "metrics": metrics}
    return Comparison("clip", "8x8", HoldOut(), [1, 3, 5], [5], shares, methods, {}, **more)


def names_in(value):
    """Every name of plain data, however deep."""
    if isinstance(value, dict):
        return set(value).union(*map(names_in, value.values()))
    return set().union(*map(names_in, value)) if isinstance(value, list) else set()


def test_every_name_in_the_data_is_described(comparison):
    """The version too; names of methods and programs are data themselves."""
    data = as_json(comparison)
    assert data["version"] == DATA_VERSION
    assert f"`version` is {DATA_VERSION};" in DESCRIPTION
    described = set(re.findall(r"[\w-]+", " ".join(re.findall(r"`([^`\n]+)`", DESCRIPTION.replace("```", "")))))
    data["verdict"]["cpu_seconds"] = data["made_with"] = data["skipped"] = {}
    assert names_in(data) <= described


def test_the_data_are_json_for_everyone(comparison, tmp_path):
    """No NaN, which JSON has not: what nobody knows is null."""
    write_json(tmp_path / "x.json", [comparison])
    text = (tmp_path / "x.json").read_text()
    data = json.loads(text, parse_constant=pytest.fail)
    assert data["methods"][1]["mean"]["seconds"] is None
    assert data["methods"][1]["frames"][0]["cpu_seconds"] is None
    assert data["verdict"]["cheapest"] == "nlm:v=0.1,patch-radius=4"


def test_the_table_has_a_row_for_each_method_and_frame(comparison, tmp_path):
    """Plain headings, each described; names with commas survive; what nobody knows is an empty cell."""
    write_csv(tmp_path / "x.csv", [comparison])
    with (tmp_path / "x.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["frame"]) for row in rows] == [
        (name, number) for name in ("nlm:v=0.1,patch-radius=4", "other, tool") for number in ("1", "3", "5")
    ]
    assert [row["counted"] for row in rows[:3]] == ["1", "1", "0"]
    assert (rows[1]["t"], rows[1]["psnr"], rows[1]["seconds"]) == ("0.25", "42.1", "0.5")
    assert (rows[3]["seconds"], rows[3]["mae_still"]) == ("", "")
    assert (rows[1]["search_radius"], rows[3]["search_radius"]) == ("15", "")
    assert set(rows[0]) >= {f"mae_{name}" for name in (*AREAS, *AREAS.values())}
    assert rows[0]["xpsnr"] == "1.0"
    for name in rows[0]:
        assert f"`{name}`" in DESCRIPTION
