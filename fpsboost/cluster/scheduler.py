"""Scheduling of the parts of a conversion on workers, whatever these are: who makes which part, and what if one fails.

A worker makes one part at a time. Largest parts go first, so that the last ones to finish are small. A part whose
worker dies, or that fails for a reason that may lie with the worker, is made again, elsewhere if possible.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from fpsboost import FpsboostError, InputError, OptionError, Part
from fpsboost.errors import ClusterError
from fpsboost.parts.plan import PlannedPart

MAX_FAILURES = 3
"""Number of times that a part may fail with an error; the last error is raised then."""

MAX_LOST_WORKERS = 10
"""Number of workers that may die with the same part; nodes that are taken away at any time need more than a few."""


@dataclass(frozen=True)
class Progress:
    """Report that a part has so many of its output frames, those of earlier runs included."""

    part: Part
    frames: int


@dataclass(frozen=True)
class Done:
    """Report that a part is complete."""

    part: Part


@dataclass(frozen=True)
class Failed:
    """Report that a part failed on a worker; without an error if the worker died."""

    part: Part
    worker: str
    error: Exception | None = None


Report = Progress | Done | Failed


class Executor(Protocol):
    """Contract: workers, each of which makes one part at a time."""

    def workers(self) -> Sequence[str]:
        """Return the names of the workers that are there now; it may change at any time."""

    def submit(self, part: Part, worker: str, attempt: int) -> None:
        """Have a worker make a part; `attempt` counts, from 0, how often that was tried."""

    def wait(self) -> Iterable[Report]:
        """Wait a short time for reports, and return those that have come."""

    def cancel(self) -> None:
        """Stop all parts that are being made; what they have finished stays."""


@dataclass
class Utilisation:
    """Seconds in which workers made parts and in which they were there, summed over workers."""

    busy_seconds: float = 0.0
    available_seconds: float = 0.0
    tail_seconds: float = 0.0
    """Duration from when a worker first finds no part left to the end."""
    most_workers: int = 0

    def add(self, seconds: float, *, busy: int, workers: int, is_tail: bool) -> None:
        """Add a period during which `busy` of the workers made parts."""
        workers = max(workers, busy)
        self.busy_seconds += busy * seconds
        self.available_seconds += workers * seconds
        self.tail_seconds += is_tail * seconds
        self.most_workers = max(self.most_workers, workers)

    def sentence(self) -> str:
        """Return it as a sentence; empty if there was nothing to make.

        Examples
        --------
        >>> Utilisation(busy_seconds=36, available_seconds=40, tail_seconds=1, most_workers=4).sentence()
        'Up to 4 workers were busy 90 % of their time; the last part ended 1.0 s after the first worker was idle.'
        """
        if not self.most_workers:
            return ""
        share = self.busy_seconds / max(self.available_seconds, 1e-9)
        plural = "s were" if self.most_workers > 1 else " was"
        return (
            f"Up to {self.most_workers} worker{plural} busy {share:.0%} of their time; the last part ended "
            f"{self.tail_seconds:.1f} s after the first worker was idle."
        ).replace("%", " %")


@dataclass
class _Attempts:
    """Attempts to make one part so far."""

    count: int = 0
    failures: int = 0
    lost_workers: int = 0
    failed_on: set[str] = field(default_factory=set)


class _Run:
    """State of a conversion in parts."""

    def __init__(self, planned: Sequence[PlannedPart], executor: Executor, wrote: Callable[[int], None]) -> None:
        self.waiting = _largest_first(planned)
        self.running: dict[Part, str] = {}
        self.executor, self.utilisation, self.complete = executor, Utilisation(), 0
        self._wrote, self._planned = wrote, {each.part: each for each in planned}
        self._attempts = {part: _Attempts() for part in self._planned}
        self._frames = Counter[Part]()

    def step(self) -> None:
        """Give free workers the next parts, and handle what is reported meanwhile."""
        begin = time.perf_counter()
        workers = self.executor.workers()
        self._submit_to_free(workers)
        busy, is_tail = len(self.running), not self.waiting and len(self.running) < len(workers)
        reports = self.executor.wait()
        self.utilisation.add(time.perf_counter() - begin, busy=busy, workers=len(workers), is_tail=is_tail)
        for report in reports:
            self._handle(report)

    def _submit_to_free(self, workers: Sequence[str]) -> None:
        busy = set(self.running.values())
        for worker in [each for each in workers if each not in busy]:
            # the largest part that has not failed on this worker, or has failed on all of them
            attempts = ((each, self._attempts[each.part].failed_on) for each in self.waiting)
            free = (each for each, failed in attempts if worker not in failed or failed.issuperset(workers))
            planned = next(free, None)
            if planned is None:
                continue
            self.waiting.remove(planned)
            self.running[planned.part] = worker
            self.executor.submit(planned.part, worker, self._attempts[planned.part].count)
            self._attempts[planned.part].count += 1

    def _handle(self, report: Report) -> None:
        if isinstance(report, Progress):
            self._count(report.part, report.frames)
            return
        if self.running.pop(report.part, None) is None:  # a worker that was taken for dead
            return
        planned = self._planned[report.part]
        if isinstance(report, Done):
            self.complete += 1
            self._count(report.part, planned.frames)
            return
        _count_failure(self._attempts[report.part], report)
        self.waiting = _largest_first([*self.waiting, planned])

    def _count(self, part: Part, frames: int) -> None:
        """Count the frames of a part; one that is made again counts only what it has more than before."""
        if frames > self._frames[part]:
            self._frames[part] = frames
            self._wrote(sum(self._frames.values()))


def _largest_first(planned: Sequence[PlannedPart]) -> list[PlannedPart]:
    return sorted(planned, key=lambda each: (-each.cost, each.part.number))


def _count_failure(attempts: _Attempts, report: Failed) -> None:
    """Count a failure of a part; raise its error if another attempt is of no use."""
    if report.error is None:
        attempts.lost_workers += 1
        if attempts.lost_workers >= MAX_LOST_WORKERS:
            raise ClusterError(
                f"{attempts.lost_workers} workers died while they made part {report.part}, the last one at "
                f"{report.worker}; see what the system and its log say, such as too little memory."
            )
        return
    attempts.failures += 1
    attempts.failed_on.add(report.worker)
    is_final = isinstance(report.error, InputError | OptionError | ClusterError)
    if is_final or attempts.failures >= MAX_FAILURES:
        raise report.error


def run_parts(planned: Sequence[PlannedPart], executor: Executor, wrote: Callable[[int], None]) -> Utilisation:
    """Make parts on workers until all are complete; `wrote` gets the number of output frames that all have together.

    Whatever ends the run stops all workers, and a note says how to go on.
    """
    run = _Run(planned, executor, wrote)
    try:
        while run.waiting or run.running:
            run.step()
    except BaseException as error:
        executor.cancel()
        if isinstance(error, KeyboardInterrupt | FpsboostError) and not isinstance(error, InputError | OptionError):
            error.__notes__ = [f"{run.complete} of {len(planned)} parts are complete; `resume` goes on with them."]
        raise
    return run.utilisation
