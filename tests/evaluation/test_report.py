"""The page of a comparison: complete, one file, and alive in a browser."""

from __future__ import annotations

import base64
import csv
import json
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest
from browser import violations
from playwright.sync_api import expect
from video_truth import scene

from fpsboost.errors import OutputError
from fpsboost.evaluation.compare import compare
from fpsboost.evaluation.contestants import InterpolatedFrame, InterpolatorContestant
from fpsboost.evaluation.hidden_frames import Hiding, read_samples
from fpsboost.evaluation.metrics import Scores, as_shown
from fpsboost.evaluation.report.charts import Dot, Series, draw_dots, draw_lines
from fpsboost.evaluation.report.page import DIFFERENT, _view_frames, choose_frames, command, write_report
from fpsboost.evaluation.report.passages import choose_exact, choose_passages, view_passages
from fpsboost.evaluation.report.pictures import find_spots, in_colour
from fpsboost.evaluation.report.styles import colours_of, styles_of
from fpsboost.evaluation.report.tables import _cells
from fpsboost.evaluation.results import ComparedClip, FrameResult, MethodResult
from fpsboost.evaluation.verdict import judge_all
from fpsboost.method_table import methods

NAMES = ("dis", "blend", "nearest")
HEIGHT, WIDTH, FRAMES = 48, 64, 7


class Silence:
    """An observer with nothing to say."""

    def begin(self, name, frames):
        pass

    def advance(self):
        pass


@pytest.fixture(scope="module")
def contestants():
    return {name: InterpolatorContestant(methods[name]) for name in NAMES}


@pytest.fixture(scope="module")
def comparison(tmp_path_factory, contestants):
    """Of a tiny clip that speeds up, so that no two frames are equally hard."""
    folder = tmp_path_factory.mktemp("clip")
    for number in range(FRAMES):
        image = scene(number * (number + 3) // 3, HEIGHT, WIDTH)
        (folder / f"{number:04d}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    reason = "there is no <ffmpeg> here"
    return compare(str(folder), contestants, Hiding(), Silence(), skipped={"minterpolate": reason})


@pytest.fixture(scope="module")
def path(comparison, contestants, tmp_path_factory):
    return write_report(tmp_path_factory.mktemp("report") / "page", [ComparedClip(comparison, contestants)])


@pytest.fixture(scope="module")
def text(path):
    return path.read_text(encoding="utf-8")


class References(HTMLParser):
    """Collects what a page would load, and the names in it."""

    def __init__(self):
        super().__init__()
        self.loaded: list[str] = []
        self.names: list[str] = []

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name in {"src", "href", "xlink:href", "srcset", "poster", "data", "action"} and value:
                self.loaded.append(value)
            if name == "id" and value:
                self.names.append(value)


def test_page_loads_nothing(path, text):
    """Whatever the page shows lies in one file: no address leads out of it, and its own policy forbids any."""
    assert [each.name for each in path.parent.iterdir()] == ["index.html"]
    references = References()
    references.feed(text)
    assert references.loaded
    assert [each for each in references.loaded if not each.startswith(("data:", "#"))] == []
    assert re.findall(r"url\((?!#|[\"']?data:)|@import", text) == []
    assert "default-src 'none'" in text


def test_page_holds_every_method(text, comparison):
    """Every method has its row with the comparison's own numbers, its line in each figure and its options."""
    for index, method in enumerate(comparison.methods):
        scores = comparison.means(method)
        row = re.search(rf'<tr data-method="{index}">.*?</tr>', text, re.DOTALL)
        assert row is not None
        assert method.name in row[0]
        assert f">{scores.psnr:.2f}<" in row[0]
        assert f">{scores.ssim:.4f}<" in row[0]
        assert text.count(f'class="series line method-{index}" data-method="{index}"') == 8  # 4 figures, 2 forms
        assert method.options.replace("'", "&#39;") in text
    assert text.count("<b>minterpolate</b> was skipped: there is no &lt;ffmpeg&gt; here.") == 1


def test_colours_hang_on_names(text, comparison):
    """Each method of the page has its own colours for light and dark, whatever its place."""
    for index, method in enumerate(comparison.methods):
        assert f".method-{index} {{ --method: light-dark({', '.join(colours_of(method.name))}); }}" in text


def test_page_says_how_to_repeat_it(text, comparison):
    """The command names the clip, the methods and what was hidden, and is on the page."""
    hiding = Hiding(skip=2, first=1, last=9)
    assert f"fpsboost compare {comparison.clip} -m dis,blend,nearest,minterpolate --report DIR" in text
    assert "--skip 2 --range 1:9 --input-fps 24 --report" in command(replace(comparison, hiding=hiding), 24)
    rendered = replace(comparison, rendered=("--vectors", "my passes"), cut_options=("--no-cuts",))
    assert command(rendered, None).endswith("--vectors 'my passes' --no-cuts --report DIR")


def test_existing_folder_is_refused(comparison, contestants, tmp_path):
    """A folder that is there is left alone, with one sentence that names it."""
    with pytest.raises(OutputError, match=rf"^{re.escape(str(tmp_path))} exists; [^.]*\.$"):
        write_report(tmp_path, [ComparedClip(comparison, contestants)])
    assert list(tmp_path.iterdir()) == []


def test_folder_appears_whole_or_not_at_all(comparison, contestants, tmp_path, monkeypatch):
    """When the disk is full, neither the folder nor anything half done remains."""

    def fail(number):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OutputError, match=r"cannot be written \(No space left on device\)"):
        write_report(tmp_path / "page", [ComparedClip(comparison, contestants)])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cuts": [0]}, "Not counted: frame {},"),
        ({"doubtful": [0], "repeats": [1]}, "nobody knows what should be seen: {}."),
    ],
)
def test_frames_that_do_not_count_are_named_and_not_drawn(comparison, contestants, tmp_path, changes, words):
    """Across a cut or beside a repeat: said, marked in every figure, and never picked to be shown."""
    worst = min(comparison.methods[0].frames, key=lambda frame: frame.scores.psnr).number
    changed = replace(comparison, **{name: [worst + each for each in numbers] for name, numbers in changes.items()})
    text = write_report(tmp_path / "page", [ComparedClip(changed, contestants)]).read_text()
    assert words.format(worst) in text
    assert text.count('class="cut"') == 8
    assert worst not in [chosen.number for chosen in choose_frames(changed)]


