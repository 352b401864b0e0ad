"""Preparation of a conversion: opens the source, trims it to the frames between two positions, and works out everything
that is known before the first frame.
"""

from __future__ import annotations

import math
import os
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import accumulate, islice, pairwise
from pathlib import Path
from typing import Protocol, runtime_checkable

from fpsboost.analysis.cadence import Repeats
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame
from fpsboost.analysis.gaps import find_gaps
from fpsboost.analysis.scene_cuts import CutList, counts_frames
from fpsboost.contracts import ClosesOnExit, FrameSource, RandomAccess
from fpsboost.errors import InputError, OptionError, refuse
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource, SeekableSource
from fpsboost.io.animation import ANIMATION_SUFFIXES
from fpsboost.io.images.files import extension_of, read_image
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.images.source import is_pattern
from fpsboost.io.opening import PIPES, Target, check_images, open_source
from fpsboost.io.output import Output, StreamInfo
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.media import FOREVER, TIME_TOLERANCE, VIDEO_SUFFIXES, Window, counted
from fpsboost.memory import BYTES_PER_PIXEL, MemoryLimit
from fpsboost.method_table import BYTES_PER_PIXEL_OF
from fpsboost.options import Checked, PathName
from fpsboost.render.folder import VectorFolder, fit_vectors
from fpsboost.run_options import RunOptions
from fpsboost.streaming import beginning
from fpsboost.timing.position import Gaps, Position, Trim, format_time
from fpsboost.timing.rate import FrameIntervals, OutputRate, readable
from fpsboost.timing.schedule import ByRate, Schedule, count_frames
from fpsboost.timing.time_map import TimeMap

BLOCK = 16
"""Frames that are in memory at a time where a source plays backwards."""


OUTPUT_SUFFIXES = (*VIDEO_SUFFIXES, *ANIMATION_SUFFIXES)
FALLBACK_SUFFIX = ".mkv"
"""Suffix of the output if the input's cannot be written; Matroska holds every kind of audio and subtitles."""


MOST_LISTED = 40  # gaps that a remark lists


ENCODER_BYTES_PER_PIXEL = 270
"""Bytes of memory that an encoder of video takes for a pixel; measured: 255 with libx264, which looks 40 frames
ahead."""


@runtime_checkable
class Sliceable(Protocol):
    """Contract: source that can leave out frames without reading them, because it has a file for each."""

    def keep(self, first: int, last: int | None) -> None:
        """Read only the frames from one place to before another; must be called before the first frame is read."""


def trim_source(
    source: FrameSource, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None
) -> tuple[FrameSource, Window | None]:
    """Return a part of a clip, and the window on the clip's clock; None if the other streams of the clip are whole."""
    if trim.is_whole and curve is None:
        return source, None
    if isinstance(source, Sliceable):
        rate = source.info.rate
        begin, end = (None if time is None else math.ceil(time * rate) for time in trim.seconds(source.info))
        source.keep(begin or 0, end)
        return source, None
    trimmed = TrimmedSource(source, trim, may_skip=may_skip, curve=curve)
    return trimmed, trimmed.window


