"""Plan of the parts of a conversion: their output frames, and where the source of each begins.

A part begins to read the source a few frames before its own; see `fpsboost.parts.entry`. The list of a video's frames
is left in a file beside the parts, so that not every part has to read the whole video.
"""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from fpsboost.conflicts import check_together
from fpsboost.contracts import OutputRange, Summary
from fpsboost.edits import OpenedClip
from fpsboost.errors import OptionError, OutputError, explained
from fpsboost.frame import ClipInfo
from fpsboost.io.video.source import VideoSource
from fpsboost.media import (
    CHUNK_FRAMES,
    INDEX_NAME,
    EntryPoint,
    FrameIndex,
    JobFingerprint,
    OutputPart,
    part_files,
    remove_if_empty,
    write_safely,
)
from fpsboost.parts.entry import find_entry
from fpsboost.parts.manifest import MANIFEST_NAME, Manifest, facts_of, first_difference, input_identity, stored
from fpsboost.preparation import ConversionJob, Preparation, prepared
from fpsboost.remarks import Remarks
from fpsboost.repair import CERTAIN_AFTER
from fpsboost.run_options import MAX_PARTS, Part, RunOptions, count_parts, parts_folder
from fpsboost.timing.edit import Edit
from fpsboost.timing.position import MAX_RUN
from fpsboost.timing.schedule import ByFactor, count_frames

REPLACED_BEFORE = 2 * (MAX_RUN + 1) + CERTAIN_AFTER
"""Number of preceding frames that influence a frame where frames are replaced: those of its group and of the group
before, from the first that is certainly grouped as in one run."""
LATE = 30
"""Time of the source at which a curve must begin at least for the frames before it to be skipped, seconds."""


@dataclass
class PartPlan:
    """Part of a conversion that is being computed."""

    part: Part
    """Number of the part, and number of parts."""
    outputs: OutputRange
    """Output frames of the part, and where its source begins."""
    output: OutputPart
    """Folder that the part is written to."""
    remarks: Remarks = field(default_factory=Remarks)
    """Remarks on how its source is read."""
    summary: Summary | None = None
    """Result of the loop, once it has run."""

    @property
    def is_empty(self) -> bool:
        """Whether the part has no frames, because there are more parts than chunks."""
        return self.outputs.first == self.outputs.stop


def plan_part(ready: Preparation) -> PartPlan:
    """Choose the output frames of a part, and let the source begin where they need it.

    Parts are whole chunks of a video, in which its encoder starts again, or any frames of images. All runs cut a job in
    the same way.

    Raises
    ------
    OptionError
        The input or the output cannot be cut into parts.
    """
    run = ready.run
    assert run.chunk is not None
    folder = run.chunk.folder(ready.target.path)
    total, unit = _measured(ready)
    outputs = outputs_of(run.chunk, total, unit)

    def write_manifest(folder: Path) -> None:  # when its files are complete
        manifest_of(plan, ready, folder).write(folder)

    output = OutputPart(folder, outputs.first, outputs.count(total), write_manifest)
    plan = PartPlan(run.chunk, outputs, output)
    if not plan.is_empty:
        plan.outputs = enter(ready, outputs)
        if outputs.first > 0 and plan.outputs.entry is None:
            plan.remarks.add("part-read-from-beginning", name=ready.clip.source.info.name)
    return plan


def enter(ready: Preparation, outputs: OutputRange) -> OutputRange:
    """Let a source that lists its frames begin near the first of some output frames; return these with the entry."""
    job = ready.job
    source = ready.clip.source
    curve = ready.clip.curve
    is_late = outputs.first > 0 or (curve is not None and curve.source(Fraction(0)) >= LATE)
    if not is_late:
        if ready.run.chunk is not None:  # frames that are listed are counted, and not sought by their time
            source.begin_at(0)
        return outputs
    if (times := source.frame_times()) is None:
        return outputs
    schedule = ready.schedule
    before = 1 if job.timing.replace is None else REPLACED_BEFORE
    entry = find_entry(times, schedule, ready.timeline.duplicates, outputs.first, ready.clip.read_from, before)
    source.begin_at(entry.number)
    return replace(outputs, entry=entry)


@contextmanager
def planned_job(job: ConversionJob, run: RunOptions, count: int) -> Iterator[tuple[ClipInfo, dict[Part, int]]]:
    """Plan the parts of a job, which have a folder while the block lasts.

    Yields the properties of the input, and how many output frames each part has, as far as that is known beforehand.
    There are about `count` parts, or as many as in an earlier run of the job.

    Raises
    ------
    OptionError, OutputError
        Parts cannot be written or joined, or the folder holds parts of another job and `overwrite` is not given.
    """
    with prepared(job, run) as ready:
        folder = parts_folder(ready.target.path)
        _refuse_others(folder, facts_of(ready), overwrite=run.overwrite)
        planned = _plan_parts(ready, count_parts(folder) or count)
        ready.target.open(replace(ready.output, job=JobFingerprint({}, resume=run.resume)))  # checks the place
        with explained(OutputError, "write to", folder, "check the path and the permissions"):
            folder.mkdir(exist_ok=True)
        share_index(ready.clip, folder)
    try:
        yield ready.clip.source.info, planned
    finally:
        remove_if_empty(folder)


