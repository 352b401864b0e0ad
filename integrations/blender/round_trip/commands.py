"""Command lines of fpsboost, a running one, and what it says while it runs.

Blender's process holds neither PyAV nor OpenCV: fpsboost is a program of its own, in its own Python.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from .errors import RoundTripError
from .folders import Folders, unfinished

MAX_KEPT_LINES = 50
"""Lines of a program's messages that are kept; the last ones hold the error."""


@dataclass(frozen=True)
class Progress:
    """Progress of a command; with the last one come its remarks on what was lost or guessed, sentences."""

    frames: int
    expected_frames: int | None
    remarks: tuple[str, ...] = ()

    @property
    def fraction(self) -> float:
        """Part that is done, 0 to 1; 0 if the total is not known."""
        return min(1.0, self.frames / self.expected_frames) if self.expected_frames else 0.0

    def __str__(self) -> str:
        return f"{self.frames} of {self.expected_frames or '?'} frames"


def find_program(given: str) -> str:
    """Return the path of the program fpsboost: that from the preferences, or the one on PATH if none is given."""
    found = shutil.which(given or "fpsboost")
    if found is not None:
        return found
    if given:
        raise RoundTripError(f"{given} is not a program; correct the path of fpsboost in the add-on's preferences.")
    raise RoundTripError("fpsboost is not on PATH; install it, or give its path in the add-on's preferences.")


def convert_command(program: str, folders: Folders, factor: int, *, vectors: bool) -> list[str]:
    """Return the command that makes the frames between the rendered ones, with all their passes.

    `vectors` says whether the rendered frames have a Vector pass, which surfaces are to follow.
    """
    what = ["--factor", str(factor), "--passes", "all", "--confidence", str(folders.confidence)]
    follow = ["--vectors", str(folders.renders), "--vectors-as", "blender"] if vectors else []
    return [program, str(folders.renders), str(folders.made), *what, *follow, "--progress", "json", "-y"]


def plan_command(program: str, folders: Folders, budget: float) -> list[str]:
    """Return the command that plans which regions to render, into a new folder; see `replace_folder`.

    `budget` is the part of the pixels that may be rendered, percent.
    """
    return [program, "plan", str(folders.renders), str(unfinished(folders.plan)), "--budget", f"{budget:.6g}%"]


def merge_command(program: str, folders: Folders) -> list[str]:
    """Return the command that puts the rendered regions into the made frames, in a new folder; see `replace_folder`."""
    images = [str(each) for each in (folders.made, folders.regions, unfinished(folders.merged))]
    return [program, "merge", *images, "--plan", str(folders.plan)]


def parse_progress(line: str) -> Progress | None:
    """Return the progress that a line reports, or None for any other line.

    Examples
    --------
    >>> parse_progress('{"frame": 3, "frames": 9}')
    Progress(frames=3, expected_frames=9, remarks=())
    >>> parse_progress("Note: alpha is dropped.")
    """
    try:
        values = json.loads(line)
        expected = values.get("frames")
        remarks = tuple(each["sentence"] for each in values.get("remarks", ()))
        return Progress(int(values["frame"]), None if expected is None else int(expected), remarks)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def explain_failure(lines: Sequence[str], exit_code: int) -> str:
    """Return the program's own sentence about why it failed, from its lines that are not about progress."""
    said = [line.removeprefix("fpsboost:").strip() for line in lines if line.startswith("fpsboost:")]
    if not said:
        last = next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing.")
        return f"fpsboost ended with exit code {exit_code}: {last}"
    unknown = re.match(r"Unknown (?:option|command)[\s:\"]+([\w-]+)", said[-1])
    if unknown:
        return f"The fpsboost that was found is too old for {unknown[1]}; install a newer one."
    return said[-1]


class Run:
    """A running command.

    A thread reads its messages, so that the program never waits for a reader and Blender never for the program.
    `progress` is the last one that it reported, `lines` are its last other lines.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.progress: Progress | None = None
        self.lines: list[str] = []
        self.is_stopped = False
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env={**os.environ, "PYTHONUTF8": "1", "NO_COLOR": "1"},
                encoding="utf-8",
                errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),  # no console window on Windows
            )
        except OSError as error:
            raise RoundTripError(f"{command[0]} cannot be started ({error.strerror}); check its path.") from error
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as lines:
            for line in lines:
                progress = parse_progress(line)
                if progress is None:
                    self.lines = [*self.lines, line.rstrip("\n")][-MAX_KEPT_LINES:]
                else:
                    self.progress = progress

    @property
    def is_running(self) -> bool:
        """Whether the program still runs, or its last words are still to be read."""
        return self._process.poll() is None or self._reader.is_alive()

    @property
    def remarks(self) -> list[str]:
        """The program's remarks on what was lost or guessed, sentences: in its lines, or with its last progress."""
        notes = [line.removeprefix("Note:").strip() for line in self.lines if line.startswith("Note:")]
        return [*notes, *(self.progress.remarks if self.progress else ())]

    def stop(self) -> None:
        """Ask the program to stop; it leaves no half-written output behind."""
        self.is_stopped = True
        self._process.terminate()

    def finish(self) -> None:
        """Wait for the end of the program; raise `RoundTripError` with its own sentence if it has failed."""
        self._process.wait()
        self._reader.join()
        if self._process.returncode != 0:
            raise RoundTripError(explain_failure(self.lines, self._process.returncode))
