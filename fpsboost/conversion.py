"""Conversion of files: a job -> source, interpolator, sink, and the loop."""

from contextlib import ExitStack
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from fpsboost import __version__
from fpsboost.contracts import (
    FrameSource,
    OutputRange,
    Summary,
)
from fpsboost.edits import looped
from fpsboost.errors import InputError, OptionError, choose_one, explained
from fpsboost.guides import opened_guides
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.side.sink import with_side_outputs
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.masks import Mask
from fpsboost.media import JobFingerprint, StagedSink, pyav_version
from fpsboost.method_table import find_method
from fpsboost.options import PathName, checked, names_in, with_options
from fpsboost.parts.manifest import fingerprint_files, fingerprint_options
from fpsboost.parts.plan import enter, plan_part, share_index
from fpsboost.preparation import (
    ConversionJob,
    closing_remarks,
    memory_limit,
    prepared,
)
from fpsboost.run_options import RunObserver, RunOptions
from fpsboost.streaming import run_conversion
from fpsboost.threads import available_cores
from fpsboost.timing.options import Timing


@checked
def convert(
    input: PathName,
    output: PathName | None = None,
    *,
    method: str | Interpolator = "nlm",
    timing: Timing | None = None,
    decoding: DecodeOptions | None = None,
    encoding: Encoding | None = None,
    run: RunOptions | None = None,
    **options: Any,
) -> Summary:
    """Convert a clip to a higher frame rate.

    Parameters
    ----------
    input, output : str or os.PathLike
        Each a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``,
        ``shot_####.png``), or ``-`` for YUV4MPEG2 from standard input or to standard output. Images whose numbers
        rise by a step of 2 or more were rendered with that step: if `factor` divides it, the frames made get the
        missing numbers. Without `output`, a name beside the input, as on the command line: ``in-2x.mp4``.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object.
    timing : Timing, optional
        Frames per second, or a factor, which is 2 by default; slow motion, speed ramps, loops, or only the images
        that are missing.
    decoding : DecodeOptions, optional
        Which part of the input is read, how fast images play, which stream of a video file is read, and how.
    encoding : Encoding, optional
        How to encode video, and which streams to keep.
    run : RunOptions, optional
        Whether existing files are replaced, memory and threads, and what is informed of the progress or cancels it.
    **options : Any
        Any field of these four, and of those nested in them, by its own name instead: ``fps=60``, ``factor=4``,
        ``crf=18``, ``overwrite=True``, ``start="1:30"``, ``limit="8G"``, ``progress=print``. Texts are read as on the
        command line. And ``mask="hud.png"``: areas that stay as in the nearer frame; see `fpsboost.Mask`.
        A mask as a layer goes with the method: ``replace(find_method("nlm"), mask=Mask("hud.png", mask_as="layer"))``.

    Raises
    ------
    OptionError, InputError, OutputError
        See `fpsboost.errors`.
    CompleteAlreadyError
        `resume` was given, and the output is complete already.
    CancelledError
        `cancel` has returned a true value. Frames that are finished are kept for `resume`.

    Examples
    --------
    >>> convert("in.mp4")  # doctest: +SKIP
    >>> convert("in.mp4", "out.mp4", fps=60, overwrite=True)  # doctest: +SKIP
    >>> convert("in.mp4", "out.mp4", timing=Timing(fps=60), run=RunOptions(overwrite=True))  # doctest: +SKIP
    """
    mask = options.pop("mask", None)
    interpolator = find_method(method)
    groups = {
        "timing": timing or Timing(),
        "decoding": decoding or DecodeOptions(),
        "encoding": encoding or Encoding(),
        "run": run or RunOptions(),
    }
    timing, decoding, encoding, run = (with_options(group, options, name) for name, group in groups.items())
    for name in options:
        choices = ["method", "mask", *groups, *chain(*map(names_in, groups.values()))]
        raise OptionError(f"convert takes no {name}; {choose_one(name, choices)}")
    interpolator = interpolator if mask is None else replace(interpolator, mask=Mask(mask))
    return convert_job(ConversionJob(input, output, timing, interpolator, decoding, encoding), run)


@checked
def convert_job(job: ConversionJob, run: RunOptions | None = None) -> Summary:
    """Run a conversion, or one part of it; see `convert`.

    Raises
    ------
    OptionError, InputError, OutputError
        See `fpsboost.errors`.
    """
    run = run or RunOptions()
    with prepared(job, run) as ready, ExitStack() as stack:
        guides = None
        if job.decoding.guide is not None:
            guides = stack.enter_context(opened_guides(job.decoding, ready.guided))
        clip = ready.clip
        images = clip.whole.stream_info.images
        fingerprint = fingerprint_job(job, run, clip.whole)
        part = None if run.chunk is None else plan_part(ready)
        output = replace(ready.output, job=fingerprint, part=None if part is None else part.output)
        main = ready.target.open(output)
        sink = with_side_outputs(main, run.side, images, overwrite=run.overwrite, watcher=run.watcher)
        info = clip.source.info
        threads = run.threads
        if threads is None:
            planes = 0 if images is None else images.planes
            threads = memory_limit(job, run).affordable_threads(info.width, info.height, available_cores(), planes)
        observer = RunObserver(run)
        source: FrameSource = clip.source
        if job.timing.loop:
            keeps_sound = ready.target.kind == "video" and output.encoding.audio
            source, outputs = looped(clip, ready.schedule, keeps_sound=keeps_sound)
        else:
            outputs = enter(ready, OutputRange()) if part is None else part.outputs
        observer.opened(info, output.expected_of_part)
        with sink:
            if part is not None:
                share_index(clip, part.output.folder.parent)
            there = sink.completed_frames if isinstance(sink, StagedSink) else 0
            if part is not None and part.is_empty:
                summary = Summary()
            else:
                summary = run_conversion(
                    source,
                    ready.interpolator,
                    sink,
                    ready.schedule,
                    observer,
                    options=replace(ready.timeline, guides=guides),
                    threads=threads,
                    outputs=replace(outputs, skip=there),
                )
            if part is not None:
                part.summary = summary
            if isinstance(main, ImageSink):
                # those that no earlier run has made; with side outputs, none were skipped
                summary.completed_frames -= min(main.kept_frames, summary.completed_frames)
                if summary.lowest_match is not None:
                    summary.lowest_match_file = main.names.path(summary.lowest_match.number).name
    # some are known only after the sink has finished the output
    summary.remarks.take(sink.remarks)
    if part is None:
        summary.remarks += closing_remarks(ready, summary)
    return summary


def fingerprint_job(job: ConversionJob, run: RunOptions, source: DescribedSource) -> JobFingerprint | None:
    """Return what an output is made of and how; None if the source can be read only once, so that nothing can resume.

    To resume from such a source raises `OptionError`.
    """
    files = source.stream_info.files
    if not files:
        if run.resume:
            raise OptionError("`resume` cannot read again what came through a pipe; name a file, or leave it out.")
        return None
    with explained(InputError, "read", source.info.name, "check that it is still there"):
        facts = fingerprint_options(
            input=str(Path(source.info.name).absolute()),
            input_files=fingerprint_files(files),
            fpsboost=f"{__version__} with PyAV {pyav_version()}",  # another FFmpeg may encode differently
            **{name: value for name, value in vars(job).items() if name not in ("input", "output")},
            in_place=run.in_place,
        )
    return JobFingerprint(facts, run.resume)