class TrimmedSource(ClosesOnExit):
    """Source of the frames that lie in a part of another source, not read yet; the first one has time 0.

    With `may_skip`, it seeks to the start if the source can; otherwise every frame before it is read and counted.
    `window` is filled in while frames are read, with `curve`; the frames keep their intervals. Iterating raises
    `InputError` if the clip ends before the part begins.
    """

    def __init__(self, source: FrameSource, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None) -> None:
        self._source, self._trim = source, trim
        by_frames = any(place is not None and place.is_frame for place in (trim.start, trim.end))
        self._seekable = source if isinstance(source, SeekableSource) else None
        self._may_skip = may_skip and trim.start is not None and not by_frames and self._seekable is not None
        origin = Fraction(0) if self._seekable is None else self._seekable.first_time()
        begin, end = trim.seconds(source.info)
        planned_end = None if end is None else origin + end
        self._rounding = min(source.info.time_base, TIME_TOLERANCE)
        self._is_cut_short = False
        self._first = self._dropped = 0
        self._begun = False
        self._own_remarks: list[str] = []
        self._ended = f"{source.info.name} has ended where `start={trim.start}` would be; name an earlier one."
        self.window = Window(origin + begin, None if by_frames else planned_end, planned_end, origin, curve=curve)

    @property
    def info(self) -> ClipInfo:
        return self._trim.of_info(self._source.info)

    @property
    def remarks(self) -> list[str]:
        return [*self._own_remarks, *self._source.remarks]

    @property
    def beginning(self) -> SourcePosition:
        """Position of the part's first frame in its clip; valid when that has been read.

        If frames before it were skipped without reading them, its number is that of the nominal rate.
        """
        number = self.window.frames_before(self._source.info.rate) if self._may_skip else self.window.skipped
        return SourcePosition(number, self.window.begin - self.window.origin)

    def close(self) -> None:
        self._source.close()

    def frame_times(self) -> Sequence[Fraction] | None:
        part = self._listed()
        if part is None:
            return None
        times, numbers = part
        return [times[number] - times[numbers[0]] for number in numbers]

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, and fill `window` as far as the times of frames tell it."""
        part = self._listed()
        if part is None:
            self._dropped = number
            if number:
                self._own_remarks.append(
                    f"{self.info.name} was read from where the range begins, because the times of its frames are known "
                    "only by decoding them."
                )
            return
        times, numbers = part
        if number >= len(numbers):
            raise InputError(
                f"The range of {self.info.name} has {len(numbers)} frames, and none has the number {number}."
            )
        assert isinstance(self._source, RandomAccess)
        self._first, self._begun = numbers[number], True
        self._source.begin_at(self._first)
        self.window.origin, self.window.begin, self.window.skipped = times[0], times[numbers[0]], numbers[0]

    def _listed(self) -> tuple[Sequence[Fraction], range] | None:
        """Return the times of the clip's frames, and the numbers of those in the part; None if only decoding tells."""
        times = self._source.frame_times() if isinstance(self._source, RandomAccess) else None
        if times is None:
            return None
        first, last = (
            bisect_left(
                range(len(times)),
                True,
                key=lambda number: place.is_reached(number, times[number] - times[0] + self._rounding),
            )
            for place in (
                self._trim.start or Position(Fraction(0)),
                self._trim.end or Position(Fraction(len(times)), is_frame=True),
            )
        )
        if first >= last:
            raise InputError(self._ended)
        return times, range(first, last)

    def __iter__(self) -> Iterator[Frame]:
        last: Frame | None = None
        for frame in islice(self._trimmed_frames(), self._dropped, None):
            if last is not None:
                yield replace(last, time=last.time - self.window.begin)
            last = frame
        if last is None:
            raise InputError(self._ended)
        if self._is_cut_short and self.window.end is not None:
            last = replace(last, duration=self.window.end - last.time)
        yield replace(last, time=last.time - self.window.begin)

    def _trimmed_frames(self) -> Iterator[Frame]:
        start, end, window = self._trim.start, self._trim.end, self.window
        if self._may_skip and self._seekable is not None and not self._begun:
            self._seekable.skip_to(window.begin - self._rounding)
        begun = self._begun
        for number, frame in enumerate(self._source, self._first):
            if number == 0 and self._seekable is None:
                window.origin = frame.time
            seconds = frame.time - window.origin + self._rounding
            if start is not None and not start.is_reached(number, seconds):
                continue
            if end is not None and end.is_reached(number, seconds):
                window.end = frame.time if end.is_frame else window.origin + end.value
                self._is_cut_short = True
                return
            if not begun:
                begun = True
                window.begin, window.skipped = frame.time, number
            yield frame


