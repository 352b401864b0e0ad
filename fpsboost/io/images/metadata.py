"""Metadata of images: colour profile, resolution, EXIF and XMP, read and put into encoded images.

Frames that pass keep their file to the byte; what is here is for the frames made between them, so that a viewer shows
all of them in the same colours, size and orientation. OpenImageIO reads profile and resolution. EXIF and XMP go along
as they are stored, by Pillow: OpenImageIO would parse them and write what it knows of them, which loses makers' notes
and the words of other programs. It has no words for the colour chunks of PNG, which are copied here.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import PALETTE, extension_of, tiff_tags
from fpsboost.io.images.library import opened, said_by_pillow

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
INCH = 0.0254  # metres
MAX_SEGMENT, MAX_FILE = 65533, 2**31  # maximum size of EXIF or XMP, bytes: in a JPEG, elsewhere
EXIF_MARK = b"Exif\0\0"
_xmp_mark = b"http://ns.adobe.com/xap/1.0/\0"
_colour_chunks = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")
_xmp_packet = re.compile(
    rb"(<\?xpacket begin[^>]*>\s*)?<x:xmpmeta\b.*?</x:xmpmeta>(\s*<\?xpacket end[^>]*>)?", re.DOTALL
)
_other_colours = {"CMYK": "CMYK", "YCCK": "CMYK", "CIELAB": "CIELab", "YCbCr": "YCbCr"}
"""Colours that are converted to RGB as they are read, by OpenImageIO's names of them."""
_per_inch = {"in": 1.0, "inch": 1.0, "cm": 2.54}


@dataclass(frozen=True)
class ImageMetadata:
    """Metadata of an image file; everything may be absent.

    Parameters
    ----------
    profile : bytes
        ICC profile.
    dots_per_inch : tuple of float, optional
        Resolution across and down.
    exif : bytes
        EXIF data, from its TIFF header on.
    xmp : bytes
        XMP packet.
    orientation : int
        EXIF's number of the orientation; 1 for upright.
    chunks : tuple
        Names and contents of a PNG's chunks about colours and pixel shape.
    bits : int
        Bits per value of a DPX; 0 for other types.
    has_exr_attributes : bool
        Whether an OpenEXR file has attributes about its colours or pixel shape.
    other_colours : str
        ``CMYK``, ``CIELab`` or ``YCbCr``, which are converted to RGB; empty for gray, RGB and palettes.
    can_pass : bool
        Whether every viewer shows the file like the image of `read_image`: no turned TIFF, no colours for print.
    has_more : bool
        Whether the file holds pages or frames beside the first.
    """

    profile: bytes = b""
    dots_per_inch: tuple[float, float] | None = None
    exif: bytes = b""
    xmp: bytes = b""
    orientation: int = 1
    chunks: tuple[tuple[bytes, bytes], ...] = ()
    bits: int = 0
    has_exr_attributes: bool = False
    other_colours: str = ""
    can_pass: bool = True
    has_more: bool = False

    def profile_for(self, channels: int) -> bytes:
        """Return the ICC profile if it is of gray or RGB as the number of channels is; otherwise empty."""
        return self.profile if self.profile[16:20] == (b"GRAY" if channels <= 2 else b"RGB ") else b""


