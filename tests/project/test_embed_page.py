"""The page for authors of other programs: its code and its commands do what it says."""

import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from support.command_line import environment
from support.video_truth import pictures_of, write_clip

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "embed.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page():
    """Names that the code of the page defines."""
    names = {}
    exec("".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)), names)
    return names


@pytest.fixture(autouse=True)
def clip(tmp_path, monkeypatch):
    """A clip of ten frames at 25 per second, in the folder where the code is run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", environment()["PYTHONPATH"])
    write_clip(tmp_path / "in.mp4")


@pytest.mark.slow
def test_a_child_process_tells_its_progress_and_what_is_wrong(page):
    """Frame by frame; the result is that of the last object, and a refusal is the sentence and no traceback."""
    shown = []
    done = page["convert"]("in.mp4", "out.mp4", "--method", "blend", show=lambda *counts: shown.append(counts))
    assert shown == [(count, 20) for count in range(1, 21)]
    assert (done["output"], done["frames_in"], done["remarks"]) == ("out.mp4", 10, [])
    for arguments, said in {
        ("none.mp4", "o.mp4"): "does not exist",
        ("in.mp4", "o.mp4", "--crf", "x"): "--crf",
    }.items():
        with pytest.raises(RuntimeError, match=f"^fpsboost: .*{said}"):
            page["convert"](*arguments)


def exit_code(*arguments):
    """Return the code of a command that runs by itself."""
    return subprocess.run([sys.executable, "-m", "fpsboost", *arguments], capture_output=True, check=False).returncode


@pytest.mark.slow
def test_exit_codes_are_those_of_the_page(fpsboost_):
    """0 to 3 by their causes; 130 of a run that is stopped, which leaves no output."""
    found = {
        0: fpsboost_("in.mp4", "out.mp4", "--method", "blend").code,
        1: fpsboost_("none.mp4", "out2.mp4").code,
        2: fpsboost_("in.mp4", "out2.mp4", "--fps", "60", "--factor", "2").code,
        3: fpsboost_("compare", "in.mp4", "-m", "blend", "--fail-under", "90").code,
    }
    command = [sys.executable, "-m", "fpsboost", "in.mp4", "out2.mp4", "--factor", "1000", "--progress", "json"]
    if sys.platform != "win32":
        with subprocess.Popen(command, stderr=subprocess.PIPE, encoding="utf-8") as run:
            for line in run.stderr:
                if "converting" in line:
                    run.send_signal(signal.SIGTERM)
                    break
            run.stderr.read()
        found[130] = run.returncode
    assert all(code == expected for expected, code in found.items()), found
    assert not Path("out2.mp4").exists()
    assert set(map(int, re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE))) >= found.keys()


def test_probe_tells_programs_what_is_refused(fpsboost_):
    """The key that the page names is null where a clip can be converted."""
    assert json.loads(fpsboost_("probe", "in.mp4", "--json").out)["conversion"]["refused"] is None


@pytest.mark.slow
def test_a_pipe_between_two_programs(page):
    """The command of the page makes a clip of the higher rate, where FFmpeg is."""
    if shutil.which("ffmpeg") is None or shutil.which("fpsboost") is None:
        pytest.skip("ffmpeg and fpsboost are not both on the PATH")
    (command,) = re.findall(r"```sh\n(ffmpeg .*?)```", PAGE, re.DOTALL)
    subprocess.run(["bash", "-o", "pipefail", "-c", command], check=True)
    assert len(pictures_of("out.mp4")) == 24


def test_arrays_between_decoder_and_encoder(page):
    """50 frames a second of 25."""
    page["smoother"]("in.mp4", "out.mp4", 50, method="blend")
    assert len(pictures_of("out.mp4")) == 20


def test_a_frame_at_a_time(page):
    """Halfway between two frames, a texture has moved by half of its way."""
    texture = np.repeat(np.repeat(np.random.default_rng(1).integers(40, 200, (12, 16, 3), dtype=np.uint8), 8, 0), 8, 1)
    made = page["shown"](texture, np.roll(texture, 8, axis=1), 0.5)
    assert np.abs(made.astype(int) - np.roll(texture, 4, axis=1))[16:-16, 24:-24].mean() < 3


def test_the_container_is_made_of_what_is_there_and_has_no_rights():
    """It copies files of a clone, with all that the metadata names, and ends as another user than root."""
    steps = [line.split() for line in (ROOT / "release" / "Containerfile").read_text("utf-8").splitlines() if line]
    copied = [name for word, *names in steps if word == "COPY" and "--from" not in names[0] for name in names[:-1]]
    assert {"pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "fpsboost"} == set(copied)
    assert all((ROOT / name).exists() for name in copied)
    (user,) = (names[0] for word, *names in steps if word == "USER")
    assert int(user) > 0
    assert steps[-1] == ["ENTRYPOINT", '["fpsboost"]']
