"""Option --dry-run: what is said of a conversion before it is run, and that nothing is written."""

import re

import pytest

from support.command_line import assert_refused
from support.video_truth import write_clip

CHEAP = ("--method", "nearest", "--no-cuts", "--preset", "ultrafast")
LAST = "5 frames give 9 images and not 10"


def rows(text: str) -> dict[str, str]:
    """The rows of the printed table by their names."""
    joined = re.sub(r"\n {3,}", " ", text)
    return dict(re.findall(r"^(from|makes|keeps|takes|size|tried) +(.*?) *$", joined, re.MULTILINE))


def test_a_video(fpsboost_, tmp_path, unchanged):
    """Frames, rate and encoder, the streams that are kept or not, and figures of a trial; nothing is written."""
    write_clip(tmp_path / "in.mov", times=range(80), sound="pcm_s16le")
    with unchanged(tmp_path):
        result = fpsboost_("in.mov", "out.mp4", "--fps", "30", "--audio-codec", "aac", *CHEAP, "--dry-run")
        said = rows(result.out)
        assert (result.code, result.err) == (0, "")
        assert said["from"] == "64x48 at 25 fps, 80 frames"
        assert said["makes"].startswith("out.mp4, 96 frames at 30 fps, 0:03.200, libx264, yuv420p")
        assert said["keeps"] == "pcm_s16le sound (fra)"
        assert re.fullmatch(r"about [\d.]+ s for 96 frames\.", said["takes"])
        assert re.fullmatch(r"about [\d.]+ kB, other streams not counted", said["size"])
        assert said["tried"] == "6 frames, for time and size"
        assert "encoded anew as aac" in result.out
        repaired = fpsboost_("in.mov", "out.mp4", "--no-audio", "--replace", "70", *CHEAP, "--dry-run")
        assert rows(repaired.out)["tried"] == "5 frames, for time and size"  # the clip does not end with them
        assert "behind it" not in repaired.out


def test_images(fpsboost_, tmp_path, save_images, unchanged):
    """Of two folders, each is tried; the last image is explained."""
    for name in ("a", "b"):
        save_images(tmp_path / name)
    with unchanged(tmp_path):
        result = fpsboost_("a", "b", "out", "--method", "blend", "--dry-run")
        assert (result.code, result.err) == (0, "")
        assert result.out.count(LAST) == result.out.count("Nothing was written.") == 2
        assert rows(result.out)["makes"] == "out/b/, 9 frames"


def test_what_is_refused_is_refused_at_once(fpsboost_, tmp_path):
    """An output that exists, and sound that does not fit, as in the conversion; a speed ramp is fine."""
    write_clip(tmp_path / "in.mp4", sound="aac")
    ramp = fpsboost_("in.mp4", "--speed", "0.5@0.2-0.3", "--dry-run", *CHEAP)
    assert rows(ramp.out)["makes"].startswith("in-retimed.mp4, 13 frames at 25 fps")
    assert rows(ramp.out)["takes"] == "not estimated, as the clip is too short for a trial"
    write_clip(tmp_path / "in.mkv")  # whose header says how long the file is, not the video
    curve = fpsboost_("in.mkv", "--retime", "0=0 0.2s=0.2s 0.4s=0 x0.5", "--dry-run", *CHEAP)
    assert rows(curve.out)["makes"].startswith("in-retimed.mkv, 30 frames at 25 fps, 0:01.200")
    assert_refused(fpsboost_("in.mp4", "in.mp4", "--dry-run"), 1, "in.mp4 is the input itself")
    assert_refused(fpsboost_("in.mp4", "--start", "9", "--dry-run"), 1, "in.mp4 has ended where --start")
    assert_refused(fpsboost_("in.mp4", "o.webm", "--dry-run", "--audio-codec", "copy"), 1, "--no-audio")


@pytest.mark.parametrize(("more", "count"), [([], 1), (["--factor", "1"], 0), (["--in-place"], 0)])
def test_last_image_is_explained_once(fpsboost_, tmp_path, save_images, more, count):
    """Where two folders become images, one note says why there are nine and not ten; in place, four are added each."""
    for name in ("a", "b"):
        save_images(tmp_path / name, "shot_{:03d}0.png")
    is_in_place = "--in-place" in more
    result = fpsboost_("a", "b", *["out"] * (not is_in_place), "--method", "blend", *more)
    assert result.code == 0, result.err
    assert (result.err.count(LAST), result.err.count("5 -> 9 frames, 4 added in ")) == (count, 2 * is_in_place)
