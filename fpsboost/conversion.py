"""Conversion of files: builds source, interpolator and sink from paths and options, and runs the loop over them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from fpsboost.analysis.scene_cuts import counts_frames
from fpsboost.analysis.vector_fit import fit_vectors
from fpsboost.errors import OptionError
from fpsboost.frame import Image
from fpsboost.interpolator import Interpolator
from fpsboost.io import Resumable
from fpsboost.io.images.files import read_image
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.opening import check_images, fingerprint_job, open_source
from fpsboost.io.output import Output
from fpsboost.io.prefetch import available_cores
from fpsboost.io.side.sink import with_side_outputs
from fpsboost.io.stream_info import StreamInfo
from fpsboost.io.target import Target
from fpsboost.io.trim import trim_source
from fpsboost.io.vectors.folder import UsesVectors, VectorFolder
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.method_table import find_method
from fpsboost.observer import SilentObserver, Summary
from fpsboost.run_options import RunOptions
from fpsboost.streaming import run_conversion
from fpsboost.timing.rate import OutputRate
from fpsboost.timing.schedule import count_frames
from fpsboost.timing.shutter import ExposureSchedule


@dataclass(frozen=True)
class Job:
    """Everything that shapes an output besides the input's files: only a run of the same job can be resumed."""

    rate: OutputRate
    method: Interpolator
    decoding: DecodeOptions
    encoding: Encoding
    in_place: bool


def convert(
    input: str,
    output: str | None = None,
    *,
    factor: Fraction | int | None = None,
    rate: OutputRate | None = None,
    method: str | Interpolator = "nlm",
    decoding: DecodeOptions | None = None,
    encoding: Encoding | None = None,
    run: RunOptions | None = None,
) -> Summary:
    """Convert a clip to a higher frame rate.

    Parameters
    ----------
    input, output : str
        Each a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``,
        ``shot_####.png``), or ``-`` for YUV4MPEG2 from standard input or to standard output. Images whose numbers
        rise by a step of 2 or more were rendered with that step: if `factor` divides it, the frames made get the
        missing numbers.
    factor : Fraction or int, optional
        Output frames per source frame; 2 if `rate` says nothing else.
    rate : OutputRate, optional
        Frames per second instead of a factor, slow motion, or only the images that are missing.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object.
    decoding : DecodeOptions, optional
        Which part of the input is read, how fast images play, which stream of a video file is read, and how.
    encoding : Encoding, optional
        How to encode video, and which streams to keep.
    run : RunOptions, optional
        What may be replaced and used, and who is told of the progress.

    Returns
    -------
    Summary

    Raises
    ------
    OptionError, InputError, OutputError
        See `fpsboost.errors`.
    CompleteAlreadyError
        `resume` was given, and the output is complete already.

    Examples
    --------
    >>> convert("in.mp4", "out.mp4", factor=2)  # doctest: +SKIP
    >>> convert("in.mp4", "out.mp4", rate=OutputRate(fps=60), run=RunOptions(overwrite=True))  # doctest: +SKIP
    """
    run, encoding, decoding = run or RunOptions(), encoding or Encoding(), decoding or DecodeOptions()
    output_rate = _resolve_rate(factor, rate)
    interpolator = find_method(method) if isinstance(method, str) else method
    _check_shutter(output_rate, interpolator, run)
    target = Target.parse(_resolve_output(input, output, in_place=run.in_place, overwrite=run.overwrite))
    target.check_encoding(encoding)
    job = Job(output_rate, interpolator, decoding, encoding, run.in_place)
    requirements = target.requirements(
        encoding,
        needs_rate=output_rate.fps is not None or decoding.trim.needs_rate,
        takes_planes=interpolator.takes_planes and output_rate.shutter is None,
        takes_layers=interpolator.takes_layers and output_rate.shutter is None,
    )
    with open_source(
        input,
        requirements=requirements,
        decoding=decoding,
        fill_gaps=output_rate.fill_gaps,
        in_place=run.in_place,
        limit=run.limit,
    ) as whole:
        _check_layers(whole.stream_info.images, interpolator, output_rate)
        may_skip = not counts_frames(interpolator.cuts)
        source, window = trim_source(whole, decoding.trim, may_skip=may_skip, stretch=output_rate.stretch)
        info, stream = source.info, whole.stream_info
        encoding, lost = _adapt_audio(encoding, stream, output_rate)
        schedule, shutter = output_rate.schedule(info, has_clock=target.has_clock), output_rate.exposure
        multiple = schedule.rate(info.rate) / info.rate
        images = stream.images
        keeps_numbers = images is not None and not target.has_rate and images.numbers_for(multiple) is not None
        if output_rate.fill_gaps or keeps_numbers:  # an image that repeats another is none that is missing
            interpolator = replace(interpolator, duplicates=None)
        expected = count_frames(schedule, info, holds_last_frame=target.has_clock)
        interpolator, on_vectors = _match_vectors(interpolator, whole.info.name, images, multiple, expected)
        sink = target.open(
            Output(
                target.path,
                whole.info,
                output_rate.timing(info, schedule),
                stream,
                encoding=encoding,
                expected_frames=expected,
                overwrite=run.overwrite,
                job=fingerprint_job(whole, job, resume=run.resume),
                window=window,
                factor=multiple,
                in_place=run.in_place,
            )
        )
        sink = with_side_outputs(sink, run.side, images, overwrite=run.overwrite)
        threads = run.threads
        if threads is None:
            planes = 0 if images is None else images.planes
            limit = run.limit or MemoryLimit()
            threads = limit.affordable_threads(info.width, info.height, available_cores(), planes)
        observer = run.observer or SilentObserver()
        observer.opened(info, count_frames(schedule, info, sink.holds_last_frame))
        with sink:
            there = sink.completed_frames if isinstance(sink, Resumable) else 0
            summary = run_conversion(
                source,
                interpolator,
                sink,
                schedule if shutter is None else ExposureSchedule(schedule, shutter),
                observer,
                stretch=output_rate.stretch,
                skip=there,
                threads=threads,
            )
    # some are known only after the sink has finished the output
    summary.remarks += [remark for remark in sink.remarks if remark not in summary.remarks]
    summary.remarks += [*lost, *on_vectors, *output_rate.remarks(info, schedule, summary.frame_intervals)]
    if images is not None and images.step > 1 and target.has_rate:
        summary.remarks.append(
            f"`input_fps` counts the images of {info.name} and not their numbers: of a scene with 24 numbers a second "
            f"it is 24/{images.step}, or 24 with `fill_gaps`."
        )
    return summary


