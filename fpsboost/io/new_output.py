"""Results that appear under their names whole or not at all: a file, a folder, or files in a folder."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self

from fpsboost.errors import ExistsError, OutputError, explained
from fpsboost.media import StagingDirectory, check_folder, hidden_place, move_all, sync, write_safely

if TYPE_CHECKING:
    from fpsboost.io.images.sequence import Numbering

ADVICE = "check the free space and the permissions"


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
        check_folder(path)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a hidden folder to write to, which gets its name at the end of the block, or is removed by an exception."""
    check_new_folder(path)
    with explained(OutputError, "write to", path, ADVICE):
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


def reason_to_refuse(folder: Path, old: Sequence[Path], *, alone: bool) -> str:
    """Return why files are not written to a folder without `overwrite`, which holds `old` ones; empty if they are."""
    if alone and any(not name.startswith(".") for name in os.listdir(folder)):
        return f"{folder} is not empty; add `overwrite=True` to replace the files in it, or name another."
    return f"{old[0]} exists; add `overwrite=True` to replace such files, or choose another pattern." if old else ""


class StagedFiles:
    """Files that are written in a hidden folder and get their names at the end, all of them or none.

    Use `open`, `write` for each file, `publish` if all went well, and `close` in any case.

    Parameters
    ----------
    path : str
        Folder or pattern as the user has given it, for messages.
    folder : Path
        Final folder of the files.
    namings : sequence of Numbering
        Names that the files may have; with `overwrite`, all existing files of such names are replaced, and others stay.
    overwrite : bool
        Replace existing files.
    alone : bool
        Make a new folder, or take an empty one; one with any file only with `overwrite`. Otherwise the folder must
        exist.

    Raises
    ------
    ExistsError
        There are files that only `overwrite` would replace.
    OutputError
        The folder cannot be made or written to.
    """

    def __init__(self, path: str, folder: Path, namings: Sequence[Numbering], *, overwrite: bool, alone: bool) -> None:
        self._path, self._folder, self._namings = path, folder, namings
        self._overwrite, self._alone = overwrite, alone
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            self._is_new = not folder.is_dir()
            check_folder(folder, may_be_new=alone)
            self.check()
        place = hidden_place(folder.absolute().parent, folder.absolute().name) if self._is_new else None
        self._staging = StagingDirectory(place or hidden_place(folder, "fpsboost-side"), "output", path, None)
        self._names, self._remarks = list[str](), list[str]()

    @property
    def remarks(self) -> list[str]:
        """Sentences about the hidden folder, and that no file was written."""
        return [*self._staging.remarks, *self._remarks]

    def check(self) -> None:
        """Raise `ExistsError` if there are files that only `overwrite` would replace."""
        if not self._overwrite and self._folder.is_dir():
            reason = reason_to_refuse(self._folder, self._find_old(), alone=self._alone)
            if reason:
                raise ExistsError(reason)

    def _find_old(self) -> list[Path]:
        """Return the existing files that `overwrite` replaces."""
        return [path for naming in self._namings for _, path in naming.find(any_padding=self._alone)]

    def open(self) -> Self:
        """Lock the hidden folder for this run, before any `write`; raise `InUseError` if another run has it."""
        with explained(OutputError, "write to", self._path, ADVICE):
            self._staging.open()
            self._staging.staged.mkdir()
        return self

    def write(self, name: str, data: bytes) -> None:
        """Write a file by its final name, in any order; it appears when `publish` is called."""
        with explained(OutputError, "write", self._folder / name, ADVICE):
            write_safely(self._staging.staged / name, data)
        self._names.append(name)

    def publish(self) -> None:
        """Give all files their names; if one cannot be moved, none is.

        Raises `ExistsError` if files have appeared there meanwhile. Without any file, there is only a remark.
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
            old = {path.name for path in self._find_old()}
            old |= {name for name in self._names if (self._folder / name).exists()}
            moves = [(self._folder / name, replaced / name) for name in sorted(old)]
            moves += [(self._staging.staged / name, self._folder / name) for name in self._names]
            move_all(moves)
            sync(self._folder)

    def close(self) -> None:
        """Release and remove the hidden folder, with files that were not published."""
        self._staging.close(keep=False)
