"""Repeated frames left out, and dropped ones made again: all pictures at the times at which they were taken."""

from dataclasses import replace
from fractions import Fraction
from itertools import accumulate, chain, cycle, islice
from pathlib import Path

import numpy as np
import pytest

from fpsboost import DuplicateDetector, Frame, FrameCache, OptionError, Part, Position, convert, find_method, join
from fpsboost.analysis.cadence import Repeats
from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.analysis.gaps import find_gaps
from fpsboost.analysis.scene_cuts import CutList
from fpsboost.timing.edit import Edit
from support.conversion_options import FAST
from support.held_frames import HEIGHT, WIDTH, pan
from support.video_truth import packets_of, pictures_of, write_clip

CADENCES = {
    **{"3:2": ([3, 2], 60), "one of five repeated": ([1, 1, 1, 2], 30), "one of 25 repeated": ([1] * 23 + [2], 25)},
    **{"2:2": ([2], 60), "on twos": ([2], 24), "on threes": ([3], 24)},
}
"""How many frames each picture lasts, and frames per second."""


def shown(pattern: list[int], count: int, first: int = 0) -> list[int]:
    """The numbers of the pictures that so many frames show, from a frame of the pattern on."""
    return list(islice(chain.from_iterable([n] * k for n, k in enumerate(cycle(pattern))), first, first + count))


def noted(pictures, rate, picture=lambda number: pan(3 * number)):
    """What is noted of frames that show these pictures, each with noise of its own, as an encoder leaves it."""
    random, repeats = np.random.default_rng(2), Repeats(DuplicateDetector())
    noisy = (picture(number) + random.integers(-1, 2, (HEIGHT, WIDTH, 3)) for number in pictures)
    images = enumerate(image.clip(0, 255).astype(np.uint8) for image in noisy)
    frames = (SourceFrame(Frame(image, Fraction(number, rate))) for number, image in images)
    assert sum(map(len, repeats.groups(frames))) == len(repeats.times)
    return repeats


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("name", CADENCES)
def test_each_picture_of_a_regular_cadence_is_kept_once(name, first):
    """Wherever the pattern begins, at even times; an edit that breaks it costs a picture at most."""
    pattern, rate = CADENCES[name]
    before, after = (shown(pattern, 8 * sum(pattern) + 40, number) for number in (first, 2))
    pictures = before + [number + 300 for number in after]
    repeats = noted(pictures, rate)
    cadence = repeats.cadence(Fraction(rate))
    assert (cadence.name, cadence.rate, cadence.is_certain) == (name, Fraction(rate * len(pattern), sum(pattern)), True)
    edit = repeats.kept(cadence)
    numbers, times = edit.frames, edit.times
    kept = [pictures[number] for number in numbers]
    assert len(kept) == len({*kept}) >= len({*pictures}) - 1
    assert (kept[: len({*before})], times) == (sorted({*before}), [k / cadence.rate for k in range(len(numbers))])
    assert all(abs(time - Fraction(n, rate)) <= 1 / cadence.rate for n, time in zip(numbers, times, strict=True))
    repeats.times[-1] += 1
    assert repeats.cadence(Fraction(rate)) is None


def test_noise_in_the_last_frames_is_no_picture():
    """A picture that would be shown when the clip has ended is none, though it differs as clearly as in slow motion."""
    pictures = shown([5], 100)
    pictures[98:] = [pictures[98] + 0.3, pictures[99] + 0.4]
    repeats = noted(pictures, 120)
    assert repeats.differences[98] > DuplicateDetector().noise
    assert repeats.kept(repeats.cadence(Fraction(120))).frames == list(range(0, 100, 5))


def test_motion_as_small_as_noise_keeps_the_cadence():
    """A slow part tells nothing of it, and as many of its frames stay as elsewhere."""
    pictures = shown([1, 1, 1, 2], 60)
    repeats = noted([*pictures, *(50 + number / 16 for number in pictures)], 30)
    cadence = repeats.cadence(Fraction(30))
    assert (cadence.name, cadence.is_certain, len(repeats.kept(cadence).frames)) == ("one of five repeated", True, 96)


@pytest.mark.parametrize("counts", [[1, 2, 1, 3, 3, 2, 1] * 8 + [2, 1, 1] * 8, [1, 1, 1, 2] * 12 + [1] * 40])
def test_what_is_irregular_keeps_the_times_of_first_frames(counts):
    """In a game, or where one part has another rate: no constant rate is that of the pictures."""
    repeats = noted([number for number, count in enumerate([*counts, 1]) for _ in range(count)], 30)
    cadence, firsts = repeats.cadence(Fraction(30)), [0, *accumulate(counts)]
    assert not cadence.is_certain
    assert repeats.kept(cadence) == Edit(firsts, [repeats.times[each] for each in firsts])


