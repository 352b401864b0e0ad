"""What images carry beside their pixels: colour profile, resolution, EXIF and XMP, read and put into encoded images.

Frames that pass keep their file to the byte; what is here is for the frames made between them, so that a viewer shows
all of them in the same colours, size and orientation.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from fpsboost.errors import InputError, explained
from fpsboost.frame import Image
from fpsboost.io.images import png_chunks, tiff_tags, webp_chunks
from fpsboost.io.images.exact import DamagedError
from fpsboost.io.images.exr import read_exr_attributes
from fpsboost.io.images.kinds import stored_otherwise
from fpsboost.io.images.tiff_tags import Tag

MAX_PROFILE = 2**24
INCH = 0.0254  # metres
MAX_SEGMENT, MAX_FILE = 65533, 2**31  # bytes: of a JPEG, of what can be said at once elsewhere

_exif_mark, _xmp_mark, _profile_mark = b"Exif\0\0", b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0"
_colour_chunks = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")
_start_of_frame = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_webp_flags = {b"ICCP": webp_chunks.PROFILE, b"EXIF": 0x08, b"XMP ": 0x04}


@dataclass(frozen=True)
class ImageMetadata:
    """What a file says beside its pixels; everything may be absent.

    Attributes
    ----------
    profile : bytes
        ICC profile.
    dots_per_inch : (float, float) or None
        Across and down.
    exif : bytes
        With its own header, which is that of TIFF.
    xmp : bytes
    chunks : tuple of Chunk
        Of a PNG: other words on its colours, and its pixels' shape.
    attributes : tuple of (str, tuple of float)
        Of an OpenEXR file.
    """

    profile: bytes = b""
    dots_per_inch: tuple[float, float] | None = None
    exif: bytes = b""
    xmp: bytes = b""
    chunks: tuple[png_chunks.Chunk, ...] = ()
    attributes: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @property
    def orientation(self) -> int:
        """How the image must be turned to stand upright, EXIF's number; 1 where it does."""
        order, tags = tiff_tags.read_tags(self.exif)
        (number, *_) = tiff_tags.numbers_of(order, tags.get(tiff_tags.ORIENTATION)) or (1,)
        return number if 1 <= number <= 8 else 1

    def fits(self, channels: int) -> bool:
        """Whether the profile is one for images of so many channels."""
        return self.profile[16:20] == (b"GRAY" if channels <= 2 else b"RGB ")


def content_of(path: Path) -> bytes:
    """All bytes of an input, or `InputError`."""
    with explained(InputError, "read", path, "leave the input as it is until all is done"):
        return path.read_bytes()


def read_metadata(path: Path) -> ImageMetadata:
    """Read what an image that could be read says beside its pixels; what is damaged is passed over.

    Raises
    ------
    InputError
        The file cannot be read any more.
    """
    data = content_of(path)
    try:
        if data.startswith(png_chunks.SIGNATURE):
            return _of_png(data)
        if data[:2] == b"\xff\xd8":
            return _of_jpeg(data)
        if data[8:12] == b"WEBP":
            return _of_webp(data)
        if path.suffix.lower() == ".exr":
            return ImageMetadata(attributes=tuple(read_exr_attributes(path).items()))
    except DamagedError:
        return ImageMetadata()
    return _of_tiff(data)


def how_stored(data: bytes, channels: int) -> str:
    """Say how a file stores its pixels, where that is not how they are read; see `kinds.stored_otherwise`."""
    components = None
    if data[:2] == b"\xff\xd8":
        components = next(
            (body[5] for mark, body in _segments(data) if mark in _start_of_frame and len(body) > 5), None
        )
    return stored_otherwise(data, channels, components)


def can_pass(path: Path) -> bool:
    """Whether a file shows in every viewer what `read_image` made of it: upright, no colours for print.

    Raises
    ------
    InputError
        The file cannot be read any more.
    """
    data = content_of(path)
    if data[:2] == b"\xff\xd8":
        return all(body[5:6] in (b"\1", b"\3") for mark, body in _segments(data) if mark in _start_of_frame)
    order, tags = tiff_tags.read_tags(data)
    (turned, *_) = tiff_tags.numbers_of(order, tags.get(tiff_tags.ORIENTATION)) or (1,)
    (photometric, *_) = tiff_tags.numbers_of(order, tags.get(tiff_tags.PHOTOMETRIC)) or (2,)
    return turned == 1 and photometric <= 3


def upright(image: Image, orientation: int) -> Image:
    """Turn an image as EXIF's orientation, 1 to 8, says."""
    if orientation in (2, 4, 5, 7):
        image = image[:, ::-1]
    turns = {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)
    return np.ascontiguousarray(np.rot90(image, turns))


