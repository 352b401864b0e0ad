"""Sources and sinks by their paths: which kind each path stands for, and what its options and kind must agree on."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal, Self

from fpsboost.contracts import FrameSink
from fpsboost.errors import InputError, OptionError, OutputError, explained
from fpsboost.frame import ClipInfo
from fpsboost.io import DescribedSource
from fpsboost.io.animation.sink import AnimationSink
from fpsboost.io.animation.source import AnimationSource, is_animation
from fpsboost.io.animation.writers import ANIMATION_SUFFIXES, types
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of, keeps_alpha
from fpsboost.io.images.layers import ALL, BEAUTY
from fpsboost.io.images.sink import ImagePartSink, ImageSink
from fpsboost.io.images.source import ImageReading, ImageSource, find_images, is_pattern
from fpsboost.io.output import Output
from fpsboost.io.video.capture import CaptureSource
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.pipe import PipeSink, PipeSource
from fpsboost.io.video.sink import VideoPartSink, VideoSink
from fpsboost.io.video.source import VideoSource
from fpsboost.media import (
    VIDEO_SUFFIXES,
    OutputTiming,
    check_is_no_playlist,
    containers_by_suffix,
    encodes_alpha,
    open_video,
)
from fpsboost.memory import MemoryLimit
from fpsboost.options import PathName, checked

ASSUMED_IMAGE_RATE = Fraction(24)
"""For images that become images: their times then only serve as an order."""

PIPES = ("-", "pipe:")
"""Paths that stand for standard input or output."""


@dataclass(frozen=True)
class TargetRequirements:
    """Properties of a target that determine how its source is read."""

    pictures_alone: bool = False
    """It holds pictures and nothing else: no sound, and no tag that turns them, so that videos come upright."""
    upright: bool = False
    """It cannot store an image's EXIF orientation, so that images come upright."""
    alpha: bool = False
    """It can hold alpha."""
    needs_rate: bool = False
    """It has a frame rate, so that one must be given for images."""
    planes: bool = False
    """Pictures of Y, Cb and Cr may stay as they are."""
    layers: bool = False
    """It can hold layers beside the picture."""
    linear: bool = False
    """Scene-linear colours come as `LayeredImage`, because the method finds weights for them on another scale."""


def open_source(
    path: str,
    *,
    requirements: TargetRequirements = TargetRequirements(),
    decoding: DecodeOptions = DecodeOptions(),
    fill_gaps: bool = False,
    in_place: bool = False,
    limit: MemoryLimit | None = None,
) -> DescribedSource:
    """Open a clip for reading: a video file, an animation, a folder or pattern of images, or ``-`` for YUV4MPEG2.

    Parameters
    ----------
    path : str
        Path of the input; messages name it so.
    requirements : TargetRequirements, optional
        Properties of the target, such as whether it can hold alpha; by default neither alpha, planes nor layers.
    decoding : DecodeOptions, optional
        Options of the user for reading.
    fill_gaps, in_place : bool
        Options for numbered images; see `fpsboost.io.images.source.ImageReading`.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Returns
    -------
    DescribedSource
        Open source, which the caller closes.

    Raises
    ------
    InputError
        The input is missing, unreadable or too large.
    OptionError
        Options do not suit the kind of the input, or images need a rate that is not given.
    """
    if not path:
        raise InputError("The name of the input is empty; name a video, a folder or a pattern of images.")
    input_fps = None if decoding.input_fps is None else Fraction(decoding.input_fps)
    with explained(InputError, "read", path, "check the name and the permissions"):
        if fill_gaps:
            check_images(path, "`fill_gaps`")
        if decoding.passes is not None:
            check_images(path, "`passes`")
        if decoding.view != "none":
            check_images(path, "`view`")
        if path in PIPES:
            _check_decoding(decoding, "standard input", "let the program before the pipe do that")
            return PipeSource(for_images=requirements.pictures_alone, keeps_planes=requirements.planes, limit=limit)
        if stands_for_images(path):
            _check_decoding(replace(decoding, input_fps=None), f"{path}, which holds images", "leave it out")
            if input_fps is None and requirements.needs_rate:
                find_images(path)  # raises its own error where there are no images
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
            if Path(path).is_file() and not decoding.allow_playlists:
                check_is_no_playlist(Path(path), path)
            return CaptureSource(path, limit=limit)
        return _open_file(path, requirements, decoding, limit)


