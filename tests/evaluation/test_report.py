"""The page of a comparison: what it holds, in one file, what it is drawn from, and what stands for methods in it."""

import base64
import csv
import itertools
import json
import math
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest

from fpsboost import DecodeOptions, OutputError
from fpsboost.cli.options import ComparedMethodOptions
from fpsboost.colour import as_shown
from fpsboost.evaluation.compare import compare
from fpsboost.evaluation.compared_methods import InterpolatedFrame, method_names
from fpsboost.evaluation.hidden_frames import HoldOut, read_samples
from fpsboost.evaluation.report.page import _view_frames, choose_frames, command, shared_out, write_report
from fpsboost.evaluation.report.pictures import choose_exact, choose_passages, find_spots, view_passages
from fpsboost.evaluation.report.styles import (
    DASH_DOTTED,
    DASHED,
    MAX_LINE,
    NAMED,
    SOLID,
    break_name,
    colours_of,
    styles_of,
)
from fpsboost.evaluation.results import ComparedClip, MethodResult
from fpsboost.evaluation.verdict import judge_all
from support.command_line import assert_refused
from support.comparison_truth import HEIGHT, NAMES, WIDTH, Nobody, scored
from support.vector_truth import save_translation


@pytest.fixture(scope="module")
def text(report_path):
    return report_path.read_text(encoding="utf-8")


def decoded(uri):
    """The pixels of a data URI."""
    return cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)


def test_page_loads_nothing(report_path, text):
    """Whatever the page shows lies in one file: no address leads out of it, and its own policy forbids any."""
    assert [path.name for path in report_path.parent.iterdir()] == ["index.html"]
    loaded = re.findall(r"""\b(?:src|href|srcset|poster|data|action)=(["'])(.+?)\1""", text)
    assert loaded
    assert [address for _, address in loaded if not address.startswith(("data:", "#"))] == []
    assert re.findall(r"url\((?!#|[\"']?data:)|@import", text) == []
    assert "default-src 'none'" in text


def test_page_holds_every_method(text, comparison):
    """Every method has its row with the comparison's own numbers, its line in each figure, options and colours."""
    for index, method in enumerate(comparison.methods):
        scores = comparison.means(method)
        row = re.search(rf'<tr data-method="{index}">.*?</tr>', text, re.DOTALL)
        assert method.name in row[0]
        assert f">{scores['psnr']:.2f}<" in row[0]
        assert f">{scores['ssim']:.4f}<" in row[0]
        assert (
            text.count(f'class="series line method-{index}" data-method="{index}"') == 12
        )  # 4 figures of quality and 2 of time, 2 forms
        assert method.options.replace("'", "&#39;").replace("0.16666666666666666", "1/6") in text
        assert f".method-{index} {{ --method: light-dark({', '.join(colours_of(method.name))}); }}" in text
    assert text.count("<b>minterpolate</b> was skipped: there is no &lt;ffmpeg&gt; here.") == 1


def test_page_says_how_to_repeat_it(text, comparison):
    """The command names the clip, the methods and what was hidden, and is on the page."""
    hold_out = HoldOut(skip=2, first=1, last=9, decoding=DecodeOptions(input_fps=24))
    words = "fpsboost", "compare", comparison.clip, "-m", "dis,blend,nearest,minterpolate", "--report", "DIR"
    assert " ".join(f"<span>{word}</span>" for word in words) in text
    assert "--skip 2 --range 1:9 --input-fps 24 --report" in command(replace(comparison, hold_out=hold_out))
    rendered = replace(comparison, rendered=("--vectors", "my passes"), cut_options=("--no-cuts",))
    assert command(rendered).endswith("--vectors 'my passes' --no-cuts --report DIR")