def with_metadata(extension: str, data: bytes, metadata: ImageMetadata, channels: int) -> bytes:
    """Put metadata into an image that was just encoded.

    Parameters
    ----------
    extension : str
        ``.png``, in small letters.
    data : bytes
        The content of the file.
    metadata : ImageMetadata
    channels : int
        Of the image.
    """
    profile = metadata.profile if metadata.fits(channels) else b""
    match extension:
        case ".png":
            return _into_png(data, metadata, profile)
        case ".jpg" | ".jpeg":
            return _into_jpeg(data, metadata, profile)
        case ".webp":
            return _into_webp(data, metadata, profile)
        case ".tif" | ".tiff":
            return _into_tiff(data, metadata, profile)
    return data


def lost_metadata(extension: str, metadata: ImageMetadata, channels: int) -> list[str]:
    """Name what `with_metadata` cannot put into a type of file."""
    holds_most = extension in (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff")
    room = MAX_SEGMENT - len(_xmp_mark) if extension in (".jpg", ".jpeg") else MAX_FILE
    wanted = {
        "colour profile": bool(metadata.profile) and not (holds_most and metadata.fits(channels)),
        "colour tags": any(chunk.name in _colour_chunks for chunk in metadata.chunks) and extension != ".png",
        "resolution": metadata.dots_per_inch is not None and extension in (".webp", ".bmp", ".exr"),
        "EXIF data": bool(metadata.exif)
        and (extension not in (".png", ".jpg", ".jpeg", ".webp") or len(metadata.exif) > room),
        "XMP data": bool(metadata.xmp) and (not holds_most or len(metadata.xmp) > room),
        "OpenEXR attributes": bool(metadata.attributes) and extension != ".exr",
    }
    return [name for name, is_lost in wanted.items() if is_lost]


def _of_png(data: bytes) -> ImageMetadata:
    chunks = {chunk.name: chunk for chunk in png_chunks.chunks_in(BytesIO(data), (b"IDAT",))}
    profile, density, others = b"", None, [chunks[name] for name in _colour_chunks if name in chunks]
    if b"iCCP" in chunks:
        _, _, rest = chunks[b"iCCP"].data.partition(b"\0")
        try:
            profile = zlib.decompressobj().decompress(rest[1:], MAX_PROFILE)
        except zlib.error:
            profile = b""
    if len(chunks.get(b"pHYs", png_chunks.Chunk(b"", b"")).data) == 9:
        across, down, unit = struct.unpack(">IIB", chunks[b"pHYs"].data)
        others.append(chunks[b"pHYs"])
        density = (across * INCH, down * INCH) if unit == 1 else None
    exif = chunks[b"eXIf"].data if b"eXIf" in chunks else b""
    xmp = b""
    if b"iTXt" in chunks and chunks[b"iTXt"].data.startswith(b"XML:com.adobe.xmp\0\0"):
        xmp = chunks[b"iTXt"].data.split(b"\0", 5)[-1]
    return ImageMetadata(profile, density, exif, xmp, tuple(others))


def _into_png(data: bytes, metadata: ImageMetadata, profile: bytes) -> bytes:
    added = [] if not profile else [png_chunks.Chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(profile))]
    added += metadata.chunks
    if metadata.dots_per_inch is not None and not any(chunk.name == b"pHYs" for chunk in metadata.chunks):
        added.append(
            png_chunks.Chunk(b"pHYs", struct.pack(">IIB", *(round(dots / INCH) for dots in metadata.dots_per_inch), 1))
        )
    added += [png_chunks.Chunk(b"eXIf", metadata.exif)] * bool(metadata.exif)
    added += [png_chunks.Chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + metadata.xmp)] * bool(metadata.xmp)
    behind_header = len(png_chunks.SIGNATURE) + 25
    return data[:behind_header] + b"".join(png_chunks.chunk_bytes(*chunk) for chunk in added) + data[behind_header:]


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The marks and contents of a JPEG up to its pixels."""
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != 0xDA:
        if data[place + 1] == 0xFF:
            place += 1
            continue
        length = int.from_bytes(data[place + 2 : place + 4])
        yield data[place + 1], data[place + 4 : place + 2 + length]
        place += 2 + max(2, length)


def _of_jpeg(data: bytes) -> ImageMetadata:
    exif, xmp, density, parts = b"", b"", None, {}
    for mark, body in _segments(data):
        if mark == 0xE0 and body.startswith(b"JFIF\0") and len(body) >= 12:
            unit, across, down = struct.unpack_from(">BHH", body, 7)
            scale = {1: 1.0, 2: 2.54}.get(unit)
            density = (across * scale, down * scale) if scale else None
        elif mark == 0xE1 and body.startswith(_exif_mark):
            exif = body[len(_exif_mark) :]
        elif mark == 0xE1 and body.startswith(_xmp_mark):
            xmp = body[len(_xmp_mark) :]
        elif mark == 0xE2 and body.startswith(_profile_mark) and len(body) > 14:
            parts[body[12]] = body[14:]
    profile = b"".join(parts[number] for number in sorted(parts))
    return ImageMetadata(profile, density, exif, xmp)


def _into_jpeg(data: bytes, metadata: ImageMetadata, profile: bytes) -> bytes:
    head, rest = bytearray(data[:20]), data[20:]  # OpenCV begins with the 18 bytes of JFIF
    if metadata.dots_per_inch is not None:
        struct.pack_into(">BHH", head, 13, 1, *(min(round(dots), 65535) for dots in metadata.dots_per_inch))
    segments = [(0xE1, _exif_mark + metadata.exif)] * bool(metadata.exif)
    segments += [(0xE1, _xmp_mark + metadata.xmp)] * bool(metadata.xmp)
    size = MAX_SEGMENT - len(_profile_mark) - 2
    parts = [profile[begin : begin + size] for begin in range(0, len(profile), size)]
    segments += [(0xE2, _profile_mark + bytes((k + 1, len(parts))) + part) for k, part in enumerate(parts)]
    for mark, body in segments:
        if len(body) <= MAX_SEGMENT:
            head += struct.pack(">BBH", 0xFF, mark, len(body) + 2) + body
    return bytes(head) + rest


def _of_webp(data: bytes) -> ImageMetadata:
    file = BytesIO(data)
    found = {name: file.read(size) for name, size in webp_chunks.chunks_in(file) if name in _webp_flags}
    exif = found.get(b"EXIF", b"").removeprefix(_exif_mark)
    return ImageMetadata(found.get(b"ICCP", b""), None, exif, found.get(b"XMP ", b""))


def _into_webp(data: bytes, metadata: ImageMetadata, profile: bytes) -> bytes:
    added = {b"ICCP": profile, b"EXIF": metadata.exif, b"XMP ": metadata.xmp}
    if not any(added.values()):
        return data
    file = BytesIO(data)
    chunks = {name: file.read(size) for name, size in webp_chunks.chunks_in(file)}
    (bits,) = struct.unpack_from("<I", chunks[b"VP8L"], 1)  # without loss, as it was encoded here
    width, height, has_alpha = bits & 0x3FFF, bits >> 14 & 0x3FFF, bits >> 28 & 1
    flags = webp_chunks.ALPHA * has_alpha + sum(_webp_flags[name] for name, content in added.items() if content)
    head = bytes((flags, 0, 0, 0)) + width.to_bytes(3, "little") + height.to_bytes(3, "little")
    in_order = [(b"VP8X", head), (b"ICCP", profile), (b"VP8L", chunks[b"VP8L"]), *list(added.items())[1:]]
    return webp_chunks.chunk_bytes(
        b"RIFF", b"WEBP" + b"".join(webp_chunks.chunk_bytes(*each) for each in in_order if each[1])
    )


def _of_tiff(data: bytes) -> ImageMetadata:
    order, tags = tiff_tags.read_tags(data)
    density = [tiff_tags.numbers_of(order, tags.get(number)) for number in (tiff_tags.ACROSS, tiff_tags.DOWN)]
    (unit, *_) = tiff_tags.numbers_of(order, tags.get(tiff_tags.RESOLUTION_UNIT)) or (tiff_tags.INCH,)
    scale = {tiff_tags.INCH: 1.0, tiff_tags.CENTIMETRE: 2.54}.get(unit)
    dots = None
    if scale and all(len(each) == 2 and each[1] for each in density):
        dots = (density[0][0] / density[0][1] * scale, density[1][0] / density[1][1] * scale)
    nothing = Tag(tiff_tags.BYTE, 0, b"")
    profile, xmp = (tags.get(number, nothing).data for number in (tiff_tags.PROFILE, tiff_tags.XMP))
    return ImageMetadata(profile, dots, xmp=xmp)


def _into_tiff(data: bytes, metadata: ImageMetadata, profile: bytes) -> bytes:
    added = {}
    if profile:
        added[tiff_tags.PROFILE] = Tag(tiff_tags.UNDEFINED, len(profile), profile)
    if metadata.xmp:
        added[tiff_tags.XMP] = Tag(tiff_tags.BYTE, len(metadata.xmp), metadata.xmp)
    if metadata.dots_per_inch is not None:
        for number, dots in zip((tiff_tags.ACROSS, tiff_tags.DOWN), metadata.dots_per_inch, strict=True):
            added[number] = Tag(tiff_tags.RATIONAL, 1, struct.pack("<II", round(dots * 1000), 1000))
        added[tiff_tags.RESOLUTION_UNIT] = Tag(tiff_tags.SHORT, 1, struct.pack("<H", tiff_tags.INCH))
    if metadata.orientation != 1:
        added[tiff_tags.ORIENTATION] = Tag(tiff_tags.SHORT, 1, struct.pack("<H", metadata.orientation))
    return tiff_tags.with_tags(data, added) if added else data
