"""The page's queue of conversions, each a command line in a process of its own, which can be stopped and resumed."""

import json
import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from io import BufferedRandom
from pathlib import Path
from threading import Condition, Thread
from typing import Any, Literal

from fpsboost import FpsboostError, InputError, InUseError, OptionError, OutputError, Target
from fpsboost.cli.errors import explain
from fpsboost.extension import Remarks, UnfinishedOutput, explained, lock_file, write_safely
from fpsboost.ui.choices import on_page, remarks_on_page
from fpsboost.ui.files import Files

State = Literal["waiting", "running", "stopping", "paused", "done", "failed"]
"""State of a job; "stopping" lasts until its process has ended."""

BEGINS_ANEW = "Paused; no part of it could be kept, so it starts again from the beginning."
"""State of a job that was paused before any part of its output was kept."""

PRIVATE = 0o600
"""Mode of files with paths or a token, which other users of this machine must not read."""

MAX_JOBS = 100
"""Maximum number of jobs in the queue."""


@dataclass
class Job:
    """Conversion in the queue: its command line, and its progress."""

    number: int
    """Number by which the page names it."""
    words: list[str]
    """Words of the command line: program, input, output, options."""
    output: str
    """Path of the output."""
    state: State = "waiting"
    frame: int = 0
    """Output frames that are complete."""
    finished: int = 0
    """Those that the next run need not compute, as the last one has said."""
    frames: int | None = None
    """Output frames of the whole conversion; None if unknown."""
    fps: float | None = None
    """Output frames per second of the current run."""
    message: str = ""
    """Sentence about the state, empty while it runs."""
    remarks: list[str] = field(default_factory=list)
    """Notes of the conversion, in the terms of the page."""

    @property
    def arguments(self) -> list[str]:
        """Arguments of the next run, which continues where the last one has stopped if the kind of output allows it."""
        words = [*self.words[1:], "--progress", "json"]
        resumes = self.frame > 0 and Target.parse(self.output).kind in ("video", "images")
        return [*words, "--resume"] if resumes else words

    def take(self, report: dict[str, Any]) -> None:
        """Update the job with the progress that a run reports."""
        for name in ("frame", "frames", "fps", "finished"):
            setattr(self, name, report.get(name, getattr(self, name)))
        remarks = remarks_on_page(Remarks.from_json(report.get("remarks", [])), self.words[1], self.output)
        self.remarks = list(dict.fromkeys([*self.remarks, *remarks]))

    def pause(self, kept: int, message: str) -> None:
        """Pause with `kept` frames that the next run need not compute; if there are none, `message` is the reason."""
        self.state = "paused"
        self.frame = kept
        of_all = f" of {self.frames}" if self.frames else ""
        self.message = f"Paused at {kept}{of_all} frames." if kept else message


