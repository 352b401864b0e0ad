"""The page of a comparison in a browser: player, figures, tables, closer looks and the blind test."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from fpsboost.colour import as_shown
from fpsboost.evaluation.hidden_frames import read_samples
from fpsboost.evaluation.report.page import DIFFERENT, choose_frames, write_report
from support.browser import violations
from support.comparison_truth import HEIGHT, NAMES, WIDTH


@pytest.fixture
def page(opened, report_path):
    return opened(report_path.as_uri(), reduced_motion="reduce")


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


def drag(page, begin, end):
    page.mouse.move(*begin)
    page.mouse.down()
    page.mouse.move(*end)
    page.mouse.up()


def opening_of(comparison):
    """The frame that the page opens with."""
    return next(number for number, reasons in choose_frames(comparison).items() if DIFFERENT in reasons)


@pytest.mark.parametrize(("width", "height"), [(1200, 900), (390, 844)])
def test_first_screen_has_the_verdict_and_pictures(opened, report_path, width, height):
    """At a desk and on a phone, what comes out and the whole picture are seen without scrolling."""
    page = opened(report_path.as_uri(), width, height)
    for selector in (".outcome", ".stage", ".play [data-side='right'] >> nth=1"):
        box = page.locator(selector).first.bounding_box()
        assert box["y"] + box["height"] <= height, selector


def test_slider_and_pointer_move_the_edge(page):
    """The slider and a drag in the picture move it."""
    page.locator(".wipe").fill("30")
    assert wipe(page) == 30
    box = page.locator(".stage").bounding_box()
    drag(page, *((box["x"] + across * box["width"], box["y"] + 20) for across in (0.5, 0.8)))
    assert math.isclose(wipe(page), 80, abs_tol=1)


def test_keyboard_steps_flips_and_chooses(page, comparison):
    """Arrows step from frame to frame, F shows one picture and then the other, a digit chooses the right one."""
    stage = page.locator(".stage")
    stage.focus()
    for key, number in (("Home", 0), ("ArrowRight", comparison.hidden[0])):
        page.keyboard.press(key)
        at_frame(page, number)
    for key, place in (("f", 0), ("f", 100), ("3", 0)):  # what was chosen is seen
        page.keyboard.press(key)
        assert wipe(page) == place
    assert left(page) == "nearest"
    page.locator(".wipe").fill("50")
    assert (left(page), right(page)) == ("truth", "nearest")
    page.locator(".flip").focus()  # keys are heard on its buttons too, not on sliders, which have their own
    for key, number in (("ArrowLeft", 0), ("ArrowRight", comparison.hidden[0])):
        page.keyboard.press(key)
        at_frame(page, number)
    page.locator(".wipe").focus()
    page.keyboard.press("ArrowLeft")
    assert wipe(page) == 49
    at_frame(page, comparison.hidden[0])
    page.locator(".wipe").fill("3")
    assert not page.locator(".tag.left").is_visible()  # a sliver has no name
    stage.focus()
    page.keyboard.press("e")
    assert left(page) == "difference of truth and nearest"


def test_choosing_the_other_sides_picture_swaps(page):
    """Two equal pictures side by side would show nothing; arrow keys choose, and the tab key stops once for a side."""
    page.locator('[data-side="right"]').first.click()
    assert (left(page), right(page)) == (NAMES[0], "truth")
    page.keyboard.press("ArrowRight")
    assert (left(page), right(page)) == ("truth", NAMES[0])
    page.locator('[data-side="left"][aria-checked="true"]').press("Tab")
    expect(page.locator('[data-side="right"][aria-checked="true"]')).to_be_focused()


def test_pixels_are_read_and_zoomed(page, comparison):
    """At 16:1 a picture can be moved, and the values of both pictures under the pointer are told."""
    at_frame(page, opening_of(comparison))
    page.locator(".stage").press("Home")
    at_frame(page, 0)
    page.locator('[data-zoom="8"]').click()
    page.locator(".stage").press("+")
    box = page.locator(".stage").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator(".pixel")).to_contain_text(re.compile(r"column \d+, row \d+\s*truth about \d+ \d+ \d+"))
    before = page.locator(".pixel span").first.inner_text()
    page.locator(".stage").focus()
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator(".pixel span").first).not_to_have_text(before)
    expect(page.locator(".loss")).to_have_text(re.compile(r"off by about [\d.]+ levels"))


def test_page_opens_with_exact_pixels(page, comparison, compared_methods):
    """There the values of pixels are the truth's and the method's, and their difference is mapped and enlarged."""
    number = opening_of(comparison)
    at_frame(page, number)
    expect(page.locator(".loss")).to_have_text("Exact: kept without loss.")
    intervals = comparison.hold_out.intervals(comparison.clip)
    (made,) = compared_methods["dis"].interpolate(intervals, [number])
    (sample,) = read_samples(comparison.clip, comparison.hold_out, [number]).values()
    images = sample.hidden.truth, made.image
    truth, interpolated = (as_shown(image).astype(int)[..., ::-1] for image in images)
    box = page.locator(".stage").bounding_box()
    page.mouse.move(box["x"] + box["width"] * 20.5 / WIDTH, box["y"] + box["height"] * 10.5 / HEIGHT)
    values = [" ".join(map(str, image[10, 20])) for image in (truth, interpolated)]
    expect(page.locator(".pixel")).to_have_text(f"column 20, row 10truth {values[0]}dis {values[1]}")
    page.locator('[data-mode="error"]').click()

    def drawn(code):
        script = """{ const map = address.clip.player.%s;
            [...map.getContext("2d").getImageData(0, 0, map.width, map.height).data]; }"""
        return np.reshape(page.evaluate(script % code), (HEIGHT, WIDTH, 4))[..., :3]

    none = (drawn("error()") == [0, 0, 4]).all(axis=-1)
    page.keyboard.press("d")
    expect(page.locator('[data-mode="boost"]')).to_have_attribute("aria-checked", "true")
    assert (drawn('seen("right")') == (truth + 4 * (interpolated - truth)).clip(0, 255)).all()
    error = abs(truth - interpolated).mean(axis=-1)
    assert (none == (np.round(255 * error / 64) == 0)).all()


def seen_at(page, x, y):
    """The pixel of the picture that lies where the pointer is."""
    page.mouse.move(x, y)
    expect(page.locator(".pixel span").first).to_contain_text("column")
    return page.locator(".pixel span").first.inner_text()


def turn_wheel(page, by):
    page.keyboard.down("Control")
    page.mouse.wheel(0, by)
    page.keyboard.up("Control")


def test_wheel_zooms_where_the_pointer_is(page):
    """With Ctrl, and the pixel there stays; without, the page scrolls as ever. A drag moves what is enlarged."""
    box = page.locator(".stage").bounding_box()
    x, y = box["x"] + 0.3 * box["width"], box["y"] + 0.4 * box["height"]
    pixel = seen_at(page, x, y)
    turn_wheel(page, -60)
    expect(page.locator(".stage")).to_have_class(re.compile("is-zoomed"))
    page.mouse.move(x + 1, y)
    assert seen_at(page, x, y) == pixel
    drag(page, (x, y), (x - 90, y))
    assert seen_at(page, x, y) != pixel
    turn_wheel(page, 300)
    expect(page.locator('[data-zoom="0"]')).to_have_attribute("aria-checked", "true")
    page.mouse.wheel(0, 500)
    expect(page.locator(".brand")).not_to_be_in_viewport()


def test_two_fingers_zoom_the_picture(opened, report_path):
    """On a phone: what they spread grows with them, and back it fits."""
    phone = opened(report_path.as_uri(), 390, 844, has_touch=True, is_mobile=True)
    box = phone.locator(".stage").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = phone.context.new_cdp_session(phone)

    def touch(kind, *across):
        points = [{"x": x + offset, "y": y, "id": index} for index, offset in enumerate(across)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    for begin, end, classes in ((20, 80, "is-zoomed"), (80, 10, "^stage ?$")):
        touch("touchStart", -begin)
        touch("touchStart", -begin, begin)
        touch("touchMove", -(begin + end) / 2, (begin + end) / 2)
        touch("touchMove", -end, end)
        touch("touchEnd")
        expect(phone.locator(".stage")).to_have_class(re.compile(classes))


def test_closer_look_leads_to_its_frame(page):
    """The button beside a spot shows its frame in the player, enlarged."""
    button = page.locator("[data-goes]").last
    number = int((button.get_attribute("data-goes") or "").split()[0])
    button.click()
    at_frame(page, number)
    expect(page.locator('[data-zoom="4"]')).to_have_attribute("aria-checked", "true")


def test_blind_test_hides_names_and_counts(page, comparison):
    """No name is told while it lasts, not in the address either; at the end every vote is."""
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


def test_a_guide_can_be_seen_and_is_no_contestant(opened, guided, tmp_path):
    """The player has it as its last picture, closer looks name it, and the blind test never draws it."""
    page = opened(write_report(tmp_path / "page", [guided]).as_uri(), reduced_motion="reduce")
    page.locator(".stage").focus()
    page.keyboard.press("3")
    assert right(page) == "guide"
    assert page.locator("figcaption .truth", has_text="guide").count() > 0
    page.get_by_role("button", name="Blind test").click()
    for count in range(1, 8):
        page.get_by_role("button", name="A, left").click()
        expect(page.locator(".count")).to_have_text(f"{count} vote{'s' if count > 1 else ''}")
    page.get_by_role("button", name="End and reveal").click()
    tally = page.locator(".tally").inner_text()
    assert set(re.findall(r"^(\S+): preferred", tally, re.MULTILINE)) == {"blend", "blend+guide"}


def test_chart_is_the_timeline(page, comparison):
    """A click in the chart, or Enter, shows the frame, and a line in every chart says which is shown."""
    chart = page.locator("#errors .metric:not(.later) .chart.wide")
    box = chart.bounding_box()
    left_side, _, width, _ = map(float, (chart.get_attribute("data-box") or "").split())
    first, last = map(float, (chart.get_attribute("data-x") or "").split())
    for number in (comparison.hidden[1], comparison.hidden[0]):
        across = left_side + width * (number - first) / (last - first)
        chart.click(position={"x": across * box["width"], "y": box["height"] / 2})
        at_frame(page, number)
        line = chart.locator(".cursor").bounding_box()
        assert math.isclose(line["x"] - box["x"], across * box["width"], abs_tol=2)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    at_frame(page, comparison.hidden[1])


def test_pointing_at_a_figure_reads_it(page, comparison):
    """The nearest frame's values are told, and their points lie on the lines."""
    chart = page.locator("#errors .metric:not(.later) .chart.wide")
    chart.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    reading = chart.locator(".reading").inner_text()
    assert f"frame {comparison.hidden[1]}" in reading
    for method in comparison.methods:
        assert method.name in reading
        assert f"{method.frames[1].scores.psnr:.3g}"[:3] in reading
    centres = """(chart, chosen) => [...chart.querySelectorAll(chosen)].map(each => each.getBoundingClientRect())
        .map(box => box.y + box.height / 2 - chart.getBoundingClientRect().y).sort((one, other) => one - other)"""
    points = chart.evaluate(centres, ".point")
    second_marks = chart.evaluate(centres, ".series.line use:nth-of-type(2)")
    assert len(points) == len(comparison.methods)
    assert np.allclose(points, second_marks, atol=2)


