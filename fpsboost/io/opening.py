"""Pick a source by looking at a path, and identify a job by its source and options."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from fpsboost.errors import InputError, OptionError, explained
from fpsboost.io import DescribedSource
from fpsboost.io.animation.source import AnimationSource, is_animation
from fpsboost.io.images.files import IMAGE_SUFFIXES
from fpsboost.io.images.layers import ALL, BEAUTY
from fpsboost.io.images.source import ImageReading, ImageSource, is_pattern
from fpsboost.io.video.capture import CaptureSource
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.demuxer import check_is_no_playlist
from fpsboost.io.video.pipe import PipeSource
from fpsboost.io.video.source import VideoSource
from fpsboost.memory import MemoryLimit

ASSUMED_IMAGE_RATE = Fraction(24)
"""For images that become images: their times then only serve as an order."""

PIPES = ("-", "pipe:")
"""What stands for standard input or output."""

MIN_IMAGE_RATE, MAX_IMAGE_RATE = Fraction(1, 1000), Fraction(100_000)


@dataclass(frozen=True)
class TargetRequirements:
    """What a target asks of its source."""

    pictures_alone: bool = False
    """It holds pictures and nothing else: no sound, and no tag that turns them, so that videos come upright."""
    upright: bool = False
    """It cannot say an image's EXIF orientation, so that images come upright."""
    alpha: bool = False
    """It can hold alpha."""
    needs_rate: bool = False
    """Images must say how fast they play."""
    planes: bool = False
    """Pictures of Y, Cb and Cr may stay as they are."""
    layers: bool = False
    """It can hold layers beside the picture."""
    linear: bool = False
    """Scene-linear colours come as `LayeredImage`, because the method finds weights for them on another scale."""


def open_source(
    path: str,
    *,
    requirements: TargetRequirements | None = None,
    decoding: DecodeOptions | None = None,
    fill_gaps: bool = False,
    in_place: bool = False,
    limit: MemoryLimit | None = None,
) -> DescribedSource:
    """Open a clip for reading: a video file, an animation, a folder or pattern of images, or ``-`` for YUV4MPEG2.

    `fill_gaps` and `in_place` are for numbered images; see `fpsboost.io.images.source.ImageReading`. Raises
    `InputError` for what is missing, unreadable or too large, and `OptionError` for options that do not suit it.
    """
    if not path:
        raise InputError("The name of the input is empty; name a video, a folder or a pattern of images.")
    requirements, decoding = requirements or TargetRequirements(), decoding or DecodeOptions()
    input_fps = None if decoding.input_fps is None else Fraction(decoding.input_fps)
    if input_fps is not None and not MIN_IMAGE_RATE <= input_fps <= MAX_IMAGE_RATE:
        raise OptionError(f"`input_fps` must be 0.001 to 100000, not {input_fps}.")
    with explained(InputError, "read", path, "check the name and the permissions"):
        is_images = stands_for_images(path)
        given = {"`fill_gaps`": fill_gaps, "`passes`": decoding.passes is not None, "`view`": decoding.view != "none"}
        for option in (option for option, is_given in given.items() if is_given):
            check_images(path, option)
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
            _check_light_and_layers(path, decoding, requirements)
            reading = ImageReading(
                upright=requirements.upright,
                fill_gaps=fill_gaps,
                in_place=in_place,
                passes=decoding.passes or (ALL if requirements.layers else BEAUTY),
                linear=requirements.linear,
                view=decoding.view,
            )
            return ImageSource(path, input_fps or ASSUMED_IMAGE_RATE, reading, limit=limit)
        if decoding.decoder == "opencv":
            _check_has_own_rate(input_fps, path)
            if Path(path).is_file() and not decoding.allow_playlists:
                check_is_no_playlist(Path(path), path)
            if {*decoding.given} - {"`allow_playlists`"} != {"`decoder`"}:
                raise OptionError(f"{' and '.join(decoding.given)} do not go together; OpenCV reads a video as it is.")
            return CaptureSource(path, limit=limit)
        return _open_file(path, input_fps, requirements, decoding, limit)


def _check_light_and_layers(path: str, decoding: DecodeOptions, requirements: TargetRequirements) -> None:
    """Raise OptionError if `passes` or `view` is given where the output cannot hold layers, or holds their light."""
    if not requirements.layers and decoding.passes not in (None, BEAUTY):
        advice = "name a folder or a pattern such as shot_####.exr, or leave it out."
        raise OptionError(f"`passes` makes layers of OpenEXR images, which the output of {path} cannot hold; {advice}")
    if decoding.view != "none" and requirements.layers:
        raise OptionError(f"`view` is for videos and animations, and the images made of {path} keep their light.")


def stands_for_images(path: str) -> bool:
    """Return whether a path names a folder, or a pattern of images."""
    return path not in {"", *PIPES} and (Path(path).is_dir() or (is_pattern(path) and not Path(path).is_file()))


def check_images(path: str, option: str) -> None:
    """Raise OptionError unless an input is a folder or a pattern of images, which an option is for."""
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
    animated = is_animation(Path(path))
    if not animated and Path(path).suffix.lower() in (*IMAGE_SUFFIXES, ".apng"):
        raise InputError(f"{path} is a single image; give its folder, or a pattern like shot_####.png.")
    _check_has_own_rate(input_fps, path)
    if animated:
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