@dataclass
class FoldedSource(ClosesOnExit):
    """Source of the frames of another one in any order of runs, at times of its own; it opens the other one for each.

    `order` are numbers of its frames, `read_from` opens it at a frame, and `beginning` is the position of the frame at
    the time of its first one. A run rises, with or without steps, and is read at once; what runs backwards is read in
    short blocks.
    """

    info: ClipInfo
    remarks: list[str]
    order: Sequence[int]
    times: Sequence[Fraction]
    read_from: Callable[[int], AbstractContextManager[FrameSource]]
    beginning: SourcePosition = field(default=SourcePosition(0, Fraction(0)))
    first: int = 0

    def frame_times(self) -> Sequence[Fraction]:
        return self.times

    def begin_at(self, number: int) -> None:
        self.first = number

    def __iter__(self) -> Iterator[Frame]:
        place, order = self.first, self.order
        while place < len(order):
            step = order[place + 1] - order[place] if place + 1 < len(order) else 0
            stop = place + 1
            while stop < len(order) and (
                order[stop] > order[stop - 1]
                if step > 0
                else order[stop] - order[stop - 1] == step < 0 and stop - place < BLOCK
            ):
                stop += 1
            first, wanted = min(order[place], order[stop - 1]), {*order[place:stop]}
            with self.read_from(first) as source:
                numbered = enumerate(source, first if isinstance(source, RandomAccess) else 0)
                frames = islice((frame for number, frame in numbered if number in wanted), len(wanted))
                for frame in frames if step >= 0 else list(frames)[::-1]:
                    yield replace(frame, time=self.times[place], duration=Fraction(0))
                    place += 1
                self.remarks += [remark for remark in source.remarks if remark not in self.remarks]


@dataclass(frozen=True)
class ConversionJob(Checked):
    """Conversion of a clip: everything that shapes its output, as `fpsboost.convert` takes it.

    `output` is None for images beside the input, or for a name beside it; see `output_beside`.
    """

    input: PathName
    output: PathName | None
    rate: OutputRate
    method: Interpolator
    decoding: DecodeOptions = DecodeOptions()
    encoding: Encoding = field(default_factory=Encoding)

    def of_part(self, trim: Trim) -> ConversionJob:
        """Return the same conversion of a part of the clip, which is no loop by itself."""
        return replace(self, rate=replace(self.rate, loop=False), decoding=replace(self.decoding, trim=trim))

    def target(self, run: RunOptions) -> Target:
        """Return the output's target; raise `OptionError` if there is none, or an option does not apply to it."""
        _check_rate(self.rate, self.method, self.decoding.trim, run)
        target = Target.parse(_resolve_output(self, run))
        target.check_encoding(self.encoding)
        return target


@dataclass
class OpenedClip:
    """Source of a conversion: the whole clip, the part that is converted, and its window; None for all."""

    target: Target
    """Where the output goes, which determines how the source is read."""
    whole: DescribedSource
    source: FrameSource
    window: Window | None
    curve: TimeMap | None = None
    """Which time of the source every output time shows; None where it plays at its own speed."""
    clip_curve: TimeMap | None = None
    """The same of the clip itself, which a source that never plays backwards unfolds."""

    def begin_near(self, seconds: Fraction) -> Fraction | None:
        """Let the whole clip begin where reading can begin next to a time, if it can; return the origin of its times.

        Times count from the clip's first frame. Must be called before the first frame is read.
        """
        if isinstance(self.whole, Sliceable):
            self.whole.keep(int(seconds * self.whole.info.rate), None)
            return -beginning(self.whole).seconds
        if isinstance(self.whole, SeekableSource):
            origin = self.whole.first_time()
            self.whole.skip_to(origin + seconds)
            return origin
        return None


def memory_limit(job: ConversionJob, run: RunOptions) -> MemoryLimit:
    """Return the memory that a conversion may take, and what it takes for a pixel, by its method and output."""
    kind = Target.parse(job.output or "images/").kind
    each = BYTES_PER_PIXEL_OF.get(type(job.method.estimator), BYTES_PER_PIXEL)
    return replace(run.limit or MemoryLimit(), bytes_per_pixel=each + ENCODER_BYTES_PER_PIXEL * (kind == "video"))


