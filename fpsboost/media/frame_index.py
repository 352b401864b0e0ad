"""Index of a video's frames, from its packets alone: their times, and the key frames at which decoding can begin.

Indexes of containers list decoding times (MP4) or only some key frames (Matroska), so the packets are read; nothing is
decoded. What they promise is believed only where every packet becomes one picture at a time of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from fpsboost.media.demuxer import is_encrypted, read_packets
from fpsboost.media.errors import refuse
from fpsboost.media.pyav import open_input
from fpsboost.media.remarks import Damage

INDEXED = ("matroska", "mov")  # containers that store a presentation time with every packet, and an index of key frames


@dataclass(frozen=True)
class EntryPoint:
    """Key frame at which decoding can begin.

    Parameters
    ----------
    number : int
        Number of the frame, counted from 0; all frames from it on can be decoded.
    pts, dts : int
        Presentation and decoding time, ticks; `dts` is None if the container stores none.
    """

    number: int
    pts: int
    dts: int | None


@dataclass(frozen=True)
class FrameIndex:
    """Index of the frames of a video stream.

    Parameters
    ----------
    ticks : NDArray
        Presentation times, (N,) int64 in ticks of the stream, strictly increasing.
    entry_points : list of EntryPoint
        Key frames at which decoding can begin, in file order.
    """

    ticks: NDArray[np.int64]
    entry_points: list[EntryPoint]


class UnindexedError(Exception):
    """Reason, as a clause without subject and full stop, why packets do not determine the times of frames."""


def read_index(path: Path, video: int, *, playlists: bool = False) -> FrameIndex:
    """Return the index of a video stream, by reading all of its packets.

    Parameters
    ----------
    path : Path
        File to read.
    video : int
        Number of the stream.
    playlists : bool
        Also open playlists, for which other files are read.

    Raises
    ------
    UnindexedError
        The packets do not determine the frames: damage, encryption, or times that are missing or equal.
    """
    damage = Damage()
    pts: list[int] = []
    dts: list[int | None] = []
    keys: list[int] = []
    presented: list[int] = []
    try:
        with open_input(str(path.absolute()), playlists=playlists) as container:
            stream = container.streams.get(video)[0]
            listed, codec = len(stream.index_entries), stream.codec_context.codec.canonical_name
            for place, packet in enumerate(read_packets(container, {video}, damage)):
                if packet.pts is None:
                    raise UnindexedError("some of its packets have no time")
                flaws = {"it is encrypted": is_encrypted(packet), "some of its packets are damaged": packet.is_corrupt}
                refuse(flaws, UnindexedError)
                pts.append(packet.pts)
                dts.append(packet.dts)
                keys += [place] * packet.is_keyframe
                presented += [place] * (not packet.is_discard and is_presented(codec, packet))
    except (av.error.FFmpegError, OSError):
        raise UnindexedError("its packets cannot be listed") from None
    refuse(
        {
            "parts of it cannot be read": damage != Damage(),
            f"it lists {listed} packets and holds {len(pts)}": len(pts) < listed,
        },
        UnindexedError,
    )
    return _index_of(np.array(pts, np.int64), dts, keys, np.array(presented, np.intp))


def _index_of(
    pts: NDArray[np.int64], dts: Sequence[int | None], keys: Sequence[int], places: NDArray[np.intp]
) -> FrameIndex:
    """Return the index of packets with these times, of which those at `keys` are key frames, at `places` presented.

    Entry points are the key frames after which all frames are stored that are presented from them on.
    """
    places = places[np.argsort(pts[places], kind="stable")]
    ticks = pts[places]
    if not len(ticks) or np.any(np.diff(ticks) <= 0):
        raise UnindexedError("some of its frames have the same time")
    earliest = np.minimum.accumulate(places[::-1])[::-1]  # place of the first packet that a frame or a later one needs
    points: list[EntryPoint] = []
    for place in keys:
        number = int(np.searchsorted(ticks, pts[place]))
        if number < len(ticks) and earliest[number] >= place and (not points or number > points[-1].number):
            points.append(EntryPoint(number, int(pts[place]), dts[place]))
    return FrameIndex(ticks, points)


def is_presented(codec: str, packet: av.Packet[Any]) -> bool:
    """Return whether a packet becomes a picture that is presented; some of VP8 and VP9 are references alone."""
    data = memoryview(packet)
    if codec == "vp8":
        return bool(data[0] & 0x10)
    if codec == "vp9":
        # the first byte: marker, profile (profile 3 has a bit more), "shows an earlier frame", "no key frame", "shown"
        flags = data[0] if data[0] & 0x30 == 0x30 else data[0] >> 1
        return data[-1] & 0xE0 == 0xC0 or bool(flags & 5)  # the first of which a superframe ends with
    return True
