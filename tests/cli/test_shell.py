"""What a shell and its user need of the command line: completion, what to look at next, and whether all works here."""

import json
import os
import platform
import pty
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import redirect_stdout, suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from fpsboost.cli import app, doctor
from fpsboost.cli.doctor import Finding, diagnose
from fpsboost.cli.options import METHODS
from fpsboost.method_table import methods, vector_methods
from fpsboost.parts.manifest import self_test
from support.command_line import environment
from support.video_truth import write_clip

SHELLS = ("bash", "zsh", "fish")


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the script of each shell, named after it."""
    folder = tmp_path_factory.mktemp("completion")
    for shell in SHELLS:
        with (folder / shell).open("w", encoding="utf-8") as script, redirect_stdout(script):
            app.app(["completion", shell], result_action="return_value")
    return folder


def in_shell(shell: str, code: str, folder: Path) -> str:
    """Return what a shell prints, which reads no files of its user."""
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    plain = {"bash": ["--norc", "--noprofile"], "zsh": ["-f"], "fish": ["--no-config"]}[shell]
    environment = {**os.environ, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "XDG_DATA_HOME": str(folder)}
    done = subprocess.run(
        [shell, *plain, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout


def test_methods_that_a_shell_proposes():
    """They are those that there are."""
    assert sorted(METHODS) == sorted([*methods, *vector_methods])


@pytest.mark.parametrize(
    ("words", "proposed"),
    [
        (["--fac"], {"--factor"}),
        (["--method", "nlm-e"], {"nlm-exhaustive"}),
        (["-m", "tvl1-"], {"tvl1-warp"}),
        (["compare", "-m", "min"], {"minterpolate"}),
        (["--at-cuts", ""], {"repeat", "blend", "extrapolate"}),
        (["doc"], {"doctor"}),
        (["completion", ""], set(SHELLS)),
    ],
)
def test_bash_completes(scripts, words, proposed):
    """Commands, options and values, by the function that bash calls at TAB."""
    line = " ".join(f"'{word}'" for word in ["fpsboost", *words])
    code = (
        f"source ./bash; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _fpsboost; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    assert set(in_shell("bash", code, scripts).split()) == proposed


def test_bash_completes_files_itself(scripts):
    """Where the script proposes nothing, so that names with spaces stay whole."""
    code = "source ./bash; COMP_WORDS=(fpsboost b); COMP_CWORD=1; _fpsboost; echo ${#COMPREPLY[@]}; complete -p"
    count, registered = in_shell("bash", code, scripts).splitlines()
    assert count == "0"
    assert "-o default" in registered


def test_fish_completes(scripts):
    """Options, values, commands and files, by fish's own command for it."""
    code = "source ./fish; for line in '--fac' '-m tvl1-' 'doc' './zs'; complete -C \"fpsboost $line\"; end"
    proposed = [line.split("\t")[0] for line in in_shell("fish", code, scripts).splitlines()]
    assert proposed == ["--factor", "tvl1-warp", "doctor", "./zsh"]


@pytest.mark.parametrize("how", ["mkdir -p f; cp zsh f/_fpsboost; fpath=($PWD/f $fpath)", ""])
def test_zsh_completes(scripts, how):
    """At TAB on a terminal; from a file of $fpath, and where the script is sourced."""
    zsh = shutil.which("zsh")
    if zsh is None:
        pytest.skip("zsh is not installed")
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(scripts)
        os.execv(zsh, ["zsh", "-f"])
    try:
        source = "" if how else "source ./zsh;"
        begin = f"PS1=; {how}; autoload -U compinit; compinit -D -u; {source} print rea''dy\n"
        for typed, shown in ((begin, "ready"), ("fpsboost --fac\t", "--factor"), ("x\x15fpsboost doc\t", "doctor")):
            os.write(terminal, typed.encode())
            said = ""
            while shown not in re.sub(r"[\x07\x08\r]|\x1b\[[0-9;?]*\w", "", said):
                said += os.read(terminal, 4096).decode()
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(terminal)


def lines_on_terminal(folder: Path, *arguments: str) -> list[str]:
    """Return what a command prints on a terminal of 200 columns that cannot move its cursor."""
    terminal, end = pty.openpty()
    variables = {**environment(), "TERM": "dumb", "COLUMNS": "200"}
    command = [sys.executable, "-m", "fpsboost", *arguments]
    with subprocess.Popen(command, cwd=folder, env=variables, stdout=end, stderr=end) as run:
        os.close(end)
        said = b""
        with suppress(OSError):  # Linux: once the command has ended
            while part := os.read(terminal, 4096):
                said += part
    os.close(terminal)
    assert run.returncode == 0, said
    return said.decode().splitlines()


