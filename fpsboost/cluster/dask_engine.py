"""Conversion by the workers of a Dask cluster: parts are planned and joined here, and are tasks that return paths.

A task is bound to the worker that it is meant for, so that a worker makes one part at a time with all its threads, and
nothing but this part is made again if it dies. Keys follow from the job: two clients that convert the same thing on one
scheduler wait for the same tasks.
"""

from __future__ import annotations

import logging
import os
import pickle
import shutil
import time
from asyncio import CancelledError
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Self
from uuid import uuid4

import dask
from distributed import Client, Future, KilledWorker, LocalCluster
from distributed.security import Security

from fpsboost import ConversionJob, FpsboostError, OptionError, OutputError, Part, RunOptions, Summary, join
from fpsboost.cluster.scheduler import MAX_LOST_WORKERS, Done, Failed, Progress, Report, run_parts
from fpsboost.cluster.worker import LOCK_INTERVAL, Outcome, PartTask, WorkerOrder, job_key, make_on_worker, read_piece
from fpsboost.contracts import SilentObserver
from fpsboost.errors import ClusterError, CompleteAlreadyError, InUseError, explained
from fpsboost.io.staging import sync
from fpsboost.parts.manifest import job_facts
from fpsboost.parts.plan import planned_job

PARTS_PER_WORKER = 8
"""Parts of a conversion for each worker; at the end, a worker idles for half of one on average."""

GROWN_CLUSTER = 32
"""Number of workers for which parts are cut at least: nodes of a batch system come one by one."""

WAIT_SECONDS = 0.5  # longest time that `DaskExecutor.wait` waits for a report

WORKERS_INTERVAL = 1.0
"""Seconds between questions to the scheduler which workers are there."""

CONNECT_SECONDS, REPLY_SECONDS = 10, 30
"""Time for a scheduler to accept a connection, and for the scheduler and workers to answer."""

PIECE_BYTES = 16 << 20
"""Bytes of a part's file that travel at a time where storage is not shared; worker, scheduler and client hold as many
in memory."""


def convert(job: ConversionJob, client: Client, *, run: RunOptions | None = None) -> Summary:
    """See `fpsboost.cluster.convert`; parts that earlier runs of the same job have made are taken over."""
    begin, run = time.perf_counter(), run or RunOptions()
    if client.asynchronous:
        raise OptionError("The client is asynchronous, and a conversion waits for its parts; give a synchronous one.")
    output = None if job.output is None else os.path.abspath(job.output)
    # as workers get it
    job = pickle.loads(pickle.dumps(replace(job, input=os.path.abspath(job.input), output=output)))
    given = [*["`in_place`"] * run.in_place, *["`chunk`"] * (run.chunk is not None), *run.side.given]
    if given:
        raise OptionError(
            f"`cluster` converts in parts, which does not work with {' or '.join(given)}; leave one of them out."
        )
    observer, progress = run.observer or SilentObserver(), Summary()
    workers = max(GROWN_CLUSTER, len(client.nthreads()))
    with planned_job(job, run, workers * PARTS_PER_WORKER) as (info, planned):
        assert job.output is not None, "it was opened"
        folders = {each.part: each.part.folder(job.output) for each in planned}
        missing = [each for each in planned if not folders[each.part].is_dir()]
        expected = sum(each.frames for each in planned)
        progress.completed_frames = expected - sum(each.frames for each in missing)
        observer.opened(info, expected)
        observer.ready()

        def wrote(frames: int) -> None:
            progress.frames_out = progress.completed_frames + frames
            progress.seconds = time.perf_counter() - begin
            observer.wrote(progress)

        with DaskExecutor(client, job, run) as executor:
            utilisation = run_parts(missing, executor, wrote)
    summary = _join(job.output, list(folders.values()), overwrite=run.overwrite)
    summary.completed_frames, summary.seconds = progress.completed_frames, time.perf_counter() - begin
    summary.utilisation = utilisation.sentence()
    return summary


def _join(output: str, parts: Sequence[Path], *, overwrite: bool) -> Summary:
    """Join the parts in these folders, and remove them; raise `CompleteAlreadyError` if another run has done that."""
    folder = parts[0].parent
    while True:
        try:
            summary = join(output, parts, overwrite=overwrite)
            break
        except InUseError:
            time.sleep(LOCK_INTERVAL)
        except FpsboostError:
            time.sleep(LOCK_INTERVAL)
            if folder.is_dir():
                raise
            raise CompleteAlreadyError(f"{output} was made by another run of the same job.") from None
    with suppress(OSError):  # with all parts at once, so that another run does not find some
        removed = folder.rename(folder.with_name(f".{folder.name}.joined"))
        shutil.rmtree(removed)
    return summary


