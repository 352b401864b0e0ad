"""Files written whole and synced to disk, and checks of where they can be written."""

import os
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from fpsboost.media.errors import (
    ExistsError,
    OutputError,
    explained,
)


def check_writable(path: Path, name: str, inputs: Collection[Path] = (), overwrite: bool | None = None) -> None:
    """Raise `OutputError` unless a file, named `name` in messages, can be written and is none of the inputs.

    `overwrite` is None for what never replaces anything.
    """
    is_there = path.exists()
    if path.is_dir():
        raise OutputError(f"{name} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise OutputError(f"{name} cannot be written because its folder does not exist; create it first.")
    if is_there and not path.is_file():
        raise OutputError(f"{name} is a device or a pipe; name a file, or - for standard output.")
    if is_there and any(source.exists() and path.samefile(source) for source in inputs):
        raise OutputError(f"{name} is the input itself; write to another name.")
    if os.path.lexists(path) and not overwrite:
        other = "remove it first" if overwrite is None else "pass `overwrite=True`"
        raise ExistsError(f"{name} exists already; choose another name or {other}.")
    _check_takes_files(path.parent, name)


def check_folder(path: Path, *, may_be_new: bool = True) -> None:
    """Raise `OutputError` unless files can be written to a folder, which is made if it may be new."""
    needed = path.parent if may_be_new else path
    for place in (path, needed):
        if os.path.lexists(place) and not place.is_dir():
            what = "a file" if place.exists() else "a link that leads nowhere"
            raise OutputError(f"{place} is {what}; name a folder, or a pattern in one.")
    if not needed.is_dir():
        raise OutputError(f"The folder {needed} does not exist; create it first.")
    _check_takes_files(path if path.is_dir() else needed, str(path))


def _check_takes_files(folder: Path, name: str) -> None:
    """Raise `OutputError` unless a file can be made in a folder; permissions alone do not prove it."""
    with (
        explained(OutputError, "write", name, "choose another folder, in which files can be made"),
        TemporaryFile(dir=folder, prefix=".fpsboost-"),  # without a name where the system has such files
    ):
        pass


def write_safely(path: Path, data: bytes, mode: int = 0o666) -> None:
    """Write a file atomically, even in case of a power cut, replacing one of that name.

    `mode` is the permissions of the file, from which the umask is subtracted.
    """
    part = path.with_name(path.name + ".part")
    with open(part, "wb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    rename_safely(part, path)


def rename_safely(here: Path, there: Path) -> None:
    """Rename a file whose content is synced to disk, and sync its name."""
    os.replace(here, there)
    sync(there.parent)


def move_all(moves: Sequence[tuple[Path, Path]], move: Callable[[Path, Path], None] | None = None) -> None:
    """Move files from the first paths to the second, by `os.replace` or `move`; if one cannot be moved, none is."""
    try:
        for here, there in moves:
            (move or os.replace)(here, there)
    except BaseException:
        for here, there in reversed(moves):
            with suppress(OSError):
                if there.exists() and not here.exists():
                    os.replace(there, here)
        raise


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are written to disk."""
    if path.is_dir() and os.name == "nt":  # Windows writes names at once and opens no folders
        return
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)