@contextmanager
def opened_clip(job: ConversionJob, run: RunOptions) -> Iterator[OpenedClip]:
    """Open the source of a job while the block lasts; see `fpsboost.io.opening.open_source`."""
    rate, interpolator, target = job.rate, job.method, job.target(run)
    requirements = target.requirements(
        job.encoding,
        needs_rate=rate.fps is not None or job.decoding.trim.needs_rate,
        takes_planes=interpolator.takes_planes and rate.shutter is None,
        takes_layers=interpolator.takes_layers and rate.shutter is None,
    )
    with open_source(
        os.fspath(job.input),
        requirements=requirements,
        decoding=job.decoding,
        fill_gaps=rate.fill_gaps,
        in_place=run.in_place,
        limit=memory_limit(job, run),
    ) as whole:
        _check_layers(whole.stream_info.images, interpolator, rate)
        may_skip = not counts_frames(interpolator.cuts, interpolator.mask) and rate.replace is None
        trim, images = job.decoding.trim, whole.stream_info.images
        info = with_duration(whole) if rate.retimes else whole.info
        clip_curve = curve = rate.time_map(trim.of_info(info), 1 if images is None else images.first_number)
        source, window = trim_source(whole, trim, may_skip=may_skip, curve=curve or rate.slow_map)
        # as `source` is, before its frames get another order or other times
        read_from = partial(
            read_again,
            replace(job, rate=replace(rate, retime=None, slow_motion_sound=None, duplicates="keep", gaps=None)),
            run,
            whole,
        )
        if curve is not None and curve.reverses:
            times = source.frame_times() if isinstance(source, RandomAccess) and whole.stream_info.files else None
            plays = f"`retime` plays {whole.info.name} backwards, which needs"
            refuse(
                {
                    f"{plays} a file that says when each frame is shown; let no time fall, or convert it with "
                    "`factor=1` first.": times is None,
                    f"{plays} no `cuts`, `replace` and `loop`, and no `mask` of each frame; leave them out.": (
                        (isinstance(interpolator.cuts, CutList) or counts_frames(interpolator.mask))
                        or (rate.replace is not None or rate.loop)
                    ),
                }
            )
            order, shown, curve = curve.unfolded(times or ())
            info = replace(info, frame_count=len(order), duration=shown[-1] + 1 / info.rate)
            source = FoldedSource(info, list(whole.remarks), order, shown, read_from)
        if rate.duplicates == "drop":
            source = without_repeats(job.method, whole, source, read_from)
        if isinstance(rate.gaps, Gaps):
            source = without_gaps(rate.gaps, whole, source, read_from)
        yield OpenedClip(target, whole, source, window, curve, clip_curve)


def without_repeats(
    interpolator: Interpolator,
    whole: DescribedSource,
    source: FrameSource,
    read_from: Callable[[int], AbstractContextManager[FrameSource]],
) -> FoldedSource:
    """Read a part of the `whole` clip, and return a source of its frames without those that repeat a picture.

    `read_from` opens the part once more at a frame. Raises `OptionError` if the clip can be read only once.
    """
    refuse(
        {
            "`duplicates='drop'` reads a clip twice, which a pipe does not allow; name a file.": (
                not whole.stream_info.files
            )
        }
    )
    info, found = source.info, Repeats(interpolator.duplicates or DuplicateDetector())
    for _ in found.groups(map(SourceFrame, source)):
        pass
    cadence, how = found.cadence(info.rate), "keep their own times"
    order, times = found.kept(cadence)
    if cadence is not None and cadence.is_certain:
        info = replace(info, rate=cadence.rate, time_base=ByRate(cadence.rate).time_base(info.time_base))
        how = f"are evenly spaced, {readable(info.rate)} per second ({cadence.name})"
    remark = (
        f"{len(found.times) - len(order)} of {len(found.times)} frames repeat another and were dropped; "
        f"the others {how}."
    )
    length = times[-1] - times[0] if times else Fraction(0)  # a clip without any frame is refused by the loop
    info = replace(info, frame_count=len(order), duration=length + 1 / info.rate, mean_rate=None)
    return FoldedSource(info, [*whole.remarks, remark], order, times, read_from)