def test_small_areas_are_not_on_the_page(comparison, contestants, tmp_path):
    """An area of less than 2 % of the picture, or of more than 98 %, has no columns; without any there is no table."""
    shares = {"moving": 0.5, "occluded": 0.019, "uncertain": 0.03}
    text = write_report(tmp_path / "page", [ComparedClip(replace(comparison, shares=shares), contestants)]).read_text()
    assert "50 % moving" in text
    assert "3 % uncertain" in text
    assert "% occluded" not in text
    none = replace(comparison, shares=dict.fromkeys(shares, 0.01) | {"moving": 0.99})
    assert 'id="by-area"' not in write_report(tmp_path / "other", [ComparedClip(none, contestants)]).read_text()


class Darkening:
    """A method that styles far: each frame is darker than the one made before, and the first is white."""

    looks_far: ClassVar[bool] = True
    any_time: ClassVar[bool] = False

    def interpolate(self, intervals, wanted=None):
        for count, interval in enumerate(intervals):
            for hidden in interval.hidden:
                if wanted is None or hidden.number in wanted:
                    yield InterpolatedFrame(hidden.number, np.full_like(hidden.truth, 255 - 60 * count), 0.1, 0.1)

    def describe(self):
        return "darkens"


def test_frames_shown_are_those_that_were_scored(comparison):
    """A method that styles far is run over the whole clip again, so that it makes what it made before."""
    contestants = {"darkening": Darkening()}
    scored = compare(comparison.clip, contestants, Hiding(), Silence())

    def has_level(uri, number):
        image = cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)
        return np.allclose(image, 255 - 60 * scored.hidden.index(number), atol=2)  # WebP is lossy

    for frame in _view_frames(scored, contestants, choose_frames(scored), None)[0]:
        assert has_level(frame.view.strips[0].crops[1].uri, frame.view.number)
    played = view_passages(scored, contestants, [scored.hidden[1:3]])
    hidden = [frame for frame in played.frames if frame["note"] == "hidden"]
    assert [frame["number"] for frame in hidden] == scored.hidden[1:3]
    assert all(has_level(played.uris[frame["images"][1]], frame["number"]) for frame in hidden)


def test_a_frame_chosen_twice_is_shown_once(comparison):
    """Worst, median, best and most different: every frame once, with all its reasons."""
    chosen = choose_frames(comparison)
    numbers = [each.number for each in chosen]
    assert len(numbers) == len(set(numbers))
    assert sum(len(each.reasons) for each in chosen) == 4
    psnr = {frame.number: frame.scores.psnr for frame in comparison.methods[0].frames}
    assert numbers[0] == min(psnr, key=lambda number: psnr[number])


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
    """The first is where all err, the second where one errs less than the others, and they do not prefetch."""
    common = np.zeros((120, 200), np.float32)
    common[60:108, 10:58] = 20
    other = common.copy()
    other[5:53, 130:178] = 10
    first, second = find_spots([common, other])
    assert first[:3] == (10, 60, 48)
    assert second[:3] == (130, 5, 48)
    assert len(find_spots([np.ones((20, 24), np.float32)])) == 1  # two have no room beside each other


