"""One image file, read and encoded: PNG, TIFF, JPEG, WebP, BMP and OpenEXR, and what each of them can hold.

Pixels are kept as the files have them, 8 or 16 bit or float, gray or colour, with or without alpha. What describes
them is read in `metadata`; an EXIF orientation is not applied, that of a TIFF is. A palette becomes
colour, gray with alpha BGRA. Alpha in OpenEXR is associated (colours are multiplied by it), which is how the package
takes all float images; values beyond black and white stay.

Encoding was chosen by measuring 1080p frames: OpenCV's own PNG setting takes 60 to 130 ms, compression 3 two to four
times as long for files between 30 % smaller (smooth) and 7 % larger (grain); LZW with a predictor takes a third off an
8-bit TIFF in 60 ms; float TIFF stays uncompressed, because OpenCV 4 would choose a lossy compression by itself. Pillow
writes JPEG and WebP with what they say beside their pixels: a JPEG byte for byte as OpenCV does, which leaves XMP out
of JPEG and PNG, and refuses profiles that are odd or longer than a segment.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError, OutputError, explained
from fpsboost.frame import ClipInfo
from fpsboost.image import Image, describe, type_names
from fpsboost.io.images.exr import decode_channels, encode_exr
from fpsboost.io.images.exr_header import ExrHeader, parse_exr_header
from fpsboost.io.images.exr_layers import contents_of
from fpsboost.io.images.jpeg_segments import START_OF_SCAN, segments_in
from fpsboost.io.images.kinds import as_stored
from fpsboost.io.images.metadata import ImageMetadata, pillow_options, with_metadata
from fpsboost.io.images.sizes import declared_size
from fpsboost.io.memory_limit import MemoryLimit

IMAGE_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".webp", ".bmp", ".exr")

_jpeg = ("JPEG", {"quality": 95})
_webp = ("WEBP", {"lossless": True, "exact": True, "quality": 70})  # of the search for a small file
_pillow_types: dict[str, tuple[str, dict[str, Any]]] = {".jpg": _jpeg, ".jpeg": _jpeg, ".webp": _webp}

# What each format keeps exactly (JPEG: as far as a lossy format does).
_types_kept = {
    ".png": (np.uint8, np.uint16),
    ".tif": (np.uint8, np.uint16, np.float32),
    ".tiff": (np.uint8, np.uint16, np.float32),
    ".jpg": (np.uint8,),
    ".jpeg": (np.uint8,),
    ".webp": (np.uint8,),
    ".bmp": (np.uint8,),
    ".exr": (np.float32,),
}
_types_with_alpha = (".png", ".tif", ".tiff", ".webp", ".exr")
_largest_side = {".jpg": 65500, ".jpeg": 65500, ".webp": 16383}


def extension_of(name: str) -> str:
    """Return the ending of a file name in small letters, ``.png``."""
    return os.path.splitext(name)[1].lower()


def read_image(path: Path, limit: MemoryLimit | None = None) -> Image:
    """Read one image as it is stored.

    Parameters
    ----------
    path : Path
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Returns
    -------
    (H, W, C) uint8, uint16 or float32

    Raises
    ------
    InputError
        It cannot be read, is damaged or too large, or has another type of pixels.
    """
    return decode_image(path, content_of(path), limit)


def content_of(path: Path, advice: str = "check that it exists and that you may read it") -> bytes:
    """Return all bytes of an input, or raise `InputError` with advice."""
    with explained(InputError, "read", path, advice):
        return path.read_bytes()  # not cv2.imread, which knows no Unicode names on Windows and gives no reasons


def decode_image(path: Path, data: bytes, limit: MemoryLimit | None = None) -> Image:
    """Make an image of the content of a file; see `read_image`."""
    if extension_of(path.name) == ".exr":
        return _decode_exr_image(path, data, limit)
    size = declared_size(data)
    if size is not None:
        (limit or MemoryLimit()).check(path, *size)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None or _ends_early(data):
        raise InputError(f"{path} is damaged or no image; replace it.")
    if image.ndim == 2:
        image = image[:, :, np.newaxis]
    image = as_stored(data, image)
    if image.dtype not in type_names or image.shape[2] not in (1, 3, 4):
        raise InputError(
            f"{path} has {image.shape[2]} channels of {image.dtype}; "
            "save it as gray or colour with 8 bits, 16 bits or 32-bit float."
        )
    return image


def _decode_exr_image(path: Path, data: bytes, limit: MemoryLimit | None) -> Image:
    header = parse_exr_header(path, data)
    return picture_of(decode_channels(path, data, header, picture_channels(path, header), limit))


def picture_channels(path: Path, header: ExrHeader) -> list[str]:
    """Return the channels of the picture in an OpenEXR file, in the order B, G, R, A or Y, A.

    Raises
    ------
    InputError
        It holds no picture.
    """
    chosen = contents_of(header).picture
    if not chosen:
        raise InputError(
            f"{path} has no colours among its channels ({', '.join(header.channels)}); save R, G and B, or Y, in one "
            "layer."
        )
    return chosen


def picture_of(channels: Mapping[str, NDArray[Any]]) -> Image:
    """Return the channels of a picture as an image, (H, W, C) float32; gray with alpha becomes BGRA."""
    planes = [plane.astype(np.float32) for plane in channels.values()]
    if len(planes) == 2:
        planes = [planes[0]] * 3 + planes[1:]
    return np.stack(planes, axis=-1)


def needs_float(path: Path, data: bytes, image: Image) -> bool:
    """Return whether the 16 bits of OpenEXR's half would lose some of an image's precision.

    Parameters
    ----------
    path : Path
        Where the image was read from.
    data : bytes
        The content of the file.
    image : (H, W, C)
    """
    if extension_of(path.name) != ".exr":
        return image.dtype == np.float32
    header = parse_exr_header(path, data)
    return any(header.channels[name] != "half" for name in contents_of(header).picture)


def unread_channels(path: Path, data: bytes) -> list[str]:
    """Return the channels of a file that `read_image` leaves out: other layers, depth, motion."""
    if extension_of(path.name) != ".exr":
        return []
    header = parse_exr_header(path, data)
    chosen = contents_of(header).picture
    return [name for name in header.channels if name not in chosen]


def _ends_early(data: bytes) -> bool:
    """Look for the end of a JPEG behind the start of its scan: OpenCV 4 fills up what is missing with gray."""
    return any(mark == START_OF_SCAN and data.find(b"\xff\xd9", place) < 0 for mark, place, _ in segments_in(data))


def check_size(target: str, extension: str, info: ClipInfo) -> None:
    """Raise `OutputError` where images of this size are too large for their type of file.

    Parameters
    ----------
    target : str
        What to call the images in the message.
    extension : str
        ``.png``.
    info : ClipInfo
    """
    largest = _largest_side.get(extension)
    if largest is not None and max(info.height, info.width) > largest:
        raise OutputError(
            f"{target} cannot hold {info.width}x{info.height} pixels, {extension} ends at {largest}; use .png."
        )


def keeps_alpha(extension: str) -> bool:
    """Return whether a type of file, ``.png``, holds alpha."""
    return extension in _types_with_alpha


def check_format(path: Path, image: Image) -> None:
    """Raise `OutputError` where a type of file cannot hold the image's type or its alpha."""
    extension = path.suffix.lower()
    if image.dtype not in _types_kept[extension]:
        other = ".tif or .exr" if image.dtype == np.float32 else ".png or .tif"
        kind = type_names[image.dtype]
        raise OutputError(f"{path.name} cannot hold {kind} images; use {other}, as in shot_######{other[-4:]}.")
    if image.shape[2] == 4 and not keeps_alpha(extension):
        raise OutputError(f"{path.name} cannot hold alpha; use .png or .tif, as in shot_######.png.")


