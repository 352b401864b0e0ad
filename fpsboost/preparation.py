"""Preparation of a conversion: its source, the frames that are asked for, and all that is known before the first."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

from fpsboost.analysis.duplicates import DuplicateDetector
from fpsboost.conflicts import check_together
from fpsboost.contracts import FrameSource, RandomAccess, Summary
from fpsboost.derived_sources import trim_source
from fpsboost.edits import OpenedClip, played_backwards, with_gaps, without_repeats
from fpsboost.errors import OptionError
from fpsboost.frame import ClipInfo
from fpsboost.guides import GuidedClip
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource
from fpsboost.io.animation.writers import ANIMATION_SUFFIXES
from fpsboost.io.images.files import extension_of, read_image
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.images.source import is_pattern
from fpsboost.io.opening import PIPES, Target, TargetRequirements, check_images, open_source
from fpsboost.io.output import Output, StreamInfo
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.source import VideoSource
from fpsboost.media import FOREVER, VIDEO_SUFFIXES, TimeMap, try_out
from fpsboost.memory import BYTES_PER_PIXEL, MemoryLimit
from fpsboost.method_table import BYTES_PER_PIXEL_OF
from fpsboost.options import Checked, PathName
from fpsboost.remarks import Remarks
from fpsboost.render.fitting import fit_vectors
from fpsboost.render.folder import VectorFolder
from fpsboost.run_options import RunOptions
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.edit import Edit
from fpsboost.timing.options import Timing, readable
from fpsboost.timing.position import Trim, format_time
from fpsboost.timing.schedule import Schedule, count_frames

OUTPUT_SUFFIXES = (*VIDEO_SUFFIXES, *ANIMATION_SUFFIXES)
FALLBACK_SUFFIX = ".mkv"
"""Suffix of the output if the input's cannot be written; Matroska holds every kind of audio and subtitles."""

ENCODER_BYTES_PER_PIXEL = 270
"""Bytes of memory that an encoder takes for a pixel; measured: 255 with libx264, which looks 40 frames ahead."""


@dataclass(frozen=True)
class ConversionJob(Checked):
    """Conversion of a clip: everything that shapes its output, as `fpsboost.convert` takes it.

    `output` is None for images beside the input, or for a name beside it; see `output_beside`.
    """

    input: PathName
    output: PathName | None
    timing: Timing
    method: Interpolator
    decoding: DecodeOptions = DecodeOptions()
    encoding: Encoding = field(default_factory=Encoding)

    def names_given(self) -> set[str]:
        """Return the names of all options that are given; see `fpsboost.conflicts`."""
        return super().names_given() | self.method.names_given()

    def of_part(self, trim: Trim) -> ConversionJob:
        """Return the same conversion of a part of the clip, which is no loop by itself."""
        return replace(self, timing=replace(self.timing, loop=False), decoding=replace(self.decoding, trim=trim))

    def target(self, run: RunOptions) -> Target:
        """Return the output's target; raise `OptionError` if there is none, or an option does not apply to it."""
        check_together(self.names_given() | run.names_given())
        target = Target.parse(_resolve_output(self, run))
        target.check_encoding(self.encoding)
        return target


def memory_limit(job: ConversionJob, run: RunOptions) -> MemoryLimit:
    """Return the memory that a conversion may take, and what it takes for a pixel, by its method and output."""
    each = BYTES_PER_PIXEL_OF.get(type(job.method.estimator), BYTES_PER_PIXEL)
    if Target.parse(job.output or "images/").kind == "video":
        each += ENCODER_BYTES_PER_PIXEL
    return replace(run.limit or MemoryLimit(), bytes_per_pixel=each)