def test_legend_hides_a_method(page):
    """A click takes its line out of every figure, another brings it back."""
    line = page.locator('#errors .metric:not(.later) .chart.wide .series[data-method="1"]').first
    assert line.is_visible()
    button = page.locator('#errors [data-toggles="1"]')
    button.click()
    assert not line.is_visible()
    dot = page.locator('#quality .metric:not(.later) .chart.wide .series[data-method="1"]')
    assert not dot.is_visible()
    for figure in ("times", "quality"):
        assert page.locator(f'#{figure} [data-toggles="1"]').get_attribute("aria-pressed") == "false"
    button.click()
    assert line.is_visible()


def test_figures_open_on_what_the_verdict_goes_by(page):
    """PSNR and CPU time; another measure of quality or another clock is a choice."""
    for figure, first, other in (
        ("errors", "psnr", "missing"),
        ("times", "cpu_seconds", "seconds"),
        ("quality", "cpu_seconds", "seconds"),
    ):
        shown = page.locator(f"#{figure} .metric:not(.later)")
        assert shown.get_attribute("data-metric") == first
        page.locator(f"#{figure} [data-shows='{other}']").click()
        assert shown.get_attribute("data-metric") == other


def test_sorting_starts_with_the_best(page):
    """The first click on a heading, whatever is better there, more or less; the second turns it round."""
    for heading, column, better in (("SSIM", 4, max), ("MAE", 5, min)):
        cells = page.locator(f"#overall tbody tr td:nth-child({column})")
        button = page.locator("#overall .sort", has_text=heading)
        button.click()
        values = [float(cell.get_attribute("data-value") or "nan") for cell in cells.all()]
        assert values[0] == better(values)
        button.click()
        assert [float(cell.get_attribute("data-value") or "nan") for cell in cells.all()] == values[::-1]
    assert page.locator("#by-area th[aria-sort=ascending]").count() == 0
    page.locator("#by-area .sort").first.click()
    assert page.locator("#by-area th[aria-sort=ascending]").count() == 1


