"""The one loop: source -> held pictures -> pairs -> interpolator -> sink.

Everything is a stream over a few frames, so memory does not grow with length. Source frames that fall on an output time
go to the sink as they are, decoder's picture and all; but those that only show again what was there before give way to
frames that are made.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import chain, pairwise
from typing import Literal, NamedTuple, Protocol, get_args

from fpsboost.cut_list import CutList
from fpsboost.errors import InputError, OptionError, check_choice
from fpsboost.frame import ClipInfo, Frame
from fpsboost.held import Held, Shown, by_moments, one_by_one
from fpsboost.interpolator import Interpolator, Pair, with_neighbours
from fpsboost.media import FrameSink, FrameSource, Resuming, Waiting
from fpsboost.media.excerpt import Excerpt, ExcerptSource
from fpsboost.media.images.numbered import ImageSource
from fpsboost.media.opening import (
    beginning,
    check_images,
    cut_out,
    describe_job,
    makes_animation,
    makes_video,
    open_sink,
    open_source,
    purpose_of,
)
from fpsboost.media.video.encoding import Encoding
from fpsboost.media.video.reading import Reading
from fpsboost.media.video.source import VideoSource
from fpsboost.memory_limit import MemoryLimit
from fpsboost.method_table import find_method
from fpsboost.overlap import available_cores, nothing, read_ahead, side_by_side, write_behind
from fpsboost.pace import Pace, Rhythm, SlowSound, stretched
from fpsboost.prepared import Moment, PreparedImage
from fpsboost.scenes import DuplicateDetector
from fpsboost.timing import ByRate, Schedule, Step, rising_moment

PART = 4
"""Output frames that are made in one go, at most."""

READ_AHEAD = 4
WRITE_BEHIND = 4

Duplicates = Literal["interpolate", "keep"]

SHAPES_NOTHING = ("input", "output", "overwrite", "resume", "limit", "threads", "observer")
"""Arguments of `convert` that a run may change which goes on with another; every other one shapes the output."""


@dataclass
class Summary:
    """What a conversion did.

    Attributes
    ----------
    frames_in, frames_out : int
        Frames read and written.
    frames_made : int
        Frames written that are none of the source's: interpolated, or repeated across a cut.
    scene_cuts : int
        Pairs in which a scene ends; they were not interpolated across.
    duplicates : int
        Frames that showed the same as the one before, and were interpolated across.
    frames_there : int
        Frames of `frames_out` that an earlier run had finished.
    seconds : float
        Wall time of the loop, without compiling.
    remarks : list of str
        Sentences about everything that was lost or guessed.
    details : str
        How the target was written, for someone who wants to know; empty where there was no choice.
    rhythm : Rhythm
        How far apart the frames of the source are.
    search_radii : set of int
        Search radii that were chosen for pairs of frames, pixels; empty where the method has none.
    """

    frames_in: int = 0
    frames_out: int = 0
    frames_made: int = 0
    scene_cuts: int = 0
    duplicates: int = 0
    frames_there: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)
    details: str = ""
    rhythm: Rhythm = field(default_factory=Rhythm)
    search_radii: set[int] = field(default_factory=set)


class Observer(Protocol):
    """Contract: told how a conversion goes."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """Source and target are open; `expected_frames` will be written if the source's header is right."""
        ...

    def ready(self) -> None:
        """The kernels are compiled, or loaded from the cache; the first frame comes next."""
        ...

    def wrote(self, summary: Summary) -> None:
        """Another frame is on its way to the target."""
        ...


