"""Side data: metadata of pictures beside their samples, stored with each of them or in the container's header.

Closed captions belong to a time and not to a picture; see `fpsboost.media.captions`. All other types describe the
picture that carries them: how it is to be shown (active format, pan and scan, stereo mode, HDR), which number it has in
its source (timecodes), or how it was taken (user data of a camera). They are either true of the whole output, or lost,
which is said.
"""

import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from typing import Any, NamedTuple

import av.filter
from av import VideoFrame, VideoStream

from fpsboost.media.pixels import graph_of
from fpsboost.media.pyav import REFUSALS, trial_file

CAPTIONS = "A53_CC"
ICC_PROFILE = 15  # FFmpeg's number of the type
unnamed_types = {ICC_PROFILE: "ICC_PROFILE", 28: "LCEVC", 29: "VIEW_ID", 30: "THREE_D_REFERENCE_DISPLAYS", 31: "EXIF"}
"""Names of FFmpeg's types, by their numbers, that PyAV is not asked for: PyAV 18 has no name for those from 28 on."""

# numbers of the types that are looked for; FFmpeg 8 ends at 33
FIRST_UNNAMED = 28
LAST_TYPE = 40

DYNAMIC_HDR = "dynamic HDR metadata"
MASTERING = "HDR mastering data"
words = {
    CAPTIONS: "closed captions",
    "AFD": "active format",
    "AMBIENT_VIEWING_ENVIRONMENT": "ambient viewing environment",
    "CONTENT_LIGHT_LEVEL": MASTERING,
    "DETECTION_BBOXES": "detected objects",
    "DOVI_METADATA": DYNAMIC_HDR,
    "DOVI_RPU_BUFFER": DYNAMIC_HDR,
    "DYNAMIC_HDR_PLUS": DYNAMIC_HDR,
    "DYNAMIC_HDR_VIVID": DYNAMIC_HDR,
    "EXIF": "EXIF metadata",
    "FILM_GRAIN_PARAMS": "film grain parameters",
    "GOP_TIMECODE": "timecodes inside the pictures",
    "ICC_PROFILE": "ICC profile",
    "LCEVC": "enhancement layer (LCEVC)",
    "MASTERING_DISPLAY_METADATA": MASTERING,
    "PANSCAN": "pan and scan window",
    "S12M_TIMECODE": "timecodes inside the pictures",
    "SEI_UNREGISTERED": "user data of the camera or encoder",
    "SPHERICAL": "360-degree projection",
    "STEREO3D": "stereo mode",
    "VIEW_ID": "second view of the spatial video",
}
"""Words for side data in remarks, by its type; other types are always carried over, or are notes of a codec."""

_X264 = "dc45e9bde6d948b7962cd820d923eeef"
_X265 = "2ca2de09b51747dbbb55a4fe7fc2fc4e"
_APPLE = "47564adc5c4c433f94efc5113cd143a8"
encoder_notes = [bytes.fromhex(identifier) for identifier in (_X264, _X265, _APPLE)]
"""Identifiers of user data that describes the coding alone."""

stereo_modes = {1: ("left_right", "right_left"), 2: ("top_bottom", "bottom_top")}
stereo_modes |= {4: ("checkerboard_lr", "checkerboard_rl"), 6: ("row_interleaved_lr", "row_interleaved_rl")}
stereo_modes |= {7: ("col_interleaved_lr", "col_interleaved_rl")}
"""Matroska's names by FFmpeg's AVStereo3DType, with the left view first and with the right one."""

# of AVStereo3DType, AVSphericalProjection and ETSI TS 101 154
FLAT = 0
RECTILINEAR = 4
FULL_FRAME = 8
TIME_OF_GOP = 0xFFEFFF  # MPEG-2's timecode without its flag and its marker

base_layers = (4, 6, 7, 9)
"""Profiles of Dolby Vision whose base layer always is ordinary video; that of others is by their compatibility."""


class Crop(NamedTuple):
    """Margins of the pictures that are not shown, pixels."""

    left: int
    top: int
    right: int
    bottom: int


class HeaderData(NamedTuple):
    """Side data of a stream that its pictures lack: the crop, and Dolby Vision's profile and compatibility."""

    crop: Crop | None
    dolby_vision: tuple[int, int] | None


def side_data_of(picture: VideoFrame) -> list[tuple[str, bytes]]:
    """Return the side data of a picture, by the name of its type in FFmpeg: ``DISPLAYMATRIX``.

    PyAV 18 gives none if it has no name for a type (EXIF of JPEG); FFmpeg's filter takes those away, which are empty.
    So is the ICC profile of a PNG: its name belongs to FFmpeg, and PyAV would free it, too.
    """
    others: list[int] = []
    if not picture.format.name.startswith("yuv") and filtered(picture, ["mode=select:type=ICC_PROFILE"]) is not None:
        others = [ICC_PROFILE]
        picture = filtered(picture, ["mode=delete:type=ICC_PROFILE"]) or picture
    try:
        sides: Any = picture.side_data
    except ValueError:
        numbers = range(FIRST_UNNAMED, LAST_TYPE + 1)
        others += [number for number in numbers if filtered(picture, [f"mode=select:type={number}"])]
        named = filtered(picture, [f"mode=delete:type={number}" for number in others])
        sides = [] if named is None else named.side_data
    items: list[Any] = []
    with suppress(IndexError):  # iterating gives types in PyAV 19, one of each
        while True:
            items.append(sides[len(items)])
    unnamed = [(unnamed_types.get(number, f"UNKNOWN_{number}"), b"") for number in others]
    return [*((item.type.name, bytes(item)) for item in items), *unnamed]


