"""Outputs that cannot be written are refused before any work, in every command."""

import sys

import pytest

from fpsboost.io.images.source import ImageSource
from fpsboost.io.video.source import VideoSource
from support.command_line import assert_refused
from support.video_truth import write_clip

COMMANDS = {
    "video": "in.mp4 PLACE.mp4",
    "animation": "in.mp4 PLACE.gif",
    "images": "in.mp4 PLACE/",
    "pattern": "in.mp4 PLACE/f_####.png",
    "part of a video": "in.mp4 PLACE/out.mp4 --chunk 1/2",
    "confidence": "in.mp4 out.mp4 --confidence PLACE",
    "motion": "in.mp4 out.mp4 --save-motion PLACE",
    "compared page": "compare in.mp4 -m blend --report PLACE",
    "compared json": "compare in.mp4 -m blend --json PLACE.json",
    "compared csv": "compare in.mp4 -m blend --csv PLACE.csv",
    "preview": "preview in.mp4 PLACE.html -m blend",
    "preview video": "preview in.mp4 p.html -m blend --side-by-side PLACE.mp4",
    "plan": "plan images PLACE",
    "merged": "merge images images PLACE --plan images",
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("place", ["/proc/out", "loop", "none/out", "in.mp4/out"])
def test_what_cannot_be_written_is_refused_before_any_frame_is_read(
    fpsboost_, tmp_path, save_images, unchanged, monkeypatch, place, command
):
    """A folder that takes no files, a link to itself, a folder that is not there or is a file: one sentence."""
    if place.startswith("/proc") and sys.platform != "linux":
        pytest.skip("the folder is Linux's")
    write_clip(tmp_path / "in.mp4", times=range(6))
    save_images(tmp_path / "images", count=3)
    for suffix in ("", ".mp4", ".gif", ".json", ".csv", ".html"):
        (tmp_path / f"loop{suffix}").symlink_to(f"loop{suffix}")

    def read(source: object) -> None:
        pytest.fail("a frame is read")

    monkeypatch.setattr(VideoSource, "__iter__", read)
    monkeypatch.setattr(ImageSource, "__iter__", read)
    with unchanged(tmp_path):
        assert_refused(fpsboost_(*COMMANDS[command].replace("PLACE", place).split()), 1, place.strip("/").split("/")[0])


@pytest.mark.parametrize("columns", ["0", "1", "2", "99999999"])
def test_help_ends_in_a_terminal_of_any_width(fpsboost_, monkeypatch, columns):
    """And it is laid out in a width that can be read."""
    monkeypatch.setenv("COLUMNS", columns)
    result = fpsboost_("--help")
    assert (result.code, result.err) == (0, "")
    assert 20 <= max(map(len, result.out.splitlines())) <= 2000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("in.mp4 film", "film has no extension; write film.mp4, or film/ for a folder of images."),
        ("in.gif film", "write film.gif, or film/"),
        ("in.mp4 images/film --chunk 1/2", "write images/film.mp4, or images/film/"),
        ("- film", "write film.mp4, or film/"),
        ("in.mp4 film/", None),
        ("in.mp4 empty", None),
        ("images film", None),
        ("images/shot_####.png film", None),
    ],
)
def test_an_ending_that_was_forgotten_is_asked_about(fpsboost_, tmp_path, save_images, snapshot, arguments, said):
    """A video is not written as images unless a folder is named as one; images are, as nothing else is meant."""
    write_clip(tmp_path / "in.mp4", times=range(3))
    save_images(tmp_path / "images", count=3)
    (tmp_path / "empty").mkdir()
    assert fpsboost_("in.mp4", "in.gif", "-m", "nearest").code == 0
    before = snapshot(tmp_path)
    result = fpsboost_(*arguments.split(), "-m", "nearest")
    if said is not None:
        assert_refused(result, 2, said)
        assert snapshot(tmp_path) == before
    else:
        assert (result.code, len(list((tmp_path / arguments.split()[1]).glob("*.png"))) in (5, 6)) == (0, True)