class Silent:
    """An `Observer` that keeps quiet."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """See `Observer.opened`."""

    def ready(self) -> None:
        """See `Observer.ready`."""

    def wrote(self, summary: Summary) -> None:
        """See `Observer.wrote`."""


def convert(
    input: str,
    output: str | None = None,
    *,
    factor: Fraction | int | None = None,
    fps: Fraction | int | None = None,
    keep_timing: bool = False,
    slow_motion: bool = False,
    slow_motion_sound: SlowSound | None = None,
    method: str | Interpolator = "nlm",
    input_fps: Fraction | int | None = None,
    excerpt: Excerpt | None = None,
    duplicates: Duplicates = "interpolate",
    fill_gaps: bool = False,
    in_place: bool = False,
    reading: Reading | None = None,
    encoding: Encoding | None = None,
    overwrite: bool = False,
    resume: bool = False,
    limit: MemoryLimit | None = None,
    threads: int | None = None,
    observer: Observer | None = None,
) -> Summary:
    """Convert a clip to a higher frame rate.

    Parameters
    ----------
    input, output : str
        Each a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``,
        ``shot_####.png``), or ``-`` for YUV4MPEG2 from standard input or to standard output. Images whose numbers
        rise by a step of 2 or more were rendered with that step: where `factor` divides it, the frames made get the
        numbers that are missing.
    factor : Fraction or int, optional
        Output frames per source frame; 2 where neither `factor` nor `fps` is given.
    fps : Fraction or int, optional
        Output frames per second, instead of `factor`.
    keep_timing : bool
        Multiply the frames of each interval by `factor`. Otherwise a video comes out at a constant rate, whatever the
        source does, and frames are made for the times of that.
    slow_motion : bool
        Last `factor` times as long, at the source's rate or at `fps`.
    slow_motion_sound : {'drop', 'stretch'}, optional
        Leave the sound of slow motion out, which is done unless told, or make it last as long at its own pitch.
    method : str or Interpolator
        A name of `fpsboost.methods`, or an object.
    input_fps : Fraction or int, optional
        Frames per second of input images.
    excerpt : Excerpt, optional
        Which part of the input to convert; all of it where it is not given.
    duplicates : {'interpolate', 'keep'}
        Frames that show the same as the one before, as in animation on threes, pulldown and captures that missed some:
        make the moving picture at their times, or keep them. Stills, and pictures held until a cut, are always kept.
        Not looked for where a renderer's motion vectors say what moves, nor where just the images are made that are
        missing between numbers.
    fill_gaps : bool
        Make just the images that are missing between numbered ones, each at the time of its number. `input_fps` then
        counts numbers, and `factor`, frames per number, is 1 unless told.
    in_place : bool
        Put the frames that are made beside the images of the input, and leave `output` out. Nothing that is there is
        touched.
    reading : Reading, optional
        Which stream of a video file is read, whether its fields become frames first, and what happens where its size
        changes.
    encoding : Encoding, optional
        How to encode video, and which streams to keep.
    overwrite : bool
        Replace an existing output.
    resume : bool
        Go on with what an earlier run of the same input and options had finished when it was stopped; where there is
        nothing, start.
    limit : MemoryLimit, optional
        What may be taken: a clip that needs more is refused before it is decoded. What is available without it.
    threads : int, optional
        Pairs of frames that are worked on side by side; as many as there are cores and memory for without it. Frames
        are the same with any number.
    observer : Observer, optional
        Told how it goes.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError, InputError, OutputError
        See `fpsboost.errors`.
    CompleteAlreadyError
        The output that `resume` was to go on with is there.

    Examples
    --------
    >>> convert("in.mp4", "out.mp4", factor=2)  # doctest: +SKIP
    """
    options = {name: value for name, value in locals().items() if name not in SHAPES_NOTHING}
    check_choice("--duplicates", duplicates, get_args(Duplicates))
    output = _target(input, output, in_place=in_place, overwrite=overwrite)
    pace = Pace(_fraction(factor), _fraction(fps), keep_timing, slow_motion, slow_motion_sound, fill_gaps)
    interpolator = find_method(method) if isinstance(method, str) else method
    encoding = encoding or Encoding()
    to_video = makes_video(output)
    to_file = to_video or makes_animation(output)
    excerpt = excerpt or Excerpt()
    purpose = purpose_of(
        output,
        encoding,
        needs_rate=fps is not None or excerpt.needs_rate,
        takes_planes=interpolator.takes_planes,
    )
    with open_source(
        input,
        _fraction(input_fps),
        purpose=purpose,
        reading=reading,
        fill_gaps=fill_gaps,
        in_place=in_place,
        limit=limit,
    ) as whole:
        may_skip = not (isinstance(interpolator.cuts, CutList) and interpolator.cuts.counts_frames)
        source = cut_out(whole, excerpt, may_skip=may_skip, stretch=pace.stretch)
        info = source.info
        encoding, lost = _with_sound_that_fits(encoding, whole, pace)
        schedule = pace.schedule(info, has_clock=to_video)
        multiple = schedule.rate(info.rate) / info.rate
        keeps_numbers = isinstance(whole, ImageSource) and not to_file and whole.numbers_for(multiple) is not None
        if fill_gaps or keeps_numbers:  # an image that repeats another is none that is missing
            duplicates = "keep"
        expected = count_frames(schedule, info, holds_last_frame=to_video)
        interpolator, on_vectors = _with_vectors_by_number(interpolator, whole, multiple, expected)
        sink = open_sink(
            output,
            source=whole,
            timing=pace.timing(info, schedule),
            encoding=encoding,
            expected_frames=expected,
            overwrite=overwrite,
            job=describe_job(whole, resume=resume, **options),
            window=source.window if isinstance(source, ExcerptSource) else None,
            factor=multiple,
            in_place=in_place,
        )
        if threads is None:
            threads = (limit or MemoryLimit()).affordable_threads(info.width, info.height, available_cores())
        observer = observer or Silent()
        observer.opened(info, count_frames(schedule, info, sink.holds_last_frame))
        with sink:
            there = sink.frames_there if isinstance(sink, Resuming) else 0
            summary = boost(
                source,
                interpolator,
                sink,
                schedule,
                observer,
                duplicates=duplicates,
                stretch=pace.stretch,
                skip=there,
                threads=threads,
            )
    # some are known only when everything has been put together
    summary.remarks += [remark for remark in sink.remarks if remark not in summary.remarks]
    summary.remarks += [*lost, *on_vectors, *pace.remarks(info, schedule, summary.rhythm)]
    if isinstance(whole, ImageSource) and whole.step > 1 and to_file:
        summary.remarks.append(
            f"--input-fps counts the images of {info.name} and not their numbers: of a scene with 24 numbers a second "
            f"it is 24/{whole.step}, or 24 with --fill-gaps."
        )
    return summary


def _target(input: str, output: str | None, *, in_place: bool, overwrite: bool) -> str:
    """Where the output goes."""
    if not in_place:
        if output is None:
            raise OptionError(f"There is no output for {input}; name one, or give --in-place for images beside it.")
        return output
    if output is not None:
        raise OptionError(f"--in-place writes beside the images of {input}; leave the output {output} out.")
    if overwrite:
        raise OptionError("--in-place replaces nothing; leave --overwrite out.")
    check_images(input, "--in-place")
    return input


def _with_vectors_by_number(
    interpolator: Interpolator, source: FrameSource, factor: Fraction, count: int | None
) -> tuple[Interpolator, list[str]]:
    """A renderer's vectors by the numbers of the output's frames where both have some, and a remark if they differ."""
    if not isinstance(source, ImageSource) or not source.numbers or count is None:
        return interpolator, []
    kept = source.numbers_for(factor)
    if interpolator.needs_every_frame and kept is None and (source.step > 1 or source.fills_gaps):
        raise OptionError(
            f"A renderer's motion vectors go by the numbers of {source.info.name}, and {factor} times the frames do "
            f"not fit between those; give --factor {source.step}."
        )
    first, step = kept or (source.first_number + int(source.skipped * factor), 1)
    return interpolator.with_vectors_for(range(first, first + count * step, step), must_match=kept is not None)


def boost(
    source: FrameSource,
    interpolator: Interpolator,
    sink: FrameSink,
    schedule: Schedule,
    observer: Observer | None = None,
    *,
    duplicates: Duplicates = "interpolate",
    stretch: Fraction = Fraction(1),
    skip: int = 0,
    threads: int | None = None,
) -> Summary:
    """Run the loop over objects: read, interpolate, write. The caller opens and closes source and sink.

    Parameters
    ----------
    source : FrameSource
    interpolator : Interpolator
    sink : FrameSink
        Entered already.
    schedule : Schedule
        Which output times there are.
    observer : Observer, optional
        Told how it goes.
    duplicates : {'interpolate', 'keep'}
        See `convert`.
    skip : int
        Output frames, from the first, that the sink has already; see `fpsboost.media.Resuming`. They are counted and
        handed over in their turn, but where an image would have to be made, one of the source stands in for it.
    stretch : Fraction
        How many times as long the output lasts; the schedule does not know of it.
    threads : int, optional
        Pairs of frames that are worked on side by side; as many as there are cores without it. Frames are the same
        with any number.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError
        There is no such way to treat duplicates, or `threads` is below 1.
    InputError
        Fewer than two frames, and whatever source and sink raise.
    """
    check_choice("--duplicates", duplicates, get_args(Duplicates))
    if threads is not None and threads < 1:
        raise OptionError(f"--threads must be at least 1, not {threads}.")
    detector = DuplicateDetector() if duplicates == "interpolate" and not interpolator.needs_every_frame else None
    summary = Summary(frames_there=skip)
    observer = observer or Silent()
    with (
        read_ahead(source, READ_AHEAD, _give_up(source)) as arriving,
        write_behind(sink.write, WRITE_BEHIND, _give_up(sink)) as write,
        side_by_side(threads or available_cores(), _give_up(source)) as in_order,
    ):
        first = next(arriving, None)
        if first is not None:
            interpolator.compile_for(first.image)
        observer.ready()
        begin = time.perf_counter()
        frames = arriving if first is None else chain([first], arriving)
        clip = _Clip(source.info, schedule, interpolator, summary, beginning(source), skip)
        outputs = _output_frames(frames, clip, detector, sink.holds_last_frame, in_order)
        for frame in stretched(_with_durations(outputs), stretch):
            write(frame)
            summary.frames_out += 1
            summary.seconds = time.perf_counter() - begin
            observer.wrote(summary)
    summary.remarks += [*source.remarks, *sink.remarks]
    summary.details = getattr(sink, "details", "")
    return summary


def _with_sound_that_fits(encoding: Encoding, source: FrameSource, pace: Pace) -> tuple[Encoding, list[str]]:
    """Sound lasts as long as it lasts, so that slow motion has none unless told; and a remark where that is a loss."""
    if pace.slow_motion_sound == "stretch" and not encoding.audio:
        raise OptionError("--slow-motion-sound stretch and --no-audio contradict each other; give one of them.")
    if pace.stretch == 1 or not encoding.audio or pace.slow_motion_sound == "stretch":
        return encoding, []
    has_sound = isinstance(source, VideoSource) and "sound" in source.companions
    lost = [f"{source.info.name} has sound, which slow motion leaves out."] if has_sound else []
    return replace(encoding, audio=False, audio_codec=None), lost


def _give_up(end: FrameSource | FrameSink) -> Callable[[], None]:
    """How to stop a source or sink that waits for another program."""
    return end.give_up if isinstance(end, Waiting) else nothing


class _Interval(NamedTuple):
    """From a held picture, nearly always one frame, to the next: the frames, and what falls into each one's time."""

    held: Held
    steps: list[list[Step]]
    end: Fraction
    pair: Pair


