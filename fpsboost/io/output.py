"""What is to be written, as far as it is known before the first frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from fpsboost.frame import ClipInfo
from fpsboost.io.staging import JobFingerprint
from fpsboost.io.stream_info import StreamInfo
from fpsboost.io.trim import Window
from fpsboost.io.video.encode_options import Encoding
from fpsboost.timing.schedule import OutputTiming


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