def without_gaps(
    gaps: Gaps,
    whole: DescribedSource,
    source: FrameSource,
    read_from: Callable[[int], AbstractContextManager[FrameSource]],
) -> FoldedSource:
    """Return a source of the frames of the `whole` clip, each later by the frames that are missing before it.

    These are found by reading the clip, unless all are listed. `read_from` opens it once more at a frame. Raises
    `OptionError` if its rate is not constant, or the last frame is listed.
    """
    info, times = source.info, (source.frame_times() if isinstance(source, RandomAccess) else None) or ()
    refuse(
        {
            f"`gaps` needs a constant rate and a file that says when each frame is shown, unlike {info.name}; convert "
            "it with `factor=1` first.": (
                not times
                or any(abs((after - time) * info.rate - 1) > Fraction(1, 2) for time, after in pairwise(times))
            )
        }
    )
    refuse(
        {
            f"`gaps` has {late}, and the last frame of {info.name} is {len(times) - 1}; name earlier ones.": True
            for late in gaps.behind(len(times) - 2, times[-1] - times[0])
        }
    )
    found = find_gaps(FrameCache(frame.image) for frame in source) if gaps.detect else {}
    missing = [
        gaps.times_listed(number, *(each - times[0] for each in shown)) or found.get(number, 0)
        for number, shown in enumerate(pairwise(times))
    ]
    later = [time + count / info.rate for time, count in zip(times, accumulate(missing, initial=0), strict=True)]
    listed = [f"{number}" + f"x{count}" * (count > 1) for number, count in enumerate(missing) if count]
    remark = (
        f"Missing behind {','.join(listed[:MOST_LISTED])}{', ...' * (len(listed) > MOST_LISTED)}: "
        f"{counted(sum(missing), 'frame')}; with them, the picture is {float(sum(missing) / info.rate):.3f} s longer."
        if listed
        else "No gap was found in camera motion; `gaps` takes a list of those in other motion."
    )
    return FoldedSource(
        replace(info, duration=later[-1] - later[0] + 1 / info.rate),
        [*whole.remarks, remark],
        range(len(times)),
        later,
        read_from,
    )


@contextmanager
def read_again(job: ConversionJob, run: RunOptions, whole: FrameSource, number: int) -> Iterator[FrameSource]:
    """Open the source of a job, which is `whole`, once more while the block lasts, to be read from a frame on.

    Without `RandomAccess`, it is read from its beginning.
    """
    with opened_clip(job, run) as again:
        index = whole.frame_index if isinstance(whole, SeekableSource) else None
        if index is not None and isinstance(again.whole, SeekableSource):
            again.whole.frame_index = index
        if isinstance(again.source, RandomAccess):
            again.source.begin_at(number)
        yield again.source


def with_duration(source: FrameSource) -> ClipInfo:
    """Return the properties of a source with its duration, by the times of its frames if the header does not say."""
    info = source.info
    times = source.frame_times() if info.duration is None and isinstance(source, RandomAccess) else None
    return replace(info, duration=times[-1] - times[0] + 1 / info.rate, frame_count=len(times)) if times else info


@dataclass
class Preparation:
    """What is known of a conversion before its first frame; the interpolator is the method, for this clip."""

    job: ConversionJob
    run: RunOptions
    clip: OpenedClip
    target: Target
    interpolator: Interpolator
    base_schedule: Schedule
    output: Output
    remarks: list[str]


@contextmanager
def prepared(job: ConversionJob, run: RunOptions) -> Iterator[Preparation]:
    """Open the source of a job while the block lasts, and `prepare` the job."""
    with opened_clip(job, run) as clip:
        yield prepare(job, run, clip)


