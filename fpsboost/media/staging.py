"""Files that appear whole: checks of their paths, safe writes, and hidden folders in which unfinished outputs wait.

Such a folder lies beside the output, and stays there if a run is stopped. It is locked while a run writes there; the
system releases the lock when the run ends, however it ends. Its manifest identifies the job, so that `--resume`
continues only the same job.
"""

import hashlib
import json
import os
import shutil
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from io import BufferedRandom
from pathlib import Path
from types import TracebackType

from fpsboost.media.errors import (
    InputError,
    InUseError,
    OptionError,
    OutputError,
    explained,
    undone_by,
)
from fpsboost.media.locks import lock_file
from fpsboost.media.remarks import Remarks
from fpsboost.media.safe_files import rename_safely, write_safely

LOCK = "lock"
MANIFEST = "manifest.json"
COMPLETE = "whole"
REPLACED = "replaced"
MAX_ATTEMPTS = 1000
"""Attempts to lock a folder that other runs remove meanwhile; a folder that keeps nothing would take any number."""
MAX_FACT_LENGTH = 60  # maximum length of an option's value that a message quotes, characters
MAX_NAME_BYTES = 230
"""Bytes of a name beyond which it is cut: file systems take 255, with prefix and suffix."""
SHORT_NAME_LENGTH = 50  # characters that are left of a name that is cut
IN_EXISTING_FOLDER = "fpsboost"
"""Name of the staging folder of images that go into a folder that was there."""


def hidden_place(folder: Path, name: str) -> Path:
    """Return the path of the staging folder of an output, always the same so that a later run finds it."""
    if len(os.fsencode(name)) > MAX_NAME_BYTES:
        name = f"{name[:SHORT_NAME_LENGTH]}.{hashlib.sha256(os.fsencode(name)).hexdigest()[:16]}"
    return folder / f".{name}.unfinished"


@dataclass(frozen=True)
class JobFingerprint:
    """Inputs and options of an output, by which a later run can tell whether it would write the same."""

    facts: Mapping[str, str]
    resume: bool = False


