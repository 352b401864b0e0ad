"""Several inputs into one folder: where each goes, what stops and what does not, and what is said."""

import os
import re
import signal
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from fpsboost import InputError, OptionError, Timing
from fpsboost.cli.app import execute
from fpsboost.cli.batch import is_pair, plan_outputs
from fpsboost.io.opening import open_source
from fpsboost.media import staging
from fpsboost.preparation import output_beside
from support.command_line import SUMMARY, assert_refused, environment
from support.video_truth import packets_of, pictures_of, write_clip

CHEAP = ("--method", "nearest", "--no-cuts", "--preset", "ultrafast")


@pytest.fixture
def two_clips(tmp_path) -> None:
    """Clips of three frames, a.mp4 and b.mp4."""
    for name in ("a.mp4", "b.mp4"):
        write_clip(tmp_path / name, times=range(3))


def test_names_and_endings(monkeypatch, tmp_path):
    """Videos keep their names, and endings that can be written; images go into a folder named like theirs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "renders").mkdir()
    outputs = {"x/a.mp4": "a.mp4", "b.MOV": "b.MOV", "c.avi": "c.mkv", "noending": "noending.mkv", "d.gif": "d.gif"}
    outputs |= {"two.dots.webm": "two.dots.webm", "renders/": "renders/", "shots/s_####.png": "shots/"}
    outputs |= {"./f_%04d.exr": f"{tmp_path.name}/"}
    assert plan_outputs(list(outputs), "out/") == [f"out{os.sep}{name}" for name in outputs.values()]


@pytest.mark.parametrize(
    ("input", "rate", "output"),
    [
        ("x/a.mp4", {}, "x/a-2x.mp4"),
        ("b.avi", {"factor": Fraction(5, 2)}, "b-2.5x.mkv"),
        ("c.gif", {"fps": Fraction(60000, 1001)}, "c-59.94fps.gif"),
        ("d.mov", {"factor": 4, "slow_motion": True}, "d-4x-slow.mov"),
        ("d.mov", {"slow_motion": True, "fps": 60}, "d-2x-slow-60fps.mov"),
        ("d.mov", {"speed": "0.5@1-2", "fps": 30}, "d-retimed-30fps.mov"),
        ("v1.0/", {}, "v1.0-2x/"),
        ("v1.0/s_####.png", {"fill_gaps": True}, "v1.0/s-filled/"),
        ("v1.0/%04d.png", {}, "{}/v1.0-2x/"),
        ("v1.0/..", {}, "{}-2x/"),
    ],
)
def test_an_output_without_a_name_lies_beside_its_input(monkeypatch, tmp_path, input, rate, output):
    """The rate is behind the name; an ending that cannot be written is replaced, and images get a folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "v1.0").mkdir()
    assert output_beside(input, Timing(**rate)) == output.format(tmp_path)


