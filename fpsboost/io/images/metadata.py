"""What images carry beside their pixels: colour profile, resolution, EXIF and XMP, read and put into encoded images.

Frames that pass keep their file to the byte; what is here is for the frames made between them, so that a viewer shows
all of them in the same colours, size and orientation.
"""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.image import Image
from fpsboost.io.images import tiff_tags, webp_chunks
from fpsboost.io.images.exact_reads import DamagedError
from fpsboost.io.images.exr_header import MAGIC, parse_exr_header
from fpsboost.io.images.jpeg_segments import components_of, segments_in
from fpsboost.io.images.png_chunks import SIGNATURE, Chunk, chunk_bytes, chunks_in
from fpsboost.io.images.tiff_tags import Tag

MAX_PROFILE = 2**24  # bytes of what a file holds compressed
INCH = 0.0254  # metres
MAX_SEGMENT, MAX_FILE = 65533, 2**31  # bytes: of a JPEG, of what can be said at once elsewhere

EXIF_MARK = b"Exif\0\0"
_xmp_mark, _profile_mark = b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0"
_colour_chunks = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")


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
    chunks: tuple[Chunk, ...] = ()
    attributes: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @property
    def orientation(self) -> int:
        """How the image must be turned to stand upright, EXIF's number; 1 where it does."""
        number = tiff_tags.number_of(tiff_tags.read_tags(self.exif), tiff_tags.ORIENTATION)
        return number if number is not None and 1 <= number <= 8 else 1

    def fits(self, channels: int) -> bool:
        """Return whether the profile is one for images of so many channels."""
        return self.profile[16:20] == (b"GRAY" if channels <= 2 else b"RGB ")


def metadata_of(path: Path, data: bytes) -> ImageMetadata:
    """Read the metadata of a readable image; ignore damaged metadata.

    Parameters
    ----------
    path : Path
        For messages.
    data : bytes
        The content of the file.
    """
    try:
        if data.startswith(SIGNATURE):
            return _of_png(data)
        if data.startswith(b"\xff\xd8"):
            return _of_jpeg(data)
        if data[8:12] == b"WEBP":
            return _of_webp(data)
        if data.startswith(MAGIC):
            return ImageMetadata(attributes=tuple(parse_exr_header(path, data).attributes.items()))
    except DamagedError:
        return ImageMetadata()
    return _of_tiff(data)


def can_pass(data: bytes) -> bool:
    """Return whether every viewer shows of a file what `decode_image` made of it: upright, no colours for print."""
    if data.startswith(b"\xff\xd8"):
        return components_of(data) in (1, 3)
    tags = tiff_tags.read_tags(data)
    turned, colours = (tiff_tags.number_of(tags, tag) for tag in (tiff_tags.ORIENTATION, tiff_tags.PHOTOMETRIC))
    return turned in (None, 1) and (colours is None or colours <= 3)


def upright(image: Image, orientation: int) -> Image:
    """Turn an image as EXIF's orientation, 1 to 8, says."""
    if orientation in (2, 4, 5, 7):
        image = image[:, ::-1]
    turns = {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)
    return np.ascontiguousarray(np.rot90(image, turns))


