"""Where a conversion is least certain: the two frames that match least, wherever no scene ends."""

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from fpsboost import (
    ByFactor,
    DecodeOptions,
    Encoding,
    Interpolator,
    LowestMatch,
    Part,
    RunOptions,
    Summary,
    Timing,
    convert,
    find_method,
    join,
)
from fpsboost.analysis.scene_cuts import CutList
from fpsboost.io.video.capture import ArraySource
from fpsboost.streaming import interpolate_frames
from fpsboost.timing.position import Position, format_time
from support.comparison_truth import save_clip
from support.truth import moved_waves, noise

BLEND = find_method("blend")
HEIGHT, WIDTH = 72, 128
HIDDEN = 6  # frame in which something covers the middle of the picture


def picture(index: int, scene: int = 0) -> np.ndarray[Any, Any]:
    """A pattern that moves by two pixels a frame."""
    image = np.clip(128 + 100 * moved_waves((HEIGHT, WIDTH), 2 * index, seed=scene), 0, 255).astype(np.uint8)
    if index == HIDDEN:
        image[20:52, 40:88] = noise(32, 48)
    return image


PAN = [picture(index) for index in range(10)]


def summary_of(images: list[np.ndarray[Any, Any]], interpolator: Interpolator = BLEND, threads: int = 1) -> Summary:
    """The summary of a conversion of images in memory to twice the rate, 25 frames a second at first."""
    summary, source = Summary(), ArraySource(iter(images), Fraction(25))
    with interpolate_frames(source, interpolator, ByFactor(Fraction(2)), summary, threads=threads) as frames:
        for _ in frames:
            pass
    return summary


def lowest(summary: Summary) -> LowestMatch:
    assert summary.lowest_match is not None
    return summary.lowest_match


@pytest.mark.parametrize("threads", [1, 3])
def test_it_is_where_something_covers_the_picture(threads):
    """Its frame and time are those of the frame that is made there, with any number of threads."""
    found = lowest(summary_of(PAN, threads=threads))
    assert found.number in (2 * HIDDEN - 1, 2 * HIDDEN + 1)
    assert found.time == Fraction(found.number, 50)
    assert 0 < found.match_score < 0.9


def test_a_scene_cut_is_not_uncertain():
    """Nothing is made of both of its frames."""
    summary = summary_of(PAN[:5] + [picture(index, scene=7) for index in range(10, 15)])
    assert summary.scene_cuts == 1
    assert lowest(summary).number != 9


@pytest.mark.parametrize("cuts", [None, CutList((Position(Fraction(100), True),))], ids=["none", "listed"])
def test_it_is_found_whoever_decides_about_cuts(cuts):
    """Also where cuts are not looked for."""
    assert lowest(summary_of(PAN, interpolator=replace(BLEND, cuts=cuts))) == lowest(summary_of(PAN))


@pytest.mark.slow
def test_parts_that_are_joined_know_it(tmp_path):
    """It is that of one run, whichever part it is in."""
    source = save_clip(tmp_path / "in", PAN)
    options: dict[str, Any] = {
        "timing": Timing(Fraction(60)),
        "decoding": DecodeOptions(input_fps=Fraction(12)),
        "encoding": Encoding(preset="ultrafast"),
        "method": BLEND,
    }
    whole = convert(source, str(tmp_path / "whole.mp4"), **options)
    output = tmp_path / "out.mp4"
    for number in (1, 2):
        convert(source, str(output), **options, run=RunOptions(chunk=Part(number, 2)))
    assert join(str(output), [f"{output}.parts"]).lowest_match == lowest(whole)


@pytest.mark.parametrize("decimals", [3, 6])
@pytest.mark.parametrize("seconds", ["0", "59/48", "59.9996", "61.5", "3723.042"])
def test_times_are_written_as_they_are_read(seconds, decimals):
    """To the millisecond, or to the microsecond: frame 59 of 48 a second begins after 1.229 s, at 1.229167 s."""
    read = Position.parse(format_time(Fraction(seconds), decimals), "time").value
    assert abs(read - Fraction(seconds)) <= Fraction(1, 2 * 10**decimals)
