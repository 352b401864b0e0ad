"""Exceptions of fpsboost, as one hierarchy.

Every message is one sentence that names the file or the option, and how to correct it. The library raises;
only the command line prints and chooses an exit code (2 for `OptionError`, 1 for the others).
"""

import math

from fpsboost.media.errors import (
    CompleteAlreadyError,
    EncryptedError,
    ExistsError,
    FpsboostError,
    InputError,
    InUseError,
    OptionError,
    OutputError,
    choose_one,
    explained,
    undone_by,
)

__all__ = [
    "CancelledError",
    "CompleteAlreadyError",
    "EncryptedError",
    "ExistsError",
    "FpsboostError",
    "InUseError",
    "InputError",
    "OptionError",
    "OutputError",
    "ReaderGoneError",
    "SceneCutWarning",
    "choose_one",
    "explained",
    "format_duration",
    "notes_of",
    "rounded",
    "undone_by",
]


class SceneCutWarning(UserWarning):
    """Warning of a scene cut between two images to be interpolated: the result does not show what lies between them.

    Issued only if a cut policy is given; ``warnings.simplefilter("error", SceneCutWarning)`` makes it an exception.
    """


class ReaderGoneError(OutputError):
    """Error for a pipe that the reading program has closed; needs no message."""


class CancelledError(FpsboostError):
    """Error for a conversion that was ended by `cancel`."""


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
