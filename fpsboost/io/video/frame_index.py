"""Index of a video's frames, from its packets alone: their times, and the key frames at which decoding can begin.

Indexes of containers list decoding times (MP4) or only some key frames (Matroska), so the packets are listed; nothing
is decoded. What they promise is believed only where every packet becomes one picture at a time of its own.
"""

from __future__ import annotations

import os
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO, cast, overload

import av
import av.container
import av.error
import av.stream
import numpy as np
from numpy.typing import NDArray

from fpsboost.io.video.demuxer import read_packets
from fpsboost.io.video.pyav import open_input
from fpsboost.io.video.remarks import Damage

BLANK_BLOCK = bytes(1 << 20)

INDEXED = ("matroska", "mov")
"""Containers that store a presentation time with every packet, and an index of key frames."""

H264_IDR, H264_SEI = 5, 6
RECOVERY_POINT = 6
HEVC_RANDOM_ACCESS = range(16, 22)
HIDING = ("vp8", "vp9")
"""Codecs with packets that only serve as references and are not presented."""

MPEG2_PICTURE, MPEG4_PICTURE = b"\x00\x00\x01\x00", b"\x00\x00\x01\xb6"


class TickTimes(Sequence[Fraction]):
    """Increasing times in ticks as a sequence of exact seconds from `start`, computed when they are asked for."""

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
    """Key frame at which decoding can begin, with its times in ticks; frame `number` is the first to be presented."""

    number: int
    pts: int
    dts: int | None


@dataclass(frozen=True)
class FrameIndex:
    """Index of the frames of a video stream: their increasing times (N,) in ticks, and entry points in file order."""

    ticks: NDArray[np.int64]
    entry_points: list[EntryPoint]

    def entry_points_before(self, number: int) -> list[EntryPoint]:
        """Return the entry points at or before a frame, the nearest first."""
        end = bisect_left(self.entry_points, number + 1, key=lambda point: point.number)
        return self.entry_points[:end][::-1]


class UnindexedError(Exception):
    """The packets of a file do not give the times of its frames; the message is the reason, as a clause."""


def read_index(path: Path, video: int) -> FrameIndex:
    """List all packets of a video stream and return the index of its frames.

    Raises `UnindexedError` if packets lack times or share them, cannot be read, or become no frame of their own.
    """
    file = HeaderReader(path)
    try:
        with open_input(file) as container:
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
            (
                keys[len(pts) - 1] if is_blank else packet.is_keyframe,
                not packet.is_discard and is_presented(codec, packet),
            )
        )
    if damage != Damage():
        raise UnindexedError("parts of it cannot be read")
    if len(pts) < listed:
        raise UnindexedError(f"it lists {listed} packets and holds {len(pts)}")
    if not pts:
        raise UnindexedError("it holds no packets")
    return _index_of(np.array(pts, np.int64), dts, *np.array(flags, bool).T)


def _index_of(
    pts: NDArray[np.int64], dts: Sequence[int | None], is_key: NDArray[np.bool_], is_presented: NDArray[np.bool_]
) -> FrameIndex:
    places = np.flatnonzero(is_presented)
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
    """Yield the key frames after which all frames are stored that are presented from them on."""
    earliest = np.minimum.accumulate(places[::-1])[::-1]  # place of the first packet that a frame or a later one needs
    last = -1
    for place in keys.tolist():
        number = int(np.searchsorted(ticks, pts[place]))
        if number < len(ticks) and earliest[number] >= place and number > last:
            last = number
            yield EntryPoint(number, int(pts[place]), dts[place])


def can_begin(stream: av.VideoStream, packet: av.Packet[Any]) -> bool:
    """Return whether decoding that begins at a packet gives the same pictures, from this one on, as decoding all.

    Containers call a packet a key frame also where pictures are refreshed little by little (`intra refresh`), so that a
    decoder that begins there shows something, but not the same.
    """
    codec, header = stream.codec_context.codec, stream.codec_context.extradata
    check = checks.get(codec.canonical_name)
    return codec.intra_only if check is None else check(bytes(packet), header)


def _begins_h264(data: bytes, header: bytes | None) -> bool:
    return any(_is_h264_entry(unit) for unit in _units(data, header, 4))


def _begins_hevc(data: bytes, header: bytes | None) -> bool:
    return any(unit and (unit[0] >> 1 & 63) in HEVC_RANDOM_ACCESS for unit in _units(data, header, 21))


def _has_intra_picture(data: bytes, start_code: bytes, at: int, shift: int, mask: int, intra: int) -> bool:
    """Return whether the picture behind a start code, with its type in byte `at`, is an intra picture."""
    place = data.find(start_code)
    return 0 <= place < len(data) - at and data[place + at] >> shift & mask == intra


