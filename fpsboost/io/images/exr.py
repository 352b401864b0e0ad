"""OpenEXR files: planes of numbers with names, read as float32 and written as half or float.

The header is read here, before anything is decoded: a few bytes can promise any size, so a file must hold the beginning
of every one of its chunks before memory is taken for what is in them, which neither of OpenEXR's readers asks for.
Measured: the older one ends the process where a name in the header is no UTF-8; the newer one does not say how precise
channels are before it has decoded them. The older one decodes, because it raises where a file is damaged; the newer one
prints to stdout and goes on.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError, OutputError, explained
from fpsboost.io.memory_limit import MemoryLimit

MAGIC = b"v/1\x01"
MAX_CHANNELS = 1024

TILED, DEEP, SEVERAL_PARTS = 0x200, 0x800, 0x1000
"""Flags of the version."""

Precision = Literal["uint", "half", "float"]
_precisions: tuple[Precision, ...] = ("uint", "half", "float")
_kept_attributes = ("chromaticities", "whiteLuminance", "pixelAspectRatio")
_lines_per_chunk = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32}
"""By compression, as numbered in the format."""


class Window(NamedTuple):
    """A rectangle of pixels, both ends included."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top + 1, self.right - self.left + 1


@dataclass(frozen=True)
class ExrHeader:
    """What a file says of itself.

    Attributes
    ----------
    channels : mapping of str to {'uint', 'half', 'float'}
        Names as they are stored, by the alphabet, and how precise each is.
    subsampled : frozenset of str
        Channels that have fewer pixels than the image.
    data, display : Window
        Where there are pixels, and what is to be shown.
    attributes : mapping of str to tuple of float
        What it says of its colours and of the shape of its pixels, unless that is square: what `encode_exr` takes.
    """

    channels: Mapping[str, Precision]
    subsampled: frozenset[str]
    data: Window
    display: Window
    attributes: Mapping[str, tuple[float, ...]]


def read_exr(
    path: Path,
    choose: Callable[[Collection[str]], Collection[str]] = lambda names: names,
    limit: MemoryLimit | None = None,
) -> dict[str, NDArray[Any]]:
    """Read channels of a file with one part, in scanlines or tiles.

    Parameters
    ----------
    path : Path
    choose : callable, optional
        Told the names of all channels, names the ones to read; all without it.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Returns
    -------
    dict of str to (H, W) float32
        As large as the display window; zero where the file has no data. Infinity and NaN are as they are stored.

    Raises
    ------
    InputError
        It cannot be read, is damaged or too large, is of a kind that holds no plain image, or a channel that is asked
        for has fewer pixels than the image.
    """
    with explained(InputError, "read", path, "check that it exists and that you may read it"):
        data = path.read_bytes()
    return decode_exr(path, data, choose, limit)


def decode_exr(
    path: Path, data: bytes, choose: Callable[[Collection[str]], Collection[str]], limit: MemoryLimit | None
) -> dict[str, NDArray[Any]]:
    """Read channels from the content of a file; see `read_exr`."""
    header = parse_exr_header(path, data)
    limit = limit or MemoryLimit()
    for window in (header.data, header.display):
        limit.check(path, *reversed(window.size))
    names = list(choose(list(header.channels)))
    if header.subsampled.intersection(names):
        raise InputError(f"{path} has channels with fewer pixels than the image; save it as RGB or gray.")
    planes = _decode(data, names, header.data, path)
    return {name: _in_display_window(plane, header) for name, plane in zip(names, planes, strict=True)}