def prepare(job: ConversionJob, run: RunOptions, clip: OpenedClip) -> Preparation:
    """Work out the frames and the output of a job; raise `OptionError` or `InputError` if they do not fit the clip."""
    target, rate, interpolator = clip.target, job.rate, job.method
    info, stream = clip.source.info, clip.whole.stream_info
    if rate.replacement is not None:
        rate.replacement.check(clip.whole.info)
    encoding, lost = _adapt_audio(job.encoding, stream, rate, clip.clip_curve, target.path)
    schedule = rate.schedule(info, has_clock=target.has_clock, curve=clip.curve)
    multiple = schedule.rate(info.rate) / info.rate
    images = stream.images
    keeps_numbers = (
        images is not None and not target.has_rate and clip.curve is None and images.numbers_for(multiple) is not None
    )
    # an image that repeats another is none that is missing
    if rate.fill_gaps or keeps_numbers or rate.keeps_frames or rate.duplicates != "interpolate":
        interpolator = replace(interpolator, duplicates=None)
    if rate.replacement is not None:
        interpolator = replace(interpolator, duplicates=None, replacement=rate.replacement)
    if interpolator.mask is not None:
        # videos come upright where the output is no video
        matrix = stream.traits.display_matrix if stream.traits is not None and target.has_clock else None
        times = (
            clip.source.frame_times()
            if isinstance(clip.source, RandomAccess) and counts_frames(interpolator.mask) and job.decoding.trim.is_whole
            else None
        )
        interpolator = replace(interpolator, mask=interpolator.mask.fitted(info, matrix, times))
    expected = count_frames(schedule, info, holds_last_frame=target.kind != "images" or rate.loop)
    interpolator, on_vectors = _match_vectors(interpolator, clip.whole.info.name, images, multiple, expected)
    output = Output(
        target.path,
        clip.whole.info,
        rate.timing(info, schedule),
        replace(stream, plays=0) if rate.loop and stream.plays == 1 else stream,  # played once, it would be no loop
        encoding=encoding,
        expected_frames=expected,
        overwrite=run.overwrite,
        window=clip.window,
        factor=None if clip.curve is not None or rate.duplicates == "drop" or rate.gaps is not None else multiple,
        in_place=run.in_place,
    )
    return Preparation(job, run, clip, target, interpolator, schedule, output, [*lost, *on_vectors])


def closing_remarks(ready: Preparation, intervals: FrameIntervals) -> list[str]:
    """Return the remarks on the whole conversion when it is done; `intervals` are complete to the source's end."""
    images, info = ready.clip.whole.stream_info.images, ready.clip.source.info
    remarks = [*ready.remarks, *ready.job.rate.remarks(info, ready.base_schedule, intervals)]
    if images is not None and images.step > 1 and ready.target.has_rate:
        remarks.append(
            f"`input_fps` counts the images of {info.name} and not their numbers: of a scene with 24 numbers a second "
            f"it is 24/{images.step}, or 24 with `fill_gaps`."
        )
    return remarks


def _check_layers(images: NumberedImages | None, interpolator: Interpolator, rate: OutputRate) -> None:
    if images is None or not images.layers or (interpolator.takes_layers and not (rate.shutter or interpolator.mask)):
        return
    first = images.files[0].name
    names = ", ".join(layer.name for layer in images.layers[:3]) + (", ..." if len(images.layers) > 3 else "")
    given = {
        "`at_cuts='extrapolate'`": interpolator.at_cuts == "extrapolate",
        "`match_grain`": interpolator.match_grain,
        "`mask`": interpolator.mask is not None,
        "`shutter`": rate.shutter is not None,
        "`uncertain`": interpolator.uncertain != "keep",
    }
    alone = f"changes the picture alone, and {first} has layers ({names}); leave it out, or give `passes='beauty'`."
    refuse({f"{option} {alone}": is_given for option, is_given in given.items()})
    raise OptionError(
        f"The method makes no layers, and {first} has some ({names}); choose nlm, nlm-fast, dis, farneback, tvl1, "
        "blend or nearest, or give `passes='beauty'` for the picture alone."
    )


