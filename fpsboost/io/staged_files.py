"""Files in a folder that appear together or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from fpsboost.errors import OutputError, explained
from fpsboost.io.images.sequence import Numbering
from fpsboost.io.staging import StagingDirectory, hidden_place, move_all, sync, write_safely

ADVICE = "check the free space and the permissions"


class StagedFiles:
    """Files that are written in a hidden folder and get their names at the end, all of them or none.

    Parameters
    ----------
    path : str
        Folder or pattern, as the user gave it, for messages.
    folder : Path
        Where the files belong; made if it is not there.
    namings : sequence of Numbering
        How the files are named. Existing files of these names are replaced with `overwrite`, those that are not
        written again too, and anything else in the folder stays.
    overwrite : bool
        Replace existing files.
    alone : bool
        Refuse a folder that holds any file, and not only those of such names, unless `overwrite` is given.

    Raises
    ------
    OutputError
        The place cannot be written, or files exist there already.
    """

    def __init__(self, path: str, folder: Path, namings: Sequence[Numbering], *, overwrite: bool, alone: bool) -> None:
        self._path, self._folder, self._namings = path, folder, namings
        self._overwrite, self._alone = overwrite, alone
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            self._is_new = not folder.is_dir()
            if self._is_new and folder.exists():
                raise OutputError(f"{folder} is a file; name a folder, or a pattern in one.")
            if not folder.absolute().parent.is_dir() or (self._is_new and not alone):
                missing = folder.parent if alone else folder
                raise OutputError(f"The folder {missing} does not exist; create it first.")
            self.check()
        place = hidden_place(folder.absolute().parent, folder.absolute().name) if self._is_new else None
        self._staging = StagingDirectory(place or hidden_place(folder, "fpsboost-side"), "output", path, None)
        self._names, self._remarks = list[str](), list[str]()

    @property
    def remarks(self) -> list[str]:
        """Sentences about what was not written."""
        return [*self._staging.remarks, *self._remarks]

    def check(self) -> None:
        """Raise `OutputError` if files exist and may not be replaced."""
        if self._overwrite or not self._folder.is_dir():
            return
        if self._alone and any(not name.startswith(".") for name in os.listdir(self._folder)):
            raise OutputError(
                f"{self._folder} is not empty; add `overwrite=True` to replace the files in it, or name another."
            )
        old = self._find_old()
        if old:
            raise OutputError(
                f"{old[0]} exists; add `overwrite=True` to replace such files, or choose another pattern."
            )

    def _find_old(self) -> list[Path]:
        return [path for naming in self._namings for _, path in naming.find(any_padding=self._alone)]

    def open(self) -> Self:
        """Take the hidden folder for this run.

        Raises
        ------
        OutputError
            Another run writes there, or it cannot be written.
        """
        with explained(OutputError, "write to", self._path, ADVICE):
            self._staging.open()
            self._staging.staged.mkdir()
        return self

    def write(self, name: str, data: bytes) -> None:
        """Write a file of the hidden folder.

        Raises
        ------
        OutputError
        """
        with explained(OutputError, "write", self._folder / name, ADVICE):
            write_safely(self._staging.staged / name, data)
        self._names.append(name)

    def publish(self) -> None:
        """Give all files their names.

        Raises
        ------
        OutputError
            Files have appeared there meanwhile, or the place cannot be written; nothing has changed then.
        """
        if not self._names:
            self._remarks.append(f"No frame was made, so that nothing was written to {self._path}.")
            return
        with explained(OutputError, "write to", self._path, ADVICE):
            self.check()
            if not self._folder.exists():
                self._staging.publish(self._folder)
                return
            replaced = self._staging.folder / "replaced"
            replaced.mkdir()
            old = {path.name for path in self._find_old()} | {
                name for name in self._names if (self._folder / name).exists()
            }
            moves = [(self._folder / name, replaced / name) for name in sorted(old)]
            moves += [(self._staging.staged / name, self._folder / name) for name in self._names]
            move_all(moves)
            sync(self._folder)

    def close(self) -> None:
        """Remove the hidden folder with everything that has not got its name."""
        self._staging.close(keep=False)
