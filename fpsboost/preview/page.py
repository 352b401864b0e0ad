"""Passages of a clip converted by every method, with the time that this took, on one page that needs only a browser.

The views may also be written as a video, side by side.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost import (
    ClipInfo,
    ConversionJob,
    Frame,
    FrameCache,
    FrameMask,
    InterpolatedImage,
    Interpolator,
    LowestMatch,
    Position,
    RunOptions,
    SilentObserver,
    SourcePosition,
    Target,
    convert_job,
    format_time,
    open_sink,
)
from fpsboost.extension import (
    Remarks,
    available_cores,
    format_duration,
    prepared,
    rounded,
    view,
)
from fpsboost.pages import PlayerData, as_heat, data_uri, encode, templates_of
from fpsboost.preview.places import Passage, Selection, find_passages, find_retimed, first_packet_size
from fpsboost.preview.view import View

TINT = np.array([255, 0, 255], np.float32)
"""Colour of what a mask keeps, in BGR."""
OPACITY = 0.6
"""Share of that colour there."""


class ConvertedPassage(NamedTuple):
    """A passage converted by a method."""

    after: View
    """Its frames after the conversion."""
    least_certain: LowestMatch | None
    """Where the result is least certain, see `fpsboost.Summary`; its time is in the passage, on the source's clock."""
    confidence: np.ndarray | None
    """Confidence of that frame's pixels, (H, W, 1) float32; None if the method has none of its own."""
    frames: int
    """Number of frames that were written."""
    seconds: float
    """Elapsed time without that of the pictures for the page."""
    cpu_seconds: float
    """CPU time without that of the pictures for the page."""
    size: int
    """Bytes that were written."""
    first: int
    """Bytes of the first picture of a video, a key frame; 0 for images and animations."""
    remarks: Remarks
    """Remarks of its conversion."""


@dataclass
class Preview:
    """Passages of a clip before and after a conversion."""

    info: ClipInfo
    """Properties of the source."""
    rate: Fraction
    """Frames per second of the output."""
    stretch: Fraction
    """Duration of the output as a multiple of the source's."""
    selection: Selection
    """Passages of the source."""
    trials: dict[str, list[ConvertedPassage]]
    """Converted passages by the names of the methods, in the order of the selection."""
    frames: int | None
    """Number of frames that the whole conversion writes; None if the header of the source does not declare its own."""
    seconds_per_frame: dict[str, float]
    """Expected time per output frame on this machine, by the names of the methods."""
    is_video: bool
    """Whether the conversion, and so the estimate, encodes video."""
    has_guide: bool
    """Whether a guide is given."""
    remarks: Remarks
    """Notes of the conversions, each once."""
    masked: list[str]
    """Data URIs of the first frame of every passage with what a mask keeps tinted; none without a mask."""

    def views(self) -> list[dict[str, View]]:
        """Return the views of every passage by their names, that before the conversion first."""
        return [
            {"before": passage.before, **{name: trials[place].after for name, trials in self.trials.items()}}
            for place, passage in enumerate(self.selection.passages)
        ]


OF_PASSAGES = ("replace-behind-end", "guide-missing", "guide-followed")
"""Kinds of remarks that say nothing of the whole clip."""


