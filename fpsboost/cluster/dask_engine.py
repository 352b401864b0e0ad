"""Conversion on the workers of a Dask cluster: parts are planned and joined here, and each part is a task.

A task is bound to a worker, so that a worker computes one part at a time with all its threads, and only this part is
repeated if it dies. Largest parts go first, so that the last ones to finish are small. A part whose worker dies, or
that fails for a reason that may lie with the worker, is computed again, elsewhere if possible. Keys follow from the
job: two clients that convert the same thing on one scheduler wait for the same tasks.
"""

import concurrent.futures
import os
import pickle
import shutil
import time
from asyncio import CancelledError
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event
from typing import Any
from uuid import uuid4

from distributed import Client, Future, KilledWorker

from fpsboost.cluster import ClusterError
from fpsboost.cluster.worker import (
    LOCK_INTERVAL,
    Outcome,
    WorkerLostError,
    WorkerOrder,
    job_key,
    make_on_worker,
    read_piece,
)
from fpsboost.conflicts import check_together
from fpsboost.contracts import Summary
from fpsboost.errors import (
    CompleteAlreadyError,
    ExistsError,
    FpsboostError,
    InputError,
    InUseError,
    OptionError,
    OutputError,
    explained,
)
from fpsboost.media import sync
from fpsboost.options import checked
from fpsboost.parts.join import join
from fpsboost.parts.manifest import job_facts
from fpsboost.parts.plan import planned_job
from fpsboost.preparation import ConversionJob
from fpsboost.run_options import Part, RunObserver, RunOptions

PARTS_PER_WORKER = 8
"""Parts of a conversion for each worker: at the end, a worker idles for half of one on average, while each part costs
the start of a run and a few frames that are read again."""

GROWN_CLUSTER = 32
"""Minimum number of workers for which parts are cut: nodes of a batch system come one by one."""

MAX_FAILURES = 3
"""Number of times that a part may fail with an error; the last error is raised then. Errors of the input or of the
options are raised at once, as another attempt would fail too."""

MAX_LOST_WORKERS = 10
"""Number of workers that may die with the same part; nodes that are taken away at any time need more than a few."""

WAIT_SECONDS = 0.5
"""Longest time between two checks of the workers, seconds; the end or progress of a task is noticed at once."""

WORKERS_INTERVAL = 1.0
"""Seconds between requests to the scheduler for the list of workers."""

REPLY_SECONDS = 30
"""Time limit of an answer of the scheduler or a worker, seconds."""

PIECE_BYTES = 16 << 20
"""Bytes of a part's file that are sent at a time where storage is not shared; worker, scheduler and client each hold
one such piece in memory."""


@checked
def convert(job: ConversionJob, client: Client, *, run: RunOptions | None = None) -> Summary:
    """Convert a clip; see `fpsboost.cluster.convert`. Complete parts of earlier runs of the same job are used."""
    begin = time.perf_counter()
    run = run or RunOptions()
    if client.asynchronous:
        raise OptionError("The client is asynchronous, and a conversion waits for its parts; give a synchronous one.")
    check_together(job.names_given() | run.names_given() | {"cluster"})
    output = os.path.abspath(job.target(run).path)
    # the job as workers get it, so that its facts are the same on both sides
    job = replace(job, input=os.path.abspath(job.input), output=output, decoding=job.decoding.absolute())
    job = pickle.loads(pickle.dumps(job))
    observer = RunObserver(run)
    progress = Summary()
    with planned_job(job, run, max(GROWN_CLUSTER, len(client.nthreads())) * PARTS_PER_WORKER) as (info, planned):
        folders = [part.folder(output) for part in planned]
        missing = {part: frames for part, frames in planned.items() if not part.folder(output).is_dir()}
        expected = sum(planned.values())
        progress.completed_frames = expected - sum(missing.values())
        observer.opened(info, expected)
        observer.ready()

        def wrote(frames: int) -> None:
            progress.frames_out = progress.completed_frames + frames
            progress.seconds = time.perf_counter() - begin
            observer.wrote(progress)

        _Parts(client, job, run, missing).make(wrote)
    summary = _join(output, folders, overwrite=run.overwrite)
    summary.completed_frames = progress.completed_frames
    summary.seconds = time.perf_counter() - begin
    return summary


def _join(output: str, parts: Sequence[Path], *, overwrite: bool) -> Summary:
    """Join the parts in these folders, and remove them; raise `CompleteAlreadyError` if another run has done so."""
    folder = parts[0].parent
    while True:
        try:
            summary = join(output, parts, overwrite=overwrite)
            break
        except InUseError:
            time.sleep(LOCK_INTERVAL)
        except FpsboostError as error:
            # the output did not exist when the parts were planned; the run that has written it removes the parts next
            if folder.is_dir() and not isinstance(error, ExistsError):
                raise
            raise CompleteAlreadyError(f"{output} was written by another run of the same job.") from None
    with suppress(OSError):  # all parts at once, so that another run does not find only some of them
        shutil.rmtree(folder.rename(folder.with_name(f".{folder.name}.joined")))
    return summary


