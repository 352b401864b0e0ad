"""What of an output is finished already: a hidden folder beside it, which outlives a run that is stopped.

The folder is locked while a run writes there; the system lets go of the lock when the run ends, however it ends. Its
manifest says which job it belongs to, so that `--resume` goes on with the same job or not at all.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from io import BufferedRandom
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from fpsboost.errors import InputError, OptionError, OutputError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

LOCK, MANIFEST, WHOLE = "lock", "manifest.json", "whole"
MAX_WORDING = 60
MAX_NAME = 230
"""Bytes of a name that leave room for what is put around it; file systems end at 255."""
SHORTENED = 50
"""Letters that are left of a longer one."""


@dataclass(frozen=True)
class JobFingerprint:
    """What an output is made of and how, so that a later run can tell whether it would make the same.

    Parameters
    ----------
    facts : mapping of str to str
        Everything that shapes the output; see `fingerprint_options`.
    resume : bool
        Go on with what an earlier run of the same job has finished.
    """

    facts: Mapping[str, str]
    resume: bool = False


@runtime_checkable
class ReadsFiles(Protocol):
    """Contract: an option that stands for files, whose content shapes the output."""

    @property
    def files(self) -> Sequence[Path]:
        """All of them."""
        ...


def fingerprint_options(**values: Any) -> dict[str, str]:
    """What a job consists of, as words: the fields of dataclasses one by one, everything else as it prints.

    Of what reads files their state is told too.

    Raises
    ------
    OSError
        One of those cannot be looked at.

    Examples
    --------
    >>> fingerprint_options(factor=2, fps=None)
    {'factor': '2', 'fps': 'None'}
    """
    return dict(fact for name, value in values.items() for fact in _facts(name, value))


def _facts(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, ReadsFiles):
        yield f"{name}_files", fingerprint_files(value.files)
    if not is_dataclass(value):
        yield name, str(value)
        return
    yield name, type(value).__name__
    for field in fields(value):
        yield from _facts(f"{name}.{field.name}", getattr(value, field.name))


def fingerprint_files(files: Iterable[Path]) -> str:
    """A digest of names, sizes and times of change, which differs where a file was replaced.

    Raises
    ------
    OSError
        One cannot be looked at.
    """
    states = [(file.name, file.stat()) for file in files]
    listed = json.dumps([(name, state.st_size, state.st_mtime_ns) for name, state in states])
    return hashlib.sha256(listed.encode()).hexdigest()


def hidden_place(folder: Path, name: str) -> Path:
    """Where in a folder an output of some name grows: always the same place, so that a later run finds it."""
    if len(os.fsencode(name)) > MAX_NAME:
        name = f"{name[:SHORTENED]}.{hashlib.sha256(os.fsencode(name)).hexdigest()[:16]}"
    return folder / f".{name}.unfinished"


class StagingDirectory:
    """The hidden folder in which an output grows.

    Parameters
    ----------
    folder : Path
    staged : str
        Name, in the folder, of what gets the output's name at the end.
    name : str
        What messages call the output.
    job : JobFingerprint or None
        None where no later run can go on; nothing is left behind then.
    """

    def __init__(self, folder: Path, staged: str, name: str, job: JobFingerprint | None) -> None:
        self.folder, self.staged, self.remarks = folder, folder / staged, list[str]()
        self._name, self._job = name, job
        self._lock: BufferedRandom | None = None

    @property
    def can_be_resumed(self) -> bool:
        """Whether this run holds the folder, and a later one can know that it is of the same job."""
        return self._lock is not None and self._job is not None

    @property
    def is_pending(self) -> bool:
        """Whether an earlier run has left something that another could go on with."""
        is_published = (self.folder / WHOLE).exists() and not self.staged.exists()
        return (self.folder / MANIFEST).exists() and not is_published

    @property
    def goes_on(self) -> bool:
        """Whether this run would go on with that, if it is of the same job."""
        return self._job is not None and self._job.resume and self.is_pending

    def open(self) -> None:
        """Take the folder for this run; what is there is kept where the job goes on with it, and else removed.

        Raises
        ------
        OutputError
            Another run writes there, or the job differs from the one that the folder belongs to.
        OSError
        """
        self._acquire()
        try:
            before = self._read_manifest() if self.is_pending else None
            if self.goes_on and before is not None and self._job is not None:
                self._check_same(before, self._job.facts)
                (self.folder / WHOLE).unlink(missing_ok=True)
                return
            if before is not None:
                self.remarks.append(
                    f"{self._name} was begun anew, and what an earlier run had finished was thrown away; --resume goes "
                    "on with it."
                )
            self._clear()
            if self._job is not None:
                write_safely(self.folder / MANIFEST, json.dumps(dict(self._job.facts), indent=1).encode())
        except BaseException:
            self.close(keep=self.is_pending)
            raise

    def publish(self, path: Path) -> None:
        """Give what is staged, whole and on the disk, its final name.

        Raises
        ------
        OSError
        """
        write_safely(self.folder / WHOLE, b"")
        rename_safely(self.staged, path)

    def leave(self, error: BaseException | None, frames: int, expected: int | None, *, stays: bool = False) -> None:
        """Let go of the folder; where a run is cut short and another can go on, keep it and note that on the error.

        Of a faulty input or option nothing is kept: what mends it makes another job.

        Parameters
        ----------
        error : BaseException or None
            What ends the run.
        frames, expected : int, int or None
            How many frames are finished, and how many there were to be.
        stays : bool
            Keep the folder in any case.
        """
        is_cut_short = error is not None and not isinstance(error, InputError | OptionError)
        keep = is_cut_short and frames > 0 and self.can_be_resumed
        self.close(keep=keep or stays)
        if keep and error is not None:
            error.add_note(note_on_resuming(frames, expected))

    def close(self, *, keep: bool) -> None:
        """Let go of the folder, and remove it unless it is to be kept."""
        if self._lock is None:
            return
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)
        self._release()
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)  # Windows does not remove a file that is open

    def _acquire(self) -> None:
        while True:
            try:
                self.folder.mkdir(exist_ok=True)
                lock = (self.folder / LOCK).open("a+b")
            except FileNotFoundError:  # the run that was here has just finished
                if not self.folder.parent.is_dir():
                    raise
                continue
            except KeyboardInterrupt:
                with contextlib.suppress(OSError):  # another run's is not empty
                    self.folder.rmdir()
                raise
            try:
                _lock(lock)
                self._lock = lock
                if os.path.samestat(os.fstat(lock.fileno()), (self.folder / LOCK).stat()):
                    return
                self._release()
            except FileNotFoundError:
                self._release()
            except OSError as error:
                if error.errno in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                    lock.close()
                    raise OutputError(
                        f"{self._name} is being written by another run; wait for it, or choose another name."
                    ) from None
                self.remarks.append(f"{self._name} lies on a disk without locks; never let two runs write it at once.")
                self._lock = lock
                return

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _clear(self) -> None:
        for path in self.folder.iterdir():
            if path.name == LOCK:
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()

    def _read_manifest(self) -> dict[str, str] | None:
        try:
            facts = json.loads((self.folder / MANIFEST).read_bytes())
        except (OSError, ValueError):
            return None
        return facts if isinstance(facts, dict) else None

    def _check_same(self, before: Mapping[str, str], now: Mapping[str, str]) -> None:
        """Raise `OutputError` that names the first difference."""
        for key in [*now, *(key for key in before if key not in now)]:
            old, new = before.get(key, "nothing"), now.get(key, "nothing")
            if old == new:
                continue
            what = key.rpartition(".")[2].replace("_", " ")
            wording = f"with {what} {old} and not {new}"
            if max(len(old), len(new)) > MAX_WORDING:
                wording = f"with {what} that {'have' if what.endswith('s') else 'has'} changed since"
            raise OutputError(
                f"{self._name} was begun {wording}; say the same as then, or leave --resume out to start anew."
            )


def complete_already(name: str) -> str:
    """What to say where a run was to go on and there is an output, but nothing unfinished."""
    return f"{name} exists already and no run of it is unfinished, so it was left as it is."


def note_on_resuming(frames: int, expected: int | None) -> str:
    """What to add to the word of a run's end: how much is finished, and how to go on."""
    of_all = "" if expected is None else f" of {expected}"
    return f"{frames}{of_all} frames are finished, and --resume goes on from there."


def write_safely(path: Path, data: bytes) -> None:
    """Write a file that is there whole or not at all, even after a power cut.

    Raises
    ------
    OSError
    """
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    rename_safely(part, path)


def rename_safely(here: Path, there: Path) -> None:
    """Give a file, whose content is on the disk, its name for good.

    Raises
    ------
    OSError
    """
    os.replace(here, there)
    sync(there.parent)


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk.

    Raises
    ------
    OSError
    """
    if path.is_dir() and os.name == "nt":  # which writes them at once and opens no folders
        return
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _lock(file: BufferedRandom) -> None:
    """Lock a file until it is closed; OSError where another has done so."""
    if sys.platform == "win32":
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