class _Made(NamedTuple):
    """Output frames of a part of an interval."""

    interval: _Interval
    frames: list[Frame]
    new: int
    """How many of them are none of the source's."""
    scene_cut: bool
    duplicates: int
    """Frames of the interval that are interpolated across."""
    begins: bool
    """It is the first part of the interval."""
    ends: bool
    """It is the last one."""


@dataclass
class _Clip:
    """What stays the same throughout the loop, and where it is."""

    info: ClipInfo
    schedule: Schedule
    interpolator: Interpolator
    summary: Summary
    beginning: Moment
    skip: int = 0
    """Output frames still to come that nobody looks at."""
    start: Fraction = Fraction(0)
    index: int = 0
    """Number of the next frame to become part of an interval."""
    last: Held | None = None
    """What was shown last."""

    def shown(self, frames: Iterator[Frame]) -> Iterator[Shown]:
        """The source's frames with their places, counted, at the times that the schedule takes them to have."""
        last: Fraction | None = None
        for frame in frames:
            if last is None:
                self.start = frame.time
            self.summary.rhythm.note(frame.time)
            number = self.summary.frames_in
            self.summary.frames_in += 1
            moment = rising_moment(self.schedule, self.start, frame.time, last)
            if moment is None:
                continue
            last = moment
            place = self.schedule.place(number, self.start, moment)
            shown = Moment(self.beginning.number + number, self.beginning.seconds + frame.time - self.start)
            yield Shown(replace(frame, time=moment), PreparedImage(frame.image, place, shown))

    def intervals(self, moments: Iterable[Held]) -> Iterator[_Interval]:
        """From each held picture to the next."""
        for held in moments:
            if self.last is not None:
                yield self.interval(self.last, held)
            self.last = held

    def skipped(self, frames: int) -> int:
        """How many of the next frames nobody looks at; asked for in order."""
        count = min(self.skip, frames)
        self.skip -= count
        return count

    def interval(self, held: Held, following: Held) -> _Interval:
        """From one held picture to the next; asked for in order."""
        frames = [*(shown.frame for shown in held), following[0].frame]
        steps = []
        for frame, after in pairwise(frames):
            steps.append(list(self.schedule.steps(self.index, self.start, frame.time, after.time)))
            self.index += 1
        end = frames[-1].time
        return _Interval(
            held, steps, end, self.interpolator.pair(held[0].image, following[0].image, end - frames[0].time)
        )