def _check_rate(rate: OutputRate, interpolator: Interpolator, trim: Trim, run: RunOptions) -> None:
    """Raise `OptionError` if the times of the output's frames exclude another option."""
    blurs, has_vectors, maps = rate.shutter is not None, interpolator.uses_vectors, " or ".join(run.side.given)
    any_time = "`retime` and `speed` show the source at any time, and"
    refuse(
        {
            "`shutter` blurs every frame, and `in_place` keeps the originals; write to another folder.": (
                blurs and run.in_place
            ),
            "`shutter` needs frames at times that `vectors` says nothing of; leave one of them out.": (
                blurs and has_vectors
            ),
            "`loop` needs motion from the last frame to the first, which `vectors` lacks; leave one of them out.": (
                rate.loop and has_vectors
            ),
            f"`shutter` averages frames, which have no one map of {maps}; leave one of them out.": blurs and maps,
            f"{any_time} `in_place` only some; leave one of them out.": rate.retimes and run.in_place,
            f"{any_time} `vectors` only some; leave one of them out.": rate.retimes and has_vectors,
            "`duplicates='drop'` changes the number of frames, which `vectors`, `in_place`, and `cuts` and `mask` by "
            "frames count; use it by itself, and convert its output.": (
                rate.duplicates == "drop"
                and (has_vectors or run.in_place or counts_frames(interpolator.cuts, interpolator.mask))
            ),
            "`gaps` changes the times of frames, which `vectors`, `in_place`, `cuts`, `start` and `end` go by; use it "
            "by itself, and convert its output.": (
                rate.gaps is not None
                and (has_vectors or run.in_place or isinstance(interpolator.cuts, CutList) or not trim.is_whole)
            ),
        }
    )


def _resolve_output(job: ConversionJob, run: RunOptions) -> str:
    """Return the name of a job's output; in place, that of its input."""
    if not run.in_place:
        return output_beside(job.input, job.rate) if job.output is None else os.fspath(job.output)
    refuse(
        {
            f"`in_place` writes beside the images of {job.input}; leave the output {job.output} out.": (
                job.output is not None
            ),
            "`in_place` replaces nothing; leave `overwrite` out.": run.overwrite,
        }
    )
    check_images(os.fspath(job.input), "`in_place`")
    return os.fspath(job.input)


def output_beside(clip: PathName, rate: OutputRate) -> str:
    """Return the name of an output that is not named: beside the input, with the rate behind its name.

    Examples
    --------
    >>> output_beside("films/in.avi", OutputRate(fps=60))
    'films/in-60fps.mkv'
    """
    input = os.fspath(clip)
    if input in PIPES:
        raise OptionError("There is no output for standard input; name one.")
    if not clip_name(input):
        return output_beside(str(Path(input).resolve().parent), rate)
    speed = "filled" if rate.fill_gaps and rate.factor is None else f"{readable(rate.multiple)}x"
    kept = ("dropped" if rate.duplicates == "drop" else "repaired") if rate.keeps_frames else speed
    parts = ["retimed" if rate.retimes else kept] if rate.fps is None or rate.slow_motion or rate.retimes else []
    parts += ["slow"] * rate.slow_motion + ([] if rate.fps is None else [f"{readable(rate.fps)}fps"])
    planned, place = name_in_folder(input, Path()), Path(input)
    folder = place.resolve().parent if place.name in ("", "..") else place.parent
    ending = "/" if planned.endswith("/") else Path(planned).suffix
    return f"{folder / '-'.join([clip_name(input), *parts])}{ending}"