def test_motion_has_the_wheels_colours():
    """No motion is white; motion to the right is red; what is longer than the wheel's rim styles like its rim."""
    flow = np.array([[[0, 0], [5, 0], [50, 0]]], np.float32)
    assert in_colour(flow, 5).tolist() == [[[255, 255, 255], [0, 0, 255], [0, 0, 255]]]


@pytest.mark.parametrize("form", [0, 1], ids=["wide", "narrow"])
def test_names_lie_in_the_figure_or_in_a_legend(form):
    """Far right they stand on the left, long ones in lines; what fits nowhere is left out and said."""
    names = ["minterpolate", "nlm-exhaustive:patch-radius=9,v=0.05", "rife"]
    styles = styles_of(names)
    apart = [Dot(index, name, 10.0**index, 20.0 + index, styles[index]) for index, name in enumerate(names)]
    chart = draw_dots("quality", "PSNR, dB", "seconds", apart)[form]
    assert chart.is_labelled
    for word in ("minterpolate", "nlm-exhaustive:", "v=0.05", "rife"):
        assert f">{word}</text>" in chart.svg
    crowd = [Dot(k, f"a-name-that-has-{k}-long-words-in-it", 1.0, 20.0, styles[0]) for k in range(20)]
    chart = draw_dots("quality", "PSNR, dB", "seconds", crowd)[form]
    assert not chart.is_labelled
    assert chart.svg.count("-long-words-in-it</text>") < len(crowd)


def test_long_lines_have_marks_too():
    """So that no figure hangs on colour alone: some points of each line, and not the same ones of all."""
    styles = styles_of(["nlm", "dis"])
    series = [Series(k, list(np.linspace(1, 2 + k, 300)), styles[k]) for k in range(2)]
    wide = draw_lines("mse", "MSE", range(300), series)[0].svg
    marks = [re.findall(r'<use [^>]*x="([^"]+)"', line) for line in wide.split('class="series line')[1:]]
    assert all(10 <= len(each) <= 16 for each in marks)
    assert set(marks[0]).isdisjoint(marks[1])


def test_numbers_have_digits_enough():
    """A column whose smallest number would read 0.000 gets up to two more digits, all of it."""
    assert [cell.text for cell in _cells([0.0004, 0.5], 3, False)] == ["0.0004", "0.5000"]
    assert [cell.text for cell in _cells([0.0000004, 0.5], 3, False)] == ["0.00000", "0.50000"]
    assert [(cell.text, cell.best) for cell in _cells([2.5, 0.5, math.nan], 1, True)] == [
        ("2.5", True),
        ("0.5", False),
        ("-", False),
    ]


def test_command_writes_the_page_and_says_where(comparison, fpsboost_, tmp_path):
    """``--report`` names a new folder; the last line of the output is the page's path."""
    result = fpsboost_("compare", comparison.clip, "-m", "blend", "--report", "page")
    assert result.code == 0, result.err
    assert result.out.splitlines()[-1] == f"Page: {Path('page', 'index.html')}"
    assert (tmp_path / "page" / "index.html").is_file()


@pytest.mark.parametrize(("report", "word"), [("taken", "exists"), ("missing/page", "no folder that exists")])
def test_folder_that_cannot_be_is_refused_before_any_work(report, word, fpsboost_, tmp_path):
    """One sentence names the folder, and the clip is not even looked for."""
    (tmp_path / "taken").mkdir()
    result = fpsboost_("compare", "no-such-clip", "--report", report)
    assert result.code == 1
    assert result.err.startswith(f"fpsboost: {report} ")
    assert word in result.err
    assert result.err.count("\n") == 1


