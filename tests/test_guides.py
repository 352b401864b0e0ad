"""Guides of the frames that are made: which picture belongs to which frame, however a conversion is run.

The synthesis is replaced by one that shows the levels of the guides that it gets.
"""

import json
import re
import shutil
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from fpsboost import (
    DecodeOptions,
    InputError,
    OptionError,
    Trim,
    convert,
    interpolate,
    interpolate_clip,
    join,
    methods,
    stream,
)
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.parts.manifest import fingerprint_options
from fpsboost.run_options import Part
from fpsboost.synthesis import InterpolatedImage
from support.command_line import assert_refused
from support.exr_truth import write_exr
from support.video_truth import write_clip

SIZE = (48, 64)
NONE = 255
"""Level that stands for no guide."""


def level_of(picture: Any) -> int:
    return NONE if picture is None else round(float(picture[0, 0, 0]))


@pytest.fixture(autouse=True)
def shown_guides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Show the level of a frame's guide in blue, and those of the guides of the two frames in green and red."""

    class Levels:
        def __init__(self, image0, image1):
            self.images = image0, image1

        def follow(self, made, picture, t):
            image = np.empty((*SIZE, 3), np.uint8)
            image[:] = [level_of(each) for each in (picture, *(each.guide for each in self.images))]
            return InterpolatedImage(image, made.confidence), SimpleNamespace(_asdict=lambda: {"t": t})

    monkeypatch.setattr("fpsboost.pair.GuidedPair", Levels)
    monkeypatch.setattr("fpsboost.guides.describe_findings", lambda means: f"t {means['t']:g}")


def save(folder: Path, levels: dict[int, int], size: tuple[int, int] = SIZE) -> str:
    """Write flat images with these levels by their numbers."""
    folder.mkdir()
    for number, level in levels.items():
        assert cv2.imwrite(str(folder / f"{folder.name}_{number:04}.png"), np.full((*size, 3), level, np.uint8))
    return str(folder)


def guides_in(folder: Path) -> dict[int, tuple[int, ...]]:
    """Return the levels of the images in an output folder by their numbers."""
    return {int(path.stem[-4:]): tuple(map(int, cv2.imread(str(path))[0, 0])) for path in sorted(folder.iterdir())}


def flat_clip(path: Path, levels: list[int], **options: Any) -> Path:
    """Write a lossless video of flat gray frames."""
    numbers = range(len(levels))
    times = options.pop("times", numbers)
    return write_clip(
        path,
        times=times,
        picture=lambda index, height, width: np.full((height, width, 3), levels[index], np.uint8),
        options={"preset": "ultrafast", "crf": "0", "g": "4"},
        pixel_format="yuv444p",
        **options,
    )


def remark(summary: Any, kind: str) -> Any:
    (found,) = [each for each in summary.remarks if each.kind == kind]
    return found


RENDERED = {1: 11, 5: 15, 9: 19}


def test_numbers_that_lack_get_their_guides(tmp_path):
    """The factor is the step of the input; a frame without guide is made as usual, counted and listed."""
    clip = save(tmp_path / "r", RENDERED)
    guide = save(tmp_path / "g", {n: 100 + n for n in range(1, 10) if n not in (3, 9)}, (24, 32))
    summary = convert(clip, tmp_path / "out", guide=guide)
    made = guides_in(tmp_path / "out")
    assert list(made) == list(range(1, 10))
    assert {n: made[n] for n in (2, 4)} == {2: (102, 101, 105), 4: (104, 101, 105)}
    assert {n: made[n] for n in (6, 7, 8)} == {n: (100 + n, 105, NONE) for n in (6, 7, 8)}
    assert made[3] == (13, 13, 13)
    assert summary.guided_frames == 5
    assert summary.guides_missing == [2]
    assert remark(summary, "guide-missing").values == {"name": guide, "missing": 1, "frames": 6, "numbers": "3"}
    assert remark(summary, "guide-followed").values["found"] == "t 0.5"


def test_numbers_of_the_output_where_they_are_new(tmp_path):
    """Images without gaps: guides have the numbers of the files that are written."""
    clip = save(tmp_path / "r", {7: 10, 8: 20, 9: 30})
    guide = save(tmp_path / "g", {n: 100 + n for n in range(7, 12)})
    convert(clip, tmp_path / "out", guide=guide)
    assert guides_in(tmp_path / "out") == {
        7: (10, 10, 10), 8: (108, 107, 109), 9: (20, 20, 20), 10: (110, 109, 111), 11: (30, 30, 30)
    }  # fmt: skip


