"""What an image file holds that its pixels, as they are read, do not: a palette, colours for print, more pictures."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.io.images import png_chunks, tiff_tags, webp_chunks
from fpsboost.io.images.exact_reads import DamagedError
from fpsboost.io.images.jpeg_segments import components_of

GRAY_PNG, RGB_PNG, PALETTE_PNG, GRAY_AND_ALPHA_PNG = 0, 2, 3, 4
"""Colour types of PNG."""

PLACE_OF_DEPTH, PLACE_OF_COLOUR_TYPE = 24, 25
"""In a PNG, whose header comes first."""

UNASSOCIATED = 2
"""What a TIFF says of alpha that its colours are not multiplied by."""

WHITE_IS_0, CMYK = 0, 5
"""TIFF's numbers of colours."""

_tiff_colours = {
    WHITE_IS_0: "with white as 0",
    3: "with a palette",
    CMYK: "as CMYK",
    6: "as YCbCr",
    8: "as CIELab",
    9: "as ICCLab",
    10: "as ITULab",
}
"""By TIFF's number of its colours; gray (1) and RGB (2) are read as they are."""


def stored_otherwise(data: bytes, channels: int) -> str:
    """Say how a file stores its pixels, where that is not how they are read.

    Parameters
    ----------
    data : bytes
        A whole file that could be read.
    channels : int
        That were read from it.

    Returns
    -------
    str
        ``with a palette``, ``as CMYK``; empty where nothing changes.
    """
    if data.startswith(png_chunks.SIGNATURE):
        return _of_png(data)
    if data.startswith(b"BM"):
        return _of_bmp(data, channels)
    if components_of(data) == 4:
        return "as CMYK"
    return _of_tiff(tiff_tags.read_tags(data))


def holds_more_pictures(data: bytes) -> bool:
    """Return whether a file holds several pictures: pages of a TIFF, frames of an animation. The first is read."""
    try:
        if data.startswith(png_chunks.SIGNATURE):
            return any(chunk.name == b"acTL" for chunk in png_chunks.chunks_in(BytesIO(data), (b"IDAT", b"fdAT")))
        if data[8:12] == b"WEBP":
            return any(name == b"ANIM" for name, _ in webp_chunks.chunks_in(BytesIO(data)))
    except DamagedError:
        return False
    return bool(tiff_tags.read_tags(data).get(tiff_tags.MORE_PAGES))


def as_stored(data: bytes, image: NDArray[Any]) -> NDArray[Any]:
    """Undo OpenCV's changes to unusual TIFFs, so that new frames match the stored ones.

    It turns 8 bits whose white is 0, but not 16; gives CMYK an alpha; and multiplies 8 bits of colour by their alpha.

    Parameters
    ----------
    data : bytes
        The whole file.
    image : (H, W, C)
        As OpenCV read it.

    Returns
    -------
    (H, W, C)
    """
    tags = tiff_tags.read_tags(data)
    colours = tiff_tags.number_of(tags, tiff_tags.PHOTOMETRIC)
    if colours == WHITE_IS_0 and image.dtype == np.uint16:
        return np.uint16(0xFFFF) - image
    if image.dtype != np.uint8 or image.shape[2] != 4:
        return image
    if colours == CMYK:
        return np.ascontiguousarray(image[..., :3])
    if tiff_tags.number_of(tags, tiff_tags.EXTRA_SAMPLES) == UNASSOCIATED:
        alpha = image[..., 3:].astype(np.uint32)
        apart = (image[..., :3] * np.uint32(255) + alpha // 2) // np.maximum(alpha, 1)
        return np.concatenate([apart.clip(0, 255).astype(np.uint8), image[..., 3:]], axis=-1)
    return image


def _of_png(data: bytes) -> str:
    depth, colour = data[PLACE_OF_DEPTH], data[PLACE_OF_COLOUR_TYPE]
    if colour == PALETTE_PNG:
        return "with a palette"
    if colour == GRAY_AND_ALPHA_PNG:
        return "as gray with alpha"
    if depth < 8:
        return f"with {depth} bit{'s' if depth > 1 else ''} a pixel"
    try:
        chunks = png_chunks.chunks_in(BytesIO(data), (b"IDAT",))
        is_keyed = colour in (GRAY_PNG, RGB_PNG) and any(chunk.name == b"tRNS" for chunk in chunks)
    except DamagedError:
        is_keyed = False
    return "with one transparent colour" if is_keyed else ""


def _of_bmp(data: bytes, channels: int) -> str:
    is_of_os2 = data[14:15] == b"\x0c"
    (depth,) = struct.unpack_from("<H", data, 24 if is_of_os2 else 28)
    if depth <= 8:
        is_gray = depth == 8 and channels == 1  # which BMP knows as a palette only
        return "" if is_gray else "with a palette"
    return f"with {depth} bits a pixel" if depth == 16 else ""


def _of_tiff(tags: Mapping[int, Any]) -> str:
    colours, depth, samples = (
        tiff_tags.number_of(tags, tag) for tag in (tiff_tags.PHOTOMETRIC, tiff_tags.BITS, tiff_tags.SAMPLES)
    )
    if tags and depth is None:
        depth = 1  # as the format has it
    if colours in _tiff_colours:
        return _tiff_colours[colours]
    if samples == 2:
        return "as gray with alpha"
    if depth is not None and depth < 8:
        return f"with {depth} bit{'s' if depth > 1 else ''} a pixel"
    return ""
