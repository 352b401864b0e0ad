"""Conversion in parts: they are planned and joined here, and made by workers."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from fpsboost import ClipInfo, ConversionJob, FpsboostError, OptionError, OutputError, Part, RunOptions, Summary, join
from fpsboost.cluster.scheduler import Executor, run_parts
from fpsboost.cluster.worker import LOCK_INTERVAL
from fpsboost.contracts import SilentObserver
from fpsboost.errors import CompleteAlreadyError, InUseError, explained
from fpsboost.io.fingerprint import JobFingerprint
from fpsboost.io.part import part_folder, remove_if_empty
from fpsboost.parts.manifest import MANIFEST_NAME, Manifest, facts_of, first_difference
from fpsboost.parts.plan import PlannedPart, plan_parts, share_index
from fpsboost.preparation import opened_clip, prepare

PARTS_PER_WORKER = 8
"""Parts of a conversion for each worker; at the end, a worker idles for half of one on average."""


@dataclass(frozen=True)
class JobInParts:
    """Conversion to an output, whose parts workers make."""

    job: ConversionJob
    run: RunOptions

    @property
    def output(self) -> str:
        assert self.job.output is not None
        return self.job.output

    @property
    def folder(self) -> Path:
        """Folder of the folders of the parts."""
        return part_folder(self.output, Part(1, 1)).parent


StartExecutor = Callable[[JobInParts], AbstractContextManager[Executor]]
"""Starts workers, which stop when the block is left."""


def convert_in_parts(job: ConversionJob, run: RunOptions, workers: int, start: StartExecutor) -> Summary:
    """Convert a clip in parts, whose number follows from that of the workers; the result is that of `convert_job`.

    Parts that earlier runs of the same job have made are taken over; all are removed when they are joined.
    """
    begin = time.perf_counter()
    parts = JobInParts(job, run)
    info, planned = _plan(parts, workers)
    complete = [each for each in planned if part_folder(parts.output, each.part).is_dir()]
    observer, progress = run.observer or SilentObserver(), Summary()
    done_before = sum(each.frames for each in complete)
    observer.opened(info, sum(each.frames for each in planned))
    observer.ready()

    def wrote(frames: int) -> None:
        progress.frames_out, progress.completed_frames = done_before + frames, done_before
        progress.seconds = time.perf_counter() - begin
        observer.wrote(progress)

    try:
        with start(parts) as executor:
            utilisation = run_parts([each for each in planned if each not in complete], executor, wrote)
    finally:
        remove_if_empty(parts.folder)
    summary = _join(parts, [part_folder(parts.output, each.part) for each in planned])
    summary.completed_frames, summary.seconds = done_before, time.perf_counter() - begin
    summary.utilisation = utilisation.sentence()
    return summary


def _plan(parts: JobInParts, workers: int) -> tuple[ClipInfo, list[PlannedPart]]:
    """Plan the parts, after checking that they can be joined; return also the properties of the input."""
    job, run = parts.job, parts.run
    given = [*["`in_place`"] * run.in_place, *["`chunk`"] * (run.chunk is not None), *run.side.given]
    if given:
        raise OptionError(
            f"`cluster` makes a new output of parts, and {' and '.join(given)} cannot be made so; leave one of them "
            "out."
        )
    with opened_clip(job, run) as clip:
        ready = prepare(job, run, clip)
        _refuse_others(parts, facts_of(job, run, clip, ready))
        count = _count_of_earlier_run(parts.folder) or workers * PARTS_PER_WORKER
        planned = plan_parts(job, clip, ready, count)
        fingerprint = JobFingerprint({}, resume=run.resume)
        ready.target.open(replace(ready.output, overwrite=run.overwrite, job=fingerprint))  # checks the place
        with explained(OutputError, "write to", parts.folder, "check the path and the permissions"):
            parts.folder.mkdir(exist_ok=True)
        share_index(clip, parts.folder)
        return clip.source.info, planned


def _join(parts: JobInParts, folders: Sequence[Path]) -> Summary:
    """Join the parts in these folders, and remove them; raise `CompleteAlreadyError` if another run has done that."""
    while True:
        try:
            summary = join(parts.output, folders, overwrite=parts.run.overwrite)
            break
        except InUseError:
            time.sleep(LOCK_INTERVAL)
        except FpsboostError:
            time.sleep(LOCK_INTERVAL)
            if parts.folder.is_dir():
                raise
            raise CompleteAlreadyError(f"{parts.output} was made by another run of the same job.") from None
    with suppress(OSError):  # with all parts at once, so that another run does not find some
        removed = parts.folder.rename(parts.folder.with_name(f".{parts.folder.name}.joined"))
        shutil.rmtree(removed)
    return summary


def _refuse_others(parts: JobInParts, facts: Mapping[str, str]) -> None:
    """Remove parts of another job if the output may be replaced; raise `OutputError` if not."""
    for manifest in map(Manifest.read, (path.parent for path in parts.folder.glob(f"*/{MANIFEST_NAME}"))):
        difference = first_difference(facts, manifest.facts)
        if difference is None:
            continue
        if not parts.run.overwrite:
            raise OutputError(
                f"{parts.folder} holds parts with another {difference}; remove it, or give `overwrite=True`."
            )
        shutil.rmtree(parts.folder)
        return


def _count_of_earlier_run(folder: Path) -> int | None:
    """Return in how many parts an earlier run has cut the job; None if there was none."""
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    counts = {int(match[1]) for name in names if (match := re.search(r"\d{4}-of-(\d{4})\b", name))}
    return max(counts, default=None)