class StagingDirectory:
    """Hidden folder in which an output is written until it is complete, locked while a run writes there.

    Creating the object touches no file; `open` locks the folder, and `leave` or `close` must release it.

    Parameters
    ----------
    folder : Path
        Hidden folder, beside the output or in it; see `hidden_place`.
    staged : str
        Name, in the folder, of the file or folder that gets the output's name at the end.
    name : str
        The output in messages.
    job : JobFingerprint or None
        Inputs and options that a run which resumes must share; without a job nothing is kept for a later run.
    """

    def __init__(self, folder: Path, staged: str, name: str, job: JobFingerprint | None) -> None:
        self.folder = folder
        self.staged = folder / staged
        self.remarks = Remarks()
        self.name = name
        self._job = job
        self._lock: BufferedRandom | None = None

    @property
    def is_pending(self) -> bool:
        """Whether an earlier run has left an unfinished output that another could resume."""
        is_published = (self.folder / COMPLETE).exists() and not self.staged.exists()
        return (self.folder / MANIFEST).exists() and not is_published

    @property
    def goes_on(self) -> bool:
        """Whether `open` would keep an unfinished output, to resume it if it is of the same job."""
        return self._job is not None and self._job.resume and self.is_pending

    def open(self) -> None:
        """Lock the folder for this run; keep its content if the job resumes it, otherwise remove it, with a remark.

        Raises `InUseError` if another run writes there, and `OutputError` if the folder cannot be used, or belongs to a
        job with other inputs or options.
        """
        begun = False  # whether what is in the folder is of this run
        with undone_by(lambda: self.close(keep=self.is_pending and not begun)):
            self._acquire()
            before = self._read_manifest() if self.is_pending else None
            if self.goes_on and before is not None and self._job is not None:
                self._check_same(before, self._job.facts)
                (self.folder / COMPLETE).unlink(missing_ok=True)
                return
            if before is not None:
                self.remarks.add("begun-anew", name=self.name)
            begun = True
            self._empty()
            if self._job is not None:
                write_safely(self.folder / MANIFEST, json.dumps(dict(self._job.facts), indent=1).encode())

    def publish(self, path: Path) -> None:
        """Give the staged output, complete and synced to disk, its final name, replacing a file of that name."""
        write_safely(self.folder / COMPLETE, b"")
        rename_safely(self.staged, path)

    def leave(self, error: BaseException | None, frames: int, expected: int | None) -> None:
        """Release the folder, and remove it unless a later run can resume from it.

        It is kept if a run with a job stops after at least one finished frame; then a remark is added to the error as a
        note. An error in an input or option keeps nothing, since its correction makes another job.

        Parameters
        ----------
        error : BaseException or None
            Exception that ends the run.
        frames, expected : int
            Number of finished frames, and of all, None if unknown.
        """
        is_cut_short = error is not None and not isinstance(error, InputError | OptionError)
        keep = is_cut_short and frames > 0 and self._lock is not None and self._job is not None
        self.close(keep=keep)
        if keep and error is not None:
            remarks = Remarks()
            remarks.add("frames-finished", finished=frames, of_all="" if expected is None else f" of {expected}")
            error.add_note(remarks[0])

    def close(self, *, keep: bool) -> None:
        """Release the folder, and remove it unless it is to be kept; no effect if this run does not hold it."""
        if self._lock is None:
            return
        if not keep:
            with suppress(OSError):
                (self.folder / MANIFEST).unlink(missing_ok=True)  # first, as without it nothing is pending
                self._empty()
            self._remove_emptied()
        self._release()
        if not keep and sys.platform == "win32":  # which removes no file that is open
            self._remove_emptied()

    def _empty(self) -> None:
        """Remove all but the lock file, without which another run would take the folder meanwhile."""
        for path in self.folder.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != LOCK:
                path.unlink()

    def _remove_emptied(self) -> None:
        """Remove the lock file and the folder, unless another run has taken it just now."""
        with suppress(OSError):
            (self.folder / LOCK).unlink()
            self.folder.rmdir()

    def _acquire(self) -> None:
        """Create and lock the folder, as often as other runs remove it meanwhile.

        On disks without locks, it is taken with a remark. Raises `InUseError` if another run holds it.
        """
        for _ in range(MAX_ATTEMPTS):
            if self._lock is not None:
                return
            lock: BufferedRandom | None = None
            try:
                self.folder.mkdir(exist_ok=True)
                lock = (self.folder / LOCK).open("a+b")
                lock_file(lock)
                self._lock = lock
                if not os.path.samestat(os.fstat(lock.fileno()), (self.folder / LOCK).stat()):
                    self._release()
            except (FileNotFoundError, FileExistsError):  # another run has just removed it
                self._release()
                if not self.folder.parent.is_dir():
                    raise
            except KeyboardInterrupt:
                self._abandon(lock)
                raise
            except OSError as error:
                if lock is None:
                    raise
                if isinstance(error, BlockingIOError):
                    lock.close()
                    raise InUseError(
                        f"{self.name} is being written by another run; wait for it, or choose another name."
                    ) from None
                self.remarks.add("without-locks", name=self.name)
                self._lock = lock
        if self._lock is None:
            raise OutputError(f"{self.name} cannot be written because its folder keeps no file; choose another.")

    def _abandon(self, lock: BufferedRandom | None) -> None:
        """Remove the folder after an interruption while it was being locked, unless another run holds it."""
        with suppress(OSError):
            self._lock = lock or (self.folder / LOCK).open("a+b")
            try:
                lock_file(self._lock)
            except OSError:
                self._release()
            self.close(keep=self.is_pending)

    def _release(self) -> None:
        """Close the lock file, which unlocks the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _read_manifest(self) -> dict[str, str] | None:
        """Return the inputs and options of the earlier run; None if they cannot be read."""
        with suppress(OSError, ValueError):
            facts = json.loads((self.folder / MANIFEST).read_bytes())
            return facts if isinstance(facts, dict) else None
        return None

    def _check_same(self, before: Mapping[str, str], now: Mapping[str, str]) -> None:
        """Raise `OutputError`, which names the first difference, unless both jobs are the same."""
        for key in [*now, *before]:
            old = before.get(key, "nothing")
            new = now.get(key, "nothing")
            if old == new:
                continue
            what = key.rpartition(".")[2].replace("_", " ")
            wording = f"{old} and not {new}"
            if max(len(old), len(new)) > MAX_FACT_LENGTH:
                wording = f"that {'have' if what.endswith('s') else 'has'} changed since"
            advice = "give the same input and options, or start anew without `resume`."
            raise OutputError(f"{self.name} was begun with {what} {wording}; {advice}")


class StagedSink(ABC):
    """Base of sinks whose output appears as a whole when they are left without an error, or not at all.

    Some resume an earlier run of the same job: `completed_frames`, known when the sink is entered, is the number of
    frames, from the first, that it has finished. They are passed to `write` again in order, but their pixels are
    ignored.
    """

    completed_frames = 0
    _name: str
    """The output in messages."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the output after a normal end, then release everything; a failure to finish is raised."""
        try:
            if kind is None:
                with self._explained():
                    self._finish()
        except BaseException as failure:
            self._leave(failure)
            raise
        self._leave(error)

    def _explained(self) -> AbstractContextManager[None]:
        """Turn errors of the system in the block into sentences about the output."""
        return explained(OutputError, "write to", self._name, "check the free space and the permissions")

    @abstractmethod
    def _finish(self) -> None:
        """Give the complete output its final name."""

    @abstractmethod
    def _leave(self, error: BaseException | None) -> None:
        """Let go of everything, and remove what no later run can resume from."""


class UnfinishedOutput:
    """What a run that was stopped or killed has left of an output.

    Parameters
    ----------
    output : str or Path
        A video or a folder of images, which need not exist.
    """

    def __init__(self, output: str | Path) -> None:
        self._name = str(output)
        path = Path(output)
        self.places = (hidden_place(path.parent, path.name), hidden_place(path, IN_EXISTING_FOLDER))
        """Hidden folders that may be there: beside the output, or in a folder that was there before."""

    @property
    def is_resumable(self) -> bool:
        """Whether there is something with which another run can go on."""
        return any((place / MANIFEST).is_file() for place in self.places)

    def discard(self) -> None:
        """Remove it, unless another run writes there."""
        for place in self.places:
            # files that were set aside may be the only copies
            if (place / MANIFEST).is_file() and not (place / REPLACED).exists():
                with explained(OutputError, "remove", place, "check the permissions"):
                    self._remove(place)

    def discard_published(self) -> None:
        """Remove it if the run was killed after the output had got its name, unless a run holds it."""
        for place in self.places:
            is_over = (place / COMPLETE).is_file() or not (place / MANIFEST).is_file()
            if place.is_dir() and is_over and not (any(place.glob("output*")) or (place / REPLACED).exists()):
                with suppress(OSError, OutputError):
                    self._remove(place)

    def _remove(self, place: Path) -> None:
        """Remove a hidden folder; raise `InUseError` if another run holds it."""
        staging = StagingDirectory(place, "output", self._name, None)
        staging.open()
        staging.close(keep=False)


def complete_already(name: str) -> str:
    """Return the message for a run to be resumed whose output exists and has no unfinished part."""
    return f"{name} exists already and no run of it is unfinished, so it was left as it is."