def test_folder_that_holds_anything_is_left_alone(comparison, compared_methods, tmp_path):
    """It is refused, and nothing is added."""
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=rf"^{re.escape(str(tmp_path))} is not empty; [^.]*\.$"):
        write_report(tmp_path, [ComparedClip(comparison, compared_methods)])
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cuts": [0]}, "Not counted: frame {},"),
        ({"doubtful": [0], "repeats": [1]}, "the true picture is unknown: {}."),
    ],
)
def test_frames_that_do_not_count_are_named_and_not_drawn(comparison, compared_methods, tmp_path, changes, words):
    """Across a cut or beside a repeat: said, marked in every figure, and never picked to be shown."""
    worst = min(comparison.methods[0].frames, key=lambda frame: frame.scores.psnr).number
    changed = replace(comparison, **{name: [worst + each for each in numbers] for name, numbers in changes.items()})
    text = write_report(tmp_path / "page", [ComparedClip(changed, compared_methods)]).read_text()
    assert words.format(worst) in text
    assert text.count('class="cut"') == 12
    assert worst not in choose_frames(changed)


@pytest.mark.slow
def test_small_areas_are_not_on_the_page(comparison, compared_methods, tmp_path):
    """An area of less than 2 % of the picture, or of more than 98 %, has no columns; without any there is no table."""
    shares = {"moving": 0.5, "occluded": 0.019, "uncertain": 0.03}
    text = write_report(
        tmp_path / "page", [ComparedClip(replace(comparison, shares=shares), compared_methods)]
    ).read_text()
    assert "50 % moving" in text
    assert "3 % uncertain" in text
    assert "% occluded" not in text
    none = replace(comparison, shares=dict.fromkeys(shares, 0.01) | {"moving": 0.99})
    assert 'id="by-area"' not in write_report(tmp_path / "other", [ComparedClip(none, compared_methods)]).read_text()


class Darkening:
    """A method that looks at all of the clip: each frame is darker than the one made before, and the first is white."""

    any_time: ClassVar[bool] = False

    def interpolate(self, intervals, wanted=None):
        for count, interval in enumerate(intervals):
            for hidden in interval.hidden:
                if wanted is None or hidden.number in wanted:
                    yield InterpolatedFrame(hidden.number, np.full_like(hidden.truth, 255 - 60 * count), 0.1, 0.1)

    def describe(self):
        return "darkens"


def test_frames_shown_are_those_that_were_scored(comparison):
    """Methods are run over the whole clip again, so that they make what they made before."""
    compared_methods = {"darkening": Darkening()}
    scored = compare(comparison.clip, compared_methods, HoldOut(), Nobody())

    def has_level(uri, number):
        return np.allclose(decoded(uri), 255 - 60 * scored.hidden.index(number), atol=2)  # WebP is lossy

    for number, strips in _view_frames(ComparedClip(scored, compared_methods), choose_frames(scored))[0].items():
        assert has_level(strips[0].crops[1].uri, number)
    played = view_passages(ComparedClip(scored, compared_methods), [scored.hidden[1:3]])
    hidden = [frame for frame in played.frames if frame["note"] == "hidden"]
    assert [frame["number"] for frame in hidden] == scored.hidden[1:3]
    assert all(has_level(played.uris[frame["images"][1]], frame["number"]) for frame in hidden)


def test_a_frame_chosen_twice_is_shown_once(comparison):
    """Worst, median, best and most different: every frame once, with all its reasons."""
    chosen = choose_frames(comparison)
    assert sum(map(len, chosen.values())) == 4
    psnr = {frame.number: frame.scores.psnr for frame in comparison.methods[0].frames}
    assert next(iter(chosen)) == min(psnr, key=lambda number: psnr[number])


@pytest.mark.parametrize(
    ("pixel", "shown"),
    [
        (np.array([65535, 0, 32768], np.uint16), [255, 0, 128]),
        (np.array([2.0, -1.0, 0.5], np.float32), [255, 0, 188]),
        (np.array([255, 0, 0, 0], np.uint8), [128, 128, 128]),
        (np.array([100, 255], np.uint8), [100, 100, 100]),
        (np.array([7], np.uint8), [7, 7, 7]),
    ],
    ids=["16-bit", "linear float", "transparent", "gray and opaque", "gray"],
)
def test_any_image_is_shown_in_8_bit_colours(pixel, shown):
    """Depths are scaled, floats clipped and shown as sRGB, what is transparent lies over mid gray."""
    assert as_shown(np.tile(pixel, (2, 3, 1))).tolist() == [[shown] * 3] * 2