NEXT = "Before and after, on a page: "


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["it's a clip.mp4", "--method", "blend"],
        ["it's a clip.mp4", "out.mp4", "--method=blend", "--fps", "60", "--end", "8f"],
        ["images", "frames/", "--method", "blend", "--input-fps", "12"],
    ],
)
def test_a_conversion_ends_on_a_terminal_with_what_to_look_at_next(fpsboost_, tmp_path, save_images, words):
    """A single last line, with a command that a shell takes as it is: it makes a page of the same conversion."""
    write_clip(tmp_path / "it's a clip.mp4")
    save_images(tmp_path / "images", count=6)
    lines = lines_on_terminal(tmp_path, *words)
    assert [line.startswith(NEXT) for line in lines] == [False] * (len(lines) - 1) + [True]
    program, *command = shlex.split(lines[-1].removeprefix(NEXT))
    assert (program, command[:2], command[-2:]) == ("fpsboost", ["preview", words[0]], ["-m", "blend"])
    assert set(command) >= {word for word in words[1:] if word in ("--fps", "60", "--end", "8f", "--input-fps", "12")}
    assert fpsboost_(*command, "--quiet").code == 0
    assert len([*tmp_path.glob("*-preview.html")]) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        "out.mp4 --quiet",
        "out.mp4 --progress json",
        "out.mp4 --dry-run",
        "out.mp4 --chunk 1/1",
        "out.mp4 --duplicates drop",
        "again.mp4 out/",
    ],
)
def test_it_is_not_said_where_nobody_asks_for_it(tmp_path, options):
    """Not to programs, of no part, trial or several clips, and not where a preview would be refused."""
    for name in ("in.mp4", "again.mp4"):
        write_clip(tmp_path / name)
    assert NEXT not in "\n".join(lines_on_terminal(tmp_path, "in.mp4", *options.split(), "--method", "blend"))


def test_it_is_not_said_in_a_pipe(fpsboost_, tmp_path, monkeypatch):
    """Even where colours are forced upon it."""
    write_clip(tmp_path / "in.mp4")
    monkeypatch.setenv("FORCE_COLOR", "1")
    result = fpsboost_("in.mp4", "--method", "blend")
    assert (result.code, NEXT in result.out + result.err) == (0, False)


def test_everything_works_here():
    """All parts are looked at, and the self-test makes right frames."""
    findings = list(diagnose())
    assert [each for each in findings if each.advice] == []
    assert [part for part in dict.fromkeys(each.part for each in findings)] == [
        *("programs", "kernels", "codecs", "machine", "self-test"),
    ]


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the known bits are those of x86-64")
@pytest.mark.parametrize("method", doctor.known_digests)
def test_the_known_bits(method):
    """They are those of this version; where a method makes other frames on purpose, they are to be replaced."""
    assert self_test(methods[method], np.zeros((4, 6, 3), np.uint8)).startswith(doctor.known_digests[method])


def test_a_missing_library_is_found(monkeypatch):
    """It ends the search, with what to install; nothing is raised."""
    monkeypatch.setitem(sys.modules, "av", None)
    last = list(diagnose())[-1]
    assert (last.part, last.name) == ("programs", "PyAV")
    assert last.advice == "PyAV cannot be imported; reinstall av with pip."


def test_an_error_is_a_finding(monkeypatch):
    """Whatever a part raises is shown with what to do, and the other parts are looked at."""

    def broken():
        raise RuntimeError("no locator\navailable")
        yield

    monkeypatch.setattr(doctor, "_looks", {**doctor._looks, "machine": (broken, "Do this.")})
    monkeypatch.setattr(doctor, "MAX_ERROR", -1.0)  # so that frames are wrong, too
    advised = [each for each in diagnose() if each.advice]
    assert advised[0] == Finding("machine", "error", "RuntimeError: no locator", "Do this.")
    assert [each.name for each in advised[1:]] == ["nlm", "nlm-fast"]


def test_doctor_prints_and_exits(monkeypatch, fpsboost_):
    """A table, and 0 where everything works; else 1 and a sentence; the same as JSON. A line for issues is whole."""
    good, bad = Finding("codecs", "FFmpeg", "8"), Finding("kernels", "level", "none", "Do this.")
    monkeypatch.setattr(doctor, "diagnose", lambda: iter([good]))
    works = fpsboost_("doctor")
    assert (works.code, "Everything works." in works.out) == (0, True)
    assert works.out.splitlines()[-1] == "For an issue: FFmpeg 8"
    monkeypatch.setattr(doctor, "diagnose", lambda: iter([good, bad]))
    table, data = fpsboost_("doctor"), fpsboost_("doctor", "--json")
    assert (table.code, "fails" in table.out, table.err) == (1, True, "fpsboost: Do this.\n")
    assert table.out.splitlines()[-1] == "For an issue: FFmpeg 8; level none"
    assert (data.code, json.loads(data.out)) == (1, {"works": False, "findings": [asdict(good), asdict(bad)]})


def test_the_line_for_issues_names_what_matters(fpsboost_, monkeypatch):
    """Versions, system and level of the processor, on one line in a narrow terminal too; no names of files or users."""
    monkeypatch.setenv("COLUMNS", "40")
    line = fpsboost_("doctor").out.splitlines()[-1]
    names = ["fpsboost", "Python", "NumPy", "OpenCV", "PyAV", "processor level", "FFmpeg"]
    assert re.fullmatch("For an issue: " + "; ".join(rf"{name} \S[^;]+" for name in names), line)
    assert platform.machine() in line
