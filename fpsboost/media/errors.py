"""Exceptions for what cannot be read, asked for or written, and the messages that are common to several of them.

Every message is one sentence that names the file or the option and says what to do.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path


class FpsboostError(Exception):
    """Base class of the exceptions that fpsboost raises on purpose."""


class OptionError(FpsboostError, ValueError):
    """Error for an invalid value of an option or argument."""


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


@contextmanager
def undone_by(undo: Callable[[], object]) -> Iterator[None]:
    """Call a function where the block ends by an exception, such as one that closes what the block had opened."""
    try:
        yield
    except BaseException:
        undo()
        raise