def test_guides_of_gaps_that_are_filled(tmp_path):
    """With `fill_gaps`, too, by the numbers that are missing."""
    clip = save(tmp_path / "r", {1: 10, 2: 20, 5: 50})
    guide = save(tmp_path / "g", {3: 103, 4: 104, 5: 105})
    convert(clip, tmp_path / "out", guide=guide, fill_gaps=True)
    made = guides_in(tmp_path / "out")
    assert (made[3], made[4]) == ((103, NONE, 105), (104, NONE, 105))


def test_a_passage_of_images_has_the_guides_of_the_whole(tmp_path):
    """Numbers are those of the whole clip, wherever a conversion begins."""
    clip = save(tmp_path / "r", RENDERED)
    guide = save(tmp_path / "g", {n: 100 + n for n in range(1, 10)})
    convert(clip, tmp_path / "out", guide=guide, start="1f")
    made = guides_in(tmp_path / "out")
    assert {n: made[n][0] for n in (6, 7, 8)} == {6: 106, 7: 107, 8: 108}


TICK = Fraction(1, 1000)
"""Of the clocks of videos; output frames are 20 of them apart, and guides may miss theirs by 5."""


@pytest.mark.parametrize("begins", [0, -48, 12])
def test_videos_go_by_time(tmp_path, begins):
    """The picture that is nearest, within a quarter of an output interval, of a guide that begins at another time."""
    clip = flat_clip(tmp_path / "in.mkv", [16, 32, 48, 64], times=range(0, 160, 40), time_base=TICK)
    near = {25: 80, 35: 90, 40: 100, 67: 110, 80: 120, 95: 130, 102: 140, 120: 150, 150: 160}
    at = [begins, *near]
    guide = flat_clip(tmp_path / "g.mkv", [70, *near.values()], times=[tick - begins for tick in at], time_base=TICK)
    summary = convert(clip, tmp_path / "out", guide=guide, guide_offset=-begins * TICK, duplicates="keep")
    made = list(guides_in(tmp_path / "out").values())
    first = {0: 70, -48: NONE, 12: NONE}[begins]
    assert made[1] == pytest.approx((80, first, 100), abs=1)
    assert made[3] != pytest.approx((110, 100, 120), abs=1)  # it comes 7 ticks late
    assert made[5] == pytest.approx((140, 120, 150), abs=1)
    assert summary.guides_missing == [3]
    assert remark(summary, "guide-missing").values["numbers"] == "3"


def test_images_are_guides_of_a_video_in_order(tmp_path):
    """One for each output frame."""
    clip = flat_clip(tmp_path / "in.mkv", [20, 40, 60])
    guide = save(tmp_path / "g", {n: 100 + n for n in range(5, 10)})
    convert(clip, tmp_path / "out", guide=guide, factor=2)
    made = list(guides_in(tmp_path / "out").values())
    assert made[1::2] == [(106, 105, 107), (108, 107, 109)]


def test_a_video_is_a_guide_of_images_with_a_rate(tmp_path):
    """By time; without the rate of the images, that is not known."""
    clip = save(tmp_path / "r", {1: 20, 2: 40, 3: 60})
    guide = flat_clip(tmp_path / "g.mkv", [100, 110, 120, 130, 140], time_base=Fraction(1, 24))
    with pytest.raises(
        OptionError, match=r"g.mkv goes by time, and images have no frame rate; say it with `input_fps`"
    ):
        convert(clip, tmp_path / "out", guide=guide)
    convert(clip, tmp_path / "out", guide=guide, input_fps=12)
    made = list(guides_in(tmp_path / "out").values())
    assert made[1] == pytest.approx((110, 100, 120), abs=1)
    assert made[3] == pytest.approx((130, 120, 140), abs=1)


def test_speed_ramps_have_guides_of_the_time_that_they_show(tmp_path):
    """Within a quarter of the time of the source that passes between two output frames."""
    clip = flat_clip(tmp_path / "in.mkv", [16, 32, 48, 64], times=range(0, 160, 40), time_base=TICK)
    guide = flat_clip(tmp_path / "g.mkv", [100, 110, 120, 130, 140], times=[0, 10, 22, 33, 40], time_base=TICK)
    summary = convert(clip, tmp_path / "out", guide=guide, speed="0.25", duplicates="keep")
    made = list(guides_in(tmp_path / "out").values())
    assert made[1] == pytest.approx((110, 100, 140), abs=1)
    assert made[2] == pytest.approx((120, 100, 140), abs=1)
    assert summary.guides_missing[:2] == [3, 5]  # of which the first would have one, but 3 ticks late


