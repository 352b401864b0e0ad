"""Plain data from sources to sinks: what a clip has beside its frames, and what is to be written of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from fpsboost.frame import ClipInfo
from fpsboost.io.fingerprint import JobFingerprint
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.trim import Window
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.traits import VideoTraits
from fpsboost.timing.schedule import OutputTiming


@dataclass(frozen=True)
class VideoFile:
    """Video file whose streams besides the converted one may be carried over.

    Attributes
    ----------
    path : Path
    name : str
        Name of the file in messages.
    stream_index : int
        Number of the converted stream.
    start : Fraction
        Time of the file's own clock from which all times are counted, seconds.
    coded_rate : Fraction
        Nominal frames per second of the coded pictures; fields made into frames double the source's rate.
    companions : sequence of str
        Kinds of streams beside the pictures: ``sound``, ``subtitles``, both or neither.
    """

    path: Path
    name: str
    stream_index: int
    start: Fraction
    coded_rate: Fraction
    companions: Sequence[str]


@dataclass(frozen=True)
class StreamInfo:
    """What a clip has beside its frames, for the sink.

    Attributes
    ----------
    traits : VideoTraits or None
        Colour coding, pixel shape, rotation and HDR metadata of video.
    video : VideoFile or None
        The video file that is read.
    images : NumberedImages or None
        The images that are read.
    plays : int
        How often an animation is shown; 0 for ever again.
    files : sequence of Path
        The files that are read, which are never written to; empty for a pipe or arrays, which can be read only once.
    """

    traits: VideoTraits | None = None
    video: VideoFile | None = None
    images: NumberedImages | None = None
    plays: int = 0
    files: Sequence[Path] = ()


@dataclass(frozen=True)
class OutputPart:
    """Part of an output, which becomes a folder of its own.

    Attributes
    ----------
    folder : Path
        Appears when the part is complete.
    first : int
        Number of its first frame, counted from 0, among those of the whole output.
    frames : int or None
        Number of its frames, as far as it is known.
    complete : callable
        Called with the folder of the finished files before it gets its final name, to add what describes them.
    """

    folder: Path
    first: int
    frames: int | None
    complete: Callable[[Path], None]


@dataclass(frozen=True)
class Output:
    """An output, for the sink that writes it.

    Attributes
    ----------
    path : str
        A video file, an animation, a folder, a pattern of images, or ``-``.
    info : ClipInfo
        Size of the frames to come, and the name of their source.
    timing : OutputTiming
        Frame rate and time base.
    stream : StreamInfo
        What the source has beside its frames.
    encoding : Encoding
        Options for video, and the streams to carry over.
    expected_frames : int or None
        Number of frames to come, for messages and for the digits of names of images.
    overwrite : bool
        Replace what exists.
    job : JobFingerprint or None
        Properties that a later run must share with this one to resume it; without them no run can be resumed.
    window : Window or None
        Part of the source that is written; None for all of it.
    factor : Fraction or None
        Frames written per frame of the source, for the numbers of images; numbered one by one without it.
    in_place : bool
        Write images beside those of the source.
    part : OutputPart or None
        The part that is written; None for all of it.
    """

    path: str
    info: ClipInfo
    timing: OutputTiming
    stream: StreamInfo = field(default_factory=StreamInfo)
    encoding: Encoding = field(default_factory=Encoding)
    expected_frames: int | None = None
    overwrite: bool = False
    job: JobFingerprint | None = None
    window: Window | None = None
    factor: Fraction | None = None
    in_place: bool = False
    part: OutputPart | None = None
