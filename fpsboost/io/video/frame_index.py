"""Times of a video's frames, and the frames at which decoding can begin, from its packets alone.

Indexes of containers list decoding times (MP4) or only some key frames (Matroska), so the packets are listed; nothing
is decoded. What they promise is believed only where every packet becomes one picture at a time of its own.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast, overload

import av
import av.container
import av.error
import numpy as np
from numpy.typing import NDArray

from fpsboost.io.video.damage import Damage
from fpsboost.io.video.entry_points import HIDING, is_shown
from fpsboost.io.video.header_reader import HeaderReader, has_whole_header
from fpsboost.io.video.packets import read_packets

INDEXED = ("matroska", "mov")
"""Containers that store a presentation time with every packet, and an index of key frames."""


class TickTimes(Sequence[Fraction]):
    """Times in whole ticks as a sequence of exact seconds, which are made when they are asked for.

    Parameters
    ----------
    ticks : (N,) int64
        Strictly increasing.
    tick : Fraction
        Seconds per tick.
    start : Fraction
        What becomes 0, seconds.

    Examples
    --------
    >>> times = TickTimes(np.array([0, 40, 80]), Fraction(1, 1000), Fraction(0))
    >>> times[1], len(times), times.index(Fraction(2, 25))
    (Fraction(1, 25), 3, 2)
    """

    def __init__(self, ticks: NDArray[np.int64], tick: Fraction, start: Fraction) -> None:
        self._ticks, self._tick, self._start = ticks, tick, start

    def __len__(self) -> int:
        return len(self._ticks)

    @overload
    def __getitem__(self, index: int) -> Fraction: ...

    @overload
    def __getitem__(self, index: slice) -> TickTimes: ...

    def __getitem__(self, index: int | slice) -> Fraction | TickTimes:
        if isinstance(index, slice):
            return TickTimes(self._ticks[index], self._tick, self._start)
        return int(self._ticks[index]) * self._tick - self._start

    def index(self, value: Any, start: int = 0, stop: int | None = None) -> int:
        """Return the number of the frame at a time; raise ValueError if there is none."""
        end = len(self) if stop is None else stop
        number = bisect_left(self, value, start, end)
        if number == end or self[number] != value:
            raise ValueError(f"{value} is no time of a frame")
        return number


@dataclass(frozen=True)
class EntryPoint:
    """Key frame at which decoding can begin: every frame from it on is decoded after it.

    Attributes
    ----------
    number : int
        Number of the first frame that is shown when decoding begins here.
    pts : int
        Presentation time of its packet, ticks.
    dts : int or None
        Decoding time of its packet, ticks.
    """

    number: int
    pts: int
    dts: int | None


@dataclass(frozen=True)
class FrameIndex:
    """Index of the frames of a video stream.

    Attributes
    ----------
    ticks : (N,) int64
        Presentation times of the frames, strictly increasing.
    entry_points : list of EntryPoint
        In the order of the file; their numbers increase.
    """

    ticks: NDArray[np.int64]
    entry_points: list[EntryPoint]

    def entry_points_before(self, number: int) -> list[EntryPoint]:
        """Return the entry points at or before a frame, the nearest first."""
        end = bisect_left(self.entry_points, number + 1, key=lambda point: point.number)
        return self.entry_points[:end][::-1]


class UnindexedError(Exception):
    """A file's packets do not tell the times of its frames; the message says why, as a clause."""


def read_index(path: Path, video: int) -> FrameIndex:
    """List all packets of a video stream and return what they tell of its frames.

    Parameters
    ----------
    path : Path
        A file that FFmpeg can read.
    video : int
        Number of the stream.

    Raises
    ------
    UnindexedError
        Packets lack times or share them, parts of the file cannot be read, or packets become no frame of their own.
    """
    file = HeaderReader(path)
    try:
        with av.open(file, "r", metadata_errors="replace") as container:
            codec = container.streams[video].codec_context.codec.canonical_name
            is_listed = container.format.name.startswith("mov") and has_whole_header(path)
            file.is_blank = is_listed and codec not in HIDING
            return _read_packets(container, cast(av.VideoStream, container.streams[video]), is_blank=file.is_blank)
    except (av.error.FFmpegError, OSError):
        raise UnindexedError("its packets cannot be listed") from None
    finally:
        file.close()


def _read_packets(container: av.container.InputContainer, stream: av.VideoStream, *, is_blank: bool) -> FrameIndex:
    """Return the index of a stream; where packets are blank, FFmpeg does not see which are key frames."""
    codec = stream.codec_context.codec.canonical_name
    listed = len(stream.index_entries)
    keys = [entry.is_keyframe for entry in stream.index_entries] if is_blank else []
    damage = Damage()
    pts: list[int] = []
    dts: list[int | None] = []
    flags: list[tuple[bool, bool]] = []
    for packet in read_packets(container, {stream.index}, damage):
        if packet.pts is None:
            raise UnindexedError("some of its packets have no time")
        if packet.is_corrupt:
            raise UnindexedError("some of its packets are damaged")
        pts.append(packet.pts)
        dts.append(packet.dts)
        if is_blank and len(pts) > listed:
            raise UnindexedError(f"it holds more than the {listed} packets that it lists")
        flags.append(
            (keys[len(pts) - 1] if is_blank else packet.is_keyframe, not packet.is_discard and is_shown(codec, packet))
        )
    if damage != Damage():
        raise UnindexedError("parts of it cannot be read")
    if len(pts) < listed:
        raise UnindexedError(f"it lists {listed} packets and holds {len(pts)}")
    if not pts:
        raise UnindexedError("it holds no packets")
    return _index_of(np.array(pts, np.int64), dts, *np.array(flags, bool).T)


def _index_of(
    pts: NDArray[np.int64], dts: Sequence[int | None], is_key: NDArray[np.bool_], is_shown: NDArray[np.bool_]
) -> FrameIndex:
    """Return the index of packets in the order of the file."""
    places = np.flatnonzero(is_shown)
    places = places[np.argsort(pts[places], kind="stable")]
    ticks = pts[places]
    if not len(ticks) or np.any(np.diff(ticks) <= 0):
        raise UnindexedError("some of its frames have the same time")
    return FrameIndex(ticks, list(_entry_points(pts, dts, np.flatnonzero(is_key), ticks, places)))


def _entry_points(
    pts: NDArray[np.int64],
    dts: Sequence[int | None],
    keys: NDArray[np.intp],
    ticks: NDArray[np.int64],
    places: NDArray[np.intp],
) -> Iterator[EntryPoint]:
    """Yield the key frames behind which all frames lie that are shown from them on."""
    earliest = np.minimum.accumulate(places[::-1])[::-1]  # place of the first packet that a frame or a later one needs
    last = -1
    for place in keys.tolist():
        number = int(np.searchsorted(ticks, pts[place]))
        if number < len(ticks) and earliest[number] >= place and number > last:
            last = number
            yield EntryPoint(number, int(pts[place]), dts[place])