@contextmanager
def opened_clip(job: ConversionJob, run: RunOptions) -> Iterator[OpenedClip]:
    """Open the source of a job while the block lasts, with its frames as they are converted."""
    timing = job.timing
    target = job.target(run)
    with open_whole(job, run, target) as whole:
        images = whole.stream_info.images
        _check_layers(images, job.method, timing)
        trim = job.decoding.trim
        info = with_duration(whole) if timing.retimes else whole.info
        curve = timing.time_map(trim.of_info(info), 1 if images is None else images.first_number)
        may_skip = not job.method.counts_frames and timing.replace is None
        source, window = trim_source(whole, trim, may_skip=may_skip, curve=curve or timing.slow_map)
        clip = OpenedClip(target, whole, source, partial(read_again, job, run, target, whole), window, curve, curve)
        if curve is not None and curve.reverses:
            check_together(job.names_given() | {"`retime` that plays backwards"})
            clip = played_backwards(clip, curve)
        if timing.duplicates == "drop":
            clip = without_repeats(clip)
        if timing.gaps is not None:
            clip = with_gaps(clip, timing.gaps)
        yield clip


def open_whole(job: ConversionJob, run: RunOptions, target: Target) -> DescribedSource:
    """Open the whole clip of a job as its target needs it; see `fpsboost.io.opening.open_source`."""
    timing = job.timing
    method = job.method
    needs = target.requirements(
        job.encoding,
        needs_rate=timing.fps is not None or job.decoding.trim.needs_rate,
        takes_planes=method.takes_planes and timing.shutter is None and job.decoding.guide is None,
        takes_layers=method.takes_layers and timing.shutter is None,
    )
    path = os.fspath(job.input)
    limit = memory_limit(job, run)
    return open_source(
        path, requirements=needs, decoding=job.decoding, fill_gaps=timing.fill_gaps, in_place=run.in_place, limit=limit
    )


@contextmanager
def read_again(
    job: ConversionJob, run: RunOptions, target: Target, whole: DescribedSource, number: int
) -> Iterator[FrameSource]:
    """Open the part that a job converts of a clip, which is open as `whole`, once more, to be read from a frame on."""
    with open_whole(job, run, target) as again:
        if isinstance(whole, VideoSource) and isinstance(again, VideoSource):
            again.frame_index = whole.frame_index
        part, _ = trim_source(again, job.decoding.trim)
        part.begin_at(number)
        yield part


def with_duration(source: RandomAccess) -> ClipInfo:
    """Return the properties of a source with its duration, by the times of its frames if the header does not say."""
    info = source.info
    times = source.frame_times() if info.duration is None else None
    return Edit.whole(times).of_info(info) if times else info


@dataclass
class Preparation:
    """What is known of a conversion before its first frame; the interpolator is the method, for this clip."""

    job: ConversionJob
    run: RunOptions
    clip: OpenedClip
    target: Target
    interpolator: Interpolator
    timeline: TimelineOptions
    schedule: Schedule
    output: Output
    remarks: Remarks

    def expected_losses(self) -> tuple[list[str], Remarks]:
        """Return the encoder and pixel format of an output that is video, and what the output would lose.

        Raises `OptionError` or `OutputError` if the output cannot be written.
        """
        sink = self.target.open(self.output)
        remarks = Remarks([*self.clip.source.remarks, *self.remarks, *sink.remarks])
        coding = list[str]()
        if self.target.kind == "video":
            coding, losses = try_out(self.output)
            remarks.take(losses)
        return coding, remarks.expected

    @property
    def guided(self) -> GuidedClip:
        """What a guide must agree with."""
        clip = self.clip
        target = clip.target
        linear = self.interpolator.takes_layers
        needs = TargetRequirements(pictures_alone=not target.has_clock, upright=target.has_rate, linear=linear)
        return GuidedClip(clip.source, clip.whole.stream_info, self.output.factor, needs)


@contextmanager
def prepared(job: ConversionJob, run: RunOptions) -> Iterator[Preparation]:
    """Open the source of a job while the block lasts, and `prepare` the job."""
    with opened_clip(job, run) as clip:
        yield prepare(job, run, clip)