def test_guides_apply_across_cuts(tmp_path):
    """Where the nearer frame would be repeated."""
    noise = np.random.default_rng(1).integers(0, 256, (2, *SIZE, 3), dtype=np.uint8)
    (tmp_path / "r").mkdir()
    for number, picture in enumerate((noise[0], noise[0] + 1, noise[1], noise[1] + 1), 1):
        cv2.imwrite(str(tmp_path / f"r/{number}.png"), picture)
    guide = save(tmp_path / "g", {n: 100 + n for n in range(1, 8)})
    summary = convert(tmp_path / "r", tmp_path / "out", guide=guide)
    assert summary.scene_cuts == 1
    assert cv2.imread(str(tmp_path / "out/4.png"))[0, 0].tolist() == [104, 103, 105]


def test_damaged_frames_guide_their_own_repair(tmp_path):
    """The frames around them are their own guides; all others stay as they are."""
    clip = save(tmp_path / "r", {1: 10, 2: 20, 3: 99, 4: 98, 5: 50})
    summary = convert(clip, tmp_path / "out", replace="2-3", guide="own")
    assert guides_in(tmp_path / "out") == {
        1: (10, 10, 10), 2: (20, 20, 20), 3: (99, 20, 50), 4: (98, 20, 50), 5: (50, 50, 50)
    }  # fmt: skip
    assert summary.guided_frames == 2
    assert "guide-missing" not in [each.kind for each in summary.remarks]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("kind", ["images", "videos"])
def test_parts_have_the_guides_of_one_run(tmp_path, monkeypatch, kind, threads):
    """With any number of threads: numbers and times are those of the whole clip; so are the counts."""
    levels = [5 * k + 5 for k in range(20)]
    if kind == "images":
        clip: Any = save(tmp_path / "r", {2 * k + 1: level for k, level in enumerate(levels)})
        guide: Any = save(tmp_path / "g", {n: n + 100 for n in range(1, 40) if n % 7})
    else:
        clip = flat_clip(tmp_path / "in.mkv", levels)
        guide = flat_clip(tmp_path / "g.mkv", [n + 100 for n in range(39)], time_base=Fraction(1, 50))
    options = {"guide": guide, "duplicates": "keep", "threads": threads}
    whole = convert(clip, tmp_path / "whole", **options)
    for number in (3, 1, 2):
        convert(clip, tmp_path / "joined", chunk=Part(number, 3), **options)
    joined = join(tmp_path / "joined", tmp_path / "joined.parts")
    made = guides_in(tmp_path / "whole")
    assert guides_in(tmp_path / "joined") == made
    assert joined.guides_missing == whole.guides_missing
    assert joined.guided_frames == whole.guided_frames > 15
    assert [str(each) for each in joined.remarks if "guide" in each.kind] == [
        str(each) for each in whole.remarks if "guide" in each.kind
    ]
    convert(clip, tmp_path / "passage", start="10f", **options)
    passage = list(guides_in(tmp_path / "passage").values())
    assert passage[1::2] == list(made.values())[21::2]


def test_another_guide_is_another_job(tmp_path):
    """What resumes or joins compares the guide's files as it does those of the input."""
    guide = save(tmp_path / "g", {1: 10, 2: 20})
    before = fingerprint_options(decoding=DecodeOptions(guide=guide))
    save(tmp_path / "other", {3: 30})
    (tmp_path / "other/other_0003.png").rename(tmp_path / "g/g_0003.png")
    assert fingerprint_options(decoding=DecodeOptions(guide=guide)) != before


def exr_of(layer: str, folder: Path) -> str:
    folder.mkdir()
    for number in (2, 4):
        planes = {f"{layer}.{letter}": np.ones(SIZE, np.float32) for letter in "RGB"}
        write_exr(folder / f"c_{number:04}.exr", planes)
    return str(folder)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: save(folder / "g", {2: 9}, (24, 24)), "24x24 pixels, .* 64x48; crop or render the guide in"),
        (lambda folder: save(folder / "g", {2: 9}, (96, 128)), "has 128x96 pixels, .* 64x48; crop or render"),
        (lambda folder: "-", "is read beside the input, which a pipe does not allow; name a file or a folder"),
        (lambda folder: str(folder / "nowhere"), "nowhere does not exist; check the name"),
        (lambda folder: save(folder / "Depth", {2: 9}), "holds depth, and a guide is a picture of the frame; render"),
        (lambda folder: save(folder / "a.albedo", {2: 9}), "holds albedo, and a guide is a picture"),
        (lambda folder: exr_of("View.Normal", folder / "g"), "holds normal, and a guide is a picture"),
    ],
)
def test_what_is_no_guide_is_refused(tmp_path, make, message):
    """In one sentence that says what to do, before anything is written."""
    clip = save(tmp_path / "r", RENDERED)
    with pytest.raises((InputError, OptionError), match=message):
        convert(clip, tmp_path / "out", guide=make(tmp_path))
    assert not (tmp_path / "out").exists()


