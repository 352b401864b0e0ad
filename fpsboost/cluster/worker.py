"""Making of one part on a worker, whichever engine has started it."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fpsboost.conversion import convert_job
from fpsboost.errors import CompleteAlreadyError, FpsboostError, InUseError
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.part import Part, part_folder
from fpsboost.observer import SilentObserver, Summary
from fpsboost.preparation import ConversionJob
from fpsboost.run_options import RunOptions
from fpsboost.streaming import one_opencv_thread

REPORT_INTERVAL = 0.5
"""Seconds between reports of a part's progress."""

LOCK_INTERVAL = 1.0
"""Seconds between attempts to lock a part that another run makes at this moment."""


@dataclass(frozen=True)
class PartTask:
    """Part to make, and what a worker may use for it.

    Attributes
    ----------
    job : ConversionJob
    part : Part
    threads : int or None
        Pairs of frames that are worked on at a time; see `fpsboost.run_options.RunOptions`.
    limit : MemoryLimit or None
    """

    job: ConversionJob
    part: Part
    threads: int | None = None
    limit: MemoryLimit | None = None

    @property
    def output(self) -> str:
        """Path of the whole output."""
        assert self.job.output is not None
        return self.job.output


class WorkerObserver(SilentObserver):
    """Observer of a part that reports its progress now and then.

    Parameters
    ----------
    report : callable
        Called with the number of output frames that the part has.
    check : callable
        Called for every frame and while another run holds the part; raises an exception to stop.
    """

    def __init__(self, report: Callable[[int], None], check: Callable[[], None]) -> None:
        self._report, self.check = report, check
        self._next = 0.0

    def wrote(self, summary: Summary) -> None:
        """See `fpsboost.observer.Observer.wrote`."""
        self.check()
        now = time.monotonic()
        if now >= self._next:
            self._next = now + REPORT_INTERVAL
            self._report(summary.frames_out)


def make_part(task: PartTask, observer: WorkerObserver) -> Path:
    """Make a part, after what an earlier attempt has finished; wait if another run makes it.

    Parameters
    ----------
    task : PartTask
    observer : WorkerObserver

    Returns
    -------
    Path
        The part's folder; it may have been complete before.

    Raises
    ------
    FpsboostError
        See `fpsboost.conversion.convert`.
    """
    run = RunOptions(chunk=task.part, resume=True, threads=task.threads, limit=task.limit, observer=observer)
    with one_opencv_thread():
        while True:
            try:
                convert_job(task.job, run)
            except CompleteAlreadyError:
                pass
            except InUseError:
                observer.check()
                time.sleep(LOCK_INTERVAL)
                continue
            return part_folder(task.output, task.part)


def picklable(error: Exception) -> Exception:
    """Return an error that another process can read: itself if it is one of fpsboost's, else one with its traceback."""
    if isinstance(error, FpsboostError):
        return error
    return RuntimeError("".join(traceback.format_exception(error)))