def metadata_of(path: Path) -> ImageMetadata:
    """Read the metadata of a readable image; ignore damaged metadata."""
    if extension_of(path.name) == ".exr":
        return ImageMetadata(has_exr_attributes=read_exr_header(path).describes_colours)
    with opened(path) as (file, spec):
        profile, kind = spec.getattribute("ICCProfile"), file.format_name()
        scale = _per_inch.get(spec.get_string_attribute("ResolutionUnit"))
        across, down = (spec.get_float_attribute(name) for name in ("XResolution", "YResolution"))
        orientation = spec.get_int_attribute("Orientation", 1)
        is_turned = kind != "tiff" and 1 <= orientation <= 8  # a TIFF is turned as it is read
        colours = _other_colours.get(spec.get_string_attribute(f"{kind}:ColorSpace"), "")
        said = said_by_pillow(path)
        exif, xmp = (said.get(name, b"") for name in ("exif", "xmp"))
        if kind == "tiff":  # of which Pillow opens few with 16 bits or float
            packet = _xmp_packet.search(path.read_bytes())
            exif, xmp = b"", b"" if packet is None else packet[0]
        photometric, turned = tiff_tags(spec)
        return ImageMetadata(
            b"" if profile is None else bytes(profile),
            (across * scale, down * scale) if scale and across > 0 and down > 0 else None,
            exif.removeprefix(EXIF_MARK),
            xmp.encode() if isinstance(xmp, str) else xmp,
            orientation if is_turned else 1,
            tuple(  # the shape of pixels only where no size is told with it
                (name, data)
                for name, data in png_chunks(path)
                if name in _colour_chunks or (name == b"pHYs" and data[8:] == b"\0")
            ),
            spec.get_int_attribute("oiio:BitsPerSample") if kind == "dpx" else 0,
            other_colours=colours,
            can_pass=turned == 1 and colours != "CMYK" and (photometric is None or photometric <= PALETTE),
            has_more=bool(file.seek_subimage(1, 0)) or (kind == "png" and "loop" in said),
        )


def png_chunks(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yield name and content of a PNG's chunks before its pixels; none where it is another file."""
    with path.open("rb") as file:
        is_png = file.read(len(PNG_SIGNATURE)) == PNG_SIGNATURE
        while is_png and len(head := file.read(8)) == 8:
            size, name = struct.unpack(">I4s", head)
            if name == b"IDAT":
                return
            yield name, file.read(size)
            file.seek(4, 1)


def lost_metadata(extension: str, metadata: ImageMetadata, channels: int) -> list[str]:
    """Return the names of metadata that a type of file, such as ``.png``, cannot hold."""
    holds_words = extension in (".png", ".jpg", ".jpeg", ".webp")
    holds_most = holds_words or extension in (".tif", ".tiff")
    room = _room_in(extension) if holds_words else 0
    wanted = {
        "colour profile": bool(metadata.profile) and not (holds_most and metadata.profile_for(channels)),
        "colour tags": any(name in _colour_chunks for name, _ in metadata.chunks) and extension != ".png",
        "resolution": metadata.dots_per_inch is not None and (extension == ".webp" or not holds_most),
        "EXIF data": len(metadata.exif) > room,
        "XMP data": len(metadata.xmp) > room,
        "OpenEXR attributes": metadata.has_exr_attributes and extension != ".exr",
    }
    return [name for name, is_lost in wanted.items() if is_lost]


def pillow_options(extension: str, metadata: ImageMetadata, channels: int) -> dict[str, Any]:
    """Return the options by which Pillow puts metadata into a JPEG or a WebP, as far as they hold it."""
    room = _room_in(extension)
    return {
        "icc_profile": metadata.profile_for(channels),
        "exif": EXIF_MARK + metadata.exif if 0 < len(metadata.exif) <= room else b"",
        "xmp": metadata.xmp if len(metadata.xmp) <= room else b"",
        "dpi": tuple(min(round(dots), 65535) for dots in metadata.dots_per_inch or (0, 0)),  # 0 where none is known
    }


def _room_in(extension: str) -> int:
    """Return the maximum size of EXIF or XMP in a type of file, bytes."""
    return MAX_SEGMENT - len(_xmp_mark) if extension in (".jpg", ".jpeg") else MAX_FILE


def into_png(data: bytes, metadata: ImageMetadata, channels: int) -> bytes:
    """Put metadata into a PNG that OpenCV has encoded, behind its header."""
    profile = metadata.profile_for(channels)
    dots = metadata.dots_per_inch
    bodies = {  # by the names of chunks, empty for those that are not written
        b"iCCP": b"ICC profile\0\0" + zlib.compress(profile) if profile else b"",
        b"pHYs": b"" if dots is None else struct.pack(">IIB", *(round(each / INCH) for each in dots), 1),
        **dict(metadata.chunks),
        b"eXIf": metadata.exif,
        b"iTXt": b"XML:com.adobe.xmp\0\0\0\0\0" + metadata.xmp if metadata.xmp else b"",
    }
    chunks = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in bodies.items()
        if body
    )
    behind_header = len(PNG_SIGNATURE) + 25
    return data[:behind_header] + chunks + data[behind_header:]
