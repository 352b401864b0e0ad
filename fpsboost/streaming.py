"""Conversion loop: groups source frames into pairs, interpolates them, and writes the output frames in order.

All steps stream over a few frames, so memory does not grow with length. Source frames that fall on an output time go to
the sink unchanged, with the decoder's own frame; but duplicate frames are replaced by interpolated ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import chain, groupby, islice, pairwise
from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.contracts import (
    Cancellable,
    FrameSink,
    FrameSource,
    LowestMatch,
    Observer,
    OutputRange,
    SilentObserver,
    Summary,
)
from fpsboost.frame import Frame, PairMotion
from fpsboost.image import view
from fpsboost.interpolator import Interpolator
from fpsboost.options import Range, checked
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.exposure import Exposure
from fpsboost.threads import available_cores, nothing, read_ahead, run_in_parallel, write_behind
from fpsboost.timeline import Interval, ScheduledFrame, Timeline, TimelineOptions
from fpsboost.timing.position import format_time
from fpsboost.timing.schedule import Schedule

LONG = 2
"""Least number of frame intervals between two frames across which a cut is named in a remark."""
MOST_NOTED = 10
"""Number of remarks from which no more are added."""
FRAMES_PER_TASK = 4  # maximum number of output frames that one task makes


@checked
def run_conversion(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    options: TimelineOptions = TimelineOptions(),
    threads: Annotated[int, Range(1)] | None = None,
    outputs: OutputRange = OutputRange(),
) -> Summary:
    """Run the loop over objects: read, interpolate, write. The caller opens and closes source and sink.

    Parameters
    ----------
    source : FrameSource
    interpolator : Interpolator
    sink : FrameSink
        Must have been entered. A sink with an attribute ``needs_confidence`` or ``needs_motion`` that is True gets
        frames with these; see `fpsboost.Frame`.
    schedule : Schedule
        Determines the output times. With a `shutter`, every output frame is the mean of several that are interpolated
        around its time, in one scene; images must be arrays.
    observer : Observer, optional
        Informed of the progress.
    options : TimelineOptions
        How the frames of the source are shown: slowed down, or with duplicates or damaged ones replaced.
    threads : int, optional
        Pairs of frames processed in parallel; as many as there are cores by default. Frames are the same with any
        number.
    outputs : OutputRange
        Output frames that the sink gets; all by default.

    Raises
    ------
    OptionError
        `threads` is below 1.
    InputError
        The source has fewer than two frames, or more than 8 in a row are to be replaced. Errors of source and sink are
        passed on.
    """
    summary = Summary(completed_frames=outputs.skip)
    observer = observer or SilentObserver()
    with (
        interpolate_frames(
            source,
            interpolator,
            schedule,
            summary,
            sink=sink,
            options=options,
            threads=threads,
            outputs=outputs,
        ) as frames,
        write_behind(sink.write, 2, _cancel_of(sink)) as write,
    ):
        observer.ready()
        begin = time.perf_counter()
        for frame in frames:
            write(frame)
            summary.frames_out += 1
            summary.seconds = time.perf_counter() - begin
            observer.wrote(summary)
    summary.remarks.take([*source.remarks, *sink.remarks])
    summary.details = getattr(sink, "details", "")
    return summary


@contextmanager
def interpolate_frames(
    source: FrameSource,
    interpolator: Interpolator,
    schedule: Schedule,
    summary: Summary,
    *,
    sink: FrameSink | None = None,
    options: TimelineOptions = TimelineOptions(),
    threads: int | None = None,
    outputs: OutputRange = OutputRange(),
) -> Generator[Iterator[Frame]]:
    """Yield the output frames in order, made while the block lasts; see `run_conversion`.

    The first frame is read when the block begins. The summary is updated with the numbers of frames read and made.
    Without a sink, the last frame is held, and frames have neither confidence nor motion.
    """
    with (
        read_ahead(source, 1, _cancel_of(source)) as arriving,
        run_in_parallel(threads or available_cores(), _cancel_of(source)) as in_order,
    ):
        first = list(islice(arriving, 1))
        timeline = Timeline(source, schedule, interpolator, summary, outputs, options)
        loop = _Loop(timeline, interpolator, summary, sink)
        yield loop.frames(in_order(loop.tasks(chain(first, arriving))))


def _cancel_of(end: FrameSource | FrameSink) -> Callable[[], None]:
    """Return the function that stops a source or sink that waits for another program."""
    return end.cancel if isinstance(end, Cancellable) else nothing


class MadeFrame(NamedTuple):
    """Frame of the output, or a sample of its exposure, with its image."""

    output: ScheduledFrame
    content: InterpolatedImage
    is_original: bool = False
    """Whether it is a frame of the source."""
    motion: PairMotion | None = None
    scene: int = 0
    """Number of cuts before it."""


class Batch(NamedTuple):
    """Output frames of an interval that one task has made."""

    interval: Interval
    begin: int
    """Number of output frames of the interval before these."""
    frames: list[MadeFrame]
    match: LowestMatch | None
    """How well the two pictures match, with the first of the frames; None if nothing is interpolated in a scene."""


@dataclass
class _Loop:
    """Makes the output frames of a timeline."""

    timeline: Timeline
    interpolator: Interpolator
    summary: Summary
    sink: FrameSink | None

    def __post_init__(self) -> None:
        sink = self.sink
        self.holds_last_frame = sink is None or sink.holds_last_frame
        self.needs_confidence = getattr(sink, "needs_confidence", False)
        self.needs_motion = getattr(sink, "needs_motion", False)

    def tasks(self, frames: Iterator[Frame]) -> Iterator[Callable[[], Batch]]:
        """Yield the tasks in order, several for an interval of many frames, so that these take no extra memory."""
        for interval in self.timeline.intervals(frames):
            for begin in range(0, max(len(interval.scheduled), 1), FRAMES_PER_TASK):
                yield partial(self.make, interval, begin)

    def make(self, interval: Interval, begin: int) -> Batch:
        """Make the output frames of a part of an interval; those that are not needed carry any image."""
        outputs = interval.outputs[begin : begin + FRAMES_PER_TASK]
        match = self.measure_match(interval) if begin == 0 and interval.is_counted and not interval.scene_cut else None
        missing = [each for each in outputs if each.is_made]
        images = self.interpolator.images(
            interval.pair,
            [each.step.t for each in missing],
            with_confidence=self.needs_confidence,
            guides=[each.guide for each in missing],
        )
        frames = [
            # between frames that show the same, a repeated one is certain
            self.interpolated(interval, each, images) if each.is_interpolated else self.repeated(each, 1)
            for each in outputs
        ]
        return Batch(interval, begin, frames, match)

    def interpolated(
        self, interval: Interval, output: ScheduledFrame, images: Iterator[InterpolatedImage]
    ) -> MadeFrame:
        """Return an output frame with the next one of the images if it is needed."""
        motion = self.motion(interval) if self.needs_motion and output == interval.interpolated[0] else None
        if not output.is_missing:
            return MadeFrame(output, InterpolatedImage(output.source.image), motion=motion)
        image = next(images)
        is_exposed = output.step.frame_number is not None  # and averaged before it is masked
        image = image if is_exposed else self.masked(image, output)
        return MadeFrame(output, image, motion=motion)

    def repeated(self, output: ScheduledFrame, confidence: float) -> MadeFrame:
        """Return an output frame that repeats the source's, with this confidence unless it is shown at its own time."""
        image = output.source.image
        is_known = self.needs_confidence and output.step.time != output.source.time
        values = np.full(image.shape[:2], confidence, np.float32) if is_known else None
        return MadeFrame(output, InterpolatedImage(image, values), is_original=True)

    def masked(self, image: InterpolatedImage, output: ScheduledFrame) -> InterpolatedImage:
        """Return an image with the areas that a mask keeps of the nearest frame of the source."""
        mask = self.interpolator.mask
        return image if mask is None or mask.parts else mask.keep(image, output.nearest)

    def measure_match(self, interval: Interval) -> LowestMatch | None:
        """Return how well the frames of an interval match, with the interpolated frame halfway; None without one."""
        if not interval.interpolated:
            return None
        middle = min(interval.interpolated, key=lambda output: abs(output.step.t - Fraction(1, 2)))
        return LowestMatch(interval.pair.detected_match_score, middle.number, middle.shown)

    def motion(self, interval: Interval) -> PairMotion | None:
        """Return the motion of an interval; None if no motion connects the two pictures."""
        if interval.pair.is_discontinuous:
            return None
        places = self.timeline.place(interval.group[0]), self.timeline.place(interval.following)
        return PairMotion(*places, *(field.flow for field in interval.pair.fields))

    def frames(self, batches: Iterator[Batch]) -> Iterator[Frame]:
        """Yield the frames of the range that is written, with what is known only when the next one is made.

        Each gets the closed captions since the frame before, and the last one also those behind it.
        """
        timeline = self.timeline
        outputs = timeline.outputs
        for each, following in pairwise(chain(self.averaged(self.all_made(batches)), [None])):
            assert each is not None, "only the last one is"
            output = each.output
            picture = output.source.frame.original
            captions = timeline.take_captions(timeline.end if following is None else output.step.time)
            end = timeline.length if following is None else following.output.shown
            if output.number in outputs:
                yield Frame(
                    each.content.image,
                    timeline.start + output.shown,
                    end - output.shown,
                    original=picture if each.is_original else None,
                    preceding=None if each.is_original else picture,
                    confidence=each.content.confidence,
                    captions=captions,
                    guide=output.guide,
                    motion=each.motion,
                )
            if outputs.is_past(output.number + 1):
                return

    def all_made(self, batches: Iterator[Batch]) -> Iterator[MadeFrame]:
        """Yield the frames as they are made, those behind the last frame of the source too, and count them."""
        scenes = 0
        for batch in batches:
            interval = batch.interval
            if batch.begin == 0:
                scenes += interval.scene_cut
                self.count_interval(interval)
                self.summary.note_match(batch.match)
            self.count_frames(batch)
            if batch.begin + FRAMES_PER_TASK >= len(interval.outputs):
                interval.pair.release_caches()
            for each in batch.frames:
                # the cuts so far include the one in the middle of this interval
                yield each._replace(scene=scenes - (interval.scene_cut and each.output.step.t <= Fraction(1, 2)))
        for output in self.timeline.last_outputs(holds_last_frame=self.holds_last_frame):
            self.summary.frames_made += output.is_new and output.number in self.timeline.outputs
            yield self.repeated(output, 0)._replace(scene=scenes)

    def count_frames(self, batch: Batch) -> None:
        """Count the frames that a task has made, and what the motion between the pictures tells when it is known."""
        summary = self.summary
        pair = batch.interval.pair
        outputs = [each.output for each in batch.frames]
        summary.frames_made += sum(each.is_new for each in outputs if each.number in self.timeline.outputs)
        made = [each for each in outputs if each.is_made]
        if pair.unsure_share > 0:
            summary.unsure_frames += len(made)
            summary.unsure_pixels += len(made) * pair.unsure_share
        if pair.search_radius is not None:
            summary.search_radii.add(pair.search_radius)
        for each in made if self.timeline.options.guides is not None else ():
            if each.guide is None:
                summary.guides_missing.append(each.number)
            else:
                summary.note_guides(1, pair.findings[each.step.t]._asdict())

    def count_interval(self, interval: Interval) -> None:
        """Count the frames of an interval's group that are interpolated, and its cut, unless another run does."""
        summary = self.summary
        if not interval.is_counted:
            return
        if interval.is_repair:
            summary.replaced += [each.position.number for each in interval.group[1:]]
        elif not interval.is_still:
            summary.duplicates += len(interval.group) - 1
        summary.scene_cuts += interval.scene_cut
        apart = interval.pair.apart
        end = interval.following.position.seconds
        if interval.scene_cut and apart * self.timeline.info.rate >= LONG and len(summary.remarks) < MOST_NOTED:
            summary.remarks.add("cut-in-long-pair", begin=format_time(end - apart), end=format_time(end))

    def averaged(self, samples: Iterator[MadeFrame]) -> Iterator[MadeFrame]:
        """Yield the mean of each output frame's samples that show its scene; frames without samples as they are.

        What a mask keeps is that of one frame.
        """
        for frame_number, exposure in groupby(samples, lambda each: each.output.step.frame_number):
            if frame_number is None:
                yield from exposure
                continue
            exposures: dict[int, Exposure] = {}
            frame: MadeFrame | None = None
            for each in exposure:
                exposures.setdefault(each.scene, Exposure()).add(view(each.content.image).array())
                if not each.output.step.is_sample:
                    frame = each
            if frame is None:
                continue
            content = frame.content
            is_blurred = exposures[frame.scene].count > 1
            if is_blurred:
                content = content._replace(image=exposures[frame.scene].image())
            is_original = frame.is_original and not is_blurred
            yield frame._replace(content=self.masked(content, frame.output), is_original=is_original)
