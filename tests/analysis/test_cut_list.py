"""Cuts from a list: read as people and PySceneDetect write them, believed, and nothing else."""

from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fpsboost import (
    DecodeOptions,
    Encoding,
    FrameCache,
    InputError,
    Interpolator,
    OptionError,
    RunOptions,
    SourcePosition,
    convert,
)
from fpsboost.analysis.scene_cuts import CutList, read_cuts
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend
from fpsboost.timing.position import Position, Trim
from support.video_truth import write_clip

SCENES = """Timecode List:,00:00:00.417
Scene Number,Start Frame,Start Timecode,Start Time (seconds),End Frame,End Timecode,End Time (seconds)
1,1,00:00:00.000,0.000,10,00:00:00.417,0.417
2,11,00:00:00.417,0.417,30,00:00:01.251,1.251
"""


def cuts_of(*texts: str) -> CutList:
    return CutList(tuple(Position.parse(text, "--cuts") for text in texts))


def found(cuts: CutList, count: int, rate: Fraction) -> list[int]:
    """Numbers of the frames that a scene begins with."""
    images = [
        FrameCache(np.zeros((2, 2, 3), np.uint8), source_position=SourcePosition(k, Fraction(k) / rate))
        for k in range(count)
    ]
    return [k for k, pair in enumerate(pairwise(images), 1) if cuts.is_cut(cuts.match_score(*pair), 0.0, 1.0)]


def test_a_list_as_people_write_it(tmp_path):
    """Times, frames, comments and empty lines."""
    (tmp_path / "cuts.txt").write_text("\ufeff# reel 1\n0:01.5\n\n 120f  # the door\r\n7.25\n", encoding="utf-8")
    expected = [Position(Fraction(3, 2)), Position(Fraction(120), is_frame=True), Position(Fraction(29, 4))]
    assert list(read_cuts(tmp_path / "cuts.txt").positions) == expected
    (tmp_path / "cuts.txt").write_text("")
    assert read_cuts(tmp_path / "cuts.txt") == CutList(())


@pytest.mark.parametrize("skipped_lines", [0, 1], ids=["with the list of times", "without"])
def test_the_list_of_pyscenedetect(tmp_path, skipped_lines):
    """Its column of seconds says where scenes begin; at 23.976 frames a second that is frame 10."""
    (tmp_path / "scenes.csv").write_text("".join(SCENES.splitlines(keepends=True)[skipped_lines:]))
    cuts = read_cuts(tmp_path / "scenes.csv")
    assert [place.value for place in cuts.positions] == [0, Fraction(417, 1000)]
    assert found(cuts, 30, Fraction(24000, 1001)) == [10]


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [
        ("none.txt", InputError, r"Cannot read .*none\.txt"),
        ("cuts.txt", InputError, r"cuts\.txt is not a text file; give `cuts` a file"),
        ("soon.txt", OptionError, r"soon\.txt, line 2: 'soon' is not a position in a clip"),
        ("scenes.csv", OptionError, r"scenes\.csv, line 5: '' is not a position"),
    ],
)
def test_what_is_no_list_is_refused(tmp_path, name, error, said):
    """The sentence names the file, and the line where it can."""
    (tmp_path / "cuts.txt").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "soon.txt").write_text("1.5\nsoon\n")
    (tmp_path / "scenes.csv").write_text(SCENES + "3,31\n")
    with pytest.raises(error, match=said):
        read_cuts(tmp_path / name)


@pytest.mark.parametrize("rate", [Fraction(25), Fraction(24000, 1001), Fraction(60000, 1001)])
@pytest.mark.parametrize("way", ["{frame}f", "{seconds:.3f}", "{seconds:.6f}"])
def test_a_cut_lies_before_the_frame_that_is_named(rate, way):
    """By number, and by a time that is rounded up or down; the first frame of all begins no scene."""
    wanted = [7, 8, 100, 333]
    texts = [way.format(frame=k, seconds=float(k / rate)) for k in [*wanted, 0]]
    assert found(cuts_of(*texts), 400, rate) == wanted


def cuts_in(path: Path, target: Path, cuts: CutList, start: str | None) -> int:
    """How many cuts a conversion comes across."""
    options: dict[str, Any] = {
        "method": Interpolator(ZeroMotion(), Blend(), cuts=cuts, compensate_illumination=False),
        "encoding": Encoding(preset="ultrafast"),
        "decoding": DecodeOptions(trim=Trim(None if start is None else Position.parse(start, "--start"))),
    }
    return convert(str(path), str(target), **options, run=RunOptions(overwrite=True)).scene_cuts


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Path:
    """Sixteen frames, of which every fourth can be gone to."""
    path = tmp_path_factory.mktemp("clip") / "in.mp4"
    return write_clip(path, times=range(100, 116), options={"preset": "ultrafast", "g": "4"})


@pytest.mark.parametrize("cut", ["12f", "0.48", "0.47"])
@pytest.mark.parametrize("start", [None, "0.2", "5f", "0.44"])
def test_a_list_counts_from_the_first_frame_of_the_clip(tmp_path, clip, cut, start):
    """Also where only a part of it is converted, whether what is before was read or passed over."""
    target = tmp_path / "out.mp4"
    assert cuts_in(clip, target, cuts_of(cut), start) == 1
    assert cuts_in(clip, target, cuts_of("17f", "99"), start) == 0
    assert cuts_in(clip, target, cuts_of("3f"), start) == (start is None)


def test_the_command_line_takes_a_list(fpsboost_, tmp_path):
    """--cuts, which contradicts the other two options."""
    write_clip(tmp_path / "in.mp4", times=range(20))
    (tmp_path / "cuts.txt").write_text("7f\n0:00.5\n")
    result = fpsboost_("in.mp4", "out.mp4", "--cuts", "cuts.txt", "-m", "blend", "--preset", "ultrafast", "--verbose")
    assert (result.code, "2 scene cuts" in result.err, "CutList of 2 cuts" in result.err) == (0, True, True)
    for others in (["--no-cuts"], ["--cut-threshold", "0.3"]):
        result = fpsboost_("in.mp4", "new.mp4", "--cuts", "cuts.txt", *others)
        assert (result.code, f"--cuts and {others[0]} cannot be combined" in result.err) == (2, True)
