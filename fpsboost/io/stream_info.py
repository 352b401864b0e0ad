"""Plain data that sources hand to sinks: what a clip has beside its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.video.traits import VideoTraits


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