def preview(
    job: ConversionJob,
    methods: Mapping[str, Interpolator],
    run: RunOptions,
    *,
    at: Iterable[Position] = (),
    length: int | None = None,
    on_task: Callable[[str], None] = lambda task: None,
) -> Preview:
    """Convert passages of a clip by every method.

    Parameters
    ----------
    job : ConversionJob
        The whole conversion. Its output is not written, and only determines the kind of the converted passages.
    methods : mapping of str to Interpolator
        Methods by name; they replace that of the job.
    run : RunOptions
        Options of the run.
    at : iterable of Position
        Beginnings of the passages; by default those with the most motion. If a curve retimes the clip, they are times
        of the output, and by default the points of the curve.
    length : int, optional
        Length of a passage in source frames; by default about a second.
    on_task : callable
        Called with the name of each task.
    """
    target = job.target(run)
    with prepared(job, run) as ready:
        info = ready.clip.whole.info
        curve = ready.clip.clip_curve
        frames = ready.output.expected_frames
        rate = ready.output.timing.rate
        mask = ready.interpolator.mask
    if job.timing.retimes:
        factor = job.timing.multiple if job.timing.fps is None else None
        job = replace(job, timing=replace(job.timing, factor=factor, retime=None, speed=None, slow_motion_sound=None))
    on_task("looking for motion")
    selection = find_passages(job, run, at, length) if curve is None else find_retimed(job, run, curve, rate, at)
    trials: dict[str, list[ConvertedPassage]] = {name: [] for name in methods}
    remarks = Remarks(selection.remarks)
    with TemporaryDirectory(prefix="fpsboost-") as folder:
        for number, passage in enumerate(selection.passages):
            for place, (name, method) in enumerate(methods.items()):
                on_task(f"{name}, passage {number + 1} of {len(selection.passages)}")
                output = Path(folder, f"{number}-{place}")
                trial = _convert_passage(replace(job, method=method), run, target, passage, output)
                trials[name].append(trial)
                # what is true of a passage, such as frames of `replace` after its end, need not be so of the clip
                remarks.take(each for each in trial.remarks if each.kind not in OF_PASSAGES)
    return Preview(
        info,
        rate,
        job.timing.stretch,
        selection,
        trials,
        frames,
        {name: _seconds_per_frame(each) for name, each in trials.items()},
        target.kind == "video",
        job.decoding.guide is not None,
        remarks,
        [] if mask is None else [_tinted(passage, mask, info) for passage in selection.passages],
    )


def _tinted(passage: Passage, mask: FrameMask, info: ClipInfo) -> str:
    """Return the data URI of the first frame of a passage, with what a mask keeps tinted."""
    black = np.zeros((info.height, info.width, 1), np.uint8)
    white = FrameCache(~black, source_position=SourcePosition(passage.number, passage.start))
    kept = view(mask.keep(InterpolatedImage(black), white).image).array()
    weights = passage.before.displayed(kept) * np.float32(OPACITY / 255)
    picture = passage.before.image_at(Fraction(0))
    return encode(np.rint(picture + weights * (TINT - picture)).astype(np.uint8))


@dataclass
class _Recorder(SilentObserver):
    """Watcher and observer of one conversion: keeps its frames and their confidence, and measures its own CPU time."""

    view: View
    """Frames for the page."""
    stretch: Fraction
    """Duration of the output as a multiple of the source's."""
    needs_confidence: bool
    """Whether frames shall have a confidence."""
    confidences: list[np.ndarray | None] = field(default_factory=list)
    """Confidence of each output frame, as it is displayed."""
    own_seconds: float = 0.0
    """CPU time of this object, which is subtracted from that of the conversion."""
    start: tuple[float, float] = (0.0, 0.0)
    """Elapsed and CPU time when the conversion began."""

    def ready(self) -> None:
        """Start the clocks when everything is open."""
        self.start = time.perf_counter(), time.process_time()

    def watch(self, frame: Frame) -> None:
        """Add a frame to the view; its time here does not count as time of the conversion."""
        begin = time.thread_time()
        self.view.add(frame, frame.time / self.stretch)
        self.view.end = (frame.time + frame.duration) / self.stretch
        confidence = frame.confidence
        self.confidences.append(None if confidence is None else self.view.displayed(confidence))
        self.own_seconds += time.thread_time() - begin