@dataclass
class _Attempts:
    """Attempts to compute one part so far, which decide whether and where it is tried again."""

    count: int = 0
    """Number of attempts."""
    failures: int = 0
    """Number of attempts that ended with an error."""
    lost_workers: int = 0
    """Number of workers that died."""
    failed_on: set[str] = field(default_factory=set)
    """Addresses of the workers on which it failed."""

    def fail(self, part: Part, worker: str, error: Exception) -> None:
        """Count a failure; raise its error if another attempt is useless."""
        if isinstance(error, WorkerLostError):
            self.lost_workers += 1
            if self.lost_workers >= MAX_LOST_WORKERS:
                raise ClusterError(
                    f"{self.lost_workers} workers died while they made part {part}, the last one at {worker}; "
                    "check the system's logs, for example for lack of memory."
                )
            return
        self.failures += 1
        self.failed_on.add(worker)
        if isinstance(error, InputError | OptionError | ClusterError) or self.failures >= MAX_FAILURES:
            raise error


@dataclass
class _Running:
    """Part that a worker computes, whose files are then copied if they lie on a disk of the worker alone."""

    part: Part
    worker: str
    """Address of the worker."""
    future: Future[Outcome]
    """Result of the task."""
    copy: concurrent.futures.Future[None] | None = None
    """Copy of its files to the folder of parts, once it has begun."""
    times_missing: int = 0  # how often in a row no worker had the task when the scheduler was asked