def test_spots_are_where_the_errors_are():
    """The first is where all err, the second where one errs less than the others, and they do not overlap."""
    common = np.zeros((120, 200), np.float32)
    common[60:108, 10:58] = 20
    other = common.copy()
    other[5:53, 130:178] = 10
    first, second = find_spots([common, other])
    assert first[:3] == (10, 60, 48)
    assert second[:3] == (130, 5, 48)
    assert len(find_spots([np.ones((20, 24), np.float32)])) == 1  # two have no room beside each other


@pytest.mark.parametrize(
    ("leads", "outcome"),
    [
        ([1.0, 0.8, 1.2], "in the mean of 3 clips, 1.0 dB ahead of b; nothing"),
        ([1.0, -1.0, 0.3], "in the mean of 3 clips, 0.1 dB ahead of b, which is level; "),
        ([1] * 5 + [-0.2], "in the mean of 6 clips, 0.8 dB ahead of b; nothing"),
    ],
)
def test_a_lead_on_several_clips_is_more_than_chance(comparison, leads, outcome):
    """Two methods are level within two standard errors of their differences, clip by clip."""
    clips = []
    for lead in leads:
        methods = [MethodResult(name, "", [scored(1, psnr)]) for name, psnr in (("a", 30.0), ("b", 30.0 - lead))]
        clips.append(replace(comparison, methods=methods, hidden=[1], cuts=[], doubtful=[]))
    advice, figures = judge_all(clips)
    assert advice.startswith(f"Take a: best picture {outcome}")
    assert re.search(
        rf"a reaches 30\.00 dB .* {np.mean(leads):.2f} ± .* best on (all|{sum(x > 0 for x in leads)}) of", figures
    )


@pytest.mark.slow
def test_command_compares_several_clips(comparison, fpsboost_, tmp_path):
    """Tables of each, a table of the means, one page, one JSON and one CSV that name the clips."""
    shutil.copytree(comparison.clip, tmp_path / "second")
    shutil.copytree(comparison.clip, tmp_path / "first")
    for number in range(2):
        (tmp_path / "second" / f"{number:04d}.png").unlink()
    for name, count in (("first", 7), ("second", 5)):
        save_translation(tmp_path / name / "of", count, (HEIGHT, WIDTH), 1, 0)
    arguments = ["-m", "blend,nearest", "--report", "page", "--json", "x.json", "--csv", "x.csv"]
    arguments += ["--vectors", "{in}/of"]
    result = fpsboost_("compare", "first", "second", *arguments)
    assert result.code == 0, result.err
    assert "2 clips" in result.out
    assert result.out.splitlines()[-1] == f"Page: {Path('page', 'index.html')}"
    assert re.search(r"^Take blend: best picture in the mean of 2 clips, [\d.]+ dB ahead of nearest", result.out, re.M)
    data = json.loads((tmp_path / "x.json").read_text())
    assert [each["rendered"] for each in data["clips"]] == [["--vectors", f"{name}/of"] for name in ("first", "second")]
    of_clips = data["mean"]["blend"]["psnr_of_clips"]
    assert of_clips == [each["methods"][0]["mean"]["psnr"] for each in data["clips"]]
    assert math.isclose(data["mean"]["blend"]["psnr"], sum(of_clips) / 2)
    rows = list(csv.DictReader((tmp_path / "x.csv").read_text().splitlines()))
    assert {row["clip"] for row in rows} == {"first", "second"}
    below = fpsboost_("compare", "first", "second", "-m", "blend", "--fail-under", "99", "-q")
    assert (below.code, below.err.count("99 dB of --fail-under")) == (3, 1)


