"""Texts that libraries such as libpng and OpenCV write to the standard error of the process.

They come from C, and without the name of the file, so they are captured, and printed at the end of the run. Python's
own output to standard error still appears at once.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from typing import IO, TextIO

STANDARD_ERROR = 2  # file descriptor
MAX_SHOWN = 3
"""Maximum number of lines of libraries that are printed."""

_prefix_of_opencv = re.compile(r"^\[ *\w+:\d+@[\d.]+\] (global )?")
"""Log level, thread and time before a line of OpenCV: ``[ WARN:0@0.035] global ``."""


@contextmanager
def native_stderr_captured() -> Iterator[None]:
    """Redirect Python's prints of libraries, such as OpenEXR's, to standard error within a block.

    Standard output may carry a video.
    """
    try:
        texts = os.fdopen(STANDARD_ERROR, "w", buffering=1, errors="backslashreplace", closefd=False)
    except OSError:  # there is no standard error
        yield
        return
    with texts, redirect_stdout(texts):
        yield


@dataclass
class LibraryTexts:
    """What libraries have written to standard error from C."""

    file: IO[bytes]

    def lines(self) -> list[str]:
        """Return each distinct line captured so far, without OpenCV's timestamp and source location."""
        self.file.seek(0)
        lines = self.file.read().decode(errors="replace").splitlines()
        return list(dict.fromkeys(_prefix_of_opencv.sub("", line).strip() for line in lines if line.strip()))

    def sentence(self) -> str:
        """Return the first captured lines as one sentence; empty if there are none."""
        lines = self.lines()
        more = f"; and {len(lines) - MAX_SHOWN} more" if len(lines) > MAX_SHOWN else ""
        return f"A library reports: {'; '.join(lines[:MAX_SHOWN])}{more}." if lines else ""


@contextmanager
def library_texts() -> Iterator[LibraryTexts]:
    """Capture what libraries write to standard error from C, by redirecting the file descriptor within a block.

    Python's `sys.stderr` is pointed at the original descriptor meanwhile, so that messages still appear. Without a
    standard error, nothing is captured.
    """
    try:
        terminal = os.dup(STANDARD_ERROR)
    except OSError:  # there is no standard error
        yield LibraryTexts(BytesIO())
        return
    before = sys.stderr
    if _is_standard_error(before):
        before.flush()
        messages = os.fdopen(os.dup(terminal), "wb")
        sys.stderr = _Messages(messages, before.encoding, before.errors, line_buffering=True)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), STANDARD_ERROR)
        try:
            yield LibraryTexts(file)
        finally:
            os.dup2(terminal, STANDARD_ERROR)
            os.close(terminal)
            if sys.stderr is not before:
                with suppress(OSError):  # its reader has closed it
                    sys.stderr.close()
                sys.stderr = before


class _Messages(TextIOWrapper):
    """Text stream that ignores errors of standard error, as a lost message is no failure of a conversion."""

    def write(self, text: str) -> int:
        """Write a text, or drop it if the stream takes none; return its length."""
        with suppress(OSError):
            super().write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream, ignoring errors."""
        with suppress(OSError):
            super().flush()


def _is_standard_error(stream: TextIO | None) -> bool:
    """Return whether a stream writes to the descriptor of standard error."""
    if stream is None:
        return False
    try:
        return stream.fileno() == STANDARD_ERROR
    except (OSError, ValueError):  # closed, or not a file of the system
        return False
