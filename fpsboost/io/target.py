"""Target of a conversion, parsed once from its path."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from fpsboost.contracts import FrameSink
from fpsboost.errors import OptionError, OutputError, explained
from fpsboost.frame import ClipInfo
from fpsboost.io.animation.sink import ANIMATION_SUFFIXES, AnimationSink
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of, keeps_alpha
from fpsboost.io.images.sink import ImagePartSink, ImageSink
from fpsboost.io.images.source import is_pattern
from fpsboost.io.opening import PIPES, TargetRequirements
from fpsboost.io.output import Output
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import VIDEO_SUFFIXES, containers, encodes_alpha
from fpsboost.io.video.pipe import PipeSink
from fpsboost.io.video.sink import VideoPartSink, VideoSink
from fpsboost.timing.schedule import OutputTiming

Kind = Literal["video", "pipe", "animation", "images"]


@dataclass(frozen=True)
class Target:
    """What a path stands for as an output.

    Parameters
    ----------
    path : str
        See `fpsboost.convert`.
    kind : {'video', 'pipe', 'animation', 'images'}
    """

    path: str
    kind: Kind

    @classmethod
    def parse(cls, path: str) -> Self:
        """Return the target that a path names, or raise `OptionError` if it can be none."""
        if not path:
            raise OptionError("The name of the output is empty; name a video, a folder or a pattern of images.")
        if path in PIPES:
            return cls(path, "pipe")
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
            endings = ", ".join(VIDEO_SUFFIXES + ANIMATION_SUFFIXES)
            raise OptionError(f"{path} has an ending that cannot be written; choose {endings}, or a folder for images.")
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
        """Whether the output says how fast its frames play."""
        return self.kind != "images"

    @property
    def holds_layers(self) -> bool:
        """Whether the output can hold layers beside the picture, if the images of its source can."""
        return self.kind == "images" and (not is_pattern(self.path) or extension_of(self.path) == ".exr")

    def holds_alpha(self, encoding: Encoding) -> bool:
        """Return whether the output can hold alpha."""
        if self.kind == "pipe":
            return False
        if self.kind == "video":
            return encodes_alpha(encoding, containers[Path(self.path).suffix.lower()])
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

    def check_parts(self) -> None:
        """Raise `OptionError` if the output cannot be put together of parts."""
        if self.kind == "pipe":
            raise OptionError("`chunk` does not work with standard output; name a file.")
        if self.kind == "animation":
            raise OptionError(f"`chunk` is for videos and images, and {self.path} will be an animation; leave it out.")

    def open(self, output: Output) -> FrameSink:
        """Prepare the output for writing; it appears when the sink is left without an error."""
        if output.job is not None and output.job.resume:
            if self.kind == "pipe":
                raise OptionError("`resume` cannot go on with what went into a pipe; name a file, or leave it out.")
            if self.kind == "animation":
                raise OptionError(f"`resume` cannot go on with the animation {self.path}; leave it out.")
        if output.part is not None:
            self.check_parts()
            return ImagePartSink(output) if self.kind == "images" else VideoPartSink(output)
        if self.kind == "pipe":
            return PipeSink(output)
        if self.kind == "animation":
            return AnimationSink(output)
        if self.kind == "images":
            return ImageSink(output)
        with explained(OutputError, "write to", self.path, "check the name and the permissions"):
            return VideoSink(output)


def open_sink(path: str, info: ClipInfo, *, encoding: Encoding | None = None, overwrite: bool = False) -> FrameSink:
    """Open an output for frames of any origin, such as those of `fpsboost.run_conversion`.

    Parameters
    ----------
    path : str
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
    target, encoding, timing = Target.parse(path), encoding or Encoding(), OutputTiming(info.rate, info.time_base)
    target.check_encoding(encoding)
    return target.open(
        Output(path, info, timing, encoding=encoding, expected_frames=info.frame_count, overwrite=overwrite)
    )