def test_several_clips_are_checked_before_any_work(comparison, fpsboost_, tmp_path):
    """The one that is wrong is named, at once; options about one clip are refused, and a clip that is named twice."""
    missing = fpsboost_("compare", comparison.clip, "missing", "-m", "blend")
    assert_refused(missing, 1, "fpsboost: missing ")
    for option, said in (
        ("--vectors", "write {in} for it, as in {in}/vectors"),
        ("--frames", "take the clips one by one"),
    ):
        refused = fpsboost_("compare", comparison.clip, "other", option, "x=y")
        assert (refused.code, refused.err.endswith(f"{said}.\n")) == (2, True)
    twice = fpsboost_("compare", comparison.clip, comparison.clip)
    assert (twice.code, twice.err) == (2, f"fpsboost: {comparison.clip} is named twice; name it once.\n")


def test_passages_are_where_methods_differ_and_err(comparison):
    """Within the count, without overlap, in order; frames of closer looks become passages of their own."""

    def with_errors(*errors):
        methods = [
            MethodResult(str(place), "", [scored(number, mae=mae) for number, mae in enumerate(of_method)])
            for place, of_method in enumerate(errors)
        ]
        return replace(comparison, methods=methods, hidden=list(range(len(errors[0]))), cuts=[], doubtful=[])

    first = [1.0] * 20
    first[15:18] = [9.0] * 3
    others = [[value + (5.0 if place in (4, 5, 6) else 0.0) for place, value in enumerate(first)] for _ in range(2)]
    errors_of = with_errors(first, *others)
    assert choose_passages(errors_of, 6) == [[4, 5, 6], [15, 16, 17]]
    assert choose_passages(errors_of, 6, [5, 11]) == [[4, 5, 6], [11], [15, 16, 17]]
    assert choose_passages(errors_of, 20, [5]) == [list(range(20))]
    assert choose_passages(replace(errors_of, cuts=[4, 5, 6]), 6)[0] != [4, 5, 6]


def test_played_frames_are_those_of_the_clip(comparison, compared_methods):
    """Frames that were shown have one picture, hidden ones the truth and one of each method, in order."""
    played = view_passages(ComparedClip(comparison, compared_methods), [comparison.hidden])
    assert [frame["number"] for frame in played.frames] == list(range(comparison.clip_frames))
    assert {len(frame["images"]) for frame in played.frames[::2]} == {1}
    assert {len(frame["images"]) for frame in played.frames[1::2]} == {1 + len(NAMES)}
    assert (played.width, played.height, played.fps) == (WIDTH, HEIGHT, 24.0)


def test_a_guide_is_shown_beside_what_follows_it(guided):
    """In closer looks behind the truth, in the player as the last picture, enlarged; black where there is none."""
    numbers = [1, 3, 5]
    data = view_passages(guided, [numbers], exact=numbers)
    assert data.names == ["truth", "blend", "blend+guide", "guide"]
    samples = read_samples(guided.comparison.clip, guided.comparison.hold_out, numbers)
    for frame in data.frames:
        if frame["number"] in numbers:
            guide_of_frame = samples[frame["number"]].hidden.source.guide
            truth, *_, guide = (decoded(data.uris[image]) for image in frame["images"])
            assert guide.shape == truth.shape
            if guide_of_frame is None:
                assert not guide.any()
            else:
                small = cv2.resize(guide, guide_of_frame.shape[1::-1], interpolation=cv2.INTER_AREA)
                assert np.abs(small - guide_of_frame.astype(float)).mean() < 4
    strips, _ = _view_frames(guided, [1, 3])
    crops = [[picture.name for picture in first.crops] for first, *_ in strips.values()]
    assert crops == [["truth", "guide", "blend", "blend+guide"], ["truth", "blend", "blend+guide"]]


def test_a_method_that_follows_guides_is_one_of_this_package(guided):
    """It is drawn as one with options, and its times are known frame by frame."""
    assert [style.line for style in styles_of(["blend", "blend+guide"])] == [SOLID, DASHED]
    assert shared_out(guided.comparison) == []


