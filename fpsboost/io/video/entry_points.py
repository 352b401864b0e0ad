"""What the first bytes of packets tell: whether decoding can begin there, and whether a picture is shown.

Containers call a packet a key frame also where pictures are refreshed little by little (`intra refresh`), so that a
decoder that begins there shows something, but not the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import av
import av.stream

H264_IDR, H264_SEI = 5, 6
RECOVERY_POINT = 6
HEVC_RANDOM_ACCESS = range(16, 22)
HIDING = ("vp8", "vp9")
"""Codecs that have packets of which no picture is shown."""

MPEG2_PICTURE, MPEG4_PICTURE = b"\x00\x00\x01\x00", b"\x00\x00\x01\xb6"


def can_begin(stream: av.VideoStream, packet: av.Packet[Any]) -> bool:
    """Return whether decoding that begins at a packet gives the same pictures, from this one on, as decoding all.

    Parameters
    ----------
    stream : av.VideoStream
    packet : av.Packet
        One of its packets, marked as a key frame.
    """
    codec, header = stream.codec_context.codec, stream.codec_context.extradata
    check = checks.get(codec.canonical_name)
    return codec.intra_only if check is None else check(bytes(packet), header)


def _begins_h264(data: bytes, header: bytes | None) -> bool:
    return any(_is_h264_entry(unit) for unit in _units(data, header, 4))


def _begins_hevc(data: bytes, header: bytes | None) -> bool:
    return any(unit and (unit[0] >> 1 & 63) in HEVC_RANDOM_ACCESS for unit in _units(data, header, 21))


def _begins_mpeg2(data: bytes, _: bytes | None) -> bool:
    place = data.find(MPEG2_PICTURE)
    return 0 <= place < len(data) - 5 and data[place + 5] >> 3 & 7 == 1


def _begins_mpeg4(data: bytes, _: bytes | None) -> bool:
    place = data.find(MPEG4_PICTURE)
    return 0 <= place < len(data) - 4 and data[place + 4] >> 6 == 0


def _begins_vp8(data: bytes, _: bytes | None) -> bool:
    return bool(data) and not data[0] & 1


def _begins_vp9(data: bytes, _: bytes | None) -> bool:
    return bool(data) and not _vp9_flags(data[0]) & 6


def _begins_as_marked(_: bytes, __: bytes | None) -> bool:
    return True


checks: dict[str, Callable[[bytes, bytes | None], bool]] = {
    "h264": _begins_h264,
    "hevc": _begins_hevc,
    "mpeg1video": _begins_mpeg2,
    "mpeg2video": _begins_mpeg2,
    "mpeg4": _begins_mpeg4,
    "vp8": _begins_vp8,
    "vp9": _begins_vp9,
    "av1": _begins_as_marked,
    "ffv1": _begins_as_marked,
}
"""For each codec whose key frames end all dependence on earlier packets, the check of one; see `can_begin`."""


def is_shown(codec: str, packet: av.Packet[Any]) -> bool:
    """Return whether a packet of this codec becomes a picture that is shown.

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
    """Return, from the first byte of a frame, 4 if it repeats an earlier one, 2 if it is no key frame, 1 if shown."""
    is_profile_3 = first & 0x30 == 0x30  # has one bit more before them
    return (first if is_profile_3 else first >> 1) & 7


def _is_h264_entry(unit: bytes) -> bool:
    kind = unit[0] & 31 if unit else 0
    return kind == H264_IDR or (kind == H264_SEI and _recovers_at_once(unit[1:]))


def _recovers_at_once(messages: bytes) -> bool:
    """Return whether an SEI unit says that decoding is right from the picture that it belongs to on."""
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
