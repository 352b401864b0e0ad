"""Runs of the command line: their results, the environment of a child process, and what every refusal has."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import fpsboost

COLOUR_VARIABLES = ("FORCE_COLOR", "CLICOLOR_FORCE", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "NO_COLOR", "COLUMNS")
SUMMARY = (
    r"{}: {} -> {} frames in [0-9.]+ s \([0-9.]+ frames/s\), "
    r"least certain at frame [0-9]+ of the output \(counted from 0(?:, [^)]+)?, [0-9:.]+ after the first\)"
)


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        return self.err.splitlines()


Command = Callable[..., Result]


def environment() -> dict[str, str]:
    """This process's, in which fpsboost can be imported from anywhere and nothing forces colour."""
    kept = {name: value for name, value in os.environ.items() if name not in COLOUR_VARIABLES}
    return {**kept, "PYTHONPATH": str(Path(fpsboost.__file__).parents[1])}


def assert_refused(result: Result, code: int, *words: str) -> None:
    """One sentence on stderr that holds all of `words`, nothing on stdout."""
    assert result.out == ""
    assert result.code == code
    assert len(result.lines) == 1, result.err
    assert "Traceback" not in result.err
    assert re.fullmatch(r"fpsboost: [^\x00-\x1f]+[.?]", result.lines[0])
    for word in words:
        assert word in result.err
