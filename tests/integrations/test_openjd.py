"""The Open Job Description template: it is valid, runs the right commands, and makes what one run makes."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest

from support.video_truth import bytes_of, packets_of, pictures_of, write_clip

yaml = pytest.importorskip("yaml", reason="comes with openjd-cli")
pytest.importorskip("openjd.cli", reason="the extra dev has openjd-cli, which runs such templates")

ROOT = Path(__file__).parents[2]
TEMPLATE = ROOT / "integrations" / "openjd" / "fpsboost.yaml"

RECORDING = """
import json, os, sys
from pathlib import Path

Path(os.environ["RECORDED"]).open("a").write(json.dumps(sys.argv[1:]) + "\\n")
for frame in range(3):
    print(json.dumps({"frame": 100 * frame, "frames": 200, "stage": "converting"}), file=sys.stderr)
remarks = [{"kind": "damaged", "sentence": "2 frames were damaged."}]
done = {"frame": 200, "frames": 200, "stage": "done", "remarks": remarks}
print(json.dumps(done), file=sys.stderr)
print("A sentence for people.", file=sys.stderr)
sys.exit(int(os.environ.get("EXIT_CODE", "0")))
"""
"""A program that writes its arguments down, and says its progress like fpsboost."""

WAITING = """
import signal, sys

signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(130))
print("ready", file=sys.stderr, flush=True)
signal.pause()
"""
"""A program that ends at SIGTERM, like fpsboost."""


def openjd(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run openjd-cli with its output as text."""
    command = [sys.executable, "-m", "openjd", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, **environment}, check=False, encoding="utf-8"
    )


def program(folder: Path, code: str) -> Path:
    """Write Python code as an executable program."""
    path, script = folder / "program", folder / "program.py"
    script.write_text(code)
    # a first line that names Python itself would end at a space in its path
    path.write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, str(script)])} "$@"\n')
    path.chmod(0o755)
    return path


def run_job(tmp_path: Path, command: Path | str, *, step: str = "Join", **values: Any) -> Any:
    """Run a step of the template and those before it, with the environment variable RECORDED."""
    given = {"Command": command, "Python": sys.executable, **values}
    parameters = [text for name, value in given.items() for text in ("-p", f"{name}={value}")]
    recorded = str(tmp_path / "recorded")
    return openjd("run", TEMPLATE, "--step", step, "--run-dependencies", *parameters, RECORDED=recorded)


def recorded(tmp_path: Path) -> list[list[str]]:
    """Return the arguments of each run of the recording program."""
    return [json.loads(line) for line in (tmp_path / "recorded").read_text().splitlines()]


def test_the_template_is_valid():
    """By the checker of Open Job Description, without any extension of it."""
    checked = openjd("check", TEMPLATE, "--extensions", "")
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="runs a script as a program")
def test_each_part_is_a_task_and_the_last_step_joins_them(tmp_path):
    """In order, with quoted options split as in a shell, and with a name that needs quotes passed as it is."""
    source, target = tmp_path / "in film's.mov", tmp_path / "out.mp4"
    options = "--method blend --encoder-option 'key=a b'"
    done = run_job(tmp_path, program(tmp_path, RECORDING), Input=source, Output=target, Parts=3, Options=options)
    assert done.returncode == 0, done.stdout + done.stderr
    *parts, join = recorded(tmp_path)
    options = ["--method", "blend", "--encoder-option", "key=a b", "--progress", "json"]
    for number, arguments in enumerate(parts, start=1):
        assert arguments == [str(source), str(target), "--chunk", f"{number}/3", "--resume", *options]
    assert join == ["join", str(target), f"{target}.parts"]
    assert len(parts) == 3


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="runs a script as a program")
def test_progress_is_said_as_the_scheduler_reads_it(tmp_path):
    """In percent and in words; remarks, and what is no progress, go to the log as they are."""
    place = {"Input": tmp_path / "in.mov", "Output": tmp_path / "out.mp4", "Parts": 1}
    done = run_job(tmp_path, program(tmp_path, RECORDING), step="Parts", **place)
    said = [re.sub(r"^[\d:.]+\t", "", line) for line in done.stdout.splitlines()]
    for name, values in (("progress", ["0", "50", "100"]), ("status", ["converting", "done"])):
        prefix = f"openjd_{name}: "
        assert [line.removeprefix(prefix) for line in said if line.startswith(prefix)] == values
    assert {"Note: 2 frames were damaged.", "A sentence for people."} <= set(said)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="runs a script as a program")
def test_a_part_that_fails_fails_its_task(tmp_path, monkeypatch):
    """And nothing is joined."""
    monkeypatch.setenv("EXIT_CODE", "1")
    place = {"Input": tmp_path / "in.mov", "Output": tmp_path / "out.mp4", "Parts": 2}
    assert run_job(tmp_path, program(tmp_path, RECORDING), **place).returncode != 0
    assert [arguments[0] for arguments in recorded(tmp_path)] == [str(tmp_path / "in.mov")]


@pytest.mark.skipif(os.name == "nt", reason="sends SIGTERM")
def test_a_task_that_is_cancelled_stops_the_program(tmp_path):
    """The embedded script hands SIGTERM on and waits for the end, so that nothing runs on behind it."""
    (step, _) = yaml.safe_load(TEMPLATE.read_text(encoding="utf-8"))["steps"]
    (script,) = step["script"]["embeddedFiles"]
    path = tmp_path / script["filename"]
    path.write_text(script["data"])
    command = [sys.executable, path, "", program(tmp_path, WAITING)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 130


def test_a_job_makes_what_one_run_makes(tmp_path, fpsboost_):
    """The same pictures, the same packets and the same sound, with the real program, in parts of whole chunks."""
    program = shutil.which("fpsboost", path=sysconfig.get_path("scripts"))
    if program is None:
        pytest.skip("fpsboost is not installed as a program")
    source = write_clip(tmp_path / "in.mp4", times=range(130), sound="aac")
    options = ["--method", "blend", "--preset", "ultrafast"]
    assert fpsboost_(source, "whole.mp4", *options).code == 0
    place = {"Input": source, "Output": tmp_path / "out.mp4", "Options": " ".join(options)}
    done = run_job(tmp_path, program, **place, Parts=2)
    assert done.returncode == 0, done.stdout + done.stderr
    for kind in ("video", "audio"):
        assert packets_of(tmp_path / "out.mp4", kind) == packets_of(tmp_path / "whole.mp4", kind)
    made, expected = (
        [(picture.pts, bytes_of(picture)) for picture in pictures_of(tmp_path / name)]
        for name in ("out.mp4", "whole.mp4")
    )
    assert len(expected) > 240  # so that the second part begins within the clip
    assert made == expected