def test_some_frames_are_kept_without_loss(comparison, compared_methods):
    """Those asked for, exactly; the others say what they lost. As many as their pixels allow, none that is reduced."""
    first, second = comparison.hidden[:2]
    played = view_passages(ComparedClip(comparison, compared_methods), [[first, second]], exact=[second])
    frames = {frame["number"]: frame for frame in played.frames}
    assert frames[second]["loss"] == 0 < frames[first]["loss"]
    picture = decoded(played.uris[frames[second]["images"][0]])
    (sample,) = read_samples(comparison.clip, comparison.hold_out, [second]).values()
    assert np.array_equal(picture, as_shown(sample.hidden.truth))
    pixels = HEIGHT * WIDTH * (1 + len(NAMES))
    assert choose_exact(comparison, [second, first], 2 * pixels - 1) == [second]
    wide = replace(comparison, kind="1920x1080, 3 channels, 8-bit")
    assert choose_exact(wide, [first], 10**9) == []


MANY = [f"nlm-exhaustive:patch-radius={r},v={v}" for r in range(1, 13) for v in (0.05, 0.1, 0.2)] + [
    "rife",
    "film",
    "flow",
]

# Machado et al. 2009 (doi:10.1109/TVCG.2009.113), complete loss, on linear light
LOSSES = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(colour):
    values = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def seen(colour, loss):
    """CIELAB of a colour as someone with this loss sees it."""
    rgb = (np.array(LOSSES[loss]) @ linear(colour)).clip(0, 1)
    rgb = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    return cv2.cvtColor(rgb[np.newaxis, np.newaxis].astype(np.float32), cv2.COLOR_RGB2Lab)[0, 0]


def test_a_method_keeps_its_colour_in_every_company():
    """The same alone, first or last, among few or many; options in another order are the same method."""
    for name in [*method_names(), *MANY]:
        alone = styles_of([name])[0]
        beside = styles_of(["blend", *MANY, *method_names(), name])[-1]
        assert (beside.on_light, beside.on_dark, beside.line) == (alone.on_light, alone.on_dark, alone.line)
    assert colours_of("nlm:v=0.1,patch-radius=3") == colours_of("nlm:patch-radius=3,v=0.1")


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("paper", [0, 1])
def test_the_usual_methods_are_told_apart_with_any_colour_vision(loss, paper):
    """A distance in CIELAB of 25 between any two of those that are compared by default, and of 15 among the others."""
    for names, least in ((ComparedMethodOptions().methods[0].split(","), 25), (NAMED, 15)):
        for one, other in itertools.combinations(names, 2):
            distance = np.linalg.norm(seen(colours_of(one)[paper], loss) - seen(colours_of(other)[paper], loss))
            assert distance > least, (one, other)


def test_colours_stand_out_from_the_paper():
    """A contrast of 3 to 1 on light and on dark paper, as WCAG wants of figures."""
    papers = [np.dot(linear(each), [0.2126, 0.7152, 0.0722]) for each in ("#fcfcfb", "#15171a")]
    for name in [*method_names(), *MANY]:
        for colour, paper in zip(colours_of(name), papers, strict=True):
            light = np.dot(linear(colour), [0.2126, 0.7152, 0.0722])
            assert (max(light, paper) + 0.05) / (min(light, paper) + 0.05) > 2.9, (name, colour)


def test_nine_methods_have_nine_marks():
    """Whoever they are, and solid lines are methods as they are, dashed ones have options, others are dotted, too."""
    for names in (method_names()[:9], MANY[:9], [*MANY[-3:], "nlm", "dis", "nlm:v=1", "dis-warp", "block", "blend"]):
        assert len({style.mark for style in styles_of(names)}) == 9
    assert [style.line for style in styles_of(["nlm", "nlm:v=1", "rife"])] == [SOLID, DASHED, DASH_DOTTED]


def test_long_names_are_broken_behind_their_punctuation():
    """Nothing is lost, and lines are short where they can be."""
    for name in MANY:
        lines = break_name(name)
        assert "".join(lines) == name
        assert all(len(line) <= MAX_LINE for line in lines)
    assert break_name("a-very-long-name-without-punctuation") == ["a-very-long-name-without-punctuation"]