def test_address_keeps_what_is_shown(opened, page, report_path):
    """An address that is copied shows the same; one that is wrong does no harm."""
    length = page.evaluate("history.length")
    page.locator(".stage").focus()
    for key in ("End", "ArrowLeft", "3", "e"):
        page.keyboard.press(key)
    page.locator('[data-zoom="2"]').click()
    page.locator('[data-shows="mae"]').click()
    page.wait_for_url(re.compile("metric=mae"))
    assert page.evaluate("history.length") == length  # back leads to where one was before the page
    other = opened(page.url)
    expect(other.locator(".place")).to_have_text(page.locator(".place").inner_text())
    assert left(other) == "difference of truth and nearest"
    assert other.locator('[data-zoom="2"]').get_attribute("aria-checked") == "true"
    assert other.locator('[data-metric="mae"] .chart.wide').first.is_visible()
    opened(f"{report_path.as_uri()}#frame=999999&left=nobody&zoom=x&metric=%22]&clip=7")


def test_page_of_several_clips(opened, several_path):
    """One clip is seen at a time, names are unique, address and links keep to it, a table has all and their mean."""
    page = opened(several_path.as_uri())
    names = page.evaluate("[...document.querySelectorAll('[id]')].map(each => each.id)")
    assert len(names) == len(set(names))
    first, second = (page.locator(".clip").nth(place) for place in range(2))
    assert page.locator("h1").inner_text() == "2 clips"
    assert "in the mean of 2 clips" in page.locator(".outcome").inner_text()
    expect(first).to_be_visible()
    expect(second).not_to_be_visible()
    page.locator("[data-clip='1']").click()
    expect(second.locator(".place")).to_contain_text("frame")
    expect(first).not_to_be_visible()
    page.wait_for_url(re.compile("clip=2"))
    page.reload()
    expect(second.locator(".place")).to_contain_text("frame")
    page.get_by_role("link", name="Summary").click()
    expect(page.locator("#summary-2")).to_be_in_viewport()
    page.locator("[data-clip='0']").click()
    page.goto(f"{several_path.as_uri()}#made-2")  # leads to the clip that has it
    expect(page.locator("#made-2")).to_be_in_viewport()
    rows = page.locator("#clips tbody tr")
    assert rows.count() == len(NAMES)
    mean, *of_clips = map(float, rows.first.locator("td").evaluate_all("all => all.map(each => each.dataset.value)"))
    assert math.isclose(mean, sum(of_clips) / 2)


