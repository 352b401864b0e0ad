"""OpenEXR files of any kind that the library can write, to test what reads them."""

from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from fpsboost.io.images.exr import encode_exr, read_channels, read_exr_header

Corners = tuple[NDArray[np.int32], NDArray[np.int32]]


def save_exr(path: Path, *parts: tuple[str, dict[str, NDArray]], **header: object) -> Path:
    """Write a file; of one part if that has no name."""
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    copies = [(name, {each: plane.copy() for each, plane in channels.items()}) for name, channels in parts]
    whole = [OpenEXR.Part(dict(kind), channels, name) for name, channels in copies]
    with OpenEXR.File(whole) if parts[0][0] else OpenEXR.File(kind, copies[0][1]) as file:
        file.write(str(path))
    return path


def tiles(side: int) -> dict[str, object]:
    """Say that a file has square tiles."""
    description = OpenEXR.TileDescription()
    description.xSize = description.ySize = side
    return {"type": OpenEXR.tiledimage, "tiles": description}


def window(left: int, top: int, width: int, height: int) -> Corners:
    """Two corners, as the library takes them."""
    return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)


def write_exr(path: Path, channels: dict[str, NDArray], *, half: bool = True) -> None:
    """Write planes by names as the package writes them."""
    path.write_bytes(encode_exr(channels, half=half))


def content(path: Path) -> dict[str, NDArray]:
    """Read all channels, in the types that the file has."""
    header = read_exr_header(path)
    return read_channels(path, header, list(header.channels))
