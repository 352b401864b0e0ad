"""Exceptions of fpsboost, as one hierarchy.

Every message is one sentence that names the file or the option and says what to do. The library raises;
only the command line prints and chooses an exit code (2 for `OptionError`, 1 for the others).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path


class FpsboostError(Exception):
    """Base class of the exceptions that fpsboost raises on purpose."""


class OptionError(FpsboostError, ValueError):
    """Error for an invalid value of an option or argument."""


class SceneCutWarning(UserWarning):
    """Warning of a scene cut between two images to be interpolated: the result does not show what lies between them.

    Issued only if a cut policy is given; ``warnings.simplefilter("error", SceneCutWarning)`` makes it an exception.
    """


class InputError(FpsboostError):
    """Error for a source that is missing, unreadable, damaged beyond use, or too short."""


class EncryptedError(InputError):
    """Error for a source that is encrypted, so that decoding it would give noise."""


class OutputError(FpsboostError):
    """Error for a target that exists already, cannot be written, or cannot hold the streams."""


class ExistsError(OutputError):
    """Error for a target that exists already, and is not to be replaced."""


class CompleteAlreadyError(OutputError):
    """Error for a run to be resumed whose target is complete already."""


class InUseError(OutputError):
    """Error for a target that another run writes at this moment."""


class ReaderGoneError(OutputError):
    """Error for a pipe that the reading program has closed; needs no message."""


class ClusterError(FpsboostError):
    """Error for a cluster whose scheduler is out of reach, or whose workers die or are set up differently."""


def notes_of(error: BaseException) -> str:
    """Return the notes added to an exception, such as how to resume."""
    return " ".join(getattr(error, "__notes__", ()))


def rounded(number: float, digits: int) -> str:
    """Return a number with so many significant digits, and no power of ten: 0.012, 12,000."""
    return f"{float(f'{number:.{digits}g}'):,.15g}"


def format_duration(seconds: float) -> str:
    """Return a duration in seconds as text, with two significant figures.

    Examples
    --------
    >>> format_duration(0.0123), format_duration(7.25), format_duration(95.0), format_duration(5000.0)
    ('0.012 s', '7.2 s', '95 s', '1 h 23 min')
    """
    if seconds >= 3600:
        hours, minutes = divmod(round(seconds / 60), 60)
        return f"{hours} h {minutes} min"
    if seconds >= 120:
        return f"{round(seconds / 60)} min"
    if 0 < seconds < 10:
        return f"{seconds:.{max(0, 1 - math.floor(math.log10(seconds)))}f} s"
    return f"{seconds:.0f} s"


def choose_one(value: str, choices: Collection[str]) -> str:
    """Return the end of a message about a value that is none of many choices: the most similar one, or all.

    Examples
    --------
    >>> choose_one("nml", ["nlm", "nlm-fast", "blend"])
    "did you mean 'nlm'?"
    >>> choose_one("magic", ["nlm", "blend"])
    'choose one of nlm, blend.'
    """
    meant = get_close_matches(value.lower(), choices, 1)
    return f"did you mean {meant[0]!r}?" if meant else f"choose one of {', '.join(choices)}."


@contextmanager
def explained(kind: type[FpsboostError], task: str, path: str | Path, advice: str) -> Iterator[None]:
    """Turn an OSError raised in the block into a sentence: cannot `task` (such as ``read``) the path; `advice`."""
    try:
        yield
    except OSError as error:
        raise kind(f"Cannot {task} {path} ({error.strerror or error}); {advice}.") from error


STANDARD_OUTPUT = "Standard output or a temporary file"  # what an error of the system is about that names no file

MAX_REASON = 200
"""Characters of an error that nobody foresaw."""


def explain(error: OSError | MemoryError, name: str = STANDARD_OUTPUT) -> str:
    """Return a sentence about an error that the library has not explained, such as one from an unchecked path."""
    if isinstance(error, MemoryError):
        return "There is not enough memory for this; scale it down, or close other programs."
    return f"{error.filename or name} cannot be used ({error.strerror or error}); check the place."
