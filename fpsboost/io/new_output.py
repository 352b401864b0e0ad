"""Results that appear under their name whole or not at all: a file, or a folder of files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fpsboost.errors import OutputError, explained
from fpsboost.io.staging import StagingDirectory, hidden_place, write_safely


def write_whole(path: Path, data: bytes) -> None:
    """Write a file, or raise OutputError and leave nothing behind."""
    try:
        write_safely(path, data)
    except OSError as error:
        if path.parent.is_dir():
            path.with_name(f"{path.name}.part").unlink(missing_ok=True)
        raise OutputError(f"{path} cannot be written ({error.strerror}); choose another place.") from None


def check_new_folder(path: Path) -> None:
    """Raise OutputError unless a folder can be made here: nothing is there but an empty folder."""
    with explained(OutputError, "write to", path, "check the path and the permissions"):
        if path.is_dir() and os.listdir(path):
            raise OutputError(f"{path} is not empty; name a new folder.")
        if path.exists() and not path.is_dir():
            raise OutputError(f"{path} is a file; name a new folder.")
        if not path.absolute().parent.is_dir():
            raise OutputError(f"The folder {path.absolute().parent} does not exist; create it first.")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a hidden folder to write to, which gets its name at the end of the block, or is removed by an exception.

    Raises
    ------
    OutputError
        See `check_new_folder`; it cannot be written, or another run writes it.
    """
    check_new_folder(path)
    with explained(OutputError, "write to", path, "check the free space and the permissions"):
        staging = StagingDirectory(hidden_place(path.absolute().parent, path.name), "output", str(path), None)
        staging.open()
        try:
            staging.staged.mkdir()
            yield staging.staged
            check_new_folder(path)  # once more: hours may have passed
            if path.is_dir():
                path.rmdir()
            staging.publish(path)
        finally:
            staging.close(keep=False)
