"""What can go wrong, as one tree.

::

    FpsboostError
    ├── OptionError     a value that can never work: factor 0, an unknown method
    ├── InputError      the source cannot be read, or holds too little
    └── OutputError     the target exists, cannot be written, or cannot hold the streams
        ├── CompleteAlreadyError  an output to go on with needs nothing more
        └── ReaderGoneError  the program that reads standard output has closed it

    UserWarning
    └── SceneCutWarning  a scene ends between two images, and nothing was interpolated across it

Every message is one sentence that names the file or the option and says what to do. The library raises;
only the command line prints and chooses an exit code (2 for `OptionError`, 1 for the others).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path


class FpsboostError(Exception):
    """Base of everything that fpsboost raises on purpose."""


class OptionError(FpsboostError, ValueError):
    """An option or argument has a value that can never work."""


class SceneCutWarning(UserWarning):
    """A scene ends between two images that were to be interpolated: what was made is not what lies between them.

    Only given where somebody asks for cuts to be looked for; ``warnings.simplefilter("error", SceneCutWarning)`` makes
    it an exception.
    """


class InputError(FpsboostError):
    """The source is missing, unreadable, damaged beyond use, or too short."""


class OutputError(FpsboostError):
    """The target exists already, cannot be written, or cannot hold what it should."""


class CompleteAlreadyError(OutputError):
    """The target of a run that was to go on is there, and nothing of it is left to do."""


class ReaderGoneError(OutputError):
    """The program at the other end of a pipe has read enough; nobody need be told."""


def notes_of(error: BaseException) -> str:
    """What was added to an exception on its way, such as how to go on."""
    return " ".join(getattr(error, "__notes__", ()))


def check_choice(option: str, value: str, choices: Collection[str]) -> None:
    """Raise `OptionError` unless a value is one of the choices; the message lists them.

    Examples
    --------
    >>> check_choice("--window", "box", ("box", "gaussian"))
    """
    if value not in choices:
        raise OptionError(f"{option} must be one of {', '.join(choices)}, not {value!r}.")


@contextmanager
def explained(kind: type[FpsboostError], task: str, path: str | Path, advice: str) -> Iterator[None]:
    """Turn what the system raises into a sentence about a path.

    Parameters
    ----------
    kind : type of FpsboostError
        What to raise instead.
    task : str
        What was tried: ``read``, ``write to``.
    path : str or Path
    advice : str
        What to do about it.
    """
    try:
        yield
    except OSError as error:
        raise kind(f"Cannot {task} {path} ({error.strerror or error}); {advice}.") from error
