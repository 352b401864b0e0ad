"""Several inputs into one folder: where each goes, what stops and what does not, and what is said."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import SUMMARY, assert_refused, environment
from video_truth import packets_of, pictures_of, write_clip

from fpsboost.cli.batch import plan_outputs
from fpsboost.errors import OptionError
from fpsboost.io import staging

CHEAP = ("--method", "nearest", "--no-cuts", "--preset", "ultrafast")


def test_names_and_endings(monkeypatch, tmp_path):
    """Videos keep their names, and endings that can be written; images go into a folder named like theirs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "renders").mkdir()
    inputs = [
        "x/a.mp4",
        "b.MOV",
        "c.avi",
        "noending",
        "two.dots.webm",
        "d.gif",
        "renders/",
        "shots/s_####.png",
        "./f_%04d.exr",
    ]
    expected = [
        "a.mp4",
        "b.MOV",
        "c.mkv",
        "noending.mkv",
        "two.dots.webm",
        "d.gif",
        "renders/",
        "shots/",
        f"{tmp_path.name}/",
    ]
    assert plan_outputs(inputs, "out/") == [f"out{os.sep}{name}" for name in expected]


@pytest.mark.parametrize(
    ("inputs", "folder", "sentence"),
    [
        (["x/a.mp4", "y/a.mp4"], "out", "x/a.mp4 and y/a.mp4 would both become out/a.mp4"),
        (["a.avi", "b.mp4", "A.mkv"], "out", "a.avi and A.mkv would both become out/A.mkv"),
        (["a.mp4", "a.mp4"], "out", "a.mp4 and a.mp4 would both"),
        (["s/a_##.png", "s/b_##.png"], "out", "s/a_##.png and s/b_##.png would both become out/s/"),
        (["a.mp4", "-"], "out", "A pipe is one clip"),
        (["a.mp4", "b.mp4"], "-", "A pipe is one clip"),
        (["a.mp4", "b.mp4"], "c.mp4", "c.mp4 is no folder, and 2 inputs need one"),
        (["a.mp4", "b.mp4"], "c.png", "c.png is no folder"),
        (["a.mp4", "b.gif"], "c.gif", "c.gif is no folder"),
        (["a.mp4", "b.mp4"], "out/c_##.png", "out/c_##.png is no folder"),
        (["a.mp4", "b.mp4"], __file__, "test_batch.py is no folder"),
    ],
)
def test_mistakes_are_told_first(inputs, folder, sentence):
    """Names that clash, pipes, and a target that is no folder."""
    with pytest.raises(OptionError, match=re.escape(sentence)):
        plan_outputs(inputs, folder)


def test_a_folder_may_be_named_like_a_video(tmp_path):
    """What is a folder already is one, whatever its name."""
    (tmp_path / "out.mp4").mkdir()
    assert plan_outputs(["a.mp4"], str(tmp_path / "out.mp4")) == [str(tmp_path / "out.mp4" / "a.mp4")]


def test_all_kinds_at_once(fpsboost_, tmp_path, save_images):
    """Videos of two kinds and images, a line for each and one for all; the folder is made."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    write_clip(tmp_path / "b.avi", times=range(4), codec="mjpeg", pixel_format="yuvj420p")
    save_images(tmp_path / "renders", count=3)
    result = fpsboost_("a.mp4", "--method", "nearest", "b.avi", "renders", "--no-cuts", "out/")
    assert (result.code, result.out) == (0, "")
    for line, place, name, counts in zip(
        result.lines, ("1/3", "2/3", "3/3"), ("a.mp4", "b.mkv", "renders/"), ((3, 6), (4, 8), (3, 5)), strict=False
    ):
        assert re.fullmatch(SUMMARY.format(f"{place} out/{name}", *counts), line)
    assert result.lines[3:] == ["All 3 inputs were converted."]
    assert len(packets_of(tmp_path / "out" / "a.mp4", "video")) == 6
    assert len(pictures_of(tmp_path / "out" / "b.mkv")) == 8
    assert sorted(path.name for path in (tmp_path / "out" / "renders").iterdir()) == [
        f"shot_{number:04d}.png" for number in range(1, 6)
    ]


def test_one_bad_file_does_not_stop_the_rest(fpsboost_, tmp_path):
    """Its sentence, the others' lines, how many failed and which, exit code 1."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    (tmp_path / "b.mp4").write_bytes(b"nonsense")
    write_clip(tmp_path / "c.mp4", times=range(3))
    result = fpsboost_("a.mp4", "b.mp4", "none.mp4", "c.mp4", "out", *CHEAP)
    assert (result.code, result.out) == (1, "")
    assert [line.split(":")[0] for line in result.lines] == [
        "1/4 out/a.mp4",
        "fpsboost",
        "fpsboost",
        "4/4 out/c.mp4",
        "fpsboost",
    ]
    assert result.lines[-1] == "fpsboost: 2 of 4 inputs failed: b.mp4, none.mp4."
    assert sorted(os.listdir(tmp_path / "out")) == ["a.mp4", "c.mp4"]


