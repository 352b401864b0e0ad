"""Plain data from a clip to a writer: what a clip has beside its pictures, and what is to be written of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fpsboost.media.clock import Window
from fpsboost.media.containers import MATROSKA_TICK, Container, containers_by_suffix
from fpsboost.media.demuxer import VideoFile
from fpsboost.media.errors import OutputError
from fpsboost.media.info import ClipInfo, EncodeSettings, OutputTiming
from fpsboost.media.parts import OutputPart
from fpsboost.media.staging import JobFingerprint
from fpsboost.media.time_map import TimeMap
from fpsboost.media.traits import VideoTraits


@dataclass(frozen=True)
class StreamInfo:
    """What a clip has beside its pictures, for the writer."""

    traits: VideoTraits | None = None
    """Colour coding, pixel shape, rotation and HDR metadata of video; None of images, whose first one decides."""
    colours: VideoTraits = field(default_factory=VideoTraits)
    """Colour tags of images or an animation, where the output is no images; defaults for video, which has `traits`."""
    video: VideoFile | None = None
    """File whose other streams and tags can be carried over; None unless the source is a video file."""
    files: Sequence[Path] = ()
    """Files that are read, and never written to; empty for a pipe or arrays, which can be read only once."""


@dataclass(frozen=True)
class Output:
    """Output, as a writer needs it: its path, the pictures to come, and what is known of their source."""

    path: str
    """File to write; messages name it so."""
    info: ClipInfo
    """Size of the pictures to come, and the name of their source."""
    timing: OutputTiming
    """Frame rate and time base of the pictures to come."""
    stream: StreamInfo = field(default_factory=StreamInfo)
    """Streams, tags and files of the source."""
    encoding: EncodeSettings = field(default_factory=EncodeSettings)
    """Options for video, and for the streams that are carried over."""
    expected_frames: int | None = None
    """Number of pictures to come, for messages."""
    overwrite: bool = False
    """Replace existing files."""
    job: JobFingerprint | None = None
    """Properties that a later run must share with this one to resume it; without them no run can be resumed."""
    window: Window | None = None
    """Part of the source that is written; None for all of it."""
    part: OutputPart | None = None
    """The part that is written; None for all of it."""

    @property
    def container(self) -> Container:
        """Container of the file; `OutputError` if none can hold it."""
        container = containers_by_suffix.get(Path(self.path).suffix.lower())
        if container is None:
            raise OutputError(
                f"{self.path} has no suffix of a video file; use one of {', '.join(containers_by_suffix)}."
            )
        if not container.exact_times and 1 / self.timing.rate < MATROSKA_TICK:
            raise OutputError(
                f"{self.path} counts time in milliseconds and cannot hold {float(self.timing.rate):g} frames per "
                "second; write an .mp4 or .mov instead."
            )
        return container

    @property
    def curve(self) -> TimeMap | None:
        """Map of output times to times of the source; None if it plays at its own speed."""
        return None if self.window is None else self.window.curve

    @property
    def expected_of_part(self) -> int | None:
        """Number of pictures of the part that is written, or of all of them; None if unknown."""
        return self.expected_frames if self.part is None else self.part.frames
