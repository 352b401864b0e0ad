"""Messages of the command line, with control characters of foreign texts escaped, and the texts of libraries.

Libraries such as libpng and OpenCV write to the standard error of the process from C, without the name of the file;
their texts are said at the end of the run. What Python writes to standard error still goes there.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import traceback
import unicodedata
from collections.abc import Collection, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import TextIOWrapper
from typing import IO, Self, TextIO

from rich.console import Console
from rich.markup import escape

from fpsboost.cli.options import in_flags
from fpsboost.errors import notes_of

STANDARD_ERROR = 2
WIDTHS = range(20, 2001)
"""Columns of a terminal in which text is laid out; with none, Rich shows nothing and Cyclopts never ends."""
MAX_SHOWN = 3
"""Lines of libraries that are said."""

_prefix_of_opencv = re.compile(r"^\[ *\w+:\d+@[\d.]+\] (global )?")

CONTROL_CATEGORIES = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that move the cursor, colour the screen, or cannot be encoded."""

BIDI_CONTROLS = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that change the writing direction, so that one name reads like another."""


def keep_columns_readable() -> None:
    """Have Rich lay out text in a readable width, whatever the terminal and the environment say."""
    width = Console().width
    if width not in WIDTHS:
        os.environ["COLUMNS"] = str(min(max(width, WIDTHS[0]), WIDTHS[-1]))


def console(*, quiet: bool = False) -> Console:
    """Return a console on standard error that prints each message on one line."""
    return Console(stderr=True, highlight=False, soft_wrap=True, quiet=quiet)


def literal(text: str) -> str:
    """Return a text escaped so that Rich prints it literally; file names and titles may contain terminal controls."""
    return escape(_escape_controls(text))


def sentence(text: str) -> str:
    """Return a sentence of the library with flags for the options that it names, escaped like `literal`."""
    return literal(in_flags(text))


def say_error(errors: Console, error: BaseException) -> None:
    """Print an error and its notes on one line."""
    sentences = " ".join(filter(None, (str(error), notes_of(error))))
    errors.print(f"[red]fpsboost:[/] {sentence(sentences)}")


def say_traceback() -> None:
    """Print the traceback of the exception that is being handled."""
    sys.stderr.write(_escape_controls(traceback.format_exc(), kept="\n"))


def _escape_controls(text: str, kept: Collection[str] = ()) -> str:
    """Return the text with Python escapes for control characters."""
    escaped = {letter for letter in text if unicodedata.category(letter) in CONTROL_CATEGORIES} | BIDI_CONTROLS
    return "".join(ascii(letter)[1:-1] if letter in escaped and letter not in kept else letter for letter in text)


@contextmanager
def library_prints_apart() -> Iterator[None]:
    """Have what libraries print from Python, as OpenEXR does, join what they write from C: a video may be printed."""
    try:
        descriptor = os.dup(STANDARD_ERROR)
    except OSError:  # there is no standard error
        yield
        return
    with open(descriptor, "w", buffering=1, errors="backslashreplace") as texts, redirect_stdout(texts):
        yield


class LibraryTexts:
    """Context manager that captures the texts of libraries instead of showing them on the terminal."""

    def __init__(self) -> None:
        self._texts: IO[bytes] | None = None
        self._terminal = -1
        self._before: TextIO | None = None

    def __enter__(self) -> Self:
        try:
            self._terminal = os.dup(STANDARD_ERROR)
        except OSError:  # there is no standard error
            return self
        self._texts = tempfile.TemporaryFile()
        if _is_standard_error(sys.stderr):
            self._before = sys.stderr
            self._before.flush()
            file = os.fdopen(os.dup(self._terminal), "wb")
            sys.stderr = _Messages(file, self._before.encoding, self._before.errors, line_buffering=True)
        os.dup2(self._texts.fileno(), STANDARD_ERROR)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._texts is None:
            return
        os.dup2(self._terminal, STANDARD_ERROR)
        os.close(self._terminal)
        if self._before is not None:
            with suppress(OSError):  # its reader has closed it
                sys.stderr.close()
            sys.stderr = self._before
        self._texts.close()
        self._texts = None

    def lines(self) -> list[str]:
        """Return each distinct line so far, without OpenCV's timestamp and source location."""
        if self._texts is None:
            return []
        self._texts.seek(0)
        lines = self._texts.read().decode(errors="replace").splitlines()
        return list(dict.fromkeys(_prefix_of_opencv.sub("", line).strip() for line in lines if line.strip()))

    def sentence(self) -> str:
        """Return the first lines as one sentence; empty if there are none."""
        lines = self.lines()
        more = f"; and {len(lines) - MAX_SHOWN} more" if len(lines) > MAX_SHOWN else ""
        return f"A library that reads files says: {'; '.join(lines[:MAX_SHOWN])}{more}." if lines else ""


class _Messages(TextIOWrapper):
    """Standard error, of which a message is lost if it takes none: that is no failure of what was done."""

    def write(self, text: str) -> int:
        with suppress(OSError):
            super().write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


def _is_standard_error(stream: TextIO | None) -> bool:
    if stream is None:
        return False
    try:
        return stream.fileno() == STANDARD_ERROR
    except (OSError, ValueError):  # closed, or not a file of the system
        return False
