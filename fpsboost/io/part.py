"""Folders of the parts of an output, which are written one by one and joined afterwards."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.io.staging import StagingDirectory, complete_already, hidden_place, sync

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.io.output import Output

REPLACED = "replaced"
INDEX_NAME = ".index.npz"
"""File in the folder of all parts with the list of the input's frames."""


class PartFolder(StagingDirectory):
    """Folder in which a part of an output is written; what is `staged` is a folder for its files.

    Raises `CompleteAlreadyError` if the part is there and the job is to be resumed.
    """

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        self._part, folder = output.part, output.part.folder
        super().__init__(hidden_place(folder.parent, folder.name), "output", str(folder), output.job)
        if folder.exists() and not output.overwrite:
            if output.job is not None and output.job.resume:
                raise CompleteAlreadyError(complete_already(self.name))
            raise OutputError(f"{self.name} exists already; give `resume` to keep it, or `overwrite=True`.")
        if not folder.parent.parent.is_dir():
            raise OutputError(f"The folder {folder.parent.parent} does not exist; create it first.")

    def open(self) -> None:
        """Lock the hidden folder for this run, with the files of an earlier run that this one resumes."""
        self._part.folder.parent.mkdir(exist_ok=True)
        try:
            super().open()
            self.staged.mkdir(exist_ok=True)
        except BaseException:
            remove_if_empty(self._part.folder.parent)
            raise

    def publish_part(self) -> None:
        """Give the complete files their final place."""
        self._part.complete(self.staged)
        sync(self.staged)
        if self._part.folder.exists():
            os.replace(self._part.folder, self.folder / REPLACED)
        self.publish(self._part.folder)

    def leave(self, error: BaseException | None, frames: int, expected: int | None, *, stays: bool = False) -> None:
        """Release the hidden folder as any other, and remove the folder of all parts if it holds none."""
        super().leave(error, frames, expected, stays=stays)
        remove_if_empty(self._part.folder.parent)


def remove_if_empty(folder: Path) -> None:
    """Remove the folder of all parts if it holds none."""
    with suppress(OSError):
        if os.listdir(folder) == [INDEX_NAME]:
            (folder / INDEX_NAME).unlink()
        folder.rmdir()  # fails unless it is empty


def part_files(folder: Path) -> list[Path]:
    """Return the files of a part in order of their names."""
    return sorted(path for path in folder.iterdir() if path.is_file())