def _refuse_others(folder: Path, facts: Mapping[str, str], *, overwrite: bool) -> None:
    """Remove parts of another job if the output may be replaced; raise `OutputError` if not."""
    manifests = (Manifest.read(path.parent) for path in folder.glob(f"*/{MANIFEST_NAME}"))
    difference = next(filter(None, (first_difference(facts, each.facts) for each in manifests)), None)
    if difference is None:
        return
    if not overwrite:
        raise OutputError(
            f"{folder} contains parts with a different {difference}; remove it, or give `overwrite=True`."
        )
    shutil.rmtree(folder)


def _plan_parts(ready: Preparation, count: int) -> dict[Part, int]:
    """Return the frames of the parts of a job: `count` parts, or as many as a video has chunks, or there are images."""
    total, unit = _measured(ready)
    count = max(1, min(count, -(-total // unit), MAX_PARTS))
    parts = [Part(number, count) for number in range(1, count + 1)]
    return {part: outputs_of(part, total, unit).count(total) for part in parts}


def _measured(ready: Preparation) -> tuple[int, int]:
    """Return the number of output frames, and how many of them stay together.

    The list of frames in the folder of all parts is used if there is one. Raises `OptionError` if the input or the
    output cannot be cut into parts.
    """
    ready.target.check_parts()
    clip = ready.clip
    if isinstance(clip.whole, VideoSource):
        index = read_index(parts_folder(ready.target.path), input_identity(clip))
        clip.whole.frame_index = index or clip.whole.frame_index
    times = clip.source.frame_times()
    info = Edit.whole(times).of_info(clip.source.info) if times else clip.source.info
    total = count_frames(ready.schedule, info, ready.target.has_clock)
    check_together(ready.job.timing.names_given() | {"chunk"})
    if total is None or not clip.whole.stream_info.files:
        raise OptionError(f"{info.name} does not declare its number of frames; convert it in one run.")
    return total, CHUNK_FRAMES if ready.target.kind == "video" else 1


def share_index(clip: OpenedClip, folder: Path) -> None:
    """Write the list of frames into the folder of all parts, if it was read from the whole file.

    Where that fails, parts read the video themselves.
    """
    index = clip.whole.frame_index if isinstance(clip.whole, VideoSource) else None
    if index is None or (folder / INDEX_NAME).exists():
        return
    points = [(point.number, point.pts, point.dts) for point in index.entry_points]
    data = {"identity": input_identity(clip), "ticks": index.ticks.tolist(), "entry_points": points}
    with suppress(OSError):
        write_safely(folder / INDEX_NAME, json.dumps(data).encode())


def outputs_of(part: Part, total: int, unit: int) -> OutputRange:
    """Return the output frames of a part, if `total` are expected, of which as many as a `unit` stay together.

    Examples
    --------
    >>> ranges = [outputs_of(Part(number, 3), 100, 32) for number in (1, 2, 3)]
    >>> [(each.first, each.stop) for each in ranges]  # the last one has all that are left
    [(0, 32), (32, 64), (64, None)]
    """
    units = -(-total // unit)
    first = units * (part.number - 1) // part.count * unit
    return OutputRange(first, None if part.number == part.count else units * part.number // part.count * unit)


def read_index(folder: Path, identity: str) -> FrameIndex | None:
    """Read the index of a video with this identity; None if there is none, or it is damaged."""
    try:
        data = json.loads((folder / INDEX_NAME).read_bytes())
        points = [EntryPoint(*point) for point in data["entry_points"]]
        return FrameIndex(np.array(data["ticks"], np.int64), points) if data["identity"] == identity else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def manifest_of(plan: PartPlan, ready: Preparation, folder: Path) -> Manifest:
    """Return the manifest of a part whose files are complete."""
    job = ready.job
    summary = plan.summary
    outputs = plan.outputs
    assert summary is not None
    read = summary.frames_in + (0 if outputs.entry is None else outputs.entry.number)
    by_number = isinstance(ready.schedule, ByFactor) or job.method.match_grain or job.method.counts_frames
    return Manifest(
        part=plan.part,
        input=str(Path(job.input).absolute()),
        output=ready.target.path,
        timing=job.timing,
        decoding=job.decoding,
        encoding=job.encoding,
        facts=facts_of(ready),
        first=outputs.first,
        summary=replace(
            summary, frames_in=read, remarks=Remarks([*plan.remarks, *summary.remarks]), seconds=0.0, completed_frames=0
        ),
        counts_frames=by_number,
        window=ready.clip.window,
        files=[stored(path) for path in part_files(folder)],
    )