def _output_frames(
    frames: Iterator[Frame],
    clip: _Clip,
    detector: DuplicateDetector | None,
    holds_last_frame: bool,
    in_order: Callable[[Iterable[Callable[[], _Made]]], Iterator[_Made]],
) -> Generator[Frame, None, Fraction]:
    """Yield the output frames without durations; return when the clip ends."""
    shown, summary = clip.shown(frames), clip.summary
    moments = one_by_one(shown) if detector is None else by_moments(shown, detector)
    for made in in_order(_jobs(clip, moments)):
        summary.frames_made += made.new
        if made.begins:
            summary.duplicates += made.duplicates
            summary.scene_cuts += made.scene_cut
        yield from made.frames
        if made.ends:
            if made.interval.pair.search_radius is not None:
                summary.search_radii.add(made.interval.pair.search_radius)
            made.interval.pair.settle()
    if clip.last is None or clip.summary.frames_in < 2:
        count = "one frame" if clip.summary.frames_in else "no frame"
        raise InputError(f"{clip.info.name} holds {count} that can be read, and two are needed to make one in between.")
    last = clip.last[-1].frame
    end = last.time + (last.duration or 1 / clip.info.rate)
    meant = clip.schedule.moment(clip.start, end)
    end = meant if meant > last.time else end
    for step in clip.schedule.steps(clip.index, clip.start, last.time, end):
        if step.t == 0 or holds_last_frame:
            clip.summary.frames_made += step.time != last.time
            yield replace(last, time=step.time)
    return end


