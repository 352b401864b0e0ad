"""Passages of a clip converted by every method, and the time that took."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from numpy.typing import NDArray

from fpsboost import (
    ClipInfo,
    ConversionJob,
    FpsboostError,
    Frame,
    Interpolator,
    LowestMatch,
    Position,
    RunOptions,
    Summary,
    Target,
    convert_job,
)
from fpsboost.contracts import SilentObserver
from fpsboost.preparation import prepared
from fpsboost.preview.places import Passage, Selection, View, find_passages
from fpsboost.threads import available_cores


class Trial(NamedTuple):
    """A passage converted by a method."""

    after: View
    least_certain: LowestMatch | None
    """See `fpsboost.Summary.lowest_match`, with the time in the passage on the source's clock."""
    confidence: NDArray[Any] | None
    """Confidence of that frame's pixels, (H, W, 1) float32; None if the method has none of its own."""
    frames: int
    seconds: float
    cpu_seconds: float
    """Elapsed and CPU time, the pictures for the page not counted."""


class Estimate(NamedTuple):
    """Expected cost of the whole conversion on this machine."""

    frames: int | None
    """Number of frames to be written; None if the header of the source does not say."""
    least: float
    most: float
    """Seconds per frame: if all cores were always busy, and as measured."""
    cpu: float


@dataclass
class Preview:
    """Passages of a clip before and after a conversion."""

    info: ClipInfo
    rate: Fraction
    stretch: Fraction
    """Duration of the output as a multiple of the source's."""
    selection: Selection
    trials: dict[str, list[Trial]]
    estimates: dict[str, Estimate]
    is_video: bool
    """Whether the conversion, and so the estimate, encodes video."""
    remarks: list[str]

    def views(self) -> list[dict[str, View]]:
        """Return the views of every passage by their names, that before the conversion first."""
        return [
            {"before": passage.before, **{name: trials[place].after for name, trials in self.trials.items()}}
            for place, passage in enumerate(self.selection.passages)
        ]


def preview(
    job: ConversionJob,
    methods: Mapping[str, Interpolator],
    run: RunOptions,
    *,
    at: Iterable[Position] = (),
    on_task: Callable[[str], None] = lambda task: None,
) -> Preview:
    """Convert passages of a clip, those with the most motion or those that begin `at` some times, by every method.

    The job is the whole conversion: its output is not written, and says of what kind the output will be. `methods`
    replace its own, and `on_task` is called with the name of each task.
    """
    target = job.target(run)
    with prepared(job, run) as ready:
        info, frames = ready.clip.whole.info, ready.output.expected_frames
    on_task("looking for motion")
    selection = find_passages(job, run, at)
    trials: dict[str, list[Trial]] = {name: [] for name in methods}
    remarks = dict.fromkeys(selection.remarks)
    with TemporaryDirectory(prefix="fpsboost-") as folder:
        for number, passage in enumerate(selection.passages):
            for name, method in methods.items():
                on_task(f"{name}, passage {number + 1} of {len(selection.passages)}")
                output = Path(folder, str(number), str(list(methods).index(name)))
                output.parent.mkdir(exist_ok=True)
                trial, summary = _try(replace(job, method=method), run, target, passage, output)
                trials[name].append(trial)
                remarks |= dict.fromkeys(summary.remarks)
    return Preview(
        info,
        ready.output.timing.rate,
        job.rate.stretch,
        selection,
        trials,
        {name: _estimate(frames, each) for name, each in trials.items()},
        target.kind == "video",
        list(remarks),
    )


@dataclass
class _Recorder(SilentObserver):
    """Watcher and observer of one conversion."""

    view: View
    stretch: Fraction
    needs_confidence: bool
    confidences: list[NDArray[Any] | None] = field(default_factory=list)
    own_seconds: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)

    def ready(self) -> None:
        """See `fpsboost.contracts.Observer.ready`."""
        self.start = time.perf_counter(), time.process_time()

    def watch(self, frame: Frame) -> None:
        """See `fpsboost.contracts.FrameWatcher.watch`."""
        begin = time.thread_time()
        self.view.add(frame, frame.time / self.stretch)
        self.view.end = (frame.time + frame.duration) / self.stretch
        confidence = frame.confidence
        self.confidences.append(None if confidence is None else self.view.displayed(confidence))
        self.own_seconds += time.thread_time() - begin


def _try(job: ConversionJob, run: RunOptions, target: Target, passage: Passage, place: Path) -> tuple[Trial, Summary]:
    """Convert a passage to files of the target's kind, which are left to the caller to remove."""
    part = job.of_part(passage.trim)
    if target.kind == "video":
        part = replace(part, encoding=replace(job.encoding, audio=False, subtitles=False))
    output = f"{place}/" if target.kind == "images" else f"{place}{target.file_type}"
    needs_confidence = job.method.has_confidence
    recorder = _Recorder(View(passage.before.traits), job.rate.stretch, needs_confidence)
    try:
        summary = convert_job(replace(part, output=output), replace(run, observer=recorder, watcher=recorder))
    except FpsboostError as error:
        raise type(error)(str(error).replace(output, target.path)) from error
    cpu = time.process_time() - recorder.start[1]
    own = min(recorder.own_seconds / cpu, 0.9)
    seconds = (time.perf_counter() - recorder.start[0]) * (1 - own)
    least, confidence = summary.lowest_match, None
    if least is not None:
        least, confidence = replace(least, time=least.time / job.rate.stretch), recorder.confidences[least.number]
    summary.remarks = [remark.replace(output, target.path) for remark in summary.remarks]
    return Trial(recorder.view, least, confidence, summary.frames_out, seconds, cpu * (1 - own)), summary


def _estimate(frames: int | None, trials: list[Trial]) -> Estimate:
    """Return what every frame takes, over all passages."""
    count = sum(trial.frames for trial in trials)
    most = sum(trial.seconds for trial in trials) / count
    cpu = sum(trial.cpu_seconds for trial in trials) / count
    return Estimate(frames, min(most, cpu / available_cores()), most, cpu)