def _check_light_and_layers(path: str, decoding: DecodeOptions, requirements: TargetRequirements) -> None:
    """Raise OptionError if `passes` or `view` is given where the output cannot hold layers, or holds their light."""
    if not requirements.layers and decoding.passes not in (None, BEAUTY):
        raise OptionError(
            f"`passes` makes layers of OpenEXR images, which the output of {path} cannot hold; name a folder or a "
            "pattern such as shot_####.exr, or leave it out."
        )
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
    path: str, requirements: TargetRequirements, decoding: DecodeOptions, limit: MemoryLimit | None
) -> AnimationSource | VideoSource:
    """Open a file by its content, as an animation or a video; raise `InputError` for single images and named pipes."""
    if "://" in path:
        raise InputError(f"{path} is an address, and only files are read; download it first.")
    if not Path(path).exists():
        raise InputError(f"{path} does not exist; check the name.")
    if Path(path).is_fifo():
        raise InputError(f"{path} is a named pipe, which is read only once; give it as standard input: - < {path}.")
    animated = is_animation(Path(path))
    if extension_of(path) == ".jxl":
        with open_video(Path(path), path) as file:
            if file.format.name == "jpegxl_anim":
                raise InputError(f"{path} is an animated JPEG XL, which cannot be read; convert it to .apng by djxl.")
    if not animated and Path(path).suffix.lower() in (*IMAGE_SUFFIXES, ".apng"):
        raise InputError(
            f"{path} is a single image; give two and a folder (a.png b.png out/), the folder of a clip, or "
            "a pattern like shot_####.png."
        )
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


def _check_decoding(decoding: DecodeOptions, what: str, advice: str) -> None:
    """Raise `OptionError` if options for video files are given for another kind of input."""
    if decoding.given:
        raise OptionError(f"{' and '.join(decoding.given)} is for video files and not for {what}; {advice}.")


Kind = Literal["video", "pipe", "animation", "images"]

sinks: Mapping[Kind, Callable[[Output], FrameSink]] = {
    "video": VideoSink,
    "pipe": PipeSink,
    "animation": AnimationSink,
    "images": ImageSink,
}
"""Sink of a whole output by its kind."""