def _jobs(clip: _Clip, moments: Iterable[Held]) -> Iterator[Callable[[], _Made]]:
    """What there is to be made, in order: a part of an interval each, so that many frames between two take no memory.

    Runs one pair behind the source: how a pair's motion goes on is seen in the next.
    """
    for before, interval, after in with_neighbours(clip.intervals(moments)):
        count = sum(map(len, interval.steps))
        skipped = clip.skipped(count)
        neighbours = before and before.pair, after and after.pair
        for begin in range(0, max(count, 1), PART):
            part = range(begin, min(begin + PART, count))
            yield partial(_make, interval, neighbours, clip.interpolator, part, skipped)


def _make(
    interval: _Interval,
    neighbours: tuple[Pair | None, Pair | None],
    interpolator: Interpolator,
    part: range,
    skipped: int,
) -> _Made:
    """The output frames of a part of an interval; in place of the first `skipped`, any image."""
    breaks_off = len(interval.held) > 1 and interval.pair.breaks_off(*neighbours)
    if breaks_off:
        # nothing leads on from it, so it stays held until the last of its frames ends in the cut
        shown = [(each, step) for each, steps in zip(interval.held, interval.steps, strict=True) for step in steps]
        first_to_move = len(shown) - len(interval.steps[-1])
    else:
        shown, first_to_move = [(interval.held[0], step) for step in _in_one(interval)], 0
    moves = [index >= first_to_move and step.t > 0 for index, (_, step) in enumerate(shown)]
    inner = [shown[index][1].t for index in part if moves[index] and index >= skipped]
    images, scene_cut = interpolator.between(interval.pair, inner, *neighbours) if any(moves) else (iter(()), False)
    frames = []
    for index in part:
        each, step = shown[index]
        if moves[index]:
            frames.append(Frame(each.frame.image if index < skipped else next(images), step.time))
        else:
            frames.append(replace(each.frame, time=step.time))
    new = sum(shown[index][1].time != shown[index][0].frame.time for index in part)
    duplicates = 0 if breaks_off else len(interval.held) - 1
    return _Made(interval, frames, new, scene_cut, duplicates, part.start == 0, part.stop == len(shown))