def with_metadata(extension: str, data: bytes, metadata: ImageMetadata, channels: int) -> bytes:
    """Put metadata into an image that was just encoded, PNG or TIFF; see `pillow_options` for JPEG and WebP.

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
        case ".tif" | ".tiff":
            return _into_tiff(data, metadata, profile)
    return data


def pillow_options(extension: str, metadata: ImageMetadata, channels: int) -> dict[str, Any]:
    """Name the options by which Pillow puts metadata into a JPEG or a WebP; those of `with_metadata`."""
    options: dict[str, Any] = {"icc_profile": metadata.profile if metadata.fits(channels) else b""}
    room = _room_in(extension)
    if metadata.exif and len(metadata.exif) <= room:
        options["exif"] = EXIF_MARK + metadata.exif
    if metadata.xmp and len(metadata.xmp) <= room:
        options["xmp"] = metadata.xmp
    if metadata.dots_per_inch is not None:
        options["dpi"] = tuple(min(round(dots), 65535) for dots in metadata.dots_per_inch)
    return options


def lost_metadata(extension: str, metadata: ImageMetadata, channels: int) -> list[str]:
    """Name what `with_metadata` cannot put into a type of file."""
    holds_most = extension in (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff")
    room = _room_in(extension)
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


def _room_in(extension: str) -> int:
    return MAX_SEGMENT - len(_xmp_mark) if extension in (".jpg", ".jpeg") else MAX_FILE


def _of_png(data: bytes) -> ImageMetadata:
    listed = list(chunks_in(BytesIO(data), (b"IDAT",)))
    chunks = {chunk.name: chunk.data for chunk in listed}
    profile, density, exif = b"", None, chunks.get(b"eXIf", b"")
    xmp = next(filter(None, (_xmp_in(chunk.data) for chunk in listed if chunk.name == b"iTXt")), b"")
    with suppress(zlib.error):
        compressed = chunks.get(b"iCCP", b"").partition(b"\0")[2][1:]
        profile = zlib.decompressobj().decompress(compressed, MAX_PROFILE)
    if len(chunks.get(b"pHYs", b"")) == 9:
        across, down, unit = struct.unpack(">IIB", chunks[b"pHYs"])
        density = (across * INCH, down * INCH) if unit == 1 else None
    else:
        chunks.pop(b"pHYs", None)
    kept = (Chunk(name, chunks[name]) for name in (*_colour_chunks, b"pHYs") if name in chunks)
    return ImageMetadata(profile, density, exif, xmp, tuple(kept))


def _xmp_in(text_chunk: bytes) -> bytes:
    """Return the XMP data of a PNG's iTXt chunk, which may be compressed; empty for another text."""
    keyword, _, rest = text_chunk.partition(b"\0")
    if keyword != b"XML:com.adobe.xmp" or len(rest) < 2:
        return b""
    text = rest[2:].partition(b"\0")[2].partition(b"\0")[2]  # behind language and translated keyword
    if not rest[0]:
        return text
    with suppress(zlib.error):
        return zlib.decompressobj().decompress(text, MAX_PROFILE)
    return b""


def _into_png(data: bytes, metadata: ImageMetadata, profile: bytes) -> bytes:
    added = {b"iCCP": b"ICC profile\0\0" + zlib.compress(profile)} if profile else {}
    if metadata.dots_per_inch is not None:
        added[b"pHYs"] = struct.pack(">IIB", *(round(dots / INCH) for dots in metadata.dots_per_inch), 1)
    added |= dict(metadata.chunks)
    added |= {b"eXIf": metadata.exif} if metadata.exif else {}
    added |= {b"iTXt": b"XML:com.adobe.xmp\0\0\0\0\0" + metadata.xmp} if metadata.xmp else {}
    behind_header = len(SIGNATURE) + 25
    return data[:behind_header] + b"".join(chunk_bytes(*each) for each in added.items()) + data[behind_header:]


def _of_jpeg(data: bytes) -> ImageMetadata:
    exif, xmp, density, parts = b"", b"", None, {}
    for mark, _, body in segments_in(data):
        if mark == 0xE0 and body.startswith(b"JFIF\0") and len(body) >= 12:
            unit, across, down = struct.unpack_from(">BHH", body, 7)
            scale = {1: 1.0, 2: 2.54}.get(unit)
            density = (across * scale, down * scale) if scale else None
        elif mark == 0xE1 and body.startswith(EXIF_MARK):
            exif = body[len(EXIF_MARK) :]
        elif mark == 0xE1 and body.startswith(_xmp_mark):
            xmp = body[len(_xmp_mark) :]
        elif mark == 0xE2 and body.startswith(_profile_mark) and len(body) > 14:
            parts[body[12]] = body[14:]
    profile = b"".join(parts[number] for number in sorted(parts))
    return ImageMetadata(profile, density, exif, xmp)


def _of_webp(data: bytes) -> ImageMetadata:
    file = BytesIO(data)
    found = {name: file.read(size) for name, size in webp_chunks.chunks_in(file) if name in (b"ICCP", b"EXIF", b"XMP ")}
    exif = found.get(b"EXIF", b"").removeprefix(EXIF_MARK)
    return ImageMetadata(found.get(b"ICCP", b""), None, exif, found.get(b"XMP ", b""))


def _of_tiff(data: bytes) -> ImageMetadata:
    tags = tiff_tags.read_tags(data)
    density: list[Any] = [tags.get(number) for number in (tiff_tags.ACROSS, tiff_tags.DOWN)]
    unit = tiff_tags.number_of(tags, tiff_tags.RESOLUTION_UNIT)
    scale = {None: 1.0, tiff_tags.INCH: 1.0, tiff_tags.CENTIMETRE: 2.54}.get(unit)
    dots = None
    if scale and all(isinstance(each, tuple) and len(each) == 2 and each[1] for each in density):
        dots = (density[0][0] / density[0][1] * scale, density[1][0] / density[1][1] * scale)
    profile, xmp = (tiff_tags.bytes_of(tags, number) for number in (tiff_tags.PROFILE, tiff_tags.XMP))
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