class _Parts:
    """Parts of a conversion that the workers of a Dask client compute; the client stays open."""

    def __init__(self, client: Client, job: ConversionJob, run: RunOptions, planned: Mapping[Part, int]) -> None:
        assert job.output is not None
        assert client.scheduler is not None
        self._client = client
        self._job = job
        self._run = run
        self._output = job.output
        self._facts = job_facts(job)
        self._topic = f"fpsboost-{job_key(self._facts, os.fspath(job.output))}"
        self._mark = Part(1, 1).folder(job.output).with_name(f".{self._topic}.{uuid4().hex[:8]}")
        self._planned = planned
        self._waiting = set(planned)
        self._attempts = {part: _Attempts() for part in planned}
        self._reported = dict.fromkeys(planned, 0)
        """Output frames that each part has had; one that is made again counts only what it has more than before."""
        self._running: list[_Running] = []
        self._news = Event()  # set, in threads of Dask, when a task has ended or reported frames
        self._scheduler = client.scheduler
        self._workers = set[str]()
        self._asked = float("-inf")
        self._copying = ThreadPoolExecutor(1, "fpsboost-copy")

    def make(self, wrote: Callable[[int], None]) -> None:
        """Compute all parts; `wrote` gets their total number of output frames whenever it rises.

        If an error ends this, a note says how to continue.
        """
        known = 0
        with explained(OutputError, "write to", self._mark.parent, "check the path and the permissions"):
            self._mark.parent.mkdir(exist_ok=True)
            self._mark.touch()
        self._client.subscribe_topic(self._topic, self._handle_event)
        try:
            while self._waiting or self._running:
                self._ask_for_workers()
                self._submit_to_free()
                self._news.wait(WAIT_SECONDS)
                self._news.clear()
                for running in list(self._running):
                    self._look_at(running)
                frames = sum(self._reported.values())
                if frames > known:
                    known = frames
                    wrote(frames)
        except (KeyboardInterrupt, OutputError, ClusterError) as error:
            complete = len(self._reported) - len(self._waiting) - len(self._running)
            note = f"{complete} of {len(self._reported)} parts are complete; `resume` goes on with them."
            error.__notes__ = [note]
            raise
        finally:
            for running in self._running:
                running.future.release()  # another client that waits for a task keeps it running
            self._copying.shutdown(cancel_futures=True)
            with suppress(Exception):  # the scheduler may be gone
                self._client.unsubscribe_topic(self._topic)
            self._mark.unlink(missing_ok=True)

    def _ask_for_workers(self) -> None:
        """Update the list of workers, and notice running tasks that no worker has any more."""
        now = time.monotonic()
        if now - self._asked < WORKERS_INTERVAL:
            return
        self._asked = now
        try:
            tasks = self._client.sync(self._scheduler.processing, callback_timeout=REPLY_SECONDS)
        except (OSError, TimeoutError) as error:
            raise self._scheduler_gone() from error
        self._workers = set(tasks)
        keys = {key for of_worker in tasks.values() for key in of_worker}
        for running in self._running:
            running.times_missing = 0 if running.future.key in keys else running.times_missing + 1

    def _submit_to_free(self) -> None:
        """Give the next part to every worker that is free."""
        busy = {running.worker for running in self._running}
        for worker in self._workers - busy:
            # the largest part that has not failed on this worker, or has failed on all of them
            for part in largest_first(self._planned):
                failed_on = self._attempts[part].failed_on
                if part in self._waiting and (worker not in failed_on or failed_on.issuperset(self._workers)):
                    self._waiting.remove(part)
                    self._submit(part, worker)
                    break

    def _submit(self, part: Part, worker: str) -> None:
        """Submit a part as a task to a worker."""
        attempts = self._attempts[part]
        run = RunOptions(chunk=part, resume=True, threads=self._run.threads, limit=self._run.limit)
        order = WorkerOrder(pickle.dumps((self._job, run)), self._facts, str(self._mark), self._topic)
        key = f"{self._topic}-{part.number}-of-{part.count}-{attempts.count}"
        attempts.count += 1
        future = self._client.submit(make_on_worker, order, key=key, workers=[worker], pure=False)
        self._running.append(_Running(part, worker, future))
        future.add_done_callback(lambda _: self._news.set())

    def _handle_event(self, event: tuple[float, Mapping[str, Any]]) -> None:
        """Record the progress that a worker has logged; called in a thread of Dask."""
        _, message = event
        part = Part(*map(int, message["part"].split("/")))
        if part in self._reported:
            self._reported[part] = max(self._reported[part], message["frames"])
            self._news.set()

    def _look_at(self, running: _Running) -> None:
        """Record a part that is complete, or queue it again if it has failed."""
        part = running.part
        try:
            if not self._is_complete(running):
                return
            self._reported[part] = self._planned[part]
        except Exception as error:
            self._attempts[part].fail(part, running.worker, error)
            self._waiting.add(part)
        self._running.remove(running)
        running.future.release()

    def _is_complete(self, running: _Running) -> bool:
        """Return whether a part is complete; start its copy if that is needed.

        Raises the error of the task, or `WorkerLostError` if its worker is lost.
        """
        part = running.part
        future = running.future
        if running.copy is not None:
            return running.copy.done() and running.copy.result() is None
        if not future.done():
            if running.times_missing > 1:  # if only once, it may be in transit
                raise WorkerLostError
            return False
        if future.cancelled():
            raise self._scheduler_gone()
        try:
            outcome = future.result(timeout=REPLY_SECONDS)
        except (OSError, TimeoutError, KilledWorker, CancelledError) as error:  # a worker that has died with its result
            raise WorkerLostError from error
        except Exception as error:  # it cannot even read its task
            raise ClusterError(
                f"The worker at {running.worker} cannot run fpsboost ({type(error).__name__}: {error}); install the "
                "same version there."
            ) from error
        if outcome.error is not None:
            raise outcome.error
        if not outcome.is_private and (part.folder(self._output).is_dir() or not self._mark.exists()):
            return True  # another client of this job may have joined and removed it
        running.copy = self._copying.submit(self._copy_part, part, running.worker, outcome)
        running.copy.add_done_callback(lambda _: self._news.set())
        return False

    def _copy_part(self, part: Part, worker: str, outcome: Outcome) -> None:
        """Copy the files of a part from a worker's own disk, and remove them there; runs in the thread for copies."""
        folder = part.folder(self._output)
        copy = folder.with_name(f".{folder.name}.{uuid4().hex[:8]}")
        try:
            with explained(OutputError, "write to", folder, "check the free space and the permissions"):
                copy.mkdir()
                for name, size in (outcome.sizes or {}).items():
                    self._copy(worker, os.path.join(outcome.folder, name), size, copy / name)
                sync(copy)
                if not folder.is_dir():
                    copy.rename(folder)
            if outcome.is_private:
                self._client.run(shutil.rmtree, outcome.folder, ignore_errors=True, workers=[worker], on_error="ignore")
        finally:
            shutil.rmtree(copy, ignore_errors=True)

    def _copy(self, worker: str, path: str, size: int, target: Path) -> None:
        """Copy a file from a worker, piece by piece, and flush it to the disk."""
        with target.open("wb") as file:
            for begin in range(0, size, PIECE_BYTES):
                try:
                    pieces = self._client.run(read_piece, path, begin, PIECE_BYTES, workers=[worker], on_error="raise")
                except Exception as error:
                    raise WorkerLostError from error
                file.write(pieces[worker])
        sync(target)

    def _scheduler_gone(self) -> ClusterError:
        """Return the error for a scheduler that does not answer any more."""
        return ClusterError(
            f"The scheduler at {self._scheduler.address} is gone; start it again, or leave `cluster` out."
        )


def largest_first(planned: Mapping[Part, int]) -> list[Part]:
    """Return parts by their frames in the order in which they are computed, those of one size by their numbers."""
    return sorted(planned, key=lambda part: (-planned[part], part.number))
