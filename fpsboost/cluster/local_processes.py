"""Workers that are processes of this machine, started with the standard library alone."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import Thread
from types import TracebackType
from typing import Any, Self

from fpsboost.cluster.conversion import convert_in_parts
from fpsboost.cluster.scheduler import Done, Failed, Progress, Report
from fpsboost.cluster.worker import PartTask, WorkerObserver, make_part, picklable
from fpsboost.interruption import stop_on
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.part import Part
from fpsboost.observer import Summary
from fpsboost.preparation import ConversionJob
from fpsboost.run_options import RunOptions
from fpsboost.threads import available_cores

WAIT_SECONDS = 0.5
"""Longest time that `ProcessExecutor.wait` waits for a report."""

STOP_SECONDS = 20.0
"""Time that a process gets to stop; it is killed then, which its finished chunks survive."""


def convert_in_processes(job: ConversionJob, processes: int, *, run: RunOptions | None = None) -> Summary:
    """Convert a clip in several processes of this machine; the result is that of one.

    Programs that call this need the usual ``if __name__ == "__main__":``, because the processes import them.

    Parameters
    ----------
    job : ConversionJob
    processes : int
    run : RunOptions, optional
        `threads` is what each process may use; by default they share the cores.

    Returns
    -------
    Summary

    Raises
    ------
    FpsboostError
        See `fpsboost.cluster.conversion.convert_in_parts`.

    Examples
    --------
    >>> convert_in_processes(job, 4)  # doctest: +SKIP
    """
    run = run or RunOptions()
    share = MemoryLimit(max(1, (run.limit or MemoryLimit()).bytes // processes))
    run = replace(run, threads=run.threads or max(1, available_cores() // processes), limit=share)
    return convert_in_parts(job, run, processes, lambda parts: ProcessExecutor(processes, parts.task))


STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Hold back requests to stop while the block lasts, where the system can."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _WorkerProcess:
    """A process that makes parts, one after the other."""

    def __init__(self) -> None:
        context = get_context("spawn")  # the same everywhere, and safe in programs with threads
        self.connection, end = context.Pipe()
        self._process: BaseProcess = context.Process(target=_work, args=(end,), name="fpsboost-part", daemon=True)
        with _signals_held_back():  # the new process holds them back, too, until it can handle them
            self._process.start()
        end.close()
        self.part: Part | None = None

    @property
    def name(self) -> str:
        return f"process {self._process.pid}"

    @property
    def is_alive(self) -> bool:
        return self._process.is_alive()

    @property
    def sentinel(self) -> int:
        return self._process.sentinel

    def submit(self, task: PartTask) -> None:
        self.part = task.part
        with suppress(OSError):  # a process that has just died is noticed by its sentinel
            self.connection.send(task)

    def received(self) -> list[Report]:
        """Return what the process has sent."""
        reports: list[Report] = []
        with suppress(OSError, EOFError):
            while self.connection.poll():
                frames_or_error = self.connection.recv()
                assert self.part is not None
                if isinstance(frames_or_error, int):
                    reports.append(Progress(self.part, frames_or_error))
                    continue
                is_done = frames_or_error is None
                reports.append(Done(self.part) if is_done else Failed(self.part, self.name, frames_or_error))
                self.part = None
        return reports

    def request_stop(self) -> None:
        self.connection.close()
        self._process.terminate()

    def close(self) -> None:
        """Wait until the process has ended."""
        self._process.join(STOP_SECONDS)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


class ProcessExecutor:
    """Executor whose workers are processes; one that dies is replaced.

    Parameters
    ----------
    processes : int
    task_of : callable
        Returns the task of a part.
    """

    def __init__(self, processes: int, task_of: Callable[[Part], PartTask]) -> None:
        self._count, self._task_of = processes, task_of
        self._processes: list[_WorkerProcess] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.cancel()

    def workers(self) -> Sequence[str]:
        """See `fpsboost.cluster.scheduler.Executor.workers`."""
        while len(self._processes) < self._count:
            self._processes.append(_WorkerProcess())
        return [process.name for process in self._processes]

    def submit(self, part: Part, worker: str, attempt: int) -> None:
        """See `fpsboost.cluster.scheduler.Executor.submit`."""
        next(each for each in self._processes if each.name == worker).submit(self._task_of(part))

    def wait(self) -> list[Report]:
        """See `fpsboost.cluster.scheduler.Executor.wait`."""
        ends: list[Any] = [end for each in self._processes for end in (each.connection, each.sentinel)]
        connection.wait(ends, WAIT_SECONDS)
        reports: list[Report] = []
        for process in list(self._processes):
            has_died = not process.is_alive  # before the last of what it has sent is read
            reports += process.received()
            if not has_died:
                continue
            if process.part is not None:
                reports.append(Failed(process.part, process.name))
            self._processes.remove(process)
            process.close()
        return reports

    def cancel(self) -> None:
        """See `fpsboost.cluster.scheduler.Executor.cancel`."""
        processes, self._processes = self._processes, []
        for process in processes:
            process.request_stop()
        for process in processes:
            process.close()


def _work(tasks: Connection) -> None:
    """Make the parts that arrive until there are no more; called in a process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process of a terminal; the first one decides
    stop_on(signal.SIGTERM)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
    Thread(target=_follow_parent, daemon=True).start()
    with suppress(KeyboardInterrupt, EOFError, OSError):
        while True:
            task = tasks.recv()
            try:
                make_part(task, WorkerObserver(tasks.send, check=_nothing))
            except Exception as error:
                tasks.send(picklable(error))
            else:
                tasks.send(None)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends anyway


def _nothing() -> None:
    """Do nothing: a signal stops the part."""


def _follow_parent() -> None:
    """Stop this process when the one that has started it has died."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