def _in_one(interval: _Interval) -> list[Step]:
    """The steps of all frames of a held picture, each at its place on the way to the next."""
    if len(interval.held) == 1:
        return interval.steps[0]
    begin = interval.held[0].frame.time
    lasts = interval.end - begin
    return [Step(step.time, (step.time - begin) / lasts) for steps in interval.steps for step in steps]


def _with_durations(frames: Generator[Frame, None, Fraction]) -> Iterator[Frame]:
    """Every frame lasts until the next one, and the last one until the clip ends."""
    held: Frame | None = None
    while True:
        try:
            frame = next(frames)
        except StopIteration as stop:
            end = stop.value
            break
        if held is not None:
            yield replace(held, duration=frame.time - held.time)
        held = frame
    if held is not None:
        yield replace(held, duration=end - held.time)


def count_frames(schedule: Schedule, info: ClipInfo, holds_last_frame: bool) -> int | None:
    """How many frames the output will have, if the source's header is right; None where it does not say."""
    if isinstance(schedule, ByRate) and info.duration is not None:
        end = schedule.moment(Fraction(0), info.duration)
        if holds_last_frame:
            return math.ceil(end * schedule.frames_per_second)
        return math.floor((end - 1 / info.rate) * schedule.frames_per_second) + 1
    if info.frame_count is None:
        return None
    intervals = info.frame_count if holds_last_frame else info.frame_count - 1
    whole, rest = divmod(intervals * schedule.rate(info.rate) / info.rate, 1)
    return int(whole) + bool(rest) + (not holds_last_frame and not rest)


def _fraction(value: Fraction | int | None) -> Fraction | None:
    return None if value is None else Fraction(value)