def test_no_name_is_needed_and_nothing_replaced(fpsboost_, tmp_path, unchanged):
    """One input makes an output beside it, named on the terminal; a second run is refused."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    assert re.fullmatch(SUMMARY.format(r"a-2x\.mp4", 3, 6), fpsboost_("a.mp4", *CHEAP).lines[0])
    with unchanged(tmp_path):
        assert_refused(fpsboost_("a.mp4", *CHEAP), 1, "a-2x.mp4 exists already")


@pytest.mark.parametrize(
    ("inputs", "folder", "sentence"),
    [
        (["x/a.mp4", "y/a.mp4"], "out", "x/a.mp4 and y/a.mp4 would both become out/a.mp4"),
        (["a.avi", "b.mp4", "A.mkv"], "out", "a.avi and A.mkv would both become out/A.mkv"),
        (["s/a_##.png", "s/b_##.png"], "out", "s/a_##.png and s/b_##.png would both become out/s/"),
        (["a.mp4", "-"], "out", "A pipe is one clip"),
        (["a.mp4", "b.mp4"], "-", "A pipe is one clip"),
        (["a.mp4", "b.mp4"], "c.mp4", "c.mp4 is not a folder, and 2 inputs need one"),
        (["a.mp4", "b.mp4"], "c.png", "c.png is not a folder"),
        (["a.mp4", "b.gif"], "c.gif", "c.gif is not a folder"),
        (["a.mp4", "b.mp4"], "out/c_##.png", "out/c_##.png is not a folder"),
        (["a.mp4", "b.mp4"], __file__, "test_batch.py is not a folder"),
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
    done = (("1/3 out/a.mp4", 3, 6), ("2/3 out/b.mkv", 4, 8), ("3/3 out/renders/", 3, 5))
    for line, counts in zip(result.lines, done, strict=False):
        assert re.fullmatch(SUMMARY.format(*counts), line)
    files = [re.search(r"\(counted from 0(.*), [0-9:.]+ after the first\)$", line)[1] for line in result.lines[:3]]
    assert files == ["", "", ", shot_0004.png"]
    assert result.lines[3].startswith("Note: 3 frames give 5 images")
    assert result.lines[4:] == ["All 3 inputs were converted."]
    assert len(packets_of(tmp_path / "out" / "a.mp4", "video")) == 6
    assert len(pictures_of(tmp_path / "out" / "b.mkv")) == 8
    assert sorted(path.name for path in (tmp_path / "out" / "renders").iterdir()) == [
        f"shot_{number:04d}.png" for number in range(1, 6)
    ]


@pytest.mark.usefixtures("two_clips")
def test_one_bad_file_does_not_stop_the_rest(fpsboost_, tmp_path):
    """Its sentence, the others' lines, how many failed and which, exit code 1."""
    (tmp_path / "bad.mp4").write_bytes(b"nonsense")
    result = fpsboost_("a.mp4", "bad.mp4", "none.mp4", "b.mp4", "out", *CHEAP)
    assert (result.code, result.out) == (1, "")
    begins = [line.split(":")[0] for line in result.lines]
    assert begins == ["1/4 out/a.mp4", "fpsboost", "fpsboost", "4/4 out/b.mp4", "fpsboost"]
    assert result.lines[-1] == "fpsboost: 2 of 4 inputs failed: bad.mp4, none.mp4."
    assert sorted(os.listdir(tmp_path / "out")) == ["a.mp4", "b.mp4"]


@pytest.mark.usefixtures("two_clips")
def test_a_batch_that_is_started_again_does_the_rest(fpsboost_, tmp_path):
    """With --resume, what is complete counts as converted."""
    assert fpsboost_("a.mp4", "none.mp4", "out/", *CHEAP).code == 1
    before = (tmp_path / "out" / "a.mp4").stat()
    result = fpsboost_("a.mp4", "b.mp4", "out/", "--resume", *CHEAP)
    assert result.code == 0, result.err
    assert "out/a.mp4 exists already" in result.lines[0]
    assert (tmp_path / "out" / "a.mp4").stat() == before
    assert (tmp_path / "out" / "b.mp4").exists()


@pytest.mark.usefixtures("two_clips")
def test_inputs_are_never_replaced(fpsboost_, tmp_path, unchanged):
    """The folder of the inputs as the target: nothing happens to them, even with --overwrite."""
    with unchanged(tmp_path):
        result = fpsboost_("a.mp4", "b.mp4", ".", "--overwrite", *CHEAP)
        assert (result.code, result.lines[-1][:30]) == (1, "fpsboost: 2 of 2 inputs failed")


@pytest.mark.usefixtures("two_clips")
def test_quiet_says_only_what_fails(fpsboost_):
    """Nothing at all when all goes well, else the sentences and the count."""
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
    """Clashes, vectors of one clip, vectors of what a mask divides, and a folder in no folder."""
    write_clip(tmp_path / "a.mp4", times=range(3))
    assert_refused(fpsboost_("a.mp4", "x/a.mp4", "out"), 2, "would both become")
    (tmp_path / "vectors").mkdir()
    (tmp_path / "vectors" / "v_0001.exr").touch()
    arguments = ("--vectors", "vectors", "--method", "reproject-scene", "--mask", "a.mp4", "--mask-as", "layer")
    assert_refused(fpsboost_("a.mp4", "b.mp4", "out", *arguments[:4]), 2, "--vectors")
    assert_refused(fpsboost_("a.mp4", "b.mkv", *arguments), 2, "--vectors and --mask-as layer cannot be combined")
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


