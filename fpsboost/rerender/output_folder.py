"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fpsboost.errors import OutputError, explained
from fpsboost.io.staging import StagingDirectory, hidden_place


def check_new(path: Path) -> None:
    """Raise `OutputError` unless a folder can be made here: nothing is there but an empty folder."""
    with explained(OutputError, "write to", path, "check the path and the permissions"):
        if path.is_dir() and os.listdir(path):
            raise OutputError(f"{path} is not empty; name a new folder.")
        if path.exists() and not path.is_dir():
            raise OutputError(f"{path} is a file; name a new folder.")
        if not path.absolute().parent.is_dir():
            raise OutputError(f"The folder {path.absolute().parent} does not exist; create it first.")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Give a hidden folder to write to, which gets its name at the end of the block, or is removed by an exception.

    Parameters
    ----------
    path : Path
        Its final name; see `check_new`.

    Yields
    ------
    Path

    Raises
    ------
    OutputError
        It cannot be written, or another run writes it.
    """
    check_new(path)
    with explained(OutputError, "write to", path, "check the free space and the permissions"):
        staging = StagingDirectory(hidden_place(path.absolute().parent, path.name), "output", str(path), None)
        staging.open()
        try:
            staging.staged.mkdir()
            yield staging.staged
            check_new(path)  # once more: hours may have passed
            if path.is_dir():
                path.rmdir()
            staging.publish(path)
        finally:
            staging.close(keep=False)
