"""Pick a source or a sink by looking at a path."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from fpsboost.errors import InputError, OptionError
from fpsboost.media import FrameSink, FrameSource, OutputTiming
from fpsboost.media.animation import ANIMATION_SUFFIXES
from fpsboost.media.animation_sink import AnimationSink
from fpsboost.media.animation_source import AnimationSource, animation_format
from fpsboost.media.encoding import VIDEO_SUFFIXES, Encoding, containers, encodes_alpha
from fpsboost.media.image_files import IMAGE_SUFFIXES, extension_of, keeps_alpha
from fpsboost.media.images import ImageSink, ImageSource
from fpsboost.media.numbering import is_pattern
from fpsboost.media.pipe import PipeSink, PipeSource
from fpsboost.media.video_sink import VideoSink
from fpsboost.media.video_source import VideoSource

ASSUMED_IMAGE_RATE = Fraction(24)
"""For images that become images: their times then only serve as an order."""

PIPES = ("-", "pipe:")
"""What stands for standard input or output."""

SLOWEST, FASTEST = Fraction(1, 1000), Fraction(100_000)


def open_source(
    path: str,
    input_fps: Fraction | None = None,
    *,
    needs_rate: bool = False,
    for_images: bool = False,
    keeps_alpha: bool = False,
    upright: bool = False,
) -> FrameSource:
    """Open a clip for reading.

    Parameters
    ----------
    path : str
        A video file, an animation, a folder of images, a pattern of images, or ``-`` for YUV4MPEG2 from standard input.
    input_fps : Fraction, optional
        Frames per second of images.
    needs_rate : bool
        Whether images must say how fast they play.
    for_images : bool
        The target will be images, which hold no rotation and no sound.
    keeps_alpha : bool
        The target can hold alpha.
    upright : bool
        Turn images as their EXIF orientation says, because the target will not be images.

    Returns
    -------
    FrameSource

    Raises
    ------
    InputError
        Missing or unreadable.
    OptionError
        `input_fps` is missing for images, or given for a video.
    """
    if not path:
        raise InputError("The name of the input is empty; name a video, a folder or a pattern of images.")
    if input_fps is not None and not SLOWEST <= input_fps <= FASTEST:
        raise OptionError(f"--input-fps must be 0.001 to 100000, not {input_fps}.")
    if path in PIPES:
        if input_fps is not None:
            raise OptionError("--input-fps is for images; standard input is a video and has its own frame rate.")
        return PipeSource(for_images=for_images)
    if Path(path).is_dir() or is_pattern(path):
        if input_fps is None and needs_rate:
            raise OptionError(
                f"{path} holds images, which have no frame rate; say it with --input-fps, for example 24."
            )
        rate = ASSUMED_IMAGE_RATE if input_fps is None else input_fps
        return ImageSource(path, rate, upright=upright)
    if not Path(path).exists():
        raise InputError(f"{path} does not exist; check the name.")
    is_animation = animation_format(Path(path)) is not None
    if not is_animation and Path(path).suffix.lower() in (*IMAGE_SUFFIXES, ".apng"):
        raise InputError(f"{path} is a single image; give its folder, or a pattern like shot_####.png.")
    if input_fps is not None:
        raise OptionError(f"--input-fps is for images; {path} is a video and has its own frame rate.")
    if is_animation:
        return AnimationSource(path, keeps_alpha=keeps_alpha)
    return VideoSource(path, for_images=for_images, keeps_alpha=keeps_alpha)


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
    if is_pattern(path) or Path(path).is_dir():
        return False
    suffix = Path(path).suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return True
    if suffix in ANIMATION_SUFFIXES:
        return False
    if suffix in IMAGE_SUFFIXES:
        raise OptionError(f"{path} would be a single image; give a folder, or a pattern like shot_####{suffix}.")
    if suffix and not path.endswith(("/", "\\")):
        known = ", ".join(VIDEO_SUFFIXES + ANIMATION_SUFFIXES)
        raise OptionError(f"{path} has an ending that cannot be written; choose {known}, or a folder for images.")
    return False


def makes_animation(path: str) -> bool:
    """Whether an output path names an animation file."""
    is_file = path not in PIPES and not is_pattern(path) and not Path(path).is_dir()
    return is_file and Path(path).suffix.lower() in ANIMATION_SUFFIXES


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
        How many images there will be, for the padding of their numbers.
    overwrite : bool
        Replace what exists.

    Returns
    -------
    FrameSink

    Raises
    ------
    OptionError
        The path is neither images nor a video that can be written.
    OutputError
        It exists, or cannot be written, or cannot hold the source's streams.
    """
    video = source if isinstance(source, VideoSource | PipeSource) else None
    if path in PIPES:
        return PipeSink(source.info, timing, encoding, video)
    if makes_video(path):
        return VideoSink(path, source.info, timing, encoding, video, overwrite=overwrite)
    images = source if isinstance(source, ImageSource) else None
    if makes_animation(path):
        plays = source.plays if isinstance(source, AnimationSource) else 0
        return AnimationSink(path, source.info, timing, plays=plays, inputs=_files_of(source), overwrite=overwrite)
    return ImageSink(path, source.info, images, expected_frames, overwrite=overwrite)


def _files_of(source: FrameSource) -> Sequence[Path]:
    """The files that a source reads."""
    if isinstance(source, ImageSource):
        return source.files
    return [source.path] if isinstance(source, AnimationSource | VideoSource) else []
