"""Code that runs in a Dask worker: comparison of the worker with the client, and computation of parts.

A thread cannot be stopped from outside, so a part checks at every frame whether Dask still needs its result: it does
not once every client that has requested it has cancelled it, has ended, or has lost its connection.
"""

import hashlib
import json
import os
import pickle
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from dask.typing import Key
from distributed import Worker, get_worker
from distributed.core import Status

from fpsboost.cluster import ClusterError
from fpsboost.conversion import convert_job
from fpsboost.errors import CompleteAlreadyError, FpsboostError, InputError, InUseError
from fpsboost.parts.manifest import first_difference, job_facts, program_facts
from fpsboost.preparation import ConversionJob
from fpsboost.run_options import RunOptions
from fpsboost.threads import one_opencv_thread

REPORT_INTERVAL = 0.5  # seconds between reports of a part's progress

LOCK_INTERVAL = 1.0
"""Seconds between attempts to lock a part that another run is computing."""


@dataclass(frozen=True)
class WorkerOrder:
    """Order to a worker to compute a part."""

    task: bytes  # pickled job and options of the run, read only after the facts agree, as versions may differ
    facts: Mapping[str, str]  # versions, input and options of the client, which the worker must share
    mark: str  # path of a file in the folder of the parts, which a worker can see if storage is shared
    topic: str  # topic of Dask under which progress is logged


@dataclass(frozen=True)
class Outcome:
    """Result of an order; it has a folder unless there is an error."""

    folder: str = ""  # path of the part, on the worker
    is_private: bool = False  # whether it lies in the worker's own folder, since storage is not shared
    sizes: Mapping[str, int] | None = None  # sizes of the part's files by their names, bytes
    error: Exception | None = None
    """Error that ended the attempt, which the client raises or counts; None if there was none."""


class WorkerLostError(FpsboostError):
    """Raised if a worker has died, does not answer, or was closed; and in a part that is not needed any more."""


def make_on_worker(order: WorkerOrder) -> Outcome:
    """Compute a part in the Dask worker that calls this."""
    worker = get_worker()
    key = worker.get_current_task()
    try:
        return _carry_out(order, worker, partial(_check_wanted, worker, key))
    except FpsboostError as error:
        return Outcome(error=error)
    except Exception as error:  # as text, since the client may be unable to unpickle it
        return Outcome(error=RuntimeError("".join(traceback.format_exception(error))))


def _carry_out(order: WorkerOrder, worker: Worker, check: Callable[[], None]) -> Outcome:
    """Compare versions and results with the client, then compute the part.

    Where storage is not shared, it is written into a private folder.
    """
    for name, here in program_facts().items():  # before the task is unpickled, which needs the same versions
        if order.facts.get(name) != here:
            raise ClusterError(
                f"The worker at {worker.address} has {here}, and the client {order.facts.get(name)}; install the same "
                "versions everywhere."
            )
    job, run = pickle.loads(order.task)
    _check_job_once(order, job, worker.address)
    is_private = not os.path.exists(order.mark)
    if is_private:
        place = Path(worker.local_directory) / "fpsboost" / order.topic
        place.mkdir(parents=True, exist_ok=True)
        job = replace(job, output=str(place / Path(job.output).name))

    next_report = 0.0

    def report(frames: int, expected: int | None) -> None:
        """Check whether to continue, and report the number of frames if the last report is long enough ago."""
        nonlocal next_report
        check()
        now = time.monotonic()
        if now >= next_report:
            next_report = now + REPORT_INTERVAL
            worker.log_event(order.topic, {"part": str(run.chunk), "frames": frames})

    make_part(job, replace(run, threads=run.threads or worker.state.nthreads, progress=report), check)
    folder = run.chunk.folder(job.output)
    return Outcome(str(folder), is_private, {path.name: path.stat().st_size for path in folder.iterdir()})


def make_part(job: ConversionJob, run: RunOptions, check: Callable[[], None]) -> None:
    """Compute a part, using the results of an earlier attempt; wait if another run is computing it.

    While it waits, it calls `check`, which raises an exception to stop.
    """
    with one_opencv_thread(), suppress(CompleteAlreadyError):
        while True:
            try:
                convert_job(job, run)
                return
            except InUseError:
                check()
                time.sleep(LOCK_INTERVAL)


def job_key(facts: Mapping[str, str], output: str) -> str:
    """Return a name for a conversion to an output, the same in every process: 16 hexadecimal digits.

    It names the tasks of the job, so that two clients of one scheduler wait for the same tasks.
    """
    return hashlib.sha256(json.dumps([sorted(facts.items()), output]).encode()).hexdigest()[:16]


def _check_job_once(order: WorkerOrder, job: ConversionJob, place: str) -> None:
    """Raise `ClusterError` if this worker has another input, or computes other pixels; once per process and job."""
    if order.topic in _checked:
        return
    try:
        here = job_facts(job)
    except InputError as error:
        raise ClusterError(f"The worker at {place} cannot read the input: {error}") from error
    difference = first_difference(order.facts, here)
    if difference == "input":
        raise ClusterError(
            f"The worker at {place} has a different file under the name of the input; copy the input there."
        )
    if difference in ("self test", "first frame"):
        raise ClusterError(
            f"The worker at {place} computes different pixels than the client; leave it out, or give all machines "
            "processors and libraries of one kind."
        )
    if difference is not None:
        raise ClusterError(
            f"The worker at {place} differs from the client in the {difference}; install the same version everywhere."
        )
    _checked.add(order.topic)


_checked: set[str] = set()
"""Topics of the jobs for which this process was compared with the client."""


def _check_wanted(worker: Worker, key: Key) -> None:
    """Raise an exception if Dask does not need the result of a task any more."""
    task = worker.state.tasks.get(key)
    is_wanted = task is not None and task.state != "cancelled"
    if not is_wanted or worker.status not in (Status.running, Status.paused, Status.closing_gracefully):
        raise WorkerLostError


def read_piece(path: str, begin: int, size: int) -> bytes:
    """Return a piece of a file of a worker, bytes from `begin` on; called by the client."""
    with open(path, "rb") as file:
        file.seek(begin)
        return file.read(size)
