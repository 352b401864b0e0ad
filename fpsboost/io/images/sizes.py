"""The size that an image file promises, from its first bytes and without decoding.

Pillow knows these sizes too, but takes memory for two canvases to open a WebP, and refuses or warns of sizes that are
fine here.
"""

from __future__ import annotations

import struct

from fpsboost.io.images import tiff_tags
from fpsboost.io.images.jpeg_segments import frame_header

Size = tuple[int, int]


def declared_size(data: bytes) -> Size | None:
    """Read what a PNG, JPEG, WebP, GIF, BMP or TIFF file says of its size.

    Parameters
    ----------
    data : bytes
        The whole file; of PNG, GIF and animated WebP, its beginning is enough.

    Returns
    -------
    (width, height) or None
        None where the file is another, or ends before it says so.
    """
    try:
        if data.startswith(b"\x89PNG"):
            width, height = struct.unpack_from(">2I", data, 16)
        elif data.startswith(b"GIF8"):
            width, height = struct.unpack_from("<2H", data, 6)
        elif data.startswith(b"BM"):  # that of OS/2 has 16 bits; below 0: upside down
            width, height = map(abs, struct.unpack_from("<2H" if data[14] == 12 else "<2i", data, 18))
        elif data.startswith(b"\xff\xd8"):
            height, width = struct.unpack_from(">2H", frame_header(data), 1)
        elif data.startswith(b"RIFF"):
            return _webp(data)
        else:
            return tiff_tags.size_of(data)
    except (struct.error, IndexError):
        return None
    return width, height


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<2H", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
