"""What the command line prints: where to, and how texts of others are made harmless on the way."""

from __future__ import annotations

import sys
import traceback
import unicodedata
from collections.abc import Collection

from rich.console import Console
from rich.markup import escape

from fpsboost.errors import notes_of

UNPRINTABLE = {"Cc", "Cs", "Zl", "Zp"}
"""Categories of characters that move the cursor, colour the screen, or cannot be encoded."""

TURNS_AROUND = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that change the direction of what follows, so that one name reads like another."""


def console(*, quiet: bool = False) -> Console:
    """Standard error, for messages that stay on one line each."""
    return Console(stderr=True, highlight=False, soft_wrap=True, quiet=quiet)


def shown(text: str) -> str:
    r"""A text as Rich prints it letter by letter; file names and titles may hold what a terminal would obey.

    Examples
    --------
    >>> print(shown("\x1b[31m.mp4"), shown("a\nb"))
    \x1b[31m.mp4 a\nb
    """
    return escape(_visible(text))


def say_error(errors: Console, error: BaseException) -> None:
    """One line: what went wrong, and what to know besides."""
    sentences = " ".join(filter(None, (str(error), notes_of(error))))
    errors.print(f"[red]fpsboost:[/] {shown(sentences)}")


def say_traceback() -> None:
    """The exception that is being handled, for someone who looks for a fault."""
    sys.stderr.write(_visible(traceback.format_exc(), kept="\n"))


def _visible(text: str, kept: Collection[str] = ()) -> str:
    """The text with escapes, as Python writes them, for characters that a terminal would obey."""
    return "".join(ascii(letter)[1:-1] if letter not in kept and _is_obeyed(letter) else letter for letter in text)


def _is_obeyed(letter: str) -> bool:
    return letter in TURNS_AROUND or unicodedata.category(letter) in UNPRINTABLE