def test_help_draws_nothing():
    """The command line starts without what only a page needs."""
    line = (
        "import sys, fpsboost.cli.app as cli; cli.app(['compare', '--help'], result_action='return_value'); "
        "sys.exit(str({'matplotlib', 'jinja2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, check=False)
    assert done.stderr == "set()\n"


# ---------------------------------------------------------------- in a browser


@pytest.fixture
def page(chromium, path):
    """The page, opened; nothing is asked of a network, and no error is reported, as long as it is."""
    opened = chromium.new_page(viewport={"width": 1200, "height": 900}, reduced_motion="reduce")
    complaints: list[str] = []

    def watch(request):
        if not request.url.startswith(("file:", "data:", "blob:")):
            complaints.append(request.url)

    opened.on("request", watch)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("console", lambda message: complaints.append(message.text) if message.type != "log" else None)
    opened.goto(path.as_uri())
    yield opened
    opened.close()
    assert complaints == []


def shown_on(page, selector):
    return page.locator(selector).first.is_visible()


def wipe(page):
    """Where the right picture begins, per cent from the left."""
    return float(page.locator(".wipe").input_value())


def left(page):
    return page.locator(".player .tag.left").inner_text()


def right(page):
    return page.locator(".player .tag.right").inner_text()


def at_frame(page, number):
    """Wait until the player shows a frame."""
    expect(page.locator(".place")).to_have_text(re.compile(rf"^frame {number}\b"))


def test_first_screen_has_the_verdict_and_pictures(chromium, path):
    """At a desk and on a phone, what comes out and the whole picture are seen without scrolling."""
    for width, height in ((1200, 900), (390, 844)):
        opened = chromium.new_page(viewport={"width": width, "height": height})
        opened.goto(path.as_uri())
        expect(opened.locator(".place")).to_contain_text("frame")
        for selector in (".outcome", ".stage", ".play [data-side='right'] >> nth=1"):
            box = opened.locator(selector).first.bounding_box()
            assert box is not None
            assert box["y"] + box["height"] <= height, selector
        opened.close()


def test_slider_and_pointer_move_the_edge(page):
    """The slider and a drag in the picture move it."""
    page.locator(".wipe").fill("30")
    assert wipe(page) == 30
    box = page.locator(".stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 30)
    page.mouse.up()
    assert math.isclose(wipe(page), 80, abs_tol=1)


def test_keyboard_steps_flips_and_chooses(page, comparison):
    """Arrows step from frame to frame, F shows one picture and then the other, a digit chooses the right one."""
    stage = page.locator(".stage")
    stage.focus()
    page.keyboard.press("Home")
    at_frame(page, 0)
    page.keyboard.press("ArrowRight")
    at_frame(page, comparison.hidden[0])
    page.keyboard.press("f")
    assert wipe(page) == 0
    page.keyboard.press("f")
    assert wipe(page) == 100
    page.keyboard.press("3")
    assert wipe(page) == 0  # what was chosen is seen
    assert left(page) == "nearest"
    page.locator(".wipe").fill("50")
    assert (left(page), right(page)) == ("truth", "nearest")
    page.locator(".flip").focus()  # keys are heard on its buttons too, not on sliders, which have their own
    page.keyboard.press("ArrowLeft")
    at_frame(page, 0)
    page.keyboard.press("ArrowRight")
    at_frame(page, comparison.hidden[0])
    page.locator(".wipe").focus()
    page.keyboard.press("ArrowLeft")
    assert wipe(page) == 49
    at_frame(page, comparison.hidden[0])
    page.locator(".wipe").fill("3")
    assert not page.locator(".tag.left").is_visible()  # a sliver has no name
    stage.focus()
    page.keyboard.press("e")
    assert left(page) == "difference of truth and nearest"


def test_player_plays_a_passage(page):
    """It goes on by itself until it is stopped, at its own speed or a quarter."""
    page.locator(".stage").focus()
    page.keyboard.press("Home")
    at_frame(page, 0)
    page.locator(".play.round").click()
    expect(page.locator(".place")).not_to_have_text(re.compile("frame 0\\b"))
    page.locator(".slow").click()
    assert page.locator(".play.round").get_attribute("aria-label") == "Pause"
    page.locator(".play.round").click()
    expect(page.locator(".play.round")).to_have_attribute("aria-label", "Play")


def test_chart_is_the_timeline(page, comparison):
    """A click in the chart, or Enter, shows the frame, and a line in every chart says which is shown."""
    chart = page.locator("#errors .metric:not(.later) .chart.wide")
    box = chart.bounding_box()
    assert box is not None
    left_side, _, width, _ = map(float, (chart.get_attribute("data-box") or "").split())
    first, last = map(float, (chart.get_attribute("data-x") or "").split())
    for number in (comparison.hidden[1], comparison.hidden[0]):
        across = left_side + width * (number - first) / (last - first)
        chart.click(position={"x": across * box["width"], "y": box["height"] / 2})
        at_frame(page, number)
        line = chart.locator(".cursor").bounding_box()
        assert line is not None
        assert math.isclose(line["x"] - box["x"], across * box["width"], abs_tol=2)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    at_frame(page, comparison.hidden[1])


def test_pixels_are_read_and_zoomed(page, comparison):
    """At 16:1 a picture can be moved, and the values of both pictures under the pointer are told."""
    at_frame(page, opening_of(comparison))
    page.locator(".stage").press("Home")
    at_frame(page, 0)
    page.locator('[data-zoom="8"]').click()
    page.locator(".stage").press("+")
    box = page.locator(".stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator(".pixel")).to_contain_text(re.compile(r"column \d+, row \d+\s*truth about \d+ \d+ \d+"))
    before = page.locator(".pixel span").first.inner_text()
    page.locator(".stage").focus()
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator(".pixel span").first).not_to_have_text(before)
    expect(page.locator(".loss")).to_have_text(re.compile(r"off by about [\d.]+ levels"))


def opening_of(comparison):
    """The frame that the page opens with."""
    return next(each.number for each in choose_frames(comparison) if DIFFERENT in each.reasons)


def test_page_opens_with_exact_pixels(page, comparison, contestants):
    """There the values of pixels are the truth's and the method's, and the error map is their difference."""
    number = opening_of(comparison)
    at_frame(page, number)
    expect(page.locator(".loss")).to_have_text("Exact: kept without loss.")
    (sample,) = read_samples(comparison.clip, comparison.hiding, [number])
    truth, made = (
        as_shown(each).astype(int)[..., ::-1] for each in (sample.hidden.truth, sample.interpolate(contestants["dis"]))
    )
    box = page.locator(".stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 20.5 / WIDTH, box["y"] + box["height"] * 10.5 / HEIGHT)
    values = [" ".join(map(str, each[10, 20])) for each in (truth, made)]
    expect(page.locator(".pixel")).to_have_text(f"column 20, row 10truth {values[0]}dis {values[1]}")
    page.locator('[data-mode="error"]').click()
    colours = page.evaluate("""() => {
        const map = address.clip.player.error();
        return [...map.getContext("2d").getImageData(0, 0, map.width, map.height).data];
    }""")
    none = (np.reshape(colours, (HEIGHT, WIDTH, 4))[..., :3] == [0, 0, 4]).all(axis=-1)
    error = abs(truth - made).mean(axis=-1)
    assert (none == (np.round(255 * error / 64) == 0)).all()


def seen_at(page, x, y):
    """The pixel of the picture that lies where the pointer is."""
    page.mouse.move(x, y)
    expect(page.locator(".pixel span").first).to_contain_text("column")
    return page.locator(".pixel span").first.inner_text()


def test_wheel_zooms_where_the_pointer_is(page):
    """With Ctrl, and the pixel there stays; without, the page scrolls as ever. A drag moves what is enlarged."""
    expect(page.locator(".place")).to_contain_text("frame")
    box = page.locator(".stage").bounding_box()
    assert box is not None
    x, y = box["x"] + 0.3 * box["width"], box["y"] + 0.4 * box["height"]
    pixel = seen_at(page, x, y)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -60)
    page.keyboard.up("Control")
    expect(page.locator(".stage")).to_have_class(re.compile("is-zoomed"))
    page.mouse.move(x + 1, y)
    assert seen_at(page, x, y) == pixel
    page.mouse.down()
    page.mouse.move(x - 90, y)
    page.mouse.up()
    assert seen_at(page, x, y) != pixel
    page.keyboard.down("Control")
    page.mouse.wheel(0, 300)
    page.keyboard.up("Control")
    expect(page.locator('[data-zoom="0"]')).to_have_attribute("aria-pressed", "true")
    page.mouse.wheel(0, 500)
    expect(page.locator(".brand")).not_to_be_in_viewport()


def test_two_fingers_zoom_the_picture(chromium, path):
    """On a phone: what they spread grows with them, and back it fits."""
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    phone = context.new_page()
    phone.goto(path.as_uri())
    expect(phone.locator(".place")).to_contain_text("frame")
    box = phone.locator(".stage").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = context.new_cdp_session(phone)

    def touch(kind, *across):
        points = [{"x": x + each, "y": y, "id": index} for index, each in enumerate(across)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    for begin, end, is_zoomed in ((20, 80, True), (80, 10, False)):
        touch("touchStart", -begin)
        touch("touchStart", -begin, begin)
        touch("touchMove", -(begin + end) / 2, (begin + end) / 2)
        touch("touchMove", -end, end)
        touch("touchEnd")
        pattern = re.compile("is-zoomed") if is_zoomed else re.compile("^stage ?$")
        expect(phone.locator(".stage")).to_have_class(pattern)
    context.close()


def test_closer_look_leads_to_its_frame(page):
    """The button beside a spot shows its frame in the player, enlarged."""
    button = page.locator("[data-goes]").last
    number = int((button.get_attribute("data-goes") or "").split()[0])
    button.click()
    at_frame(page, number)
    expect(page.locator('[data-zoom="4"]')).to_have_attribute("aria-pressed", "true")


def test_address_keeps_what_is_shown(chromium, page, path, comparison):
    """An address that is copied shows the same; one that is wrong does no harm."""
    length = page.evaluate("history.length")
    page.locator(".stage").focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("3")
    page.keyboard.press("e")
    page.locator('[data-zoom="2"]').click()
    page.locator('[data-shows="psnr"]').click()
    page.wait_for_url(re.compile("metric=psnr"))
    assert page.evaluate("history.length") == length  # back leads to where one was before the page
    copied, place = page.url, page.locator(".place").inner_text()
    other = chromium.new_page(viewport={"width": 1200, "height": 900})
    other.goto(copied)
    expect(other.locator(".place")).to_have_text(place)
    assert left(other) == "difference of truth and nearest"
    assert other.locator('[data-zoom="2"]').get_attribute("aria-pressed") == "true"
    assert shown_on(other, '[data-metric="psnr"] .chart.wide')
    other.goto(f"{path.as_uri()}#frame=999999&left=nobody&zoom=x&metric=%22]&clip=7")
    other.reload()
    expect(other.locator(".place")).to_contain_text("frame")
    other.close()


def test_blind_test_hides_names_and_counts(page, comparison):
    """No name is told while it lasts, not in the address either; at the end every vote is."""
    expect(page.locator(".place")).to_contain_text("frame")
    before = page.locator(".place").inner_text()
    page.get_by_role("button", name="Blind test").click()
    for vote in ("A, left", "B, right", "No difference"):
        expect(page.locator(".tag.left")).to_have_text("A")
        expect(page.locator(".tag.right")).to_have_text("B")
        assert not page.locator("[data-side='left'], .begins").first.is_visible()
        assert "A" not in page.url.partition("#")[2]
        page.get_by_role("button", name="Show the truth").click()
        assert left(page) == "truth"
        page.locator(".stage").focus()
        page.keyboard.press("2")  # would tell
        assert left(page) == "truth"
        page.get_by_role("button", name=vote).click()
    expect(page.locator(".count")).to_have_text("3 votes")
    page.get_by_role("button", name="End and reveal").click()
    tally = page.locator(".tally").inner_text()
    assert tally.startswith(f"{Path(comparison.clip).name}: 3 votes, 1 without a difference")
    page.evaluate("navigator.clipboard.writeText = async (text) => { window.copied = text; }")
    page.get_by_role("button", name="Copy the result").click()
    expect(page.get_by_role("button", name="Copied")).to_be_visible()
    assert page.evaluate("copied") == tally
    assert sum(int(won) for won in re.findall(r"preferred in (\d+) of", tally)) == 2
    assert {name for name in NAMES if name in tally} == set(re.findall(r"^(\S+): preferred", tally, re.MULTILINE))
    assert (left(page), right(page)) == ("truth", NAMES[0])
    expect(page.locator(".place")).to_have_text(before)


@pytest.mark.parametrize(("width", "height", "scheme"), [(1200, 900, "light"), (390, 844, "dark")])
def test_nothing_is_in_the_way_of_anybody(chromium, several, scheme, width, height):
    """Axe finds no violation, in a page of several clips, also in the error map and in the blind test."""
    opened = chromium.new_page(
        viewport={"width": width, "height": height}, color_scheme=scheme, reduced_motion="reduce"
    )
    opened.goto(several.as_uri())
    expect(opened.locator(".place").first).to_contain_text("frame")
    for button in (None, "Error map", "Blind test"):
        if button is not None:
            opened.get_by_role("button", name=button).click()
        assert violations(opened) == []
    assert opened.evaluate("document.documentElement.scrollWidth") == width
    opened.close()


# ---------------------------------------------------------------- several clips


@pytest.fixture(scope="module")
def several(comparison, contestants, tmp_path_factory):
    """A page of two clips, of which the second is the first one's end."""
    other = compare(comparison.clip, contestants, Hiding(first=4), Silence())
    clips = [ComparedClip(each, contestants) for each in (comparison, other)]
    return write_report(tmp_path_factory.mktemp("report") / "page", clips)


def test_page_of_several_clips(chromium, several, comparison):
    """One clip is seen at a time, names are unique, address and links keep to it, a table has all and their mean."""
    references = References()
    references.feed(several.read_text(encoding="utf-8"))
    assert len(references.names) == len(set(references.names))
    opened = chromium.new_page(viewport={"width": 1200, "height": 900})
    opened.goto(several.as_uri())
    assert opened.locator("h1").inner_text() == "2 clips"
    assert "in the mean of 2 clips" in opened.locator(".outcome").inner_text()
    expect(opened.locator(".clip").nth(0)).to_be_visible()
    expect(opened.locator(".clip").nth(1)).not_to_be_visible()
    opened.locator("[data-clip='1']").click()
    expect(opened.locator(".clip").nth(1).locator(".place")).to_contain_text("frame")
    expect(opened.locator(".clip").nth(0)).not_to_be_visible()
    opened.wait_for_url(re.compile("clip=2"))
    opened.reload()
    expect(opened.locator(".clip").nth(1).locator(".place")).to_contain_text("frame")
    opened.get_by_role("link", name="Summary").click()
    expect(opened.locator("#summary-2")).to_be_in_viewport()
    opened.locator("[data-clip='0']").click()
    opened.goto(f"{several.as_uri()}#made-2")  # leads to the clip that has it
    expect(opened.locator("#made-2")).to_be_in_viewport()
    rows = opened.locator("#clips tbody tr")
    assert rows.count() == len(NAMES)
    mean, *of_clips = (
        float(each) for each in rows.first.locator("td").evaluate_all("all => all.map(each => each.dataset.value)")
    )
    assert math.isclose(mean, sum(of_clips) / 2)
    opened.close()


@pytest.mark.parametrize(
    ("leads", "outcome"),
    [
        (
            [1.0, 0.8, 1.2],
            "a does best in the mean of 3 clips: 30.00 dB, 1.00 ± 0.12 dB more than b; it is best on all of",
        ),
        (
            [1.0, -1.0, 0.3],
            "a and b are level in the mean of 3 clips: a reaches 30.00 dB, and no lead is more than two",
        ),
        (
            [1, 1, 1, 1, 1, -0.2],
            "a does best in the mean of 6 clips: 30.00 dB, 0.80 ± 0.20 dB more than b; it is best on 5",
        ),
    ],
)
def test_a_lead_on_several_clips_is_more_than_chance(comparison, leads, outcome):
    """Two methods are level within two standard errors of their differences, clip by clip."""
    clips = []
    for lead in leads:
        methods = [
            MethodResult(name, "", [FrameResult(1, Scores(1.0, psnr, 0.9, 1.0), 0.1, 0.1, {}, {})])
            for name, psnr in (("a", 30.0), ("b", 30.0 - lead))
        ]
        clips.append(replace(comparison, methods=methods, hidden=[1], cuts=[], doubtful=[]))
    assert judge_all(clips).startswith(outcome)


def test_command_compares_several_clips(comparison, fpsboost_, tmp_path):
    """Tables of each, a table of the means, one page, one JSON and one CSV that name the clips."""
    shutil.copytree(comparison.clip, tmp_path / "second")
    shutil.copytree(comparison.clip, tmp_path / "first")
    for number in range(2):
        (tmp_path / "second" / f"{number:04d}.png").unlink()
    arguments = ("-m", "blend,nearest", "--report", "page", "--json", "x.json", "--csv", "x.csv")
    result = fpsboost_("compare", "first", "second", *arguments)
    assert result.code == 0, result.err
    assert "2 clips" in result.out
    assert re.search(
        r"blend does best in the mean of 2 clips: [\d.]+ dB, [\d.]+ ± [\d.]+ dB more than nearest", result.out
    )
    data = json.loads((tmp_path / "x.json").read_text())
    assert [each["clip"] for each in data["clips"]] == ["first", "second"]
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
    assert (missing.code, missing.out, missing.err.count("\n")) == (1, "", 1)
    assert missing.err.startswith("fpsboost: missing ")
    for option in ("--vectors", "--frames"):
        refused = fpsboost_("compare", comparison.clip, "other", option, "x=y")
        assert (refused.code, refused.err) == (
            2,
            f"fpsboost: {option} goes with one clip; compare several one by one.\n",
        )
    twice = fpsboost_("compare", comparison.clip, comparison.clip)
    assert (twice.code, twice.err) == (2, f"fpsboost: {comparison.clip} is named twice; name it once.\n")


def test_passages_are_where_methods_differ_and_err(comparison):
    """Within the count, without overlap, in order; frames of closer looks become passages of their own."""

    def with_errors(*errors):
        methods = [
            MethodResult(str(place), "", [frame_of(number, mae) for number, mae in enumerate(of_method)])
            for place, of_method in enumerate(errors)
        ]
        return replace(comparison, methods=methods, hidden=list(range(len(errors[0]))), cuts=[], doubtful=[])

    def frame_of(number, mae):
        return FrameResult(number, Scores(mae**2, 30.0, 0.9, mae), 0.1, 0.1, {}, {})

    first = [1.0] * 20
    first[15:18] = [9.0] * 3
    others = [[value + (5.0 if place in (4, 5, 6) else 0.0) for place, value in enumerate(first)] for _ in range(2)]
    found = with_errors(first, *others)
    assert choose_passages(found, 6) == [[4, 5, 6], [15, 16, 17]]
    assert choose_passages(found, 6, [5, 11]) == [[4, 5, 6], [11], [15, 16, 17]]
    assert choose_passages(found, 20, [5]) == [list(range(20))]
    assert choose_passages(replace(found, cuts=[4, 5, 6]), 6)[0] != [4, 5, 6]


def test_played_frames_are_those_of_the_clip(comparison, contestants):
    """Frames that were shown have one picture, hidden ones the truth and one of each method, in order."""
    played = view_passages(comparison, contestants, [comparison.hidden])
    assert [frame["number"] for frame in played.frames] == list(range(comparison.clip_frames))
    assert {len(frame["images"]) for frame in played.frames[::2]} == {1}
    assert {len(frame["images"]) for frame in played.frames[1::2]} == {1 + len(NAMES)}
    assert (played.width, played.height, played.fps) == (WIDTH, HEIGHT, 24.0)


def test_some_frames_are_kept_without_loss(comparison, contestants):
    """Those asked for, exactly; the others say what they lost. As many as their pixels allow, none that is reduced."""
    first, second = comparison.hidden[:2]
    played = view_passages(comparison, contestants, [[first, second]], exact=[second])
    frames = {frame["number"]: frame for frame in played.frames}
    assert frames[second]["loss"] == 0 < frames[first]["loss"]
    uri = played.uris[frames[second]["images"][0]]
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)
    (sample,) = read_samples(comparison.clip, comparison.hiding, [second])
    assert np.array_equal(decoded, as_shown(sample.hidden.truth))
    pixels = HEIGHT * WIDTH * (1 + len(NAMES))
    assert choose_exact(comparison, [second, first], 2 * pixels - 1) == [second]
    wide = replace(comparison, kind="1920x1080, 3 channels, 8-bit")
    assert choose_exact(wide, [first], 10**9) == []


def test_sorting_starts_with_the_best(page):
    """The first click on a heading, whatever is better there, more or less; the second turns it round."""
    column = {"SSIM": 4, "MAE": 5}
    for heading, better in (("SSIM", max), ("MAE", min)):
        cells = page.locator(f"#overall tbody tr td:nth-child({column[heading]})")
        button = page.locator("#overall .sort", has_text=heading)
        button.click()
        values = [float(each.get_attribute("data-value") or "nan") for each in cells.all()]
        assert values[0] == better(values)
        button.click()
        assert [float(each.get_attribute("data-value") or "nan") for each in cells.all()] == values[::-1]
    assert page.locator("#by-area th[aria-sort=ascending]").count() == 0
    page.locator("#by-area .sort").first.click()
    assert page.locator("#by-area th[aria-sort=ascending]").count() == 1


def test_a_phone_may_zoom_and_sees_every_label(chromium, path):
    """360 pixels wide: nothing is wider, no label is cut off, and two fingers zoom the page, or the picture."""
    phone = chromium.new_page(viewport={"width": 360, "height": 740})
    phone.goto(path.as_uri())
    assert phone.evaluate("document.documentElement.scrollWidth") == 360
    words = phone.locator("meta[name=viewport]").get_attribute("content")
    assert not re.search("user-scalable|maximum-scale", words)
    actions = "[...document.querySelectorAll(':not(.stage)')].map(each => getComputedStyle(each).touchAction)"
    assert set(phone.evaluate(actions)) <= {"auto", "manipulation", "pan-y pinch-zoom"}
    texts = """[...document.querySelectorAll('.chart.narrow svg text')].filter(each => each.getClientRects().length)
        .map(each => [each.textContent, each.getBoundingClientRect().left, each.getBoundingClientRect().right])"""
    shown = phone.evaluate(texts)
    assert {"frame", *NAMES} <= {text for text, _, _ in shown}
    assert [text for text, begin, end in shown if begin < 0 or end > 360] == []
    phone.close()


def test_choosing_the_other_sides_picture_swaps(page):
    """Two equal pictures side by side would show nothing."""
    page.locator('[data-side="right"]').first.click()
    assert right(page) == "truth"
    assert left(page) == NAMES[0]


def test_legend_hides_a_method(page):
    """A click takes its line out of every figure, another brings it back."""
    line = '#errors .metric:not(.later) .chart.wide .series[data-method="1"]'
    assert shown_on(page, line)
    button = page.locator('#errors [data-toggles="1"]')
    button.click()
    assert not shown_on(page, line)
    assert page.locator('#times [data-toggles="1"]').get_attribute("aria-pressed") == "false"
    button.click()
    assert shown_on(page, line)


def test_pointing_at_a_figure_reads_it(page, comparison):
    """The nearest frame's values are told, and their points lie on the lines."""
    chart = page.locator("#errors .metric:not(.later) .chart.wide")
    chart.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    decoding = chart.locator(".reading").inner_text()
    assert f"frame {comparison.hidden[1]}" in decoding
    for method in comparison.methods:
        assert method.name in decoding
        assert f"{method.frames[1].scores.mse:.3g}"[:3] in decoding
    centres = """(chart, chosen) => [...chart.querySelectorAll(chosen)].map(each => each.getBoundingClientRect())
        .map(box => box.y + box.height / 2 - chart.getBoundingClientRect().y).sort((one, other) => one - other)"""
    points = chart.evaluate(centres, ".point")
    second_marks = chart.evaluate(centres, ".series.line use:nth-of-type(2)")
    assert len(points) == len(comparison.methods)
    assert np.allclose(points, second_marks, atol=2)


def test_theme_can_be_chosen(page):
    """The switch turns light to dark."""
    colour = "() => getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.locator(".theme").click()
    assert page.evaluate(colour) != light


def test_page_can_be_read_without_script(chromium, path):
    """Every closer look and table is there for a browser that runs no script."""
    context = chromium.new_context(java_script_enabled=False)
    opened = context.new_page()
    opened.goto(path.as_uri())
    crops = opened.locator(".crops img")
    assert all(crops.nth(index).is_visible() for index in range(crops.count()))
    assert opened.locator("#overall").is_visible()
    assert not opened.locator(".player").is_visible()
    context.close()