@pytest.mark.parametrize("length", [2, 3])
def test_a_pan_on_ones_stays(length):
    """A figure on twos or threes in front of it repeats, and no frame does."""
    x = np.arange(WIDTH)[:, np.newaxis]
    repeats = noted(range(60), 24, lambda number: np.where(abs(x - number // length * length) < 10, 255, pan(number)))
    assert not any(repeats.are_repeats)


@pytest.mark.slow
def test_a_conversion_drops_them_and_restores_them(fpsboost_, tmp_path):
    """The true rate, exactly even, with the same sound; the old times from it; and `probe` says so beforehand."""
    pictures, options = shown([3, 2], 90), {"encoding": FAST, "method": "nearest"}
    write_clip(
        Path("in.mp4"),
        times=range(0, 90 * 1001, 1001),
        time_base=Fraction(1, 60000),
        rate=Fraction(60000, 1001),
        size=(HEIGHT, WIDTH),
        sound="aac",
        options={"crf": "23", "preset": "medium"},
        picture=lambda number, *size: pan(3 * pictures[number]),
    )
    assert ", 3:2 in 100 % of what moves; --duplicates drop leaves 23.976 fps" in fpsboost_("probe", "in.mp4").out
    summary = convert("in.mp4", "film.mp4", duplicates="drop", **options)
    assert (summary.frames_out, summary.frames_made, summary.remarks) == (
        *(36, 0),
        ["54 of 90 frames repeat another and were dropped; the others are evenly spaced, 23.976 per second (3:2)."],
    )
    assert times_of("film.mp4") == [Fraction(1001 * number, 24000) for number in range(36)]
    assert packets_of(Path("film.mp4"), "audio") == packets_of(Path("in.mp4"), "audio")
    convert("film.mp4", "back.mp4", fps="59.94", **options)
    assert times_of("back.mp4") == times_of("in.mp4")
    assert convert("in.mp4", "doubled.mp4", duplicates="drop", factor=2, **options).frames_out == 72


def test_cuts_count_from_the_first_frame_of_the_clip(tmp_path):
    """A listed time is one of the clip, also where a part of it is read, and repeats are left out."""
    pictures = shown([2], 50)
    clip = write_clip(
        tmp_path / "in.mp4",
        times=range(50),
        size=(HEIGHT, WIDTH),
        picture=lambda number, *size: pan(3 * pictures[number]),
    )
    method = replace(find_method("blend"), cuts=CutList((Position(Fraction(3, 2)),)))
    options = {"method": method, "duplicates": "drop", "factor": 2, "encoding": FAST}
    for start in (None, "1"):
        assert convert(clip, tmp_path / f"from {start}.mp4", start=start, **options).scene_cuts == 1


@pytest.mark.parametrize("decoder", ["ffmpeg", "opencv"])
def test_parts_without_repeats_are_those_of_one_run(tmp_path, decoder):
    """Also of a file whose times only decoding tells, and by a library that reads from the first frame on."""
    pictures = shown([2], 40)
    clip = write_clip(
        tmp_path / "in.avi",
        times=range(40),
        size=(HEIGHT, WIDTH),
        codec="mpeg4",
        picture=lambda number, *size: pan(3 * pictures[number]),
    )
    options = {"method": "blend", "duplicates": "drop", "factor": 2, "decoder": decoder}
    convert(clip, tmp_path / "whole", **options)
    for number in (1, 2):
        convert(clip, tmp_path / "out", chunk=Part(number, 2), **options)
    join(tmp_path / "out", tmp_path / "out.parts")
    whole, joined = ([path.read_bytes() for path in sorted((tmp_path / name).iterdir())] for name in ("whole", "out"))
    assert joined == whole


def times_of(name: str) -> list[Fraction]:
    """The times of a video's frames, seconds."""
    return [picture.pts * picture.time_base for picture in pictures_of(Path(name))]


@pytest.mark.parametrize(
    ("places", "gaps"),
    [
        pytest.param([*range(12), *range(13, 25), *range(27, 40)], {11: 1, 23: 2}, id="frames left out"),
        pytest.param(range(40), {}, id="none left out"),
        pytest.param([*[0] * 8, *range(16), *[15] * 8], {}, id="begins and ends"),
        pytest.param([number**2 / 24 for number in range(40)], {}, id="gets faster"),
        pytest.param([*range(16), *range(16, 48, 2)], {}, id="twice as fast from then on"),
        pytest.param([*range(16), *range(12, 0, -1)], {}, id="turns back"),
        pytest.param([*range(16), *range(1000, 1016)], {}, id="a cut"),
        pytest.param(shown([1, 1, 1, 1, 2], 40), {}, id="repeats"),
    ],
)
def test_gaps_are_found_where_a_steady_pan_jumps(places, gaps):
    """Those and no others: where motion changes or is interrupted, nothing tells how much is missing."""
    assert find_gaps(FrameCache(pan(3 * place, seed=int(place >= 1000))) for place in places) == gaps


@pytest.mark.slow
@pytest.mark.parametrize(("gaps", "factor"), [("auto", 1), ("19,33x2", 1), ("0:00.65,33x2", 2)])
def test_a_conversion_makes_again_what_a_camera_dropped(fpsboost_, gaps, factor):
    """All pictures at the times of the clip before, and the sound untouched."""
    pictures = [number for number in range(60) if number not in (20, 35, 36)]
    write_moving(pictures, range(0, 57 * 1001, 1001))
    summary = convert(
        "in.mp4", "out.mp4", gaps=gaps, factor=None if factor == 1 else factor, method="dis", encoding=FAST
    )
    assert (summary.frames_in, summary.frames_out, summary.frames_made, summary.remarks) == (
        *(57, 60 * factor, 60 * factor - 57),
        ["Missing behind 19,33x2: 3 frames; with them, the picture is 0.100 s longer."],
    )
    assert times_of("out.mp4") == [Fraction(1001 * number, 30000 * factor) for number in range(60 * factor)]
    images = [picture.to_ndarray(format="bgr24").astype(int) for picture in pictures_of(Path("out.mp4"))[::factor]]
    shown = [pan(3 * number) for number in range(60)]
    assert [np.argmin([abs(image - each).mean() for each in shown]) for image in images] == [*range(60)]
    assert packets_of(Path("out.mp4"), "audio") == packets_of(Path("in.mp4"), "audio")


def test_a_gap_that_is_named_is_no_scene_cut(tmp_path, monkeypatch):
    """The frames missing there are made from both sides, however little these have in common."""
    monkeypatch.chdir(tmp_path)
    write_moving([*range(4), *range(1000, 1004)], range(0, 8 * 1001, 1001))
    options = {"factor": 1, "method": "blend", "encoding": FAST}
    summary = convert("in.mp4", "out.mp4", gaps="3x2", **options)
    assert (summary.frames_out, summary.frames_made, summary.scene_cuts) == (10, 2, 0)
    mixed = pictures_of(Path("out.mp4"))[4].to_ndarray(format="bgr24").astype(float)
    assert abs(mixed - (pan(9) * (2 / 3) + pan(3000) * (1 / 3))).mean() < 8


@pytest.mark.parametrize(
    ("times", "options", "says"),
    [
        ([0, 1001, 2002, 5005, 6006], {"gaps": "auto"}, "needs a constant rate .* convert it with `factor=1` first"),
        (range(0, 5005, 1001), {"gaps": "2,4"}, r"has 4, and the last frame of in\.mp4 is 4"),
        (range(0, 5005, 1001), {"gaps": "3-2"}, "has a range from 3f to 2f, which ends before it begins"),
        (range(0, 5005, 1001), {"gaps": "2x"}, "contains no frame"),
        (
            range(0, 5005, 1001),
            {"gaps": "2", "start": "1f"},
            "and `start` cannot be combined",
        ),
    ],
)
def test_gaps_that_cannot_be_filled_are_refused(fpsboost_, times, options, says):
    """In one sentence: where the times vary already, nothing follows, or the list is wrong."""
    write_moving(range(len(times)), times)
    with pytest.raises(OptionError, match=f"`gaps` .*{says}"):
        convert("in.mp4", "out.mp4", **options)


def write_moving(pictures, times):
    """A clip with sound of a pan whose frames show these places, at these ticks."""
    write_clip(
        Path("in.mp4"),
        times=times,
        time_base=Fraction(1, 30000),
        rate=Fraction(30000, 1001),
        size=(HEIGHT, WIDTH),
        sound="aac",
        options={"crf": "10"},
        picture=lambda number, *size: pan(3 * pictures[number]),
    )
