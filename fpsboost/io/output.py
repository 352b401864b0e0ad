"""Plain data from sources to sinks: what a clip has beside its frames, and what is to be written of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from fpsboost.errors import OutputError
from fpsboost.fingerprint import JobFingerprint
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import view
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.traits import VideoTraits
from fpsboost.timing.schedule import OutputTiming
from fpsboost.timing.time_map import TimeMap

TIME_TOLERANCE = Fraction(1, 1000)
"""Maximum seconds by which a clock that counts in milliseconds puts a frame before its position."""


@dataclass
class Window:
    """Part of a clip that becomes the output, on the clip's own clock, seconds."""

    begin: Fraction
    """Time that becomes 0: of the first frame of the part. Until that has been read, the time by the options."""
    end: Fraction | None
    """End of the part; None if that is the clip's own end, or a frame that has not been read yet."""
    planned_end: Fraction | None
    """End of the part by the options and the nominal rate; None for the clip's end."""
    origin: Fraction = Fraction(0)
    """Time of the clip's first frame."""
    skipped: int = 0
    """Number of frames before the part that were read, or that reading it has left out by their times."""
    curve: TimeMap | None = None
    """Which time of the part every output time shows; None if it plays at its own speed."""

    def frames_before(self, rate: Fraction) -> int:
        return max(0, math.ceil((self.begin - self.origin - TIME_TOLERANCE) * rate))


@dataclass(frozen=True)
class VideoFile:
    """Video file whose streams besides the converted one may be carried over; messages call it `name`."""

    path: Path
    name: str
    stream_index: int
    """Number of the converted stream."""
    start: Fraction
    """Time of the file's own clock from which all times are counted, seconds."""
    coded_rate: Fraction
    """Nominal frames per second of the coded pictures; fields made into frames double the source's rate."""
    companions: Sequence[str]
    """Kinds of streams beside the pictures: ``sound``, ``subtitles``, both or neither."""
    playlists: bool = False
    """Whether it may be a playlist, for which other files are read."""


@dataclass(frozen=True)
class StreamInfo:
    """What a clip has beside its frames, for the sink."""

    traits: VideoTraits | None = None
    """Colour coding, pixel shape, rotation and HDR metadata of video."""
    colours: VideoTraits = field(default_factory=VideoTraits)
    """What images say of their colours, where the output is no images; of video see `traits`."""
    video: VideoFile | None = None
    images: NumberedImages | None = None
    plays: int = 0
    """How often an animation is shown; 0 for ever again."""
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
    """An output, for the sink that writes it."""

    path: str
    """A video file, an animation, a folder, a pattern of images, or ``-``."""
    info: ClipInfo
    """Size of the frames to come, and the name of their source."""
    timing: OutputTiming
    stream: StreamInfo = field(default_factory=StreamInfo)
    encoding: Encoding = field(default_factory=Encoding)
    expected_frames: int | None = None
    """Number of frames to come, for messages and for the digits of names of images."""
    overwrite: bool = False
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
