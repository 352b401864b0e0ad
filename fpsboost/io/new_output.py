"""Results that appear under their names whole or not at all: a file, a folder, or files in a folder."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from fpsboost.errors import CompleteAlreadyError, ExistsError, OutputError, explained
from fpsboost.media import (
    MANIFEST,
    REPLACED,
    JobFingerprint,
    StagingDirectory,
    UnfinishedOutput,
    check_folder,
    complete_already,
    hidden_place,
    move_all,
    sync,
    write_safely,
)

if TYPE_CHECKING:
    from fpsboost.io.images.sequence import Numbering

ADVICE = "check the free space and the permissions"

STAGED = "output"
"""Folder of the files that are written, in a hidden folder."""
MOVING = "moving.json"
"""List of the files to be moved to their names, in a hidden folder."""


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
        UnfinishedOutput(path).discard_published()
        if path.is_dir() and os.listdir(path):
            raise OutputError(f"{path} is not empty; name a new folder.")
        check_folder(path)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a hidden folder to write to, which gets its name at the end of the block, or is removed by an exception."""
    check_new_folder(path)
    with explained(OutputError, "write to", path, ADVICE):
        staging = StagingDirectory(hidden_place(path.absolute().parent, path.name), STAGED, str(path), None)
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


class StagedFiles(StagingDirectory):
    """Hidden folder of files that get their names at the end, all of them or none, in a new folder or an existing one.

    A new folder gets its name by one renaming. Into an existing one the files are moved, and moved back if that fails;
    files that they replace are set aside until all are moved. A list of the files to be moved lets a later run go on
    when this one is killed in between.

    Use `check` and `open`, write to `staged`, `publish_files` if all went well, and `close` or `leave` in any case.

    Parameters
    ----------
    path : str
        Folder or pattern as the user has given it, for messages.
    namings : sequence of Numbering
        Names that the files may have, all in one folder; with `overwrite`, all existing files of such names are
        replaced, and others stay.
    called : str
        Name of the hidden folder in an existing one.
    overwrite : bool
        Replace existing files.
    alone : bool
        Make a new folder, or take an empty one; one with any file only with `overwrite`. Otherwise the folder must
        exist.
    job : JobFingerprint, optional
        Inputs and options that a run which resumes must share; without a job nothing is kept for a later run.
    adds_only : bool
        Add files between others of the same naming, and replace none.

    Raises
    ------
    OutputError
        The folder cannot be made or written to.
    """

    def __init__(
        self,
        path: str,
        namings: Sequence[Numbering],
        called: str,
        *,
        overwrite: bool,
        alone: bool,
        job: JobFingerprint | None = None,
        adds_only: bool = False,
    ) -> None:
        self.namings = namings
        self._target = namings[0].folder
        self._overwrite = overwrite
        self._alone = alone
        self._adds_only = adds_only
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            check_folder(self._target, may_be_new=alone)
            UnfinishedOutput(self._target).discard_published()
            # Inside an existing folder rather than beside it: the folder may be a mount point, the parent read-only.
            self._is_new = not self._target.is_dir()
            beside = self._target.parent, self._target.name
            super().__init__(hidden_place(*(beside if self._is_new else (self._target, called))), STAGED, path, job)
            self._replaced = self.folder / REPLACED
            self._moving = self.folder / MOVING

    def check(self) -> None:
        """Raise an error if there are files that this run must not replace, or that an earlier run has left unmoved.

        That is `CompleteAlreadyError` if the job is to be resumed but is complete, `ExistsError` for other files that
        only `overwrite` would replace, and `OutputError` if a run that adds files was stopped while it moved them.
        """
        is_moving = bool(names_to_move(self.folder))
        if self._adds_only and is_moving and not self.goes_on:
            raise OutputError(
                f"A run in {self.name} was stopped while its frames got their names; `resume` goes on with that."
            )
        if self._adds_only or self._overwrite or not self._target.is_dir() or (is_moving and self.goes_on):
            return
        old = self.find_old()
        reason = ""
        if self._alone and any(not name.startswith(".") for name in os.listdir(self._target)):
            reason = f"{self._target} is not empty; add `overwrite=True` to replace the files in it, or name another."
        elif old:
            reason = f"{old[0]} exists; add `overwrite=True` to replace such files, or choose another pattern."
        if reason and self._job is not None and self._job.resume and not self.is_pending:
            raise CompleteAlreadyError(complete_already(self.name))
        if reason:
            raise ExistsError(reason)

    def find_old(self) -> list[Path]:
        """Return the existing files that `overwrite` replaces."""
        # In a folder the digits are this program's choice, so files of an earlier run may have fewer or more.
        return [path for naming in self.namings for _, path in naming.find(any_padding=self._alone)]

    def open(self) -> None:
        """Lock the hidden folder for this run; keep its files if the job resumes them, otherwise remove them.

        Raises `InUseError` if another run has it, and `OutputError` if it holds the only copies of files that a stopped
        run has set aside, and this one does not resume it.
        """
        with explained(OutputError, "write to", self.name, ADVICE):
            if not self.goes_on and self._replaced.is_dir() and os.listdir(self._replaced):
                way = "let that run finish with `resume`, or move" if self.is_pending else "move"
                raise OutputError(
                    f"{self._replaced} holds files that a run had set aside to replace them; {way} them to where they "
                    "belong."
                )
            super().open()
            self.staged.mkdir(exist_ok=True)

    @property
    def finished(self) -> set[str]:
        """Names of the files that are written, also of those that a run has moved before it was killed."""
        return {*os.listdir(self.staged), *names_to_move(self.folder)}

    def publish_files(self) -> None:
        """Give all files in `staged` their names; if one cannot be moved, none is. Without files, nothing happens.

        Raises `ExistsError` or `OutputError` if files have appeared there meanwhile.
        """
        with explained(OutputError, "write to", self.name, ADVICE):
            staged = sorted(os.listdir(self.staged))
            finished = sorted(self.finished)
            if not finished:
                return
            self.check()
            if self._is_new and not self._target.exists():
                self.publish(self._target)
                return
            taken = [name for name in staged if (self._target / name).exists()]
            if self._adds_only and taken:
                raise OutputError(f"{self._target / taken[0]} has appeared meanwhile; move it away, and use `resume`.")
            self._replaced.mkdir(exist_ok=True)
            moves = [(self.staged / name, self._target / name) for name in staged]
            if staged == finished and not self._adds_only:  # else an earlier run has set all of them aside
                old = {*taken, *(path.name for path in self.find_old())}
                moves = [(self._target / name, self._replaced / name) for name in sorted(old)] + moves
            write_safely(self._moving, json.dumps({"names": finished}).encode())
            try:
                move_all(moves, _move_new if self._adds_only else None)
            except BaseException:
                if sorted(os.listdir(self.staged)) == finished:
                    self._moving.unlink()
                raise
            sync(self._target)
            shutil.rmtree(self._replaced, ignore_errors=True)

    def close(self, *, keep: bool = False) -> None:
        """Release the folder, and remove it unless it is to be kept.

        It is kept in any case if it holds files that were set aside, or are to be moved where others are already.
        """
        if self._lock is None:
            return
        with suppress(OSError):
            self._replaced.rmdir()  # fails where it is not empty
        is_torn = bool(names_to_move(self.folder)) and any(self.staged.glob("*"))
        super().close(keep=keep or is_torn or self._replaced.exists())


def names_to_move(hidden: Path) -> list[str]:
    """Return the names of files that a run has begun to move from a hidden folder; empty if none has, or it is done."""
    # which goes first when a run is done
    moving = hidden / MOVING
    is_pending = (hidden / MANIFEST).exists()
    is_due = moving.exists() and (is_pending or any((hidden / STAGED).glob("*")))
    return list(json.loads(moving.read_bytes())["names"]) if is_due else []


def _move_new(here: Path, there: Path) -> None:
    """Move a file to a name that nothing has, also where capital letters make no difference."""
    if there.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(there))
    os.rename(here, there)
