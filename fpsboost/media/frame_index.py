"""Index of a video's frames, from its packets alone: their times, and the key frames at which decoding can begin.

Indexes of containers list decoding times (MP4) or only some key frames (Matroska), so the packets are read; nothing is
decoded. What they promise is believed only where every packet becomes one picture at a time of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from fpsboost.media.demuxer import VideoFile, is_encrypted, read_packets
from fpsboost.media.pyav import Packet
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


def read_index(file: VideoFile) -> FrameIndex:
    """Return the index of the converted stream of a file, by reading all of its packets.

    Raises `UnindexedError` if the packets do not determine the frames: damage, encryption, or times that are missing or
    equal.
    """
    damage = Damage()
    pts: list[int] = []
    dts: list[int | None] = []
    keys: list[int] = []
    presented: list[int] = []
    try:
        with file.open() as container:
            stream = container.streams.get(file.stream_index)[0]
            listed = len(stream.index_entries)
            codec = stream.codec_context.codec.canonical_name
            for place, packet in enumerate(read_packets(container, {file.stream_index}, damage)):
                if packet.pts is None:
                    raise UnindexedError("some of its packets have no time")
                if is_encrypted(packet):
                    raise UnindexedError("it is encrypted")
                if packet.is_corrupt:
                    raise UnindexedError("some of its packets are damaged")
                pts.append(packet.pts)
                dts.append(packet.dts)
                if packet.is_keyframe:
                    keys.append(place)
                if not packet.is_discard and is_presented(codec, packet):
                    presented.append(place)
    except (FFmpegError, OSError):
        raise UnindexedError("its packets cannot be listed") from None
    if damage != Damage():
        raise UnindexedError("parts of it cannot be read")
    if len(pts) < listed:
        raise UnindexedError(f"it lists {listed} packets and holds {len(pts)}")
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


def is_presented(codec: str, packet: Packet) -> bool:
    """Return whether a packet becomes a picture that is presented; some of VP8 and VP9 are references alone."""
    data = memoryview(packet)
    if codec == "vp8":
        return bool(data[0] & 0x10)
    if codec == "vp9":
        # the first byte: marker, profile (profile 3 has a bit more), "shows an earlier frame", "no key frame", "shown"
        flags = data[0] if data[0] & 0x30 == 0x30 else data[0] >> 1
        return data[-1] & 0xE0 == 0xC0 or bool(flags & 5)  # the first of which a superframe ends with
    return True