def prepare(job: ConversionJob, run: RunOptions, clip: OpenedClip) -> Preparation:
    """Work out the frames and the output of a job; raise `OptionError` or `InputError` if they do not fit the clip."""
    target = clip.target
    timing = job.timing
    interpolator = job.method
    info = clip.source.info
    stream = clip.whole.stream_info
    if timing.replace is not None:
        timing.replace.check("replace", clip.whole.info)
    remarks = Remarks()
    encoding = _adapt_audio(job.encoding, stream, timing, clip.clip_curve, target.path, remarks)
    images = stream.images
    if job.decoding.guide is not None and images and images.step > 1 and timing.follows_source and not clip.curve:
        timing = replace(timing, factor=Fraction(images.step))  # so that all numbers between have their guides
    schedule = timing.schedule(info, has_clock=target.has_clock, curve=clip.curve)
    most = target.highest_rate
    asked = timing.output_timing(info, schedule).rate
    if most is not None and asked > most and timing.follows_source:
        timing = (
            replace(timing, fps=most) if timing.slow_motion else replace(timing, factor=timing.multiple * most / asked)
        )
        schedule = timing.schedule(info, has_clock=target.has_clock, curve=clip.curve)
        remarks.add("rate-lowered", name=target.path, rate=most, file_type=target.file_type)
    multiple = schedule.rate(info.rate) / info.rate
    has_room = images is not None and images.numbers_for(multiple) is not None
    keeps_numbers = has_room and not target.has_rate and clip.curve is None
    # an image that repeats another is none that is missing
    keeps_all = timing.fill_gaps or keeps_numbers or timing.keeps_frames or interpolator.needs_every_frame
    interpolates = timing.duplicates == "interpolate" and timing.replace is None and not keeps_all
    timeline = TimelineOptions(timing.stretch, DuplicateDetector() if interpolates else None, timing.replace)
    if interpolator.mask is not None:
        # videos come upright where the output is no video
        matrix = stream.traits.display_matrix if stream.traits is not None and target.has_clock else None
        is_whole = interpolator.mask.counts_frames and job.decoding.trim.is_whole
        times = clip.source.frame_times() if is_whole else None
        interpolator = replace(interpolator, mask=interpolator.mask.fitted(info, matrix, times))
    expected = count_frames(schedule, info, holds_last_frame=target.kind != "images" or timing.loop)
    interpolator = _match_vectors(interpolator, clip.whole.info.name, images, multiple, expected, remarks)
    output = Output(
        target.path,
        clip.whole.info,
        timing.output_timing(info, schedule),
        replace(stream, plays=0) if timing.loop and stream.plays == 1 else stream,  # played once, it would be no loop
        encoding=encoding,
        expected_frames=expected,
        overwrite=run.overwrite,
        window=clip.window,
        factor=None if clip.curve is not None or timing.duplicates == "drop" or timing.gaps is not None else multiple,
        in_place=run.in_place,
    )
    return Preparation(job, run, clip, target, interpolator, timeline, schedule, output, remarks)


def closing_remarks(ready: Preparation, summary: Summary) -> Remarks:
    """Return the remarks on the whole conversion when it is done."""
    images = ready.clip.whole.stream_info.images
    info = ready.clip.source.info
    remarks = Remarks([*ready.remarks, *ready.job.timing.remarks(info, ready.schedule, summary.frame_intervals)])
    if images is not None and images.step > 1 and ready.target.has_rate:
        remarks.add("input-fps-of-steps", name=info.name, step=images.step)
    if summary.guided_frames or summary.guides_missing:
        remarks.take(ready.guided.remarks(ready.job.decoding.guide, summary))
    return remarks