def _convert_passage(
    job: ConversionJob, run: RunOptions, target: Target, passage: Passage, place: Path
) -> ConvertedPassage:
    """Convert a passage to files of the target's kind, which are left to the caller to remove."""
    part = job.of_part(passage.trim)
    if passage.retimed:
        times = [*passage.retimed.values()]
        curve = " ".join(f"{place}f={time}s" for place, time in enumerate([*times, times[-1]]))
        part = replace(part, timing=replace(job.timing, retime=curve))
    if target.kind == "video":
        encoding = replace(job.encoding.without_audio(), subtitles=False, streams=None)
        part = replace(part, encoding=encoding, timing=replace(part.timing, slow_motion_sound=None))
    output = f"{place}/" if target.kind == "images" else f"{place}{target.file_type}"
    recorder = _Recorder(View(passage.before.traits), job.timing.stretch, job.method.has_confidence)
    summary = convert_job(replace(part, output=output), replace(run, observer=recorder, watcher=recorder))
    cpu = time.process_time() - recorder.start[1]
    own = min(recorder.own_seconds / cpu, 0.9)
    seconds = (time.perf_counter() - recorder.start[0]) * (1 - own)
    least = summary.lowest_match
    confidence = None
    if least is not None:
        confidence = recorder.confidences[least.number]
        least = replace(least, time=least.time / job.timing.stretch)
    size = sum(file.stat().st_size for file in [Path(output), *Path(output).glob("*")] if file.is_file())
    first = first_packet_size(Path(output)) if target.kind == "video" else 0
    remarks = Remarks(each.about(output, target.path) for each in summary.remarks)
    return ConvertedPassage(
        recorder.view, least, confidence, summary.frames_out, seconds, cpu * (1 - own), size, first, remarks
    )


def _seconds_per_frame(trials: list[ConvertedPassage]) -> float:
    """Return the expected time per frame of the whole conversion, seconds.

    A passage is so short that the queues between its threads are never full: it takes longer than the same frames of a
    long run, and that longer than cores which are always busy. The geometric mean of the two is off by the least
    factor.
    """
    count = sum(trial.frames for trial in trials)
    measured = sum(trial.seconds for trial in trials) / count
    busy = sum(trial.cpu_seconds for trial in trials) / count / available_cores()
    return math.sqrt(measured * min(measured, busy))


SPEEDS = (Fraction(1), Fraction(1, 4))
"""Speeds at which a video shows each passage."""

LABEL_HEIGHT = 32
"""Height of the line of text above the pictures, pixels."""


class LeastCertain(NamedTuple):
    """Frame of a passage about which the first method is least certain."""

    time: str
    """Time in the clip, as text."""
    place: int
    """Index of the frame in the player."""
    picture: str
    """Data URI of the frame."""
    uncertainty: str | None
    """Data URI of a map of uncertainty; None if the method has no confidence."""
    confidence: float | None
    """Mean confidence of the frame, 0 to 1; None if the method has none."""


def make_page(preview: Preview, command: str, notes: Sequence[str]) -> str:
    """Return a page as HTML text.

    `command` is the command line of the whole conversion, and `notes` are the remarks in the words of that.
    """
    frames = sum(trial.frames for trial in next(iter(preview.trials.values())))
    work = "encoding, but not the copying of sound" if preview.is_video else "writing the images"
    included = (
        f"Measured on {frames} frames of these passages, which have more motion than most; it includes reading and "
        f"{work}. Long runs use the cores better than these passages, which is allowed for."
    )
    environment = templates_of("fpsboost.preview")
    environment.filters["as_time"] = format_time
    return environment.get_template("preview.html.j2").render(
        command_name="preview",
        preview=preview,
        name=Path(preview.info.name).name or preview.info.name,
        rates=f"{float(preview.info.rate):.5g} to {float(preview.rate):.5g} frames a second",
        passages=preview.selection.passages,
        least_certain=list(_least_certain(preview)),
        estimates={name: estimate_sentence(preview.frames, each) for name, each in preview.seconds_per_frame.items()},
        included=included,
        command=command,
        notes=notes,
        played=_player_data(preview),
    )


