"""Making of one part in a task of a Dask worker.

A thread cannot be stopped from outside, so the task looks at every frame whether Dask still wants its result: it does
not once every client that has asked for it has cancelled it, has ended, or has lost its connection.
"""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from dask.typing import Key
from distributed import Worker, get_worker
from distributed.core import Status

from fpsboost.cluster.worker import PartTask, WorkerObserver, make_part, picklable
from fpsboost.cluster.worker_facts import check_job, check_programs, job_facts
from fpsboost.errors import ClusterError, InputError


@dataclass(frozen=True)
class WorkerOrder:
    """What a worker needs to make a part.

    Attributes
    ----------
    task : bytes
        Pickled `PartTask`: read only after the facts agree, since another version may not be able to.
    facts : mapping of str to str
        What the client knows of its installation and of the input, and the worker must know, too.
    mark : str
        Path of a file in the folder of the parts, which a worker can see if storage is shared.
    topic : str
        Topic of Dask under which progress is logged.
    """

    task: bytes
    facts: Mapping[str, str]
    mark: str
    topic: str


@dataclass(frozen=True)
class Outcome:
    """What a worker has made.

    Attributes
    ----------
    folder : str
        Path of the part, on the worker.
    is_private : bool
        Whether it lies in the worker's own folder, since storage is not shared.
    sizes : dict of str to int
        Sizes of the part's files by their names, bytes.
    error : Exception or None
        The error that ended the part; it has no folder then.
    is_stopped : bool
        Whether the worker was closed meanwhile, or nobody wanted the part any more; it has no folder then, either.
    """

    folder: str = ""
    is_private: bool = False
    sizes: Mapping[str, int] | None = None
    error: Exception | None = None
    is_stopped: bool = False


class _CancelledPartError(Exception):
    """Raised in a part that nobody wants any more."""


def make_on_worker(order: WorkerOrder) -> Outcome:
    """Make a part in the Dask worker that calls this.

    Parameters
    ----------
    order : WorkerOrder

    Returns
    -------
    Outcome
    """
    worker = get_worker()
    key = worker.get_current_task()
    try:
        return _made(order, worker, partial(_check_wanted, worker, key))
    except _CancelledPartError:
        return Outcome(is_stopped=True)
    except Exception as error:
        return Outcome(error=picklable(error))


def _made(order: WorkerOrder, worker: Worker, check: Callable[[], None]) -> Outcome:
    check_programs(order.facts, worker.address)
    task: PartTask = pickle.loads(order.task)
    _check_job_once(order, task, worker)
    is_private = not os.path.exists(order.mark)
    if is_private:
        place = Path(worker.local_directory) / "fpsboost" / order.topic
        place.mkdir(parents=True, exist_ok=True)
        task = replace(task, job=replace(task.job, output=str(place / Path(task.output).name)))
    task = replace(task, threads=task.threads or worker.state.nthreads)

    def report(frames: int) -> None:
        worker.log_event(order.topic, {"part": str(task.part), "frames": frames})

    folder = make_part(task, WorkerObserver(report, check))
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    return Outcome(str(folder), is_private, sizes)


def _check_job_once(order: WorkerOrder, task: PartTask, worker: Worker) -> None:
    """Compare input and pixels with the client's, once in this process for each job."""
    if order.topic in _checked:
        return
    try:
        here = job_facts(task.job)
    except InputError as error:
        raise ClusterError(f"The worker at {worker.address} cannot read the input: {error}") from error
    check_job(order.facts, here, worker.address)
    _checked.add(order.topic)


_checked: set[str] = set()
"""Topics of the jobs that this process has been found fit for."""


def _check_wanted(worker: Worker, key: Key) -> None:
    """Raise an exception if Dask has no use for the result of a task."""
    task = worker.state.tasks.get(key)
    is_wanted = task is not None and task.state != "cancelled"
    if not is_wanted or worker.status not in (Status.running, Status.paused, Status.closing_gracefully):
        raise _CancelledPartError


def read_piece(path: str, begin: int, size: int) -> bytes:
    """Return a piece of a file of a worker.

    Parameters
    ----------
    path : str
    begin, size : int
        Bytes.

    Raises
    ------
    OSError
    """
    with open(path, "rb") as file:
        file.seek(begin)
        return file.read(size)


def remove_private(folder: str) -> None:
    """Remove a part from the own folder of a worker, and what is empty then."""
    shutil.rmtree(folder, ignore_errors=True)
