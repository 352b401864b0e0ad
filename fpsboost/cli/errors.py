"""Unexpected errors of a command, as sentences of the library's own kind."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from textwrap import shorten

from cyclopts import CycloptsError

from fpsboost.errors import FpsboostError, ReaderGoneError
from fpsboost.media import UnfinishedOutput

PIPE = "pipe:"
"""Replacement for an argument that is a lone dash, which the parser would take for an option without a name."""

STANDARD_OUTPUT = "Standard output or a temporary file"  # what an error of the system is about that names no file

MAX_REASON = 200
"""Maximum number of characters of the text of an unexpected error."""


@contextmanager
def all_explained(names: Sequence[str], output: str | None = None) -> Iterator[None]:
    """Convert unexpected exceptions in a block to `FpsboostError` with one sentence.

    Errors of the system and of memory are explained. After any other exception, a fault of fpsboost, the unfinished
    output is removed, since the same job would fail again.

    Parameters
    ----------
    names : sequence of str
        Arguments of the command; the first that is an existing file is named in the sentence.
    output : str, optional
        Output whose unfinished part is removed after a fault; without it, nothing is.
    """
    try:
        yield
    except (FpsboostError, CycloptsError):
        raise
    except ImportError as error:  # the kernels' own error already gives advice
        others = f"{error.name} cannot be imported ({error}); run fpsboost doctor to see which packages are missing."
        raise FpsboostError(others if error.name else str(error)) from error
    except (OSError, MemoryError) as error:
        raise FpsboostError(explain(error, STANDARD_OUTPUT if output is None else names[0])) from error
    except Exception as error:
        name = next((each for each in names if os.path.exists(each)), next(iter(names), "The command"))
        name = "Standard input" if name == PIPE else name
        if output is not None:
            UnfinishedOutput(output).discard()
        raise FpsboostError(
            f"{name} could not be processed because of a fault in fpsboost ({reason_of(error)}); give --verbose for "
            "details, and report it."
        ) from error


@contextmanager
def standard_output_finished() -> Iterator[None]:
    """Flush standard output at the end of a block, as Python would do it later, with its own exit code."""
    try:
        yield
        if sys.stdout is not None:  # closed
            sys.stdout.flush()
    except OSError as error:
        # errors of other files have no name either, but those are explained
        if error.filename is None and sys.stdout is not None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what Python still flushes
        if isinstance(error, BrokenPipeError):
            raise ReaderGoneError from None
        raise


def explain(error: BaseException, name: str = STANDARD_OUTPUT) -> str:
    """Return the sentence of an error of the library, or one about an error of the system or of memory.

    `name` is what an error of the system is about if it names no file itself. Any other error is a fault.
    """
    if isinstance(error, FpsboostError):
        return str(error)
    if isinstance(error, MemoryError):
        return "There is not enough memory for this; scale it down, or close other programs."
    if isinstance(error, OSError):
        return f"{error.filename or name} cannot be used ({error.strerror or error}); check the place."
    return f"This is a fault in fpsboost ({reason_of(error)}); report it."


def reason_of(error: BaseException) -> str:
    """Return kind and text of an unexpected error, shortened."""
    return shorten(f"{type(error).__name__}: {error}", MAX_REASON)