def write_exr(path: Path, channels: Mapping[str, NDArray[Any]], *, half: bool = True) -> None:
    """Write a file; see `encode_exr`.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    data = encode_exr(channels, half=half)
    with explained(OutputError, "write", path, "check the free space and the permissions"):
        path.write_bytes(data)


def encode_exr(
    channels: Mapping[str, NDArray[Any]],
    *,
    half: bool = True,
    attributes: Collection[tuple[str, tuple[float, ...]]] = (),
) -> bytes:
    """Turn planes into the content of a file: scanlines, compressed without loss (ZIP).

    Parameters
    ----------
    channels : mapping of str to (H, W)
        All of one size.
    half : bool
        Store 16 bits a number, which hold about three digits and end at 65504 (what is larger becomes infinity),
        instead of float32.
    attributes : collection of (str, tuple of float)
        What else the header is to say, as `ExrHeader.attributes` has it.

    Returns
    -------
    bytes
    """
    import OpenEXR  # noqa: PLC0415  # only who has such files waits for it

    with np.errstate(over="ignore"):
        planes = {
            name: np.ascontiguousarray(plane, np.float16 if half else np.float32) for name, plane in channels.items()
        }
    stream = io.BytesIO()
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {name: values[0] if len(values) == 1 else values for name, values in attributes}
    with OpenEXR.File(header, planes) as file:
        file.write(stream)
    return stream.getvalue()


def find_layer(names: Collection[str], parts: str, preferred: str) -> str | None:
    """Find the name prefix of the only layer that has all these channels.

    Parameters
    ----------
    names : collection of str
        Channels of a file.
    parts : str
        One letter for each channel of the layer, ``XYZW``.
    preferred : str
        The last word of the layer's name where several layers have these letters.

    Returns
    -------
    str or None
        "" for plain names; None where there is no such layer, or several.

    Examples
    --------
    >>> find_layer(["Scene.Vector.X", "Scene.Vector.Y", "Scene.Depth.Z"], "XY", "Vector")
    'Scene.Vector.'
    """
    prefixes = {name[:-1] for name in names if name.endswith(parts[0]) and (len(name) == 1 or name[-2] == ".")}
    whole = sorted(prefix for prefix in prefixes if all(prefix + part in names for part in parts))
    if "" in whole:
        return ""
    named = [prefix for prefix in whole if prefix.split(".")[-2] == preferred]
    found = named or whole
    return found[0] if len(found) == 1 else None


def parse_exr_header(path: Path, data: bytes) -> ExrHeader:
    """Read what a file says of itself, nothing decoded.

    Parameters
    ----------
    path : Path
        For messages.
    data : bytes
        The content of the file, whole: it must have all its chunks.

    Raises
    ------
    InputError
        It is damaged, or of a kind that holds no plain image.
    """
    if data[:4] != MAGIC:
        raise _damaged(path)
    (version,) = struct.unpack("<I", data[4:8].ljust(4, b"\0"))
    if version & (DEEP | SEVERAL_PARTS):
        kind = "deep pixels" if version & DEEP else "several parts"
        raise InputError(f"{path} has {kind}; save it as one flat image.")
    try:
        attributes, end = _attributes(data)
        channels, subsampled = _channels(attributes["channels"])
        header = ExrHeader(
            channels,
            subsampled,
            Window(*struct.unpack("<4i", attributes["dataWindow"])),
            Window(*struct.unpack("<4i", attributes["displayWindow"])),
            _kept(attributes),
        )
        if min(header.data.size + header.display.size) < 1:
            raise ValueError("a window without pixels")
        is_whole = _has_all_chunks(data, end, header.data, attributes, bool(version & TILED))
    except (KeyError, IndexError, ValueError, ZeroDivisionError, struct.error) as error:
        raise _damaged(path) from error
    if not is_whole:
        raise _damaged(path)
    return header


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is damaged or no OpenEXR file; replace it.")


def _attributes(data: bytes) -> tuple[dict[str, bytes], int]:
    """Return all attributes by name, and where the table of chunks begins."""
    attributes, place = {}, 8
    while data[place] != 0:
        name, place = _word(data, place)
        _, place = _word(data, place)
        (size,) = struct.unpack_from("<i", data, place)
        if not 0 <= size <= len(data) - place - 4:
            raise ValueError("an attribute ends behind the file")
        attributes[name] = data[place + 4 : place + 4 + size]
        place += 4 + size
    return attributes, place + 1


def _kept(attributes: Mapping[str, bytes]) -> dict[str, tuple[float, ...]]:
    """Return the attributes to copy to output files, without the default pixel aspect ratio of 1."""
    kept = {name: attributes[name] for name in _kept_attributes if len(attributes.get(name, b"-")) % 4 == 0}
    values = {name: struct.unpack(f"<{len(value) // 4}f", value) for name, value in kept.items()}
    return {name: value for name, value in values.items() if (name, value) != ("pixelAspectRatio", (1.0,))}


def _word(data: bytes, place: int) -> tuple[str, int]:
    """Read a null-terminated string; return it and the position after it."""
    end = data.index(b"\0", place)
    return data[place:end].decode("utf-8"), end + 1


def _channels(data: bytes) -> tuple[dict[str, Precision], frozenset[str]]:
    channels, subsampled, place = {}, set(), 0
    while data[place] != 0:
        name, place = _word(data, place)
        kind, _, *sampling = struct.unpack_from("<iIii", data, place)
        channels[name] = _precisions[kind]
        if sampling != [1, 1]:
            subsampled.add(name)
        place += 16
        if len(channels) > MAX_CHANNELS:
            raise ValueError("more channels than any program writes")
    return channels, frozenset(subsampled)


def _has_all_chunks(data: bytes, table: int, window: Window, attributes: Mapping[str, bytes], is_tiled: bool) -> bool:
    """Return whether every chunk of the full image lies within the file, by the table and by what each one says."""
    if is_tiled:
        tile_width, tile_height = struct.unpack_from("<II", attributes["tiles"])
        count, before_size = -(-window.size[0] // tile_height) * -(-window.size[1] // tile_width), 16
    elif attributes["compression"][0] in _lines_per_chunk:
        count, before_size = -(-window.size[0] // _lines_per_chunk[attributes["compression"][0]]), 4
    else:  # of a later time: the decoder will know
        return True
    behind_table = table + 8 * count
    if behind_table > len(data):
        return False
    chunks = np.frombuffer(data, "<u8", count, table)
    if chunks.min() < behind_table or chunks.max() > len(data) - before_size - 4:
        return False
    places = chunks.astype(np.int64) + before_size
    content = np.frombuffer(data, np.uint8)
    sizes = np.ascontiguousarray(content[places[:, np.newaxis] + np.arange(4)]).view("<i4")[:, 0]
    return bool(sizes.min() >= 0 and (places + 4 + sizes <= len(data)).all())


def _decode(data: bytes, names: list[str], window: Window, path: Path) -> list[NDArray[Any]]:
    """Return the channels as they are stored, (height, width) of the data window, float32."""
    import Imath  # noqa: PLC0415
    import OpenEXR  # noqa: PLC0415

    try:
        file = OpenEXR.InputFile(io.BytesIO(data))
        planes = file.channels(names, Imath.PixelType(Imath.PixelType.FLOAT))
        file.close()
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise _damaged(path) from error
    return [np.frombuffer(plane, np.float32).reshape(window.size) for plane in planes]


def _in_display_window(plane: NDArray[Any], header: ExrHeader) -> NDArray[Any]:
    data, display = header.data, header.display
    if data == display:
        return plane
    shown = np.zeros(display.size, np.float32)
    left, right = max(data.left, display.left), min(data.right, display.right) + 1
    top, bottom = max(data.top, display.top), min(data.bottom, display.bottom) + 1
    if left < right and top < bottom:
        part = plane[top - data.top : bottom - data.top, left - data.left : right - data.left]
        shown[top - display.top : bottom - display.top, left - display.left : right - display.left] = part
    return shown
