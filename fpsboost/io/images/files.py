"""One image file, read: PNG, TIFF, JPEG, WebP, BMP, DPX, TGA, JPEG XL, HDR and OpenEXR, and what each can hold.

Pixels are kept as the files have them, 8 or 16 bit or float, gray or colour, with or without alpha, which OpenImageIO
would otherwise multiply colours by. What describes them is read in `metadata`; an EXIF orientation is not applied, that
of a TIFF is. A palette becomes colour, gray with alpha BGRA. Alpha in OpenEXR is associated (colours are multiplied by
it), which is how the package takes all float images; values beyond black and white stay.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError, explained
from fpsboost.image import Image
from fpsboost.io.images.layers import read_picture
from fpsboost.io.images.library import damaged, opened
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

WHITE_IS_0, PALETTE = 0, 3  # values of TIFF's PhotometricInterpretation
_types_read = {"uint8": "uint8", "uint16": "uint16", "float": "float", "half": "float"}
_orders = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}


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
        is_bmp = file.format_name() == "bmp"  # whose fourth byte is seldom meant as alpha
        channels = min(spec.nchannels, 3) if is_bmp else spec.nchannels
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
    image: NDArray[Any] = stored[..., [0, 0, 0, 1]] if channels == 2 else stored
    if channels > 2:
        image = cv2.cvtColor(image, _orders[channels])
    if photometric == WHITE_IS_0 and image.dtype == np.uint16:  # the library turns 8 bits, but not 16
        image = np.uint16(0xFFFF) - image
    if orientation in (2, 4, 5, 7):  # as EXIF numbers them
        image = image[:, ::-1]
    turns = {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)
    return np.ascontiguousarray(np.rot90(image, turns))


def tiff_tags(spec: Any) -> tuple[int | None, int]:
    """Return a TIFF's number of its colours and its orientation; None and 1 for other types of file."""
    photometric = spec.getattribute("tiff:PhotometricInterpretation")
    return photometric, 1 if photometric is None else spec.get_int_attribute("Orientation", 1)