def _check_layers(images: NumberedImages | None, interpolator: Interpolator, timing: Timing) -> None:
    if images is None or not images.layers or (interpolator.takes_layers and not (timing.shutter or interpolator.mask)):
        return
    first = images.files[0].name
    names = ", ".join(layer.name for layer in images.layers[:3]) + (", ..." if len(images.layers) > 3 else "")
    given = interpolator.names_given() | timing.names_given()
    for option in sorted(given & {"at_cuts='extrapolate'", "match_grain", "mask", "shutter", "uncertain"}):
        raise OptionError(
            f"`{option}` changes only the picture, and {first} has layers ({names}); leave it out, or give "
            "`passes='beauty'`."
        )
    raise OptionError(
        f"The method makes no layers, and {first} has some ({names}); choose nlm, nlm-fast, dis, farneback, tvl1, "
        "blend or nearest, or give `passes='beauty'` for the picture alone."
    )


def _resolve_output(job: ConversionJob, run: RunOptions) -> str:
    """Return the name of a job's output; in place, that of its input."""
    if not run.in_place:
        return output_beside(job.input, job.timing) if job.output is None else os.fspath(job.output)
    if job.output is not None:
        raise OptionError(f"`in_place` writes beside the images of {job.input}; leave the output {job.output} out.")
    check_images(os.fspath(job.input), "`in_place`")
    return os.fspath(job.input)


def output_beside(clip: PathName, timing: Timing) -> str:
    """Return the name of an output that is not named: beside the input, with the rate behind its name.

    Examples
    --------
    >>> output_beside("films/in.avi", Timing(fps=60))
    'films/in-60fps.mkv'
    """
    input = os.fspath(clip)
    if input in PIPES:
        raise OptionError("There is no output for standard input; name one.")
    if not clip_name(input):
        return output_beside(str(Path(input).resolve().parent), timing)
    speed = "filled" if timing.fill_gaps and timing.factor is None else f"{readable(timing.multiple)}x"
    if timing.keeps_frames:
        speed = "dropped" if timing.duplicates == "drop" else "repaired"
    parts = list[str]()
    if timing.retimes:
        parts.append("retimed")
    elif timing.fps is None or timing.slow_motion:
        parts.append(speed)
    if timing.slow_motion:
        parts.append("slow")
    if timing.fps is not None:
        parts.append(f"{readable(timing.fps)}fps")
    planned = name_in_folder(input, Path())
    place = Path(input)
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
    interpolator: Interpolator,
    name: str,
    images: NumberedImages | None,
    factor: Fraction,
    count: int | None,
    remarks: Remarks,
) -> Interpolator:
    """Match a renderer's vectors to the output's frame numbers if both have numbers; add remarks if they differ."""
    if images is None or not images.numbers or count is None:
        return interpolator
    kept = images.numbers_for(factor)
    if interpolator.needs_every_frame and kept is None and (images.step > 1 or images.fills_gaps):
        raise OptionError(
            f"A renderer's motion vectors go by the numbers of {name}, and {factor} times the frames do not fit "
            f"between those; give `factor={images.step}`."
        )
    first, step = images.output_numbers(factor)
    numbers = range(first, first + count * step, step)

    def matched(vectors: VectorFolder) -> VectorFolder:
        compared = _compared_frames(images, factor) if factor.denominator == 1 else ()
        vectors = fit_vectors(vectors.matched(numbers, must_match=kept is not None), compared)
        remarks.take(vectors.remarks)
        return vectors

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
    encoding: Encoding, stream: StreamInfo, timing: Timing, curve: TimeMap | None, path: str, remarks: Remarks
) -> Encoding:
    """Drop the audio of slow motion unless it is to be stretched; add a remark if audio is lost."""
    video = stream.video
    name = video.name if video is not None and encoding.audio and "sound" in video.auxiliary_streams else None
    if curve is not None and curve.sounding and timing.slow_motion_sound != "drop":
        passages = ", ".join(_describe_silence(*each) for each in curve.silences)
        if name is not None and passages:
            remarks.add("silent-passages", name=path, passages=passages)
        return encoding
    is_kept = timing.stretch == 1 or timing.slow_motion_sound == "stretch"
    if not encoding.audio or (curve is None and is_kept):
        return encoding
    if name is not None:
        remarks.add("sound-left-out", name=name, cause="slow motion" if curve is None else "the retime curve")
    return encoding.without_audio()
