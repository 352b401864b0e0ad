"""Capture of texts that libraries print themselves, such as libpng and OpenCV on a damaged file.

They write to the process's standard error from C, without the name of the file; the texts are printed at the end of the
run. What Python writes to standard error still goes there.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from contextlib import suppress
from types import TracebackType
from typing import IO, Self, TextIO

STANDARD_ERROR = 2
MAX_SHOWN = 3

_prefix_of_opencv = re.compile(r"^\[ *\w+:\d+@[\d.]+\] (global )?")


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
            sys.stderr = open(
                os.dup(self._terminal),
                "w",
                buffering=1,
                encoding=self._before.encoding,
                errors=self._before.errors,
            )
        os.dup2(self._texts.fileno(), STANDARD_ERROR)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
        text = self._texts.read().decode(errors="replace")
        return list(
            dict.fromkeys(_prefix_of_opencv.sub("", line).strip() for line in text.splitlines() if line.strip())
        )

    def sentence(self) -> str:
        """Return the first lines as one sentence; empty if there are none."""
        lines = self.lines()
        more = f"; and {len(lines) - MAX_SHOWN} more" if len(lines) > MAX_SHOWN else ""
        return f"A library that reads files says: {'; '.join(lines[:MAX_SHOWN])}{more}." if lines else ""


def _is_standard_error(stream: TextIO | None) -> bool:
    if stream is None:
        return False
    try:
        return stream.fileno() == STANDARD_ERROR
    except (OSError, ValueError):  # closed, or not a file of the system
        return False
