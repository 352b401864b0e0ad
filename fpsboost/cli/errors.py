"""Unexpected errors of a command, as sentences of the library's own kind."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from cyclopts import CycloptsError

from fpsboost.errors import STANDARD_OUTPUT, FpsboostError, ReaderGoneError, explain, reason_of
from fpsboost.media import UnfinishedOutput

PIPE = "pipe:"
"""Replacement for an argument that is a lone dash, which the parser would take for an option without a name."""


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