def clip_name(input: str) -> str:
    """Return the name of a clip without its ending and what a pattern adds to it; of a pattern, nothing may be left."""
    name = Path(input).resolve().name if os.path.isdir(input) else Path(input).stem
    return name if os.path.exists(input) else name.split("#")[0].split("%")[0].rstrip("._- ")


def name_in_folder(path: str, folder: Path) -> str:
    """Return the name of an output for an input in a folder, of its type if that can be written."""
    if os.path.isdir(path) or (is_pattern(path) and not os.path.isfile(path)):
        images = Path(path) if os.path.isdir(path) else Path(path).parent
        return f"{folder / images.resolve().name}/"
    suffix = Path(path).suffix if extension_of(path) in OUTPUT_SUFFIXES else FALLBACK_SUFFIX
    return str(folder / f"{Path(path).stem}{suffix}")


def _match_vectors(
    interpolator: Interpolator, name: str, images: NumberedImages | None, factor: Fraction, count: int | None
) -> tuple[Interpolator, list[str]]:
    """Match a renderer's vectors to the output's frame numbers if both have numbers; return remarks if they differ."""
    if images is None or not images.numbers or count is None:
        return interpolator, []
    kept = images.numbers_for(factor)
    if interpolator.needs_every_frame and kept is None and (images.step > 1 or images.fills_gaps):
        raise OptionError(
            f"A renderer's motion vectors go by the numbers of {name}, and {factor} times the frames do not fit "
            f"between those; give `factor={images.step}`."
        )
    first, step = kept or (images.first_number + int(images.skipped * factor), 1)
    numbers = range(first, first + count * step, step)

    def matched(vectors: VectorFolder) -> VectorFolder:
        vectors = vectors.matched(numbers, must_match=kept is not None)
        return fit_vectors(vectors, _compared_frames(images, factor)) if factor.denominator == 1 else vectors

    return interpolator.with_vectors(matched)


def _compared_frames(images: NumberedImages, factor: Fraction) -> Iterator[tuple[tuple[int, Image], tuple[int, Image]]]:
    """Yield a pair of frames from the beginning, the middle and the end, each with its number in the output."""

    def frame(index: int) -> tuple[int, Image]:
        place = images.numbers[index] - images.numbers[0] if images.fills_gaps else int(index * factor)
        return place, read_image(images.files[index])

    last = len(images.files) - 2
    for index in sorted({0, last // 2, last} if last >= 0 else ()):
        yield frame(index), frame(index + 1)


def _describe_silence(begin: Fraction, end: Fraction, reasons: Sequence[str]) -> str:
    """Return when the output is silent, and why: ``from 0:01 to 0:05.500 (speed 0.25)``."""
    first, last = (format_time(time).removesuffix(".000") for time in (begin, end))
    return f"from {first} to {last if end < FOREVER else 'the end'} ({', '.join(dict.fromkeys(reasons))})"


def _adapt_audio(
    encoding: Encoding, stream: StreamInfo, output_rate: OutputRate, curve: TimeMap | None, path: str
) -> tuple[Encoding, list[str]]:
    """Drop the audio of slow motion unless it is to be stretched; return a remark if audio is lost."""
    if output_rate.slow_motion_sound == "stretch" and not encoding.audio:
        raise OptionError("`slow_motion_sound='stretch'` and `audio=False` contradict each other; give one of them.")
    video = stream.video
    name = video.name if video is not None and encoding.audio and "sound" in video.companions else None
    if curve is not None and curve.sounding and output_rate.slow_motion_sound != "drop":
        passages = ", ".join(_describe_silence(*each) for each in curve.silences)
        return encoding, [f"{path} has no sound {passages}."] if name is not None and passages else []
    is_kept = output_rate.stretch == 1 or output_rate.slow_motion_sound == "stretch"
    if not encoding.audio or (curve is None and is_kept):
        return encoding, []
    lost = f"{name} has sound, which {'slow motion' if curve is None else 'the retime curve'} leaves out."
    return replace(encoding, audio=False, audio_codec=None), [lost] * (name is not None)