def test_existing_outputs_fail_by_themselves(fpsboost_, tmp_path):
    """What was converted before is refused and kept, what is new is made; --overwrite makes both."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.mp4").write_bytes(b"precious")
    assert fpsboost_("a.mp4", "b.mp4", "out", *CHEAP).code == 1
    assert (tmp_path / "out" / "a.mp4").read_bytes() == b"precious"
    assert (tmp_path / "out" / "b.mp4").exists()
    assert fpsboost_("a.mp4", "b.mp4", "out", "--overwrite", *CHEAP).code == 0
    assert len(packets_of(tmp_path / "out" / "a.mp4", "video")) == 6


def test_a_batch_that_is_started_again_does_the_rest(fpsboost_, tmp_path):
    """With --resume, what is complete counts as converted."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))
    assert fpsboost_("a.mp4", "none.mp4", "out/", *CHEAP).code == 1
    before = (tmp_path / "out" / "a.mp4").stat()
    result = fpsboost_("a.mp4", "b.mp4", "out/", "--resume", *CHEAP)
    assert result.code == 0, result.err
    assert "out/a.mp4 exists already" in result.lines[0]
    assert (tmp_path / "out" / "a.mp4").stat() == before
    assert (tmp_path / "out" / "b.mp4").exists()


def test_inputs_are_never_replaced(fpsboost_, tmp_path, snapshot):
    """The folder of the inputs as the target: nothing happens to them, even with --overwrite."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))
    before = snapshot(tmp_path)
    result = fpsboost_("a.mp4", "b.mp4", ".", "--overwrite", *CHEAP)
    assert result.code == 1
    assert "2 of 2 inputs failed" in result.lines[-1]
    assert snapshot(tmp_path) == before


def test_quiet_says_only_what_fails(fpsboost_, tmp_path):
    """Nothing at all when all goes well, else the sentences and the count."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))
    done = fpsboost_("a.mp4", "b.mp4", "out", "--quiet", *CHEAP)
    assert (done.code, done.out, done.err) == (0, "", "")
    result = fpsboost_("a.mp4", "none.mp4", "new", "--quiet", *CHEAP)
    assert result.code == 1
    assert len(result.lines) == 2


def test_nothing_is_left_where_all_fail(fpsboost_, tmp_path):
    """A folder that was made for the outputs goes again if there are none; one that was there stays."""
    (tmp_path / "old").mkdir()
    assert fpsboost_("none.mp4", "nor.mp4", "out").code == 1
    assert fpsboost_("none.mp4", "nor.mp4", "old").code == 1
    assert os.listdir(tmp_path) == ["old"]


def test_wrong_usage_stops_before_anything(fpsboost_, tmp_path):
    """Clashes, vectors of one clip, and a folder in no folder."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    assert_refused(fpsboost_("a.mp4", "x/a.mp4", "out"), 2, "would both become")
    (tmp_path / "vectors").mkdir()
    (tmp_path / "vectors" / "v_0001.exr").touch()
    arguments = ("--vectors", "vectors", "--method", "reproject-scene")
    assert_refused(fpsboost_("a.mp4", "b.mp4", "out", *arguments), 2, "--vectors")
    assert_refused(fpsboost_("a.mp4", "b.mp4", "none/out"), 1, "none does not exist")
    assert not (tmp_path / "out").exists()


def test_options_that_do_not_fit_one_input(fpsboost_, tmp_path, save_images):
    """An option for video fails for images alone."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    save_images(tmp_path / "renders", count=2)
    result = fpsboost_("renders", "a.mp4", "out", *CHEAP)
    assert result.code == 1
    assert "--preset" in result.lines[0]
    assert os.listdir(tmp_path / "out") == ["a.mp4"]