@pytest.mark.usefixtures("two_clips")
def test_a_bar_says_which_of_how_many(fpsboost_, monkeypatch):
    """On a terminal the bar carries the place in the row."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    result = fpsboost_("a.mp4", "b.mp4", "out", *CHEAP)
    plain = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", result.err)
    assert re.search(r"2/2 out/b\.mp4 .*[0-9]+/6", plain)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_a_signal_stops_all(tmp_path):
    """SIGTERM to a real process in its second input, which has frames for minutes."""
    write_clip(tmp_path / "a.mp4", times=range(2))
    write_clip(tmp_path / "b.mp4", times=range(0, 200000, 1000))
    command = [sys.executable, "-m", "fpsboost", "a.mp4", "b.mp4", "out", "--fps", "1000", "--verbose", *CHEAP]
    with subprocess.Popen(command, cwd=tmp_path, env=environment(), stderr=subprocess.PIPE) as process:
        assert any(line.startswith(b"b.mp4: 64x48") for line in process.stderr)  # the lines until it is open
        process.send_signal(signal.SIGTERM)
        rest = process.stderr.read().decode()
    assert process.returncode == 130
    assert "Stopped; 1 of 2 inputs were converted." in rest
    assert os.listdir(tmp_path / "out") == ["a.mp4"]


@pytest.mark.parametrize("is_there", [False, True])
def test_a_run_that_is_stopped_while_it_locks_its_folder(tmp_path, monkeypatch, is_there):
    """Nothing stays of the hidden folder, unless it is that of another run."""
    mine, other = (staging.StagingDirectory(tmp_path / ".out.unfinished", "output", "out", None) for _ in range(2))
    if is_there:
        other.open()

    def stop(*arguments, **options):
        monkeypatch.undo()
        Path.open(*arguments, **options).close()
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "open", stop)
    with pytest.raises(KeyboardInterrupt):
        mine.open()
    assert mine.folder.is_dir() == is_there
    if is_there:
        other.close(keep=False)


def save_pan(*paths):
    """A texture that moves by two pixels from image to image."""
    texture = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), np.roll(texture, 2 * number, axis=1))


@pytest.mark.parametrize("names", [("b.png", "a.png"), ("take, 1.png", "a.png"), ("x/a.tif", "y/a.tif")])
def test_two_pictures_are_a_clip(tmp_path, names):
    """In the order in which they are named, whatever their names are."""
    save_pan(*(tmp_path / name for name in names))
    execute([*(str(tmp_path / name) for name in names), f"{tmp_path}/out/", "--factor", "4", "-m", "blend"])
    made = sorted((tmp_path / "out").iterdir())
    assert len(made) == 5
    for ours, name in ((made[0], names[0]), (made[-1], names[1])):
        np.testing.assert_array_equal(cv2.imread(str(ours)), cv2.imread(str(tmp_path / name)))


def test_two_animations_are_two_inputs(tmp_path):
    """As are a picture and a video; three pictures are no clip, and a single one is told how to be one."""
    save_pan(*(tmp_path / f"{name}.png" for name in "abc"))
    (tmp_path / "v.mp4").touch()
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    for name in "de":
        frames[0].save(tmp_path / f"{name}.png", save_all=True, append_images=frames[1:])
    for names in (["d.png", "e.png"], ["a.png", "v.mp4"], ["a.png", "b.png", "c.png"], ["a.png"]):
        assert not is_pair([str(tmp_path / name) for name in names])
    assert is_pair([str(tmp_path / name) for name in ("a.png", "b.png")])
    with pytest.raises(InputError, match=r"give two and a folder \(a.png b.png out/\)"):
        open_source(str(tmp_path / "a.png"))


def test_the_order_of_images_without_numbers_is_said(tmp_path):
    """They go by the alphabet; those with numbers, and a pair that was named, need no word."""
    save_pan(tmp_path / "two" / "before.png", tmp_path / "two" / "after.png", tmp_path / "n" / "1.png")
    said = [f"The images of {tmp_path}/two have no numbers and were taken by the alphabet: after.png is the first one."]
    pair = f"{tmp_path}/two/before.png,{tmp_path}/two/after.png"
    for path, remarks in {f"{tmp_path}/two": said, pair: [], f"{tmp_path}/n": []}.items():
        with open_source(path) as source:
            assert source.remarks == remarks


def test_a_folder_of_videos_is_answered_with_their_names(tmp_path):
    """A shell makes them of a star."""
    (tmp_path / "vids").mkdir()
    write_clip(tmp_path / "vids" / "a.mp4", times=range(3))
    with pytest.raises(InputError, match=re.escape(f"is a folder of videos; name these: fpsboost {tmp_path}/vids/* F")):
        execute([f"{tmp_path}/vids/", f"{tmp_path}/out/"])