@dataclass(frozen=True)
class Target:
    """Output that a path names, as `fpsboost.convert` takes it, and its kind."""

    path: str
    kind: Kind

    @classmethod
    @checked
    def parse(cls, path: PathName) -> Self:
        """Return the target that a path names, or raise `OptionError` if it can be none."""
        path = os.fspath(path)
        if not path:
            raise OptionError("The name of the output is empty; name a video, a folder or a pattern of images.")
        if path in PIPES:
            return cls(path, "pipe")
        if "://" in path:
            raise OptionError(f"{path} is an address, and only files are written; name a file, and send that.")
        if is_pattern(path) or os.path.isdir(path) or path.endswith(("/", "\\")):
            return cls(path, "images")
        suffix = Path(path).suffix.lower()
        if suffix in VIDEO_SUFFIXES:
            return cls(path, "video")
        if suffix in ANIMATION_SUFFIXES:
            return cls(path, "animation")
        if suffix in IMAGE_SUFFIXES:
            raise OptionError(f"{path} would be a single image; give a folder, or a pattern like shot_####{suffix}.")
        if suffix:
            raise OptionError(
                f"{path} has an ending that cannot be written; choose "
                f"{', '.join(VIDEO_SUFFIXES + ANIMATION_SUFFIXES)}, or a folder for images."
            )
        return cls(path, "images")

    @property
    def file_type(self) -> str:
        """Type of the files: the ending of a single one, or ``images``."""
        return "images" if self.kind == "images" else Path(self.path).suffix.lower()

    @property
    def has_clock(self) -> bool:
        """Whether the output stores when each frame is shown, and the streams of video."""
        return self.kind in ("video", "pipe")

    @property
    def has_rate(self) -> bool:
        """Whether the output stores a frame rate."""
        return self.kind != "images"

    @property
    def highest_rate(self) -> Fraction | None:
        """Highest frame rate that the type of an animation can hold; None for other outputs."""
        return 1 / types[self.file_type].shortest if self.kind == "animation" else None

    @property
    def holds_layers(self) -> bool:
        """Whether the output can hold layers beside the picture, if the images of its source can."""
        return self.kind == "images" and (not is_pattern(self.path) or extension_of(self.path) == ".exr")

    def holds_alpha(self, encoding: Encoding) -> bool:
        """Return whether the output can hold alpha."""
        if self.kind == "pipe":
            return False
        if self.kind == "video":
            return encodes_alpha(encoding, containers_by_suffix[Path(self.path).suffix.lower()])
        return not is_pattern(self.path) or keeps_alpha(extension_of(self.path))

    def requirements(
        self, encoding: Encoding, *, needs_rate: bool, takes_planes: bool, takes_layers: bool
    ) -> TargetRequirements:
        """Return what the output asks of its source, for a method that takes planes of Y, Cb and Cr, and layers.

        With `needs_rate`, ask for a rate also where the output has none.
        """
        return TargetRequirements(
            pictures_alone=not self.has_clock,
            upright=self.has_rate,
            alpha=self.holds_alpha(encoding),
            needs_rate=self.has_rate or needs_rate,
            planes=self.has_clock and takes_planes,
            layers=self.holds_layers,
            linear=takes_layers,
        )

    def check_encoding(self, encoding: Encoding) -> None:
        """Raise `OptionError` if options for encoding were given and nothing is encoded."""
        if encoding.given and self.kind in ("animation", "images"):
            what = "an animation, which takes" if self.kind == "animation" else "images, which take"
            raise OptionError(f"{self.path} will be {what} no {' or '.join(encoding.given)}; leave that out.")

    @property
    def _described(self) -> str:
        """The output in messages, for kinds that cannot be resumed or joined."""
        return "standard output" if self.kind == "pipe" else f"the animation {self.path}"

    def check_parts(self) -> None:
        """Raise `OptionError` if the output cannot be put together of parts."""
        if self.kind in ("pipe", "animation"):
            raise OptionError(f"`chunk` is for videos and images, not for {self._described}; leave it out.")

    def open(self, output: Output) -> FrameSink:
        """Return the sink of an output or of its part, to be entered before frames are written.

        Nothing is written yet, but what can be checked is. Raises `OptionError` if options do not suit the kind of
        output, and `OutputError` if it exists or cannot be written.
        """
        if output.job is not None and output.job.resume and self.kind in ("pipe", "animation"):
            raise OptionError(f"`resume` cannot go on with what went into {self._described}; leave it out.")
        if output.part is not None:
            self.check_parts()
            return ImagePartSink(output) if self.kind == "images" else VideoPartSink(output)
        with explained(OutputError, "write to", self.path, "check the name and the permissions"):
            return sinks[self.kind](output)


@checked
def open_sink(
    path: PathName, info: ClipInfo, *, encoding: Encoding | None = None, overwrite: bool = False
) -> FrameSink:
    """Open an output for frames of any origin, such as those of `fpsboost.run_conversion`.

    Parameters
    ----------
    path : str or os.PathLike
        See `fpsboost.convert`.
    info : ClipInfo
        Size, rate and time base of the frames to come, their number if it is known, and a name of their source.
    encoding : Encoding, optional
    overwrite : bool
        Replace an existing output.

    Returns
    -------
    FrameSink
        The output appears when the sink is left without an error.

    Raises
    ------
    OptionError, OutputError
        The path can be no output, exists, or cannot be written.
    """
    target = Target.parse(path)
    encoding = encoding or Encoding()
    timing = OutputTiming(info.rate, info.time_base)
    target.check_encoding(encoding)
    return target.open(
        Output(target.path, info, timing, encoding=encoding, expected_frames=info.frame_count, overwrite=overwrite)
    )