def _check_layers(images: NumberedImages | None, interpolator: Interpolator, rate: OutputRate) -> None:
    """Raise `OptionError` if images have layers that a method does not make."""
    if images is None or not images.layers or (interpolator.takes_layers and rate.shutter is None):
        return
    first = images.files[0].name
    names = ", ".join(layer.name for layer in images.layers[:3]) + (", ..." if len(images.layers) > 3 else "")
    if interpolator.at_cuts == "extrapolate":
        raise OptionError(
            f"`at_cuts='extrapolate'` makes no layers, and {first} has some ({names}); give `at_cuts='repeat'`, or "
            "`passes='beauty'` for the picture alone."
        )
    for option, is_given in (("`match_grain`", interpolator.match_grain), ("`shutter`", rate.shutter is not None)):
        if is_given:
            raise OptionError(
                f"{option} changes the picture alone, and {first} has layers ({names}); leave it out, or give "
                "`passes='beauty'`."
            )
    raise OptionError(
        f"The method makes no layers, and {first} has some ({names}); choose nlm, nlm-fast, dis, farneback, tvl1, "
        "blend or nearest, or give `passes='beauty'` for the picture alone."
    )


def _resolve_rate(factor: Fraction | int | None, rate: OutputRate | None) -> OutputRate:
    """Return the rate with the factor in it.

    Raises
    ------
    OptionError
        Both say a factor.
    """
    if factor is None:
        return rate or OutputRate()
    if rate is None:
        return OutputRate(factor)
    if rate.factor is not None:
        raise OptionError("factor and rate.factor say the same thing twice; give one of them.")
    return replace(rate, factor=factor)


def _check_shutter(rate: OutputRate, interpolator: Interpolator, run: RunOptions) -> None:
    """Raise OptionError if motion blur is asked for where it cannot be made."""
    if rate.shutter is None:
        return
    if run.in_place:
        raise OptionError("`shutter` blurs every frame, and `in_place` keeps the originals; write to another folder.")
    parts = interpolator.estimator, interpolator.synthesizer
    if any(isinstance(part, UsesVectors) and part.vectors is not None for part in parts):
        raise OptionError("`shutter` needs frames at times that `vectors` says nothing of; leave one of them out.")
    if run.side.given:
        raise OptionError(
            f"`shutter` averages frames, which have no one map of {' or '.join(run.side.given)}; leave one of them out."
        )


def _resolve_output(input: str, output: str | None, *, in_place: bool, overwrite: bool) -> str:
    """Return the path of the output."""
    if not in_place:
        if output is None:
            raise OptionError(f"There is no output for {input}; name one, or give `in_place` for images beside it.")
        return output
    if output is not None:
        raise OptionError(f"`in_place` writes beside the images of {input}; leave the output {output} out.")
    if overwrite:
        raise OptionError("`in_place` replaces nothing; leave `overwrite` out.")
    check_images(input, "`in_place`")
    return input


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


def _adapt_audio(encoding: Encoding, stream: StreamInfo, output_rate: OutputRate) -> tuple[Encoding, list[str]]:
    """Drop the audio of slow motion unless it is to be stretched; return a remark if audio is lost."""
    if output_rate.slow_motion_sound == "stretch" and not encoding.audio:
        raise OptionError("`slow_motion_sound='stretch'` and `audio=False` contradict each other; give one of them.")
    if output_rate.stretch == 1 or not encoding.audio or output_rate.slow_motion_sound == "stretch":
        return encoding, []
    video = stream.video
    has_sound = video is not None and "sound" in video.companions
    lost = [f"{video.name} has sound, which slow motion leaves out."] if video is not None and has_sound else []
    return replace(encoding, audio=False, audio_codec=None), lost
