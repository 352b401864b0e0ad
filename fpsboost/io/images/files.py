"""One image file, read: PNG, TIFF, JPEG, WebP, BMP, DPX, TGA, JPEG XL, HDR and OpenEXR; its pixels and metadata.

Pixels are kept as the files have them, 8 or 16 bit or float, gray or colour, with or without alpha, which OpenImageIO
would otherwise multiply colours by. An EXIF orientation is not applied, that of a TIFF is. A palette becomes colour,
gray with alpha BGRA. Alpha in OpenEXR is associated (colours are multiplied by it), which is how the package takes all
float images; values beyond black and white stay.

Metadata is for the frames made between others, so that a viewer shows all of them in the same colours, size and
orientation; frames that pass keep their file to the byte. OpenImageIO reads profile and resolution. EXIF and XMP go
along as they are stored, by Pillow: OpenImageIO would parse them and write what it knows of them, which loses makers'
notes and the words of other programs. It has no words for the colour chunks of PNG, which are copied as they are.
"""

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.errors import InputError, explained
from fpsboost.image import Image
from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.layers import read_picture
from fpsboost.io.images.library import damaged, opened, said_by_pillow
from fpsboost.memory import MemoryLimit

# What each format keeps exactly (JPEG and HDR: as far as their ways of storing go).
types_kept: dict[str, tuple[type[np.generic], ...]] = {
    ".png": (np.uint8, np.uint16),
    ".tif": (np.uint8, np.uint16, np.float32),
    ".tiff": (np.uint8, np.uint16, np.float32),
    ".jpg": (np.uint8,),
    ".jpeg": (np.uint8,),
    ".webp": (np.uint8,),
    ".bmp": (np.uint8,),
    ".exr": (np.float32,),
    ".dpx": (np.uint8, np.uint16),
    ".tga": (np.uint8,),
    ".jxl": (np.uint8, np.uint16),
    ".hdr": (np.float32,),
}
IMAGE_SUFFIXES = tuple(types_kept)
_types_with_alpha = (".png", ".tif", ".tiff", ".webp", ".exr", ".dpx", ".tga", ".jxl")

# values of TIFF's PhotometricInterpretation
WHITE_IS_0 = 0
PALETTE = 3
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
EXIF_MARK = b"Exif\0\0"
COLOUR_CHUNKS = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")
_xmp_packet = re.compile(
    rb"(<\?xpacket begin[^>]*>\s*)?<x:xmpmeta\b.*?</x:xmpmeta>(\s*<\?xpacket end[^>]*>)?", re.DOTALL
)
_other_colours = {"CMYK": "CMYK", "YCCK": "CMYK", "CIELAB": "CIELab", "YCbCr": "YCbCr"}
"""Colours that are converted to RGB as they are read, by OpenImageIO's names of them."""
_per_inch = {"in": 1.0, "inch": 1.0, "cm": 2.54}
_types_read = {"uint8": "uint8", "uint16": "uint16", "float": "float", "half": "float"}


def extension_of(name: str) -> str:
    """Return the ending of a file name in small letters, ``.png``."""
    return os.path.splitext(name)[1].lower()


def keeps_alpha(extension: str) -> bool:
    """Return whether a type of file, ``.png``, holds alpha."""
    return extension in _types_with_alpha


def content_of(path: Path, advice: str = "check that it exists and that you may read it") -> bytes:
    """Return all bytes of an input, or raise `InputError` with advice."""
    with explained(InputError, "read", path, advice):
        return path.read_bytes()


def read_image(path: Path, limit: MemoryLimit | None = None, *, upright: bool = False) -> Image:
    """Read one image as it is stored, (H, W, C) uint8, uint16 or float32.

    Parameters
    ----------
    path : Path
        File to read.
    limit : MemoryLimit, optional
        Limit that the size is checked against; by default the free memory.
    upright : bool
        Turn the image by its EXIF orientation; a TIFF is turned anyway.

    Returns
    -------
    NDArray
        Gray, BGR or BGRA; gray with alpha becomes BGRA.

    Raises
    ------
    InputError
        The file is damaged, too large, or has another type of pixels.
    """
    if extension_of(path.name) == ".exr":
        return read_picture(path, limit)
    with opened(path) as (file, spec):
        (limit or MemoryLimit()).check(path, spec.width, spec.height)
        # the fourth byte of a BMP is seldom meant as alpha
        channels = min(spec.nchannels, 3 if file.format_name() == "bmp" else spec.nchannels)
        kind = _types_read.get(str(spec.format))
        if kind is None or channels not in (1, 2, 3, 4):
            raise InputError(
                f"{path} has {channels} channels of {spec.format}; "
                "save it as gray or colour with 8 bits, 16 bits or 32-bit float."
            )
        stored = file.read_image(0, 0, 0, channels, kind)
        if stored is None or file.geterror():  # a JPEG that ends early has pixels, of which the last are gray
            raise damaged(path)
        photometric, orientation = tiff_tags(spec)
        if upright:
            orientation = spec.get_int_attribute("Orientation", 1)
    stored = with_red_and_blue_swapped(stored)
    image = stored[..., [0, 0, 0, 1]] if channels == 2 else stored
    if photometric == WHITE_IS_0 and image.dtype == np.uint16:  # the library turns 8 bits, but not 16
        image = np.uint16(0xFFFF) - image
    if orientation in (2, 4, 5, 7):  # as EXIF numbers them
        image = image[:, ::-1]
    return np.ascontiguousarray(np.rot90(image, {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)))


def tiff_tags(spec: Any) -> tuple[int | None, int]:
    """Return a TIFF's number of its colours and its orientation; None and 1 for other types of file."""
    photometric = spec.getattribute("tiff:PhotometricInterpretation")
    return photometric, 1 if photometric is None else spec.get_int_attribute("Orientation", 1)


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
        profile = spec.getattribute("ICCProfile")
        kind = file.format_name()
        scale = _per_inch.get(spec.get_string_attribute("ResolutionUnit"))
        across, down = (spec.get_float_attribute(name) for name in ("XResolution", "YResolution"))
        orientation = spec.get_int_attribute("Orientation", 1)
        is_turned = kind != "tiff" and 1 <= orientation <= 8  # a TIFF is turned as it is read
        colours = _other_colours.get(spec.get_string_attribute(f"{kind}:ColorSpace"), "")
        said = said_by_pillow(path)
        exif, xmp = (said.get(name, b"") for name in ("exif", "xmp"))
        if kind == "tiff":  # of which Pillow opens few with 16 bits or float
            packet = _xmp_packet.search(path.read_bytes())
            exif = b""
            xmp = b"" if packet is None else packet[0]
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
                if name in COLOUR_CHUNKS or (name == b"pHYs" and data[8:] == b"\0")
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