class Queue:
    """Jobs, of which one at a time runs until the queue is closed; a file keeps them from one start to the next."""

    def __init__(self, path: Path, files: Files | None = None) -> None:
        """Load the jobs of the last start.

        Parameters
        ----------
        path : Path
            File of the queue.
        files : Files, optional
            Files that jobs may read and write; by default all.

        Raises
        ------
        InUseError
            Another process has opened the queue.
        """
        self._path = path
        self._files = files or Files()
        self._changed = Condition()
        self._lock = _locked(path)
        try:
            jobs = [replace(job, number=number) for number, job in enumerate(_read(path), 1)]
            self.outside = [job for job in jobs if not self._is_inside(job)]  # which are kept, and do not run
            self._jobs = {job.number: job for job in jobs if job not in self.outside}
            self._process: subprocess.Popen[str] | None = None
            self._closed = False
            with self._changed:
                self._save()
        except BaseException:
            self._lock.close()
            raise
        self._thread = Thread(target=self._work, name="jobs", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the running job, which is paused for the next start."""
        with self._changed:
            self._closed = True
            self._stop()
            self._changed.notify_all()
        self._thread.join()
        self._lock.close()

    def listing(self) -> list[dict[str, Any]]:
        """Return all jobs as plain data."""
        with self._changed:
            return [asdict(job) for job in self._jobs.values()]

    def job(self, number: int) -> Job:
        """Return a job by its number; raise `OptionError` if there is none."""
        with self._changed:
            if number not in self._jobs:
                raise OptionError(f"There is no job {number} in the queue; reload the page.")
            return self._jobs[number]

    def add(self, *commands: list[str]) -> list[int]:
        """Add jobs by the words of their command lines, the third of which is the output, and return their numbers.

        Raises `OptionError`, and adds none, if there are too many, or another job writes the same output.
        """
        with self._changed:
            count = len(self._jobs)
            outputs = [*self.outputs(), *(words[2].rstrip("/") for words in commands)]
            twice = next((output for output in outputs if outputs.count(output) > 1), None)
            if count + len(commands) > MAX_JOBS:
                raise OptionError(f"The queue is full, with {count} of {MAX_JOBS} jobs; remove some first.")
            if twice is not None:
                raise OptionError(f"Another job in the queue writes {twice}; choose another name.")
            first = max((job.number for job in self._all), default=0) + 1
            jobs = {number: Job(number, words, words[2]) for number, words in enumerate(commands, first)}
            self._jobs |= jobs
            self._save()
            return list(jobs)

    def outputs(self) -> set[str]:
        """Return the outputs of all jobs that are not done, folders without a slash at the end."""
        with self._changed:
            return {job.output.rstrip("/") for job in self._jobs.values() if job.state != "done"}

    def pause(self, number: int) -> None:
        """Stop a job, so that it can continue later."""
        with self._changed:
            job = self.job(number)
            if job.state == "running":
                job.state = "stopping"
                self._stop()
            elif job.state == "waiting":
                job.pause(job.frame, "Paused before it began.")
            self._save()

    def resume(self, number: int) -> None:
        """Let a paused job continue, or try a failed one again."""
        with self._changed:
            job = self.job(number)
            if job.state in ("paused", "failed"):
                job.state = "waiting"
                job.message = ""
            self._save()

    def remove(self, number: int) -> None:
        """Remove a job and its unfinished output; a finished output stays."""
        with self._changed:
            job = self.job(number)
            self.pause(number)
            self._changed.wait_for(lambda: job.state != "stopping")
            if job.state != "done":
                UnfinishedOutput(job.output).discard()
            self._jobs.pop(number, None)
            self._save()

    def _save(self) -> None:
        """Notify threads that wait for a change, and write the jobs to the file."""
        self._changed.notify_all()
        with explained(OutputError, "write to", self._path, "check the permissions"):
            write_safely(self._path, json.dumps([asdict(job) for job in self._all]).encode(), PRIVATE)

    @property
    def _all(self) -> list[Job]:
        """Jobs of the page, and those outside of its folder."""
        return [*self._jobs.values(), *self.outside]

    def _is_inside(self, job: Job) -> bool:
        """Return whether a job reads and writes only files that the page may use."""
        with suppress(InputError, OutputError):
            self._files.check_job(job.words[1], job.output)
            return True
        return False

    def _stop(self) -> None:
        """Terminate the process of the running job, which then keeps its finished frames."""
        if self._process is not None:
            self._process.terminate()

    def _work(self) -> None:
        """Run waiting jobs until the queue is closed; the thread's function."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or "waiting" in (job.state for job in self._jobs.values()))
                if self._closed:
                    return
                job = next(job for job in self._jobs.values() if job.state == "waiting")
                job.state = "running"
                job.fps = None
                job.finished = job.frame
                with suppress(OutputError):
                    self._save()
            try:  # without holding up the page, since the disk may be slow
                self._files.check_job(job.words[1], job.output)  # which may have become links
                process = start_process(job.arguments)
            except (OSError, FpsboostError) as error:
                self._end(job, explain(error), 1)
                continue
            with self._changed:
                self._process = process
                if self._closed or self.job(job.number).state == "stopping":  # meanwhile
                    self._stop()
            self._end(job, *self._follow(job, process))

    def _follow(self, job: Job, process: subprocess.Popen[str]) -> tuple[str, int]:
        """Update a job with the progress of its process until that ends; return its messages and its exit code."""
        lines = deque[str](maxlen=20)  # a broken run may print a lot
        assert process.stderr is not None, "it is a pipe"
        with process.stderr as report:
            for line in report:
                try:
                    values = dict(json.loads(line))
                except (TypeError, ValueError):
                    lines.append(line.strip().removeprefix("fpsboost: "))
                else:
                    with self._changed:
                        job.take(values)
                        self._changed.notify_all()
        code = process.wait()
        return " ".join(lines) or f"The conversion ended with code {code} and without a message.", code

    def _end(self, job: Job, message: str, code: int) -> None:
        """Set the state of a job whose run has ended."""
        is_kept = UnfinishedOutput(job.output).is_resumable
        with self._changed:
            self._process = None
            is_stopped = self._closed or job.state == "stopping"
            if code == 0:
                job.state = "done"
                job.message = ""
            else:
                job.pause(job.finished * is_kept, BEGINS_ANEW)
                if not is_stopped:
                    job.state = "failed"
                    job.message = on_page(message)
            with suppress(OutputError):  # on a full disk jobs go on; the next change writes all of them
                self._save()


def start_process(words: list[str], stdout: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
    """Start the command line in a process of its own, whose messages can be read."""
    return subprocess.Popen(
        [sys.executable, "-m", "fpsboost", *words],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
    )


def _locked(path: Path) -> BufferedRandom:
    """Return a file that is locked as long as it is open, so that only one process opens the queue."""
    with explained(OutputError, "write to", path, "check the permissions"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.parent.chmod(0o700)  # also one that an earlier version has made
        file = path.with_suffix(".lock").open("a+b")
    try:
        lock_file(file)
    except BlockingIOError:
        file.close()
        raise InUseError("fpsboost ui is already running; stop it, or leave the folder out to open its page.") from None
    except OSError:  # a disk without locks
        pass
    return file


def _read(path: Path) -> list[Job]:
    """Return the jobs of the last start, paused if they were not done; none at the first start."""
    try:
        jobs = [Job(**each) for each in json.loads(path.read_bytes())]
        if any(len(job.words) < 3 or {str} != {*map(type, [job.output, *job.words])} for job in jobs):
            raise ValueError("a job has no words")
    except FileNotFoundError:
        return []
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(f"{path} is not a queue of fpsboost ui; move it away.") from error
    for job in jobs:
        if job.state in ("running", "stopping"):  # its server was killed
            is_kept = UnfinishedOutput(job.output).is_resumable
            job.pause(0, "Interrupted; it goes on from the last chunk that was finished." if is_kept else BEGINS_ANEW)
            job.frame = int(is_kept)
        elif job.state == "waiting":
            job.pause(job.frame, "Paused before it began.")
    return jobs
