"""Messages of the command line, with control characters of foreign texts escaped."""

from __future__ import annotations

import sys
import traceback
import unicodedata
from collections.abc import Collection

from rich.console import Console
from rich.markup import escape

from fpsboost.cli.options import in_flags
from fpsboost.errors import notes_of

CONTROL_CATEGORIES = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that move the cursor, colour the screen, or cannot be encoded."""

BIDI_CONTROLS = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that change the writing direction, so that one name reads like another."""


def console(*, quiet: bool = False) -> Console:
    """Return a console on standard error that prints each message on one line."""
    return Console(stderr=True, highlight=False, soft_wrap=True, quiet=quiet)


def shown(text: str) -> str:
    r"""Return a text escaped so that Rich prints it literally; file names and titles may contain terminal controls.

    Examples
    --------
    >>> print(shown("\x1b[31m.mp4"), shown("a\nb"))
    \x1b[31m.mp4 a\nb
    """
    return escape(_escape_controls(text))


def sentence(text: str) -> str:
    """Return a sentence of the library with flags for the options that it names, escaped like `shown`."""
    return shown(in_flags(text))


def say_error(errors: Console, error: BaseException) -> None:
    """Print an error and its notes on one line."""
    sentences = " ".join(filter(None, (str(error), notes_of(error))))
    errors.print(f"[red]fpsboost:[/] {sentence(sentences)}")


def say_traceback() -> None:
    """Print the traceback of the exception that is being handled."""
    sys.stderr.write(_escape_controls(traceback.format_exc(), kept="\n"))


def _escape_controls(text: str, kept: Collection[str] = ()) -> str:
    """Return the text with Python escapes for control characters."""
    return "".join(ascii(letter)[1:-1] if letter not in kept and _is_control(letter) else letter for letter in text)


def _is_control(letter: str) -> bool:
    return letter in BIDI_CONTROLS or unicodedata.category(letter) in CONTROL_CATEGORIES