@dataclass
class _Running:
    """Part that a worker makes."""

    worker: str
    future: Future[Outcome]
    was_missing: bool = False  # whether no worker had its task when the scheduler was asked for the last time


class DaskExecutor:
    """Executor whose workers are those of a Dask client, which stays open; paths of the parts are absolute."""

    def __init__(self, client: Client, job: ConversionJob, run: RunOptions) -> None:
        assert job.output is not None
        self._client, self._job, self._run, self._output, self._facts = client, job, run, job.output, job_facts(job)
        self._topic = f"fpsboost-{job_key(self._facts, job.output)}"
        self._mark = Part(1, 1).folder(job.output).with_name(f".{self._topic}.{uuid4().hex[:8]}")
        self._reports: SimpleQueue[Report | Exception] = SimpleQueue()
        self._running: dict[Part, _Running] = {}
        self._workers: list[str] = []
        self._asked = float("-inf")
        self._fetching = ThreadPoolExecutor(1, "fpsboost-fetch")
        self._call: Future[Any] | None = None

    def __enter__(self) -> Self:
        with explained(OutputError, "write to", self._mark.parent, "check the path and the permissions"):
            self._mark.parent.mkdir(exist_ok=True)
            self._mark.touch()
        self._client.subscribe_topic(self._topic, self._handle_event)
        return self

    def __exit__(self, *exception: object) -> None:
        self.cancel()
        self._fetching.shutdown()
        with suppress(Exception):  # the scheduler may be gone
            self._client.unsubscribe_topic(self._topic)
        self._mark.unlink(missing_ok=True)

    def workers(self) -> Sequence[str]:
        """Return the names of the workers; the scheduler is asked for them now and then."""
        now = time.monotonic()
        if now - self._asked < WORKERS_INTERVAL:
            return self._workers
        self._asked = now
        try:
            assert self._client.scheduler is not None
            processing = self._client.sync(self._client.scheduler.processing, callback_timeout=REPLY_SECONDS)
        except (OSError, TimeoutError) as error:
            raise self._scheduler_gone() from error
        self._workers = list(processing)
        on_workers = {key for keys in processing.values() for key in keys}
        for part, running in list(self._running.items()):
            # a result may be on its way, so only what was missing the last time, too, is lost
            is_missing = running.future.key not in on_workers and not running.future.done()
            if is_missing and running.was_missing:
                self._release(part)
                self._reports.put(Failed(part, running.worker))
            running.was_missing = is_missing
        # while there is none, a task for any worker, so that a cluster that starts them on demand does
        if not self._workers and self._call is None:
            self._call = self._client.submit(os.getpid, key=f"{self._topic}-call", pure=False)
        elif self._workers:
            self._call = None
        return self._workers

    def submit(self, part: Part, worker: str, attempt: int) -> None:
        task = PartTask(self._job, part, self._run.threads, self._run.limit)
        order = WorkerOrder(pickle.dumps(task), self._facts, str(self._mark), self._topic)
        key = f"{self._topic}-{part.number}-of-{part.count}-{attempt}"
        future = self._client.submit(make_on_worker, order, key=key, workers=[worker], pure=False)
        self._running[part] = _Running(worker, future)
        future.add_done_callback(lambda done: self._handle_end(part, worker, done))

    def wait(self) -> list[Report]:
        """Return the reports that have come; raises `ClusterError` if the scheduler is gone."""
        received: list[Report | Exception] = []
        with suppress(Empty):
            received.append(self._reports.get(timeout=WAIT_SECONDS))
            while True:
                received.append(self._reports.get_nowait())
        reports: list[Report] = []
        for report in received:
            if isinstance(report, Exception):
                raise report
            if not isinstance(report, Progress):
                self._release(report.part)
            reports.append(report)
        return reports

    def cancel(self) -> None:
        """Release all tasks; another client that waits for one keeps it running."""
        for part in list(self._running):
            self._release(part)
        self._fetching.shutdown(cancel_futures=True)

    def _release(self, part: Part) -> None:
        """Tell Dask that the result of a part's task is not wanted any more."""
        running = self._running.pop(part, None)
        if running is not None:
            with suppress(Exception):  # the scheduler may be gone
                running.future.release()

    def _handle_event(self, event: tuple[float, Mapping[str, Any]]) -> None:
        _, message = event
        self._reports.put(Progress(Part(*map(int, message["part"].split("/"))), message["frames"]))

    def _handle_end(self, part: Part, worker: str, future: Future[Outcome]) -> None:
        """Handle the end of a task; called in a thread of Dask."""
        running = self._running.get(part)
        if running is None or running.future is not future:
            return
        if future.status == "cancelled":
            self._reports.put(self._scheduler_gone())
            return
        try:
            outcome = future.result(timeout=REPLY_SECONDS)
        except (OSError, TimeoutError, KilledWorker, CancelledError):  # a worker that has died with its result
            self._reports.put(Failed(part, worker))
            return
        except Exception as error:  # it cannot even read its task
            reason = f"{type(error).__name__}: {error}"
            sentence = f"The worker at {worker} cannot run fpsboost ({reason}); install the same version there."
            self._reports.put(Failed(part, worker, ClusterError(sentence)))
            return
        if outcome.is_stopped:
            self._reports.put(Failed(part, worker))
        elif outcome.error is not None:
            self._reports.put(Failed(part, worker, outcome.error))
        elif not outcome.is_private and (part.folder(self._output).is_dir() or not self._mark.exists()):
            self._reports.put(Done(part))  # another client of this job may have joined and removed it
        else:
            with suppress(RuntimeError):  # cancelled meanwhile
                self._fetching.submit(self._fetch, part, worker, outcome)

    def _fetch(self, part: Part, worker: str, outcome: Outcome) -> None:
        """Copy the files of a part from a worker's own disk, and remove them there."""
        folder = part.folder(self._output)
        place = folder.with_name(f".{folder.name}.{uuid4().hex[:8]}")
        copy = place / "copy"
        try:
            with explained(OutputError, "write to", folder, "check the free space and the permissions"):
                copy.mkdir(parents=True)
                for name, size in (outcome.sizes or {}).items():
                    self._copy(worker, os.path.join(outcome.folder, name), size, copy / name)
                sync(copy)
                if not folder.is_dir():
                    copy.rename(folder)
            if outcome.is_private:
                self._client.run(shutil.rmtree, outcome.folder, ignore_errors=True, workers=[worker], on_error="ignore")
            self._reports.put(Done(part))
        except _WorkerLostError:
            self._reports.put(Failed(part, worker))
        except Exception as error:
            self._reports.put(Failed(part, worker, error))
        finally:
            shutil.rmtree(place, ignore_errors=True)

    def _copy(self, worker: str, path: str, size: int, target: Path) -> None:
        with target.open("wb") as file:
            for begin in range(0, size, PIECE_BYTES):
                try:
                    pieces = self._client.run(read_piece, path, begin, PIECE_BYTES, workers=[worker], on_error="raise")
                except Exception as error:
                    raise _WorkerLostError from error
                file.write(pieces[worker])
            file.flush()
            os.fsync(file.fileno())

    def _scheduler_gone(self) -> ClusterError:
        address = self._client.scheduler.address if self._client.scheduler is not None else "the cluster"
        return ClusterError(f"The scheduler at {address} is gone; start it again, or leave `cluster` out.")


class _WorkerLostError(Exception):
    """Raised where a worker does not answer."""


@contextmanager
def local_client(workers: int) -> Iterator[Client]:
    """Start a scheduler and workers with one thread each on this machine; stop them at the end."""
    settings = {
        "distributed.scheduler.allowed-failures": MAX_LOST_WORKERS,
        "distributed.worker.profile.enabled": False,  # takes a tenth of the time of Python code in threads
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,  # what a conversion takes is checked before it begins
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@contextmanager
def remote_client(address: str) -> Iterator[Client]:
    """Connect to a scheduler with the certificates of Dask's configuration; raise `ClusterError` if that fails."""
    if address.startswith("tls://") and Security().get_connection_args("client").get("ssl_context") is None:
        raise ClusterError(
            f"{address} needs certificates, and Dask's configuration names none; set distributed.comm.tls.ca-file, and "
            "cert and key of distributed.comm.tls.client."
        )
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, RuntimeError, ValueError) as error:
            raise ClusterError(f"There is no scheduler at {address} ({error}); check the address.") from error
        with client:
            yield client


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from logging that a scheduler is gone, which is said in one sentence."""
    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)
