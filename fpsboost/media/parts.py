"""Parts of an output, to be joined afterwards: each is written as a folder of its own, which appears whole."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fpsboost.media.errors import CompleteAlreadyError, ExistsError, OutputError, undone_by
from fpsboost.media.safe_files import sync
from fpsboost.media.staging import (
    REPLACED,
    JobFingerprint,
    StagingDirectory,
    UnfinishedOutput,
    complete_already,
    hidden_place,
)

INDEX_NAME = ".index.json"
"""File in the folder of all parts with the list of the input's frames."""


@dataclass(frozen=True)
class OutputPart:
    """Part of an output: `frames` frames (None if unknown), from number `first` on, in a folder of its own."""

    folder: Path
    first: int
    frames: int | None
    complete: Callable[[Path], None]
    """Called with the folder of the finished files before it gets its final name, to add what describes them."""


class PartFolder(StagingDirectory):
    """Hidden folder in which a part of an output is written; `staged` is a folder in it for the part's files.

    Parameters
    ----------
    part : OutputPart
        The part.
    job : JobFingerprint or None
        Inputs and options that a run which resumes must share.
    overwrite : bool
        Replace the part if it is there.

    Raises
    ------
    CompleteAlreadyError
        The part is there and the job is to be resumed.
    ExistsError
        The part is there otherwise, and `overwrite` is not set.
    OutputError
        The folder in which the folder of all parts belongs does not exist.
    """

    def __init__(self, part: OutputPart, job: JobFingerprint | None, *, overwrite: bool) -> None:
        self._part = part
        folder = part.folder
        super().__init__(hidden_place(folder.parent, folder.name), "output", str(folder), job)
        UnfinishedOutput(folder).discard_published()
        if folder.exists() and not overwrite:
            if job is not None and job.resume:
                raise CompleteAlreadyError(complete_already(self.name))
            raise ExistsError(f"{self.name} exists already; give `resume` to keep it, or `overwrite=True`.")
        if not folder.parent.parent.is_dir():
            raise OutputError(f"The folder {folder.parent.parent} does not exist; create it first.")

    def open(self) -> None:
        """Lock the hidden folder for this run, with the files of an earlier run that this one resumes."""
        self._part.folder.parent.mkdir(exist_ok=True)
        with undone_by(lambda: remove_if_empty(self._part.folder.parent)):
            super().open()
            self.staged.mkdir(exist_ok=True)

    def publish_part(self) -> None:
        """Add the description of the part, and give its folder its final name, replacing an earlier one."""
        self._part.complete(self.staged)
        sync(self.staged)
        if self._part.folder.exists():
            os.replace(self._part.folder, self.folder / REPLACED)
        self.publish(self._part.folder)

    def leave(self, error: BaseException | None, frames: int, expected: int | None) -> None:
        """Release the hidden folder, and also remove the folder of all parts if it is empty."""
        super().leave(error, frames, expected)
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
