"""Plain data from sources to sinks: what a clip has beside its frames, and what is to be written of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from fpsboost.errors import OutputError
from fpsboost.fingerprint import JobFingerprint
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import view
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.video.clock import Window
from fpsboost.io.video.demuxer import VideoFile
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.traits import VideoTraits
from fpsboost.timing.schedule import OutputTiming


@dataclass(frozen=True)
class StreamInfo:
    """Everything that a clip has beside its frames, for the sink."""

    traits: VideoTraits | None = None
    """Colour coding, pixel shape, rotation and HDR metadata of video."""
    colours: VideoTraits = field(default_factory=VideoTraits)
    """Colour tags of images or an animation, where the output is no images; defaults for video, which has `traits`."""
    video: VideoFile | None = None
    """File whose other streams and tags can be carried over; None unless the source is a video file."""
    images: NumberedImages | None = None
    """Files of the source, whose names and metadata the output can follow; None unless it is images."""
    plays: int = 0
    """Number of times that an animation is shown; 0 for ever."""
    files: Sequence[Path] = ()
    """Files that are read, and never written to; empty for a pipe or arrays, which can be read only once."""


@dataclass(frozen=True)
class OutputPart:
    """Part of an output: `frames` frames (None if unknown), from number `first` on, in a folder of its own."""

    folder: Path
    first: int
    frames: int | None
    complete: Callable[[Path], None]
    """Called with the folder of the finished files before it gets its final name, to add what describes them."""


@dataclass(frozen=True)
class Output:
    """Output, as a sink needs it: its path, the frames to come, and everything known of their source."""

    path: str
    """A video file, an animation, a folder, a pattern of images, or ``-``."""
    info: ClipInfo
    """Size of the frames to come, and the name of their source."""
    timing: OutputTiming
    """Frame rate and time base of the frames to come."""
    stream: StreamInfo = field(default_factory=StreamInfo)
    """Streams, tags and files of the source."""
    encoding: Encoding = field(default_factory=Encoding)
    """Options of the user for video."""
    expected_frames: int | None = None
    """Number of frames to come, for messages and for the digits of names of images."""
    overwrite: bool = False
    """Replace existing files."""
    job: JobFingerprint | None = None
    """Properties that a later run must share with this one to resume it; without them no run can be resumed."""
    window: Window | None = None
    """Part of the source that is written; None for all of it."""
    factor: Fraction | None = None
    """Frames written per frame of the source, for the numbers of images; numbered one by one without it."""
    in_place: bool = False
    """Write images beside those of the source."""
    part: OutputPart | None = None
    """The part that is written; None for all of it."""


def check_frame_size(frame: Frame, info: ClipInfo, name: str) -> None:
    """Raise `OutputError` if a frame does not have the size of the clip; the message calls the output `name`."""
    if frame.image.shape[:2] != (info.height, info.width):
        raise OutputError(
            f"{name} is {info.width}x{info.height} and cannot take a frame of {view(frame.image).describe()}; make all "
            "frames one size first."
        )