def test_images_without_numbers_are_no_guide_of_images(tmp_path):
    """Nothing says which frame they show."""
    clip = save(tmp_path / "r", RENDERED)
    (tmp_path / "g").mkdir()
    cv2.imwrite(str(tmp_path / "g/first.png"), np.zeros((24, 32, 3), np.uint8))
    with pytest.raises(InputError, match="have no numbers; give them those of the output frames"):
        convert(clip, tmp_path / "out", guide=tmp_path / "g")


@pytest.mark.parametrize("numbers", [(12, 13), (1, 5, 9)])
def test_a_guide_of_none_of_the_frames_is_told(tmp_path, numbers):
    """Whether its numbers are others, or it shows the input alone: all frames are made as usual, and listed."""
    clip = save(tmp_path / "r", RENDERED)
    summary = convert(clip, tmp_path / "out", guide=save(tmp_path / "g", dict.fromkeys(numbers, 9)))
    assert summary.guided_frames == 0
    assert remark(summary, "guide-missing").values["missing"] == summary.frames_made == 6


def test_an_offset_is_for_guides_by_time(tmp_path):
    """Images go by their numbers."""
    images = save(tmp_path / "r", RENDERED)
    cheap = save(tmp_path / "g", {2: 2})
    with pytest.raises(OptionError, match=r"`guide_offset` is for guides by time, and .*g goes by numbers; leave it"):
        convert(images, tmp_path / "out", guide=cheap, guide_offset=1)


FRAMES = [np.full((*SIZE, 3), level, np.uint8) for level in (20, 40, 60)]
CHEAP = [np.full((24, 32, 3), 100 + number, np.uint8) for number in range(6)]
FOLLOWED = [(101, 100, 102), (103, 102, 104)]


@pytest.mark.parametrize("guide", [CHEAP, iter(CHEAP), np.stack(CHEAP)], ids=["list", "iterator", "array"])
def test_streams_have_a_guide_for_every_frame(guide):
    """In order, those of the frames that are not made too."""
    made = [tuple(map(int, frame[0, 0])) for frame in stream(FRAMES, duplicates="keep", guide=guide)]
    assert made[1::2] == [*FOLLOWED, (60, 60, 60)]
    assert made[::2] == [(20, 20, 20), (40, 40, 40), (60, 60, 60)]


def test_streams_take_pictures_and_no_path():
    """Which is for conversions of files."""
    with pytest.raises(OptionError, match="`guide` must be a sequence, not 'cheap'"):
        list(stream(FRAMES, guide="cheap"))


def test_whole_clips_have_a_guide_for_every_frame():
    """In the order of colours and the layout of the clip."""
    frames, cheap = (np.stack(images)[..., ::-1] for images in (FRAMES, CHEAP))
    made, _ = interpolate_clip(frames, fps=24, duplicates="keep", guides=cheap)
    assert [tuple(map(int, frame[0, 0, ::-1])) for frame in made[1:4:2]] == FOLLOWED
    with pytest.raises(OptionError, match="`guide` and `loop` cannot be combined"):
        interpolate_clip(frames, fps=24, loop=True, guides=cheap)
    with pytest.raises(InputError, match="A guide has 32x32 pixels, and the frames have 64x48; crop or"):
        interpolate_clip(frames, fps=24, guides=np.zeros((6, 32, 32, 3), np.uint8))


def test_two_images_have_a_guide_of_the_one_between():
    """And perhaps guides of their own."""
    made = interpolate(FRAMES[0], FRAMES[1], guide=CHEAP[1])
    assert made[0, 0].tolist() == [101, NONE, NONE]
    made = interpolate(FRAMES[0], FRAMES[1], guide=CHEAP[1], key_guides=(CHEAP[0], CHEAP[2]))
    assert made[0, 0].tolist() == list(FOLLOWED[0])
    several = methods["nlm"].interpolate(FRAMES[0], FRAMES[1], [0, 0.5], guides=CHEAP[:2])
    assert [image[0, 0, 0] for image in several] == [20, 101]
    with pytest.raises(InputError, match="A guide has 64x48 pixels, and the frames have 32x24; crop or render"):
        interpolate(CHEAP[0], CHEAP[1], guide=FRAMES[0])
    with pytest.raises(InputError, match="Guides of frames must be like those between them; make all of one size"):
        interpolate(FRAMES[0], FRAMES[1], guide=CHEAP[1], key_guides=(CHEAP[0], FRAMES[1]))