def test_a_bar_says_which_of_how_many(fpsboost_, tmp_path, monkeypatch):
    """On a terminal the bar carries the place in the row."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))
    monkeypatch.setenv("FORCE_COLOR", "1")
    result = fpsboost_("a.mp4", "b.mp4", "out", *CHEAP)
    plain = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", result.err)
    assert re.search(r"2/2 out/b\.mp4 .*[0-9]+/6", plain)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_a_signal_stops_all(tmp_path):
    """SIGTERM to a real process in its second input, which has frames for minutes."""
    write_clip(tmp_path / "a.mp4", times=range(2))
    write_clip(tmp_path / "b.mp4", times=range(0, 200000, 1000))
    command = [sys.executable, "-m", "fpsboost", "a.mp4", "b.mp4", "out", "--fps", "1000", "--verbose", *CHEAP]
    with subprocess.Popen(command, cwd=tmp_path, env=environment(), stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        assert any(line.startswith(b"b.mp4: 64x48") for line in process.stderr)  # the lines until it is open
        process.send_signal(signal.SIGTERM)
        rest = process.stderr.read().decode()
    assert process.returncode == 130
    assert "Stopped; 1 of 2 inputs were converted." in rest
    assert os.listdir(tmp_path / "out") == ["a.mp4"]


def test_one_input_and_a_folder_is_still_images(fpsboost_, tmp_path):
    """Two names are what they always were."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    assert fpsboost_("a.mp4", "out/", "--method", "nearest").code == 0
    assert sorted(os.listdir(tmp_path / "out")) == [f"{number:06d}.png" for number in range(1, 6)]


def test_help_shows_how_to_name_several(fpsboost_):
    """The usage lines are short and whole."""
    result = fpsboost_("--help")
    assert result.out.splitlines()[:3] == [
        "Usage: fpsboost [OPTIONS] IN OUT",
        "       fpsboost [OPTIONS] IN... FOLDER",
        "       fpsboost COMMAND",
    ]


@pytest.mark.parametrize("moment", ["mkdir", "open", "lock", "stat"])
def test_nothing_stays_of_a_run_that_is_stopped_while_it_locks_its_folder(tmp_path, monkeypatch, moment):
    """At each step between making the hidden folder and holding it."""
    place = tmp_path / ".out.mp4.unfinished"
    interrupted = []

    def stopping(function):
        def call(*arguments, **keywords):
            result = function(*arguments, **keywords)
            if not interrupted:
                interrupted.append(function)
                if name == "open":
                    result.close()
                raise KeyboardInterrupt
            return result

        return call

    target, name = {
        "mkdir": (Path, "mkdir"),
        "open": (Path, "open"),
        "lock": (staging, "_lock"),
        "stat": (os.path, "samestat"),
    }[moment]
    monkeypatch.setattr(target, name, stopping(getattr(target, name)))
    with pytest.raises(KeyboardInterrupt):
        staging.StagingDirectory(place, "output", "out.mp4", None).open()
    assert not place.exists()


def test_a_run_that_is_stopped_leaves_the_folder_of_another(tmp_path, monkeypatch):
    """It is stopped while it waits for the lock that the other one holds."""
    other = staging.StagingDirectory(tmp_path / ".out.unfinished", "output", "out", None)
    other.open()
    lock, interrupted = staging._lock, []

    def stop_first(file):
        if not interrupted:
            interrupted.append(file)
            raise KeyboardInterrupt
        lock(file)

    monkeypatch.setattr(staging, "_lock", stop_first)
    with pytest.raises(KeyboardInterrupt):
        staging.StagingDirectory(tmp_path / ".out.unfinished", "output", "out", None).open()
    assert other.folder.is_dir()
    other.close(keep=False)
    assert not other.folder.exists()