def losses(path: Path, image: Image) -> list[str]:
    """Say what encoding an image loses although `check_format` lets it pass.

    Parameters
    ----------
    path : Path
        Its suffix is the type of file.
    image : (H, W, C)

    Returns
    -------
    list of str
        Sentences for the user.
    """
    if path.suffix.lower() == ".webp" and image.shape[2] == 1:
        return ["WebP has no gray: gray images were written as colour with three equal channels."]
    return []


def encode_image(path: Path, image: Image, *, half: bool = True, metadata: ImageMetadata | None = None) -> bytes:
    """Turn an image into the content of a file.

    Parameters
    ----------
    path : Path
        Its suffix is the type of file; nothing is written there.
    image : (H, W, C)
        Of a type that `check_format` lets pass.
    half : bool
        Write OpenEXR with 16 bits a number instead of 32.
    metadata : ImageMetadata, optional
        What else the file is to say, as far as its type can.

    Raises
    ------
    OutputError
        OpenCV or Pillow refuses.
    """
    extension, metadata = path.suffix.lower(), metadata or ImageMetadata()
    if extension == ".exr":
        names = {1: "Y", 2: "YA", 3: "BGR", 4: "BGRA"}[image.shape[2]]
        return encode_exr(
            {name: image[..., i] for i, name in enumerate(names)}, half=half, attributes=metadata.attributes
        )
    try:
        if extension in _pillow_types:
            return _encode_by_pillow(extension, image, metadata)
        done, data = cv2.imencode(extension, image, _options(extension, image))
    except (cv2.error, LookupError, OSError, ValueError):
        done = False
    if not done:
        raise OutputError(f"{path} cannot be encoded ({describe(image)}); try .png or .tif.")
    return with_metadata(extension, data.tobytes(), metadata, image.shape[2])


def _encode_by_pillow(extension: str, image: Image, metadata: ImageMetadata) -> bytes:
    """Encode a JPEG or a WebP with its metadata."""
    from PIL import Image as Pictures  # noqa: PLC0415  # only who writes such files waits for it

    height, width, channels = image.shape
    mode, stored = {1: ("L", "L"), 3: ("RGB", "BGR"), 4: ("RGBA", "BGRA")}[channels]
    picture = Pictures.frombuffer(mode, (width, height), np.ascontiguousarray(image), "raw", stored, 0, 1)
    kind, options = _pillow_types[extension]
    file = BytesIO()
    picture.save(file, kind, **options, **pillow_options(extension, metadata, channels))
    return file.getvalue()


def _options(extension: str, image: Image) -> list[int]:
    """Return options of OpenCV for one image; see the module's text for why."""
    if extension in (".tif", ".tiff"):
        if image.dtype == np.float32:
            return [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_NONE]
        lzw, horizontal = cv2.IMWRITE_TIFF_COMPRESSION_LZW, cv2.IMWRITE_TIFF_PREDICTOR_HORIZONTAL
        return [cv2.IMWRITE_TIFF_COMPRESSION, lzw, cv2.IMWRITE_TIFF_PREDICTOR, horizontal]
    return []