def test_it_is_known_beforehand_which_frames_have_a_guide(tmp_path, fpsboost_):
    """By numbers, and by the times of frames: what a dry run and a probe tell is what a conversion finds."""
    images = save(tmp_path / "r", RENDERED)
    guide = save(tmp_path / "g", {2: 2, 4: 4, 6: 6})
    clip = str(flat_clip(tmp_path / "in.mkv", list(range(20, 100, 2))))
    proxy = str(flat_clip(tmp_path / "proxy.mkv", list(range(10, 40)), time_base=Fraction(1, 50)))
    for input, cheap, options in ((images, guide, []), (clip, proxy, ["--guide-offset=0.1"])):
        out = tmp_path / "out"
        tried = fpsboost_(input, f"{out}/", "--guide", cheap, *options, "--dry-run")
        probed = fpsboost_("probe", input, "--guide", cheap, *options, "--json")
        summary = convert(input, out, guide=cheap, guide_offset=float(bool(options)) / 10, duplicates="keep")
        missing = len(summary.guides_missing)
        found = f"has no picture of {missing} of the {summary.guided_frames + missing} frames that are made"
        assert found in tried.out
        (told,) = [each for each in json.loads(probed.out)["remarks"] if each["kind"] == "guide-missing"]
        assert found in told["sentence"]
        assert told["values"] == dict(remark(summary, "guide-missing").values)
        shutil.rmtree(out)


def test_long_lists_of_frames_are_shortened(tmp_path):
    """A remark names some of them."""
    clip = save(tmp_path / "r", {n: n for n in range(1, 41)})
    summary = convert(clip, tmp_path / "out", guide=save(tmp_path / "g", {2: 2}), duplicates="keep")
    numbers = remark(summary, "guide-missing").values["numbers"]
    assert re.fullmatch(r"4, 6, 8, ([0-9]+, )+\.\.\.", numbers)
    assert len(numbers) <= 60


def hidden_levels(path: str, **options: Any) -> list[tuple[int, ...]]:
    """Return what a comparison shows of the guides of hidden frames."""
    compared = ComparedInterpolator(methods["nearest"], follows_guides=True)
    decoding = DecodeOptions(Trim(options.pop("start", None)), **options)
    hold_out = HoldOut(decoding=decoding, duplicates="keep")
    return [tuple(map(int, frame.image[0, 0])) for frame in compared.interpolate(hold_out.intervals(path))]


def test_hidden_frames_have_their_guides_by_number(tmp_path):
    """Those of the clip's own images, as do the frames that are shown; where there is none, the frame is as without."""
    clip = save(tmp_path / "r", {n: 10 + n for n in range(3, 16, 2)})
    guide = save(tmp_path / "g", {n: 100 + n for n in range(3, 16, 2) if n != 9})
    assert hidden_levels(clip, guide=guide) == [(105, 103, 107), (17, 17, 17), (113, 111, 115)]
    assert hidden_levels(clip, guide=guide, start="2f") == [(17, 17, 17), (113, 111, 115)]


def test_hidden_frames_have_their_guides_by_time(tmp_path):
    """From a passage on, too."""
    clip = str(flat_clip(tmp_path / "in.mkv", [20, 40, 60, 80, 100]))
    proxy = str(flat_clip(tmp_path / "proxy.mkv", [110, 120, 130, 140, 150, 160], times=range(-1, 5)))
    made = hidden_levels(clip, guide=proxy, guide_offset=0.04)
    assert made == [pytest.approx((130, 120, 140), abs=1), pytest.approx((150, 140, 160), abs=1)]
    assert hidden_levels(clip, guide=proxy, guide_offset=0.04, start="2f") == [pytest.approx((150, 140, 160), abs=1)]


def test_a_comparison_has_the_first_method_with_and_without_guide(tmp_path, fpsboost_):
    """Side by side, with the command that does the same; its JSON has both."""
    clip = save(tmp_path / "r", {n: 10 * n for n in range(1, 8)})
    guide = save(tmp_path / "g", {n: 10 * n for n in range(1, 8)}, (24, 32))
    data = tmp_path / "out.json"
    fpsboost_("compare", clip, "--guide", guide, "-m", "nearest,blend", "--duplicates", "keep", "--json", data)
    methods = json.loads(data.read_text())["methods"]
    assert [each["name"] for each in methods] == ["nearest", "nearest+guide", "blend"]
    assert_refused(fpsboost_("compare", clip, "--guide", "own"), 2, "--guide own needs --replace")