@pytest.mark.parametrize(("width", "height", "scheme"), [(1200, 900, "light"), (390, 844, "dark")])
def test_nothing_is_in_the_way_of_anybody(opened, several_path, scheme, width, height):
    """Axe finds no violation, in a page of several clips, also in the error map and in the blind test."""
    page = opened(several_path.as_uri(), width, height, color_scheme=scheme, reduced_motion="reduce")
    for button in (None, "Error map", "Blind test"):
        if button is not None:
            page.locator("button:visible", has_text=button).click()
        assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_a_phone_may_zoom_and_sees_every_label(opened, report_path):
    """360 pixels wide: nothing is wider, no label is cut off, no button broken, and two fingers zoom the page."""
    phone = opened(report_path.as_uri(), 360, 740)
    assert phone.evaluate("document.documentElement.scrollWidth") == 360
    words = phone.locator("meta[name=viewport]").get_attribute("content")
    assert not re.search("user-scalable|maximum-scale", words)
    actions = "[...document.querySelectorAll(':not(.stage)')].map(each => getComputedStyle(each).touchAction)"
    assert set(phone.evaluate(actions)) <= {"auto", "manipulation", "pan-y pinch-zoom"}
    texts = """[...document.querySelectorAll('.chart.narrow svg text')].filter(each => each.getClientRects().length)
        .map(each => [each.textContent, each.getBoundingClientRect().left, each.getBoundingClientRect().right])"""
    labels = phone.evaluate(texts)
    assert "frame" in {text for text, _, _ in labels}
    assert [text for text, begin, end in labels if begin < 0 or end > 360] == []
    broken = """() => {
        const more = "xpsnr wrong spurious missing flicker steps".split(" ");
        const button = (name) => Object.assign(document.createElement("button"), { textContent: name });
        document.querySelector("#errors .choice").append(...more.map(button));
        return [...document.querySelectorAll(".chip, .choice button")].map((each) => each.getBoundingClientRect())
            .filter((box) => box.right > 360 || box.height > box.width);
    }"""
    assert phone.evaluate(broken) == []


def test_theme_can_be_chosen(page):
    """The switch turns light to dark."""
    colour = "() => getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.locator(".theme").click()
    assert page.evaluate(colour) != light


def test_page_can_be_read_without_script(chromium, report_path):
    """Every closer look and table is there for a browser that runs no script."""
    page = chromium.new_page(java_script_enabled=False)
    page.goto(report_path.as_uri())
    assert all(crop.is_visible() for crop in page.locator(".crops img").all())
    assert page.locator("#overall").is_visible()
    assert not page.locator(".player").is_visible()
    page.close()
