"""Parts of a conversion, which are written one by one, each into a folder of its own, and joined afterwards."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fpsboost.errors import CompleteAlreadyError, OptionError, OutputError
from fpsboost.io.staging import StagingDirectory, complete_already, hidden_place, sync

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.io.output import Output

MAX_PARTS = 9999
REPLACED = "replaced"
INDEX_NAME = ".index.npz"
"""File in the folder of all parts with the list of the input's frames."""


@dataclass(frozen=True)
class Part:
    """One of the parts that a conversion is cut into: its number, counted from 1, and how many there are."""

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_PARTS:
            raise OptionError(f"`chunk={self}` must have 1 to {MAX_PARTS} parts; write it like 3/8.")
        if not 1 <= self.number <= self.count:
            raise OptionError(f"`chunk={self}` does not exist; parts are numbered from 1 to {self.count}.")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def folder(self, output: str) -> Path:
        """Return where this part of an output is written: beside it, in a folder of its name with ``.parts`` behind it.

        Examples
        --------
        >>> Part(3, 8).folder("films/out.mp4").as_posix()
        'films/out.mp4.parts/0003-of-0008'
        """
        whole = Path(output)
        return whole.parent / f"{whole.name}.parts" / f"{self.number:04d}-of-{self.count:04d}"


def parse_part(text: str, option: str = "`chunk`") -> Part:
    """Parse the number of a part and how many there are; messages name it by `option`.

    Examples
    --------
    >>> parse_part("3/8")
    Part(number=3, count=8)
    """
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
    if match is None:
        raise OptionError(f"{option} {text!r} is no part of a whole; write it like 3/8 for the third of eight.")
    return Part(int(match[1]), int(match[2]))


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

    def leave_part(self, error: BaseException | None, frames: int) -> None:
        """Release the hidden folder; after an error, keep the number of finished frames if a later run can resume."""
        self.leave(error, frames, self._part.frames)
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