def _least_certain(preview: Preview) -> Iterator[LeastCertain]:
    """Yield the least certain frame of every passage, by the first method."""
    trials = next(iter(preview.trials.values()))
    first = 0
    for passage, trial in zip(preview.selection.passages, trials, strict=True):
        least = trial.least_certain
        confidence = trial.confidence
        if least is not None:
            time = format_time(passage.in_clip(least.time))
            uncertainty = None if confidence is None else encode(as_heat(1 - confidence))
            mean = None if confidence is None else float(confidence.mean())
            picture = data_uri(trial.after.pictures[least.number], "jpeg")
            place = first + round(least.time * preview.stretch * preview.rate)
            yield LeastCertain(time, place, picture, uncertainty, mean)
        first += _count(preview, passage.before.end)


def _count(preview: Preview, end: Fraction) -> int:
    """Return the number of frames in which the player shows a passage."""
    return max(1, round(end * preview.stretch * preview.rate))


def _player_data(preview: Preview) -> PlayerData:
    """Return the frames of all passages for the player of the page."""
    height, width = preview.selection.passages[0].before.image_at(Fraction(0)).shape[:2]
    names = ["before", *preview.trials] if len(preview.trials) > 1 else ["before", "after"]
    shown = preview.views()
    if preview.has_guide:
        names.append("guide")
        for views, trial in zip(shown, next(iter(preview.trials.values())), strict=True):
            views["guide"] = replace(trial.after, pictures=trial.after.guides)
    data = PlayerData(names, width, height, float(preview.rate))
    for number, (passage, views) in enumerate(zip(preview.selection.passages, shown, strict=True)):
        for place in range(_count(preview, passage.before.end)):
            time = place / preview.rate / preview.stretch
            pictures = [view.pictures[view.place_at(time)] for view in views.values()]
            data.frames.append(
                {
                    "number": place,
                    "note": format_time(passage.in_clip(time)),
                    "passage": number,
                    "images": [data.add_picture(data_uri(each, "jpeg")) for each in pictures],
                }
            )
    return data


def estimate_sentence(frames: int | None, seconds_per_frame: float) -> str:
    """Return the expected duration of a conversion in a sentence, or its speed if the number of frames is unknown."""
    if frames is None:
        speed = rounded(1 / seconds_per_frame, 2)
        return f"about {speed} frames a second; the length of the clip is not known beforehand."
    return f"about {format_duration(frames * seconds_per_frame)} for {frames:,} frames."


def write_video(path: str, preview: Preview, *, overwrite: bool = False) -> None:
    """Write every passage at full and at quarter speed, at the rate of the output, without sound."""
    shown = []
    for views in preview.views():
        for speed in SPEEDS:
            label = "" if speed == 1 else f", {speed} of the speed"
            count = _count(preview, views["before"].end / speed)
            shown += [(views, place * speed / preview.rate / preview.stretch, label) for place in range(count)]
    height, width = _beside(*shown[0]).shape[:2]
    info = ClipInfo(path, height, width, preview.rate, 1 / preview.rate, len(shown))
    with open_sink(path, info, overwrite=overwrite) as sink:
        for number, each in enumerate(shown):
            sink.write(Frame(_beside(*each), number / preview.rate, 1 / preview.rate))


def _beside(views: dict[str, View], time: Fraction, label: str) -> np.ndarray:
    """Return the pictures of all views at a time, side by side, each under its name."""
    return np.concatenate([_labelled(view.image_at(time), name + label) for name, view in views.items()], axis=1)


def _labelled(image: np.ndarray, text: str) -> np.ndarray:
    """Return a picture under a line of text, with even sides as encoders require."""
    height, width = (each + each % 2 for each in image.shape[:2])
    canvas = np.zeros((height + LABEL_HEIGHT, width, 3), np.uint8)
    canvas[LABEL_HEIGHT : LABEL_HEIGHT + image.shape[0], : image.shape[1]] = image
    (across, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)
    scale = 0.6 * min(1.0, (width - 16) / max(across, 1))
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas
