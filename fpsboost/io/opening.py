"""Pick a source or a sink by looking at a path."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fpsboost.errors import InputError, OptionError, OutputError, explained
from fpsboost.frame_cache import SourcePosition
from fpsboost.io import FrameSink, FrameSource
from fpsboost.io.animation.canvas import ANIMATION_SUFFIXES
from fpsboost.io.animation.sink import AnimationSink
from fpsboost.io.animation.source import AnimationSource, animation_format
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of, keeps_alpha
from fpsboost.io.images.numbered import ImageSink, ImageSource
from fpsboost.io.images.numbering import is_pattern
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.staging import JobFingerprint, fingerprint_files, fingerprint_options
from fpsboost.io.trim import TrimmedSource, Window
from fpsboost.io.video.capture import CaptureSource
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import VIDEO_SUFFIXES, containers, encodes_alpha
from fpsboost.io.video.pipe import PipeSink, PipeSource
from fpsboost.io.video.sink import VideoSink
from fpsboost.io.video.source import VideoSource
from fpsboost.timing.schedule import OutputTiming
from fpsboost.timing.trim import Trim
from fpsboost.version import __version__

ASSUMED_IMAGE_RATE = Fraction(24)
"""For images that become images: their times then only serve as an order."""

PIPES = ("-", "pipe:")
"""What stands for standard input or output."""

SLOWEST, FASTEST = Fraction(1, 1000), Fraction(100_000)


@dataclass(frozen=True)
class TargetRequirements:
    """What a target asks of its source.

    Parameters
    ----------
    pictures_alone : bool
        It holds pictures and nothing else: no sound, and no tag that turns them, so that videos come upright.
    upright : bool
        It cannot say an image's EXIF orientation, so that images come upright.
    alpha : bool
        It can hold alpha.
    needs_rate : bool
        Images must say how fast they play.
    planes : bool
        Pictures of Y, Cb and Cr may stay as they are.
    """

    pictures_alone: bool = False
    upright: bool = False
    alpha: bool = False
    needs_rate: bool = False
    planes: bool = False


def requirements_of(path: str, encoding: Encoding, *, needs_rate: bool, takes_planes: bool) -> TargetRequirements:
    """Return what the output under a path asks of its source; a file always has a rate.

    `takes_planes` says whether what makes its frames can work on planes of Y, Cb and Cr.
    """
    to_video = makes_video(path)
    is_file = to_video or makes_animation(path)
    return TargetRequirements(
        not to_video, is_file, holds_alpha(path, encoding), is_file or needs_rate, to_video and takes_planes
    )


def open_source(
    path: str,
    *,
    requirements: TargetRequirements | None = None,
    decoding: DecodeOptions | None = None,
    fill_gaps: bool = False,
    in_place: bool = False,
    limit: MemoryLimit | None = None,
) -> FrameSource:
    """Open a clip for reading.

    Parameters
    ----------
    path : str
        A video file, an animation, a folder of images, a pattern of images, or ``-`` for YUV4MPEG2 from standard input.
    requirements : TargetRequirements, optional
        What the target asks of it.
    decoding : DecodeOptions, optional
        How a video file is read.
    fill_gaps, in_place : bool
        Of numbered images; see `fpsboost.io.images.numbered.ImageSource`.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Returns
    -------
    FrameSource

    Raises
    ------
    InputError
        Missing, unreadable, or too large.
    OptionError
        `input_fps` is missing for images, or given for a video; `decoding` says what only video files know, or
        `fill_gaps` what only images have.
    """
    if not path:
        raise InputError("The name of the input is empty; name a video, a folder or a pattern of images.")
    requirements, decoding = requirements or TargetRequirements(), decoding or DecodeOptions()
    input_fps = None if decoding.input_fps is None else Fraction(decoding.input_fps)
    if input_fps is not None and not SLOWEST <= input_fps <= FASTEST:
        raise OptionError(f"`input_fps` must be 0.001 to 100000, not {input_fps}.")
    with explained(InputError, "read", path, "check the name and the permissions"):
        is_images = stands_for_images(path)
        if fill_gaps and not is_images:
            check_images(path, "`fill_gaps`")
        if path in PIPES:
            _check_decoding(decoding, "standard input", "let the program before the pipe do that")
            _check_has_own_rate(input_fps, "standard input")
            return PipeSource(for_images=requirements.pictures_alone, keeps_planes=requirements.planes, limit=limit)
        if is_images:
            _check_decoding(decoding, f"{path}, which holds images", "leave it out")
            if input_fps is None and requirements.needs_rate:
                raise OptionError(
                    f"{path} holds images, which have no frame rate; say it with `input_fps`, for example 24."
                )
            rate = ASSUMED_IMAGE_RATE if input_fps is None else input_fps
            return ImageSource(
                path, rate, upright=requirements.upright, fill_gaps=fill_gaps, in_place=in_place, limit=limit
            )
        if decoding.decoder == "opencv":
            _check_has_own_rate(input_fps, path)
            if decoding.given != ["`decoder`"]:
                raise OptionError(f"{' and '.join(decoding.given)} do not go together; OpenCV reads a video as it is.")
            return CaptureSource(path, limit=limit)
        return _open_file(path, input_fps, requirements, decoding, limit)


def stands_for_images(path: str) -> bool:
    """Whether a path names a folder, or a pattern of images."""
    return path not in {"", *PIPES} and (Path(path).is_dir() or (is_pattern(path) and not Path(path).is_file()))


def check_images(path: str, option: str) -> None:
    """Raise an error unless an input is a folder or a pattern of images, which an option is for.

    Raises
    ------
    OptionError
        It is something else.
    InputError
        It does not exist.
    """
    if stands_for_images(path):
        return
    if path not in PIPES and not Path(path).exists():
        raise InputError(f"{path or 'An input without a name'} does not exist; check the name.")
    name = "standard input" if path in PIPES else path
    raise OptionError(f"{option} is for a folder or a pattern of images, which {name} is not; leave it out.")


def _open_file(
    path: str,
    input_fps: Fraction | None,
    requirements: TargetRequirements,
    decoding: DecodeOptions,
    limit: MemoryLimit | None,
) -> AnimationSource | VideoSource:
    if not Path(path).exists():
        raise InputError(f"{path} does not exist; check the name.")
    if Path(path).is_fifo():
        raise InputError(f"{path} is a named pipe, which can be read only once; give - and lead it there: < {path}.")
    is_animation = animation_format(Path(path)) is not None
    if not is_animation and Path(path).suffix.lower() in (*IMAGE_SUFFIXES, ".apng"):
        raise InputError(f"{path} is a single image; give its folder, or a pattern like shot_####.png.")
    _check_has_own_rate(input_fps, path)
    if is_animation:
        _check_decoding(decoding, f"{path}, which is an animation", "leave it out")
        return AnimationSource(path, keeps_alpha=requirements.alpha, limit=limit)
    return VideoSource(
        path,
        for_images=requirements.pictures_alone,
        keeps_alpha=requirements.alpha,
        keeps_planes=requirements.planes,
        decoding=decoding,
        limit=limit,
    )


def _check_has_own_rate(input_fps: Fraction | None, name: str) -> None:
    if input_fps is not None:
        raise OptionError(f"`input_fps` is for images; {name} is a video and has its own frame rate.")


def _check_decoding(decoding: DecodeOptions, what: str, advice: str) -> None:
    if decoding.given:
        raise OptionError(f"{' and '.join(decoding.given)} is for video files and not for {what}; {advice}.")


def trim_source(
    source: FrameSource, trim: Trim, *, may_skip: bool = True, stretch: Fraction = Fraction(1)
) -> FrameSource:
    """Return a part of a clip; see `fpsboost.io.trim.TrimmedSource`. Of images, no others are read."""
    if trim.is_whole and stretch == 1:
        return source
    if isinstance(source, ImageSource):
        begin, end = (
            None if time is None else math.ceil(time * source.info.rate) for time in trim.seconds(source.info)
        )
        source.keep(begin or 0, end)
        return source
    return TrimmedSource(source, trim, may_skip=may_skip, stretch=stretch)


def beginning(source: FrameSource) -> SourcePosition:
    """When the first frame of a source is shown in its clip; asked for when that has been read."""
    if isinstance(source, TrimmedSource):
        return source.beginning
    if isinstance(source, ImageSource):
        return SourcePosition(source.skipped, source.begins)
    return SourcePosition(0, Fraction(0))


def makes_video(path: str) -> bool:
    """Whether an output path names a video file or a pipe rather than an animation or images.

    Raises
    ------
    OptionError
        It names neither.
    """
    if not path:
        raise OptionError("The name of the output is empty; name a video, a folder or a pattern of images.")
    if path in PIPES:
        return True
    if is_pattern(path) or os.path.isdir(path) or path.endswith(("/", "\\")):
        return False
    suffix = Path(path).suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return True
    if suffix in ANIMATION_SUFFIXES:
        return False
    if suffix in IMAGE_SUFFIXES:
        raise OptionError(f"{path} would be a single image; give a folder, or a pattern like shot_####{suffix}.")
    if suffix:
        known = ", ".join(VIDEO_SUFFIXES + ANIMATION_SUFFIXES)
        raise OptionError(f"{path} has an ending that cannot be written; choose {known}, or a folder for images.")
    return False


def makes_animation(path: str) -> bool:
    """Whether an output path names an animation file."""
    is_file = path not in PIPES and not is_pattern(path) and not os.path.isdir(path)
    return is_file and not path.endswith(("/", "\\")) and Path(path).suffix.lower() in ANIMATION_SUFFIXES


def holds_alpha(path: str, encoding: Encoding) -> bool:
    """Whether an output can hold alpha."""
    if path in PIPES:
        return False
    if makes_video(path):
        return encodes_alpha(encoding, containers[Path(path).suffix.lower()])
    return not is_pattern(path) or keeps_alpha(extension_of(path))


def open_sink(
    path: str,
    *,
    source: FrameSource,
    timing: OutputTiming,
    encoding: Encoding,
    expected_frames: int | None,
    overwrite: bool,
    job: JobFingerprint | None = None,
    window: Window | None = None,
    factor: Fraction | None = None,
    in_place: bool = False,
) -> FrameSink:
    """Prepare a target for writing; it appears when the sink is left without an error.

    Parameters
    ----------
    path : str
        A video file, an animation, a folder, a pattern of images, or ``-`` for YUV4MPEG2 to standard output.
    source : FrameSource
        The clip it is made from, whose size, naming, colour and other streams carry over.
    timing : OutputTiming
        Rate and clock.
    encoding : Encoding
        For video.
    expected_frames : int or None
        How many frames there will be, for the padding of the numbers of images.
    overwrite : bool
        Replace what exists.
    job : JobFingerprint, optional
        What a later run must have in common with this one to go on with it.
    window : Window, optional
        Which part of the clip is written, for its other streams.
    factor : Fraction, optional
        Frames written per frame of the source, for the numbers of images; numbered one by one without it.
    in_place : bool
        Write images beside those of the source.

    Returns
    -------
    FrameSink

    Raises
    ------
    OptionError
        The path is neither images nor a video that can be written, or nothing that a run can go on with.
    OutputError
        It exists, or cannot be written, or cannot hold the source's streams.
    """
    video = source if isinstance(source, VideoSource | PipeSource) else None
    if path in PIPES:
        if job is not None and job.resume:
            raise OptionError("`resume` cannot go on with what went into a pipe; name a file, or leave it out.")
        return PipeSink(source.info, timing, encoding, video)
    if makes_video(path):
        with explained(OutputError, "write to", path, "check the name and the permissions"):
            return VideoSink(
                path,
                source.info,
                timing,
                encoding,
                video,
                overwrite=overwrite,
                job=job,
                frame_count=expected_frames,
                window=window,
            )
    images = source if isinstance(source, ImageSource) else None
    if makes_animation(path):
        if job is not None and job.resume:
            raise OptionError(f"`resume` cannot go on with the animation {path}; leave it out.")
        plays = source.plays if isinstance(source, AnimationSource) else 0
        return AnimationSink(path, source.info, timing, plays=plays, inputs=_files_of(source), overwrite=overwrite)
    return ImageSink(
        path,
        source.info,
        images,
        expected_frames,
        overwrite=overwrite,
        job=job,
        factor=factor,
        in_place=in_place,
    )


def fingerprint_job(source: FrameSource, job: Any, *, resume: bool) -> JobFingerprint | None:
    """Return what an output is made of and how; None if the source can be read only once, so that nothing can resume.

    Parameters
    ----------
    source : FrameSource
    job : dataclass
        Everything else that shapes the output.
    resume : bool
        Resume an earlier run.

    Raises
    ------
    OptionError
        `resume` is asked for and the source is a pipe.
    InputError
        The source's files are not there any more.
    """
    files = _files_of(source)
    if not files:
        if resume:
            raise OptionError("`resume` cannot read again what came through a pipe; name a file, or leave it out.")
        return None
    with explained(InputError, "read", source.info.name, "check that it is still there"):
        place = str(Path(source.info.name).absolute())
        versions = f"{__version__} with PyAV {version('av')}"  # another FFmpeg may encode differently
        facts = fingerprint_options(input=place, input_files=fingerprint_files(files), job=job, fpsboost=versions)
    return JobFingerprint(facts, resume)


def _files_of(source: FrameSource) -> Sequence[Path]:
    """Return the files that a source reads."""
    if isinstance(source, ImageSource | CaptureSource):
        return source.files
    return [source.path] if isinstance(source, AnimationSource | VideoSource) else []