def filtered(picture: VideoFrame, operations: Iterable[str]) -> VideoFrame | None:
    """Return a picture after operations of FFmpeg's filter of side data, without copying it; None if one stops it."""
    graph = graph_of(picture, *(("sidedata", operation) for operation in operations))
    graph.vpush(picture)
    with suppress(av.error.BlockingIOError):
        return graph.vpull()
    return None


def described(sides: Sequence[tuple[str, bytes]], width: int) -> dict[str, str]:
    """Return in words, by type, the side data of pictures of this width that re-encoding loses."""
    kinds = dict(sides)
    said: dict[str, str] = {}
    for kind, data in sides:
        number = int.from_bytes(data[:4], sys.byteorder)
        is_implied = {
            "STEREO3D": number == FLAT or "VIEW_ID" in kinds,
            "SPHERICAL": number == RECTILINEAR,
            "PANSCAN": int.from_bytes(data[4:8], sys.byteorder) in (0, 16 * width),  # the window's, in sixteenths
            "GOP_TIMECODE": not number & TIME_OF_GOP,
            "AFD": number & 15 == FULL_FRAME,
            "SEI_UNREGISTERED": data[:16] in encoder_notes,
        }
        if kind.startswith("UNKNOWN_"):
            said[kind] = f"side data of FFmpeg's type {kind.removeprefix('UNKNOWN_')}"
        elif kind in words and not is_implied.get(kind):
            said[kind] = words[kind]
    return said


def stereo_mode_of(sides: Mapping[str, bytes]) -> str:
    """Return Matroska's name of how a picture holds two views; empty if it does not, or there is no name."""
    kind, flags = struct.unpack_from("=2i", sides.get("STEREO3D", bytes(8)))
    return "" if "VIEW_ID" in sides or kind not in stereo_modes else stereo_modes[kind][flags & 1]


def read_header(stream: VideoStream) -> HeaderData:
    """Return a stream's side data that PyAV does not give, from the header that a muxer writes for it."""
    header = next(filter(None, (_header_of(stream, container) for container in ("mp4", "mov", "matroska"))), b"")
    crop = _crop_of_box(header, stream) or _crop_of_elements(header)
    context = stream.codec_context
    is_whole = not any(crop) or crop.left + crop.right >= context.width or crop.top + crop.bottom >= context.height
    boxes = [at for at in map(header.find, (b"dvcC", b"dvvC", b"dvwC")) if at >= 0]
    dolby_vision = (header[boxes[0] + 6] >> 1, header[boxes[0] + 8] >> 4) if boxes else None
    return HeaderData(None if is_whole else crop, dolby_vision)


def _header_of(stream: VideoStream, container: str) -> bytes:
    options = {"movflags": "frag_keyframe+empty_moov", "strict": "unofficial"}
    with trial_file() as path, suppress(*REFUSALS):
        with av.open(str(path), "w", format=container, container_options=options) as output:
            output.add_stream_from_template(stream, opaque=True)
            output.start_encoding()
        return path.read_bytes()
    return b""


def _crop_of_box(header: bytes, stream: VideoStream) -> Crop | None:
    """Parse QuickTime's clean aperture: fractions of its width, its height, and how far its centre is off."""
    at = header.find(b"\0\0\0\x28clap")
    if at < 0:
        return None
    numbers = struct.unpack_from(">8i", header, at + 8)
    width, height, right, down = (Fraction(*numbers[place : place + 2]) for place in (0, 2, 4, 6))
    left = (stream.codec_context.width - width) / 2
    top = (stream.codec_context.height - height) / 2
    return Crop(*(max(0, round(margin)) for margin in (left + right, top + down, left - right, top - down)))


def _crop_of_elements(header: bytes) -> Crop:
    """Parse Matroska's elements PixelCropLeft, -Top, -Right and -Bottom, two bytes each at most."""
    margins = []
    for element in (b"\x54\xcc", b"\x54\xbb", b"\x54\xdd", b"\x54\xaa"):
        after = header.partition(element)[2] if header.startswith(b"\x1a\x45\xdf\xa3") else b""
        size = after[0] - 0x80 if after else 0
        margins.append(int.from_bytes(after[1 : 1 + size], "big") if 0 < size <= 2 else 0)
    return Crop(*margins)


def is_ordinary(sides: Mapping[str, bytes], dolby_vision: tuple[int, int] | None) -> bool:
    """Return whether players without Dolby Vision show a stream's pictures in the right colours.

    Without a profile in the header it follows from the metadata of a picture, as in FFmpeg: the base layer of profile 5
    has full range.
    """
    if dolby_vision is not None:
        profile, compatibility = dolby_vision
        return compatibility != 0 or profile in base_layers
    data = sides.get("DOVI_METADATA", b"")
    header = int.from_bytes(data[:8], sys.byteorder)  # AVDOVIMetadata begins with its offset
    return len(data) < header + 11 or data[header + 4] != 0 or data[header + 10] != 1
