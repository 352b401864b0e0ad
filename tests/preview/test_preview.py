"""The preview of a conversion: which passages are shown, what is said of them, the page and the video."""

import base64
import json
import os
import re
from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import ConversionJob, DecodeOptions, Position, RunOptions, Timing, convert, methods
from fpsboost.io.new_output import write_whole
from fpsboost.preview.page import LABEL_HEIGHT, estimate_sentence, make_page, preview, write_video
from fpsboost.preview.places import find_passages
from support.browser import violations
from support.command_line import assert_refused
from support.video_truth import scene, write_clip

RATE, HEIGHT, WIDTH = 12, 48, 64
BLEND = {"blend": methods["blend"]}

Picture = NDArray[np.uint8]


def write_video_of(path, pictures, gop=1, pixel_format="yuv420p"):
    """A video with a key frame at every `gop`-th picture."""
    numbers, options = range(len(pictures)), {"crf": "10", "preset": "ultrafast", "g": str(gop)}
    clip = {"times": numbers, "time_base": Fraction(1, RATE), "picture": lambda number, *size: pictures[number]}
    return write_clip(path, **clip, pixel_format=pixel_format, options=options)


def other_scene(index):
    """Stripes that no motion connects with `scene`."""
    across = np.arange(WIDTH) + 2 * index
    return np.repeat(np.repeat(np.uint8(40 + 180 * (across // 5 % 2))[None, :, None], HEIGHT, 0), 3, 2)


def job_of(path, output="out.mp4", **rate):
    return ConversionJob(str(path), output, Timing(**rate), methods["blend"])


def found_in(path, *at):
    return find_passages(job_of(path), RunOptions(), at)


def tried(path, output="out.mp4", **rate):
    return preview(job_of(path, output, **rate), BLEND, RunOptions())


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Sixteen seconds that stand still but for the eighth, ninth and tenth, with a key frame each second."""
    places = [min(max(number - 7 * RATE, 0), 3 * RATE) for number in range(16 * RATE)]
    return write_video_of(tmp_path_factory.mktemp("clip") / "clip.mp4", [scene(place) for place in places], RATE)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Two seconds in motion, with one key frame."""
    pictures = [scene(number) for number in range(2 * RATE)]
    return write_video_of(tmp_path_factory.mktemp("short") / "short.mp4", pictures, 100)


@pytest.fixture(scope="module")
def shown(short):
    return preview(job_of(short), {name: methods[name] for name in ("blend", "nlm")}, RunOptions())


@pytest.mark.slow
def test_passage_in_motion_is_chosen(clip):
    """Of a clip that mostly stands still, the part that moves is shown, though few frames were decoded elsewhere."""
    found = found_in(clip)
    assert any(7 <= passage.start < 10 for passage in found.passages)
    assert sum(float(end - start) for start, end in found.parts) < 8


@pytest.mark.slow
def test_passages_do_not_overlap_and_lie_in_the_part_asked_for(short):
    """Each shows other frames; of a short clip all together are the clip."""
    passages = found_in(short).passages
    assert [(passage.start, passage.end) for passage in passages] == [(0, 1), (1, 2)]


@pytest.mark.slow
def test_cut_is_reported_and_divides_no_passage(tmp_path):
    """Where a scene ends within a second of motion, the longer piece is shown and the cut is said."""
    pictures = [scene(number) if number < 8 else other_scene(number) for number in range(2 * RATE)]
    found = found_in(write_video_of(tmp_path / "cut.mp4", pictures, 100))
    cut = Fraction(8, RATE)
    assert found.cuts == [cut]
    assert found.passages
    assert not any(passage.start < cut < passage.end for passage in found.passages)


def test_duplicates_are_reported(tmp_path):
    """Of animation on twos, the times of all second frames are said."""
    pictures = [scene(number // 2 * 6) for number in range(RATE)]
    found = found_in(write_video_of(tmp_path / "twos.mp4", pictures, 100))
    assert found.duplicates == [Fraction(number, RATE) for number in range(1, RATE - 1, 2)]


def test_given_place_is_shown(clip):
    """What is there does not matter, and near the end a passage begins earlier."""
    found = found_in(clip, Position(Fraction(3)), Position(Fraction(191), is_frame=True))
    assert [passage.start for passage in found.passages] == [3, 15]


@pytest.mark.slow
def test_passage_has_the_frames_of_the_whole_conversion(clip, tmp_path):
    """Shown as before and after, at the same times; the estimate counts all frames, each of which took some time."""
    passage = found_in(clip, Position(Fraction(8))).passages[0]
    found = preview(job_of(clip), BLEND, RunOptions(), at=[Position(Fraction(8))])
    after, estimate = found.trials["blend"][0].after, found.seconds_per_frame["blend"]
    assert (found.frames, estimate > 0) == (16 * 2 * RATE, True)
    assert after.times == [Fraction(place, 2 * RATE) for place in range(2 * RATE)]
    convert(str(clip), str(tmp_path / "frames"), method="blend")
    whole = [cv2.imread(str(path)) for path in sorted((tmp_path / "frames").iterdir())]
    for view, times in ((passage.before, 1), (after, 2)):
        for place in (0, 3, 7):
            expected = whole[2 * 8 * RATE + place * 2 // times]
            assert np.abs(view.image_at(view.times[place]).astype(int) - expected).mean() < 4  # JPEG is lossy


def test_estimate_is_said_with_units():
    """Short times in seconds, long ones in minutes, as one figure; a speed where the length is not known."""
    said = {
        (1000, 0.5): "about 8 min for 1,000 frames.",
        (10, 1): "about 10 s for 10 frames.",
        (None, 1 / 123): "about 120 frames a second; the length of the clip is not known beforehand.",
    }
    assert {each: estimate_sentence(*each) for each in said} == said


@pytest.mark.slow
def test_least_certain_frame_has_its_confidence(short, shown):
    """A method that has confidence says it for the frame between the two that match least; another one does not."""
    for trial in shown.trials["nlm"]:
        assert trial.least_certain is not None
        assert trial.confidence.shape == (HEIGHT, WIDTH, 1)
    assert all(trial.confidence is None for trial in shown.trials["blend"])


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_images_without_a_rate(save_images, tmp_path, suffix):
    """A folder needs no rate; 16 bits and scene-linear floats are shown in 8-bit colours."""
    kind = np.uint16 if suffix == ".png" else np.float32
    save_images(tmp_path / "renders", "shot_{:04d}" + suffix, 9, kind)
    found = tried(tmp_path / "renders", "converted/")
    assert (len(found.trials["blend"][0].after.times), found.is_video) == (17, False)


def test_missing_images(save_images, tmp_path):
    """With `fill_gaps` the numbers are the clock."""
    save_images(tmp_path / "renders", "shot_{:04d}.png", 9)
    for number in (2, 4, 6, 8):
        next(iter((tmp_path / "renders").glob(f"*{number:04d}.png"))).unlink()
    found = tried(tmp_path / "renders", "converted/", fill_gaps=True)
    assert len(found.trials["blend"][0].after.times) in (8, 9)


def test_deep_video_with_full_chroma_rows(tmp_path):
    """4:2:2 in 10 bits is shown with its colours, in their place."""
    path = write_video_of(tmp_path / "deep.mov", [scene(number) for number in range(RATE)], pixel_format="yuv422p10le")
    found = tried(path, "out.mov")
    image = found.selection.passages[0].before.image_at(Fraction(0)).astype(int)
    assert np.abs(image - scene(0)).mean() < 8


@pytest.mark.slow
def test_slow_motion_plays_in_step(short):
    """Views count the source's time, however long the output is."""
    found = tried(short, factor=4, slow_motion=True)
    views = found.views()[0]
    assert (found.stretch, views["before"].end, views["blend"].end) == (4, 1, 1)
    assert len(views["blend"].times) == 4 * len(views["before"].times)


@pytest.mark.parametrize("curve", ["0=0 1s=1s 2s=1.25s x1", "smooth 0=1.5s 1s=1s 3s=.5s"])
def test_passages_show_the_points_of_a_curve(short, tmp_path, curve):
    """Before and after in step, forwards and backwards, with the frames of the whole conversion."""
    found = tried(short, retime=curve)
    convert(str(short), str(tmp_path / "frames"), method="blend", timing=Timing(retime=curve))
    whole = [cv2.imread(str(path)).astype(int) for path in sorted((tmp_path / "frames").iterdir())]
    for passage, trial in zip(found.selection.passages, found.trials["blend"], strict=True):
        assert RATE in passage.retimed
        assert trial.after.times == passage.before.times
        for time, number in zip(trial.after.times, passage.retimed, strict=True):
            assert np.abs(trial.after.image_at(time) - whole[number]).mean() < 4


def test_notes_name_flags(fpsboost_, tmp_path):
    """What is said of the passages names options as the command line does, on the terminal and on the page."""
    write_clip(tmp_path / "in.mkv", times=[each + each // 3 for each in range(24)])
    result = fpsboost_("preview", "in.mkv", "-m", "blend", "--at", "0.2")
    (note,) = result.out.splitlines()[:-2]
    assert "--keep-timing keeps it" in note
    assert note in (tmp_path / "in-preview.html").read_text()


def test_input_is_left_alone_and_nothing_else_is_written(short, fpsboost_, tmp_path, snapshot):
    """One page appears in the current folder, named after the clip, and the command says where."""
    before = snapshot(short.parent)
    result = fpsboost_("preview", short, "-m", "blend", "--fps", "30", "--at", "0.5")
    assert result.code == 0, result.err
    assert result.out.splitlines()[-1] == "Page: short-preview.html"
    assert [path.name for path in tmp_path.iterdir()] == ["short-preview.html"]
    assert snapshot(short.parent) == before
    text = (tmp_path / "short-preview.html").read_text()
    words = "fpsboost", short, short.with_name("short-30fps.mp4"), "--method", "blend", "--fps", "30"
    assert " ".join(f"<span>{word}</span>" for word in words) + "</pre>" in text


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["nothing.mp4"], 1, "nothing.mp4 does not exist; check the name."),
        (["one.mp4", "-m", "blend"], 1, "one.mp4 holds one frame that can be read, and two are needed"),
        (["-"], 2, "Standard input can be read only once"),
        (["CLIP", "there.html"], 1, "there.html exists already; choose another name or pass --overwrite."),
        (["CLIP", "missing/page.html"], 1, "missing/page.html cannot be written because its folder does not exist"),
        (["CLIP", "page"], 2, "page is not the name of an HTML page; write page.html."),
        (["CLIP", "CLIP", "-y"], 2, "is not the name of an HTML page; write"),
        (["CLIP", "--at", "99"], 2, "--at 99 is after the end of"),
        (["CLIP", "--at", "soon"], 2, "--at 'soon' is not a position in a clip"),
        (["CLIP", "-m", "best"], 2, "There is no method 'best'"),
        (["CLIP", "-m", "reproject-image"], 2, "'reproject-image' needs the renderer's motion vectors"),
        (["CLIP", "--side-by-side", "out.png"], 2, "out.png"),
        (["CLIP", "--factor", "0"], 2, "--factor must be above 0"),
    ],
)
def test_bad_input_is_said_in_one_sentence(short, fpsboost_, tmp_path, arguments, code, message):
    """The sentences are those of a conversion, and no page is left."""
    (tmp_path / "there.html").write_text("mine")
    write_video_of(tmp_path / "one.mp4", [scene(0)])
    assert_refused(fpsboost_("preview", *(short if word == "CLIP" else word for word in arguments)), code, message)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.mp4", "there.html"]
    assert (tmp_path / "there.html").read_text() == "mine"


def test_page_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    """Where writing fails nothing is left, and a page that was there stays."""

    def fail(number):
        raise OSError(28, "No space left on device")

    page = tmp_path / "page.html"
    page.write_bytes(b"mine")
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(Exception, match="cannot be written"):
        write_whole(page, b"a page")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("page.html", b"mine")]


def test_side_by_side_video(shown, tmp_path):
    """Every passage at full and quarter speed, before and all methods beside each other, at the output's rate."""
    path = tmp_path / "beside.mp4"
    write_video(str(path), shown)
    with av.open(path) as file:
        frames = list(file.decode(video=0))
    assert (frames[0].width, frames[0].height) == (3 * WIDTH, HEIGHT + LABEL_HEIGHT)
    assert len(frames) == 2 * (1 + 4) * 2 * RATE
    assert [frame.time for frame in frames[:3]] == pytest.approx([0, 1 / (2 * RATE), 1 / RATE])
    first, second, third = (frame.to_ndarray(format="gray")[LABEL_HEIGHT:, :WIDTH].astype(int) for frame in frames[:3])
    assert 3 * np.abs(first - second).mean() < np.abs(second - third).mean()  # repeated, until the next frame is due


@pytest.fixture(scope="module")
def page(shown, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(make_page(shown, "fpsboost 'in & out.mp4' out.mp4", []))
    return path


def played_in(text):
    """What the player of a page shows, as it stands there."""
    return json.loads(text.split('class="played">')[1].split("</script>")[0])


def decoded(uri):
    return cv2.imdecode(np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8), cv2.IMREAD_COLOR)


def test_page_loads_nothing(page):
    """It is one file without addresses, and shows each picture once however often it is repeated."""
    text = page.read_text()
    assert not re.search(r"(?:src|href)=[\"']?(?!data:|#)[a-z/]", text)
    assert "https://" not in text
    assert not re.search(r"\b(crf|preset|yuv420p|x264)\b", text), "an encoder's parameters are no words for a person"
    played = played_in(text)
    assert len(played["uris"]) == len(set(played["uris"]))
    assert len(played["frames"]) == 2 * 2 * RATE
    assert played["frames"][0]["images"][0] == played["frames"][1]["images"][0]
    assert decoded(played["uris"][0]).shape == (HEIGHT, WIDTH, 3)


def test_guide_is_a_view_of_the_page(tmp_path):
    """Beside before and after it shows the guide of every frame, those of the source too; without one it is missing."""
    for folder in ("renders", "cheap"):
        (tmp_path / folder).mkdir()
    small = [cv2.resize(scene(number), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for number in range(17)]
    for number, guide in enumerate(small):
        cv2.imwrite(str(tmp_path / f"cheap/{number + 1:04}.png"), guide)
        if number % 2 == 0:
            cv2.imwrite(str(tmp_path / f"renders/{number + 1:04}.png"), scene(number))
    job = job_of(tmp_path / "renders", f"{tmp_path}/out/")
    guided = replace(job, decoding=DecodeOptions(guide=str(tmp_path / "cheap")))
    alone, played = (played_in(make_page(preview(each, BLEND, RunOptions()), "", [])) for each in (job, guided))
    assert (alone["names"], played["names"]) == (["before", "after"], ["before", "after", "guide"])
    assert {len(frame["images"]) for frame in alone["frames"]} == {2}
    for frame, expected in zip(played["frames"], small, strict=False):
        picture = decoded(played["uris"][frame["images"][2]])
        assert np.abs(picture - expected.astype(int)).mean() < 4  # JPEG is lossy


@pytest.fixture
def browser_page(opened, page):
    return opened(page.as_uri(), 390, 844, reduced_motion="reduce")


def test_page_plays_steps_and_jumps(browser_page):
    """The passage plays, stops, steps, jumps to another one and to an uncertain frame; axe finds nothing."""
    play = browser_page.locator(".play")
    browser_page.get_by_text("frame 0, 0:00.000").wait_for()
    browser_page.locator(".forth").click()
    browser_page.get_by_text("frame 1, 0:00.042").wait_for()
    play.click()
    browser_page.locator(".play.is-playing").wait_for()
    browser_page.locator(".slow").click()
    play.click()
    browser_page.locator(".play:not(.is-playing)").wait_for()
    browser_page.locator("[data-passage='1']").click()
    browser_page.locator("[data-passage='1'][aria-checked='true']").wait_for()
    play.click()
    browser_page.locator("[data-place]").last.click()
    browser_page.locator("[data-passage='1'][aria-checked='true']").wait_for()
    assert browser_page.evaluate("document.documentElement.scrollWidth") == 390
    assert browser_page.locator("#command").inner_text() == "fpsboost 'in & out.mp4' out.mp4"
    for scheme in ("light", "dark"):
        browser_page.emulate_media(color_scheme=scheme)
        assert violations(browser_page) == []


@pytest.mark.slow
def test_watcher_sees_frames_as_they_are_written(short, tmp_path):
    """All frames in order, those that are made with their confidence."""

    class Watcher:
        needs_confidence = True
        seen: list[tuple[Fraction, bool]] = []  # noqa: RUF012

        def watch(self, frame):
            self.seen.append((frame.time, frame.confidence is not None))

    convert(str(short), str(tmp_path / "out.mp4"), method="nlm", run=RunOptions(watcher=Watcher()))
    assert Watcher.seen[:4] == [(Fraction(place, 2 * RATE), bool(place % 2)) for place in range(4)]
    assert len(Watcher.seen) == 4 * RATE
