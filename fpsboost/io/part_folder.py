"""Folder of a part of an output, which gets its name when the part is complete."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.io.output import Output
from fpsboost.io.staging import StagingDirectory, complete_already, hidden_place, sync

REPLACED = "replaced"
INDEX_NAME = ".index.npz"
"""File in the folder of all parts with the list of the input's frames."""


class PartFolder:
    """Folder in which a part of an output is written.

    Parameters
    ----------
    output : Output
        With a part.

    Attributes
    ----------
    files : Path
        Hidden folder for the files of the part.
    name : str
        Name of the part in messages.

    Raises
    ------
    CompleteAlreadyError
        The part is there, and the job is to be resumed.
    OutputError
        The part is there, and may not be replaced, or its folder cannot be made.
    """

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        self._part = output.part
        folder = output.part.folder
        self.name = str(folder)
        self._staging = StagingDirectory(hidden_place(folder.parent, folder.name), "output", self.name, output.job)
        self.files = self._staging.staged
        if folder.exists() and not output.overwrite:
            if output.job is not None and output.job.resume:
                raise CompleteAlreadyError(complete_already(self.name))
            raise OutputError(f"{self.name} exists already; give `resume` to keep it, or `overwrite=True`.")
        if not folder.parent.parent.is_dir():
            raise OutputError(f"The folder {folder.parent.parent} does not exist; create it first.")

    @property
    def remarks(self) -> list[str]:
        """What happened to an earlier run."""
        return self._staging.remarks

    def open(self) -> None:
        """Lock the hidden folder for this run, with the files of an earlier run that this one resumes.

        Raises
        ------
        OutputError
            Another run writes there, or the job differs.
        OSError
        """
        self._part.folder.parent.mkdir(exist_ok=True)
        try:
            self._staging.open()
            self.files.mkdir(exist_ok=True)
        except BaseException:
            remove_if_empty(self._part.folder.parent)
            raise

    def publish(self) -> None:
        """Give the complete files their final place.

        Raises
        ------
        OSError
        """
        self._part.complete(self.files)
        sync(self.files)
        if self._part.folder.exists():
            os.replace(self._part.folder, self._staging.folder / REPLACED)
        self._staging.publish(self._part.folder)

    def leave(self, error: BaseException | None, frames: int) -> None:
        """Release the hidden folder; keep finished frames that a later run can resume from.

        Parameters
        ----------
        error : BaseException or None
            Exception that ends the run.
        frames : int
            Number of finished frames.
        """
        self._staging.leave(error, frames, self._part.frames)
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