checks: dict[str, Callable[[bytes, bytes | None], bool]] = {
    "h264": _begins_h264,
    "hevc": _begins_hevc,
    "mpeg1video": lambda data, _: _has_intra_picture(data, MPEG2_PICTURE, 5, 3, 7, 1),
    "mpeg2video": lambda data, _: _has_intra_picture(data, MPEG2_PICTURE, 5, 3, 7, 1),
    "mpeg4": lambda data, _: _has_intra_picture(data, MPEG4_PICTURE, 4, 6, 3, 0),
    "vp8": lambda data, _: bool(data) and not data[0] & 1,
    "vp9": lambda data, _: bool(data) and not _vp9_flags(data[0]) & 6,
    "av1": lambda *_: True,
    "ffv1": lambda *_: True,
}
"""For each codec whose key frames end all dependence on earlier packets, the check of one; see `can_begin`."""


def is_presented(codec: str, packet: av.Packet[Any]) -> bool:
    """Return whether a packet of this codec becomes a picture that is presented.

    VP8 and VP9 have frames that only serve as references, in packets of their own; H.264 and others have none.
    """
    if codec == "vp8":
        return bool(memoryview(packet)[0] & 0x10)
    if codec == "vp9":
        data = memoryview(packet)
        is_superframe = data[-1] & 0xE0 == 0xC0
        return is_superframe or bool(_vp9_flags(data[0]) & 5)
    return True


def _vp9_flags(first: int) -> int:
    """Return from the first byte of a frame: 4 if it repeats an earlier one, 2 if no key frame, 1 if presented."""
    is_profile_3 = first & 0x30 == 0x30  # has one bit more before them
    return (first if is_profile_3 else first >> 1) & 7


def _is_h264_entry(unit: bytes) -> bool:
    kind = unit[0] & 31 if unit else 0
    return kind == H264_IDR or (kind == H264_SEI and _recovers_at_once(unit[1:]))


def _recovers_at_once(messages: bytes) -> bool:
    """Return whether an SEI unit declares a recovery point at its own picture."""
    place = 0
    while place + 2 < len(messages):
        numbers = []
        for _ in range(2):  # type and size, each as bytes of 255 and a rest
            number = 0
            while place < len(messages) and messages[place] == 255:
                number, place = number + 255, place + 1
            if place >= len(messages):
                return False
            numbers.append(number + messages[place])
            place += 1
        kind, size = numbers
        if kind == RECOVERY_POINT and place < len(messages):
            return bool(messages[place] & 0x80)  # the Exp-Golomb code of 0 frames
        place += size
    return False


def _units(data: bytes, header: bytes | None, place_of_length: int) -> Iterator[bytes]:
    """Yield the NAL units of a packet, behind lengths where the header says so, else behind start codes."""
    if not header or header[0] != 1 or len(header) <= place_of_length:
        yield from data.split(b"\x00\x00\x01")[1:]
        return
    width = (header[place_of_length] & 3) + 1
    place = 0
    while place + width < len(data):
        length = int.from_bytes(data[place : place + width], "big")
        yield data[place + width : place + width + length]
        place += width + length


class HeaderReader:
    """File for FFmpeg whose content is zeros while `is_blank`.

    The header of an MP4 or QuickTime file says where each packet lies, how long it is and when it is presented. FFmpeg
    gives all that only with the packet itself, so it is given zeros for what lies behind the header: a film of 100 GB
    is listed without reading it.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self._size, self._place = os.fstat(self._file.fileno()).st_size, 0
        self.is_blank = False

    def read(self, count: int) -> bytes:
        count = min(count, self._size - self._place, len(BLANK_BLOCK))
        if count <= 0:
            return b""
        if self.is_blank:
            data = BLANK_BLOCK if count == len(BLANK_BLOCK) else BLANK_BLOCK[:count]
        else:
            self._file.seek(self._place)
            data = self._file.read(count)
        self._place += len(data)
        return data

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        self._place = base + offset
        return self._place

    def tell(self) -> int:
        return self._place

    def close(self) -> None:
        self._file.close()


def has_whole_header(path: Path) -> bool:
    """Return whether all packets of an MP4 or QuickTime file are listed in one place, not in fragments."""
    with path.open("rb") as file:
        kinds = list(_kinds_of_boxes(file))
    return b"moov" in kinds and b"moof" not in kinds


def _kinds_of_boxes(file: BinaryIO) -> list[bytes]:
    kinds, place, size = [], 0, os.fstat(file.fileno()).st_size
    while place + 8 <= size:
        file.seek(place)
        head = file.read(16)
        length, kind = int.from_bytes(head[:4], "big"), head[4:8]
        if length == 1:
            length = int.from_bytes(head[8:], "big")
        kinds.append(kind)
        if length < 8:  # 0 for a box up to the end
            break
        place += length
    return kinds
