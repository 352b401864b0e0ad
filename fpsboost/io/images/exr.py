"""OpenEXR files: planes of numbers with names, read as float32 or in their own types, and written.

Measured: OpenEXR's older reader ends the process where a name in the header is no UTF-8; the newer one does not say how
precise channels are before it has decoded them. The older one decodes, because it raises where a file is damaged; the
newer one prints to stdout and goes on. It knows one part only, so that each of several is handed to it as a file. The
newer one writes; its header is then replaced by that of the source, because it would change the types of attributes.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError, OutputError, explained
from fpsboost.io.images.exr_header import (
    LONG_NAMES,
    MAGIC,
    SEVERAL_PARTS,
    TILED,
    Channel,
    ExrHeader,
    ExrPart,
    Precision,
    Window,
    channel_bytes,
    chunk_head,
    damaged,
    header_bytes,
    numbers_at,
    parse_exr_header,
)
from fpsboost.io.memory_limit import MemoryLimit

LEVEL = "dwaCompressionLevel"
"""Attribute that says how strongly DWAA and DWAB compress."""

numpy_types: Mapping[Precision, type[np.generic]] = MappingProxyType(
    {"uint": np.uint32, "half": np.float16, "float": np.float32}
)
"""Types of channels in memory."""


def read_exr(
    path: Path,
    choose: Callable[[Collection[str]], Collection[str]] = lambda names: names,
    limit: MemoryLimit | None = None,
) -> dict[str, NDArray[Any]]:
    """Read channels of a file, in scanlines or tiles.

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
        By the names of channels, in a file of several parts with that of their part before it. As large as the display
        window; zero where the file has no data. Infinity and NaN are as they are stored.

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
    planes = decode_channels(path, data, header, list(choose(list(header.channels))), limit)
    return {name: plane.astype(np.float32) for name, plane in planes.items()}


def decode_channels(
    path: Path, data: bytes, header: ExrHeader, names: Sequence[str], limit: MemoryLimit | None
) -> dict[str, NDArray[Any]]:
    """Read channels from the content of a file in their own types.

    Parameters
    ----------
    path : Path
        For messages.
    data : bytes
        The content of the file.
    header : ExrHeader
        What it says of itself.
    names : sequence of str
        Full names of channels, in any order.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Returns
    -------
    dict of str to (H, W) float16, float32 or uint32
        In the order of the names; otherwise as for `read_exr`.
    """
    limit = limit or MemoryLimit()
    for window in (header.display, *(part.data for part in header.parts)):
        limit.check(path, *reversed(window.size))
    if header.subsampled.intersection(names):
        raise InputError(f"{path} has channels with fewer pixels than the image; save it as RGB or gray.")
    planes = _decode(data, header, names, path)
    return {name: _in_display_window(planes[name], header.places[name][0].data, header.display) for name in names}


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


def encode_exr_like(header: ExrHeader, planes: Mapping[str, NDArray[Any]]) -> bytes:
    """Turn planes into the content of a file that says the same as another one, in the same parts.

    Parts, names, types, compression, line order, tiles and all attributes are those of the other file, except that it
    has data for the whole display window, no smaller copies of its images, and no channels without a plane.

    Parameters
    ----------
    header : ExrHeader
        Of the other file.
    planes : mapping of str to (H, W)
        By the full names of channels that the other file has, all of the size of its display window.

    Returns
    -------
    bytes
    """
    import OpenEXR  # noqa: PLC0415

    parts, written = [], []
    for part in header.parts:
        own = {name: each for name, each in part.channels.items() if part.full_name(name) in planes}
        if not own:
            continue
        channels = {}
        for name, each in own.items():
            with np.errstate(over="ignore"):
                plane = np.ascontiguousarray(planes[part.full_name(name)], numpy_types[each.precision])
            channels[name] = OpenEXR.Channel(name, plane, 1, 1, each.is_linear)
        parts.append((part, own))
        written.append(OpenEXR.Part(_coding(part), channels, part.name or "image"))
    stream = io.BytesIO()
    with OpenEXR.File(written) as file:
        file.write(stream)
    return _with_headers(stream.getvalue(), header, parts)


def _coding(part: ExrPart) -> dict[str, Any]:
    """Return the attributes of a part that its pixels are coded by."""
    import OpenEXR  # noqa: PLC0415

    stored = part.attributes
    window = np.array(part.display[:2], np.int32), np.array(part.display[2:], np.int32)
    coding = {
        "type": OpenEXR.tiledimage if part.is_tiled else OpenEXR.scanlineimage,
        "compression": OpenEXR.Compression(stored["compression"].value[0]),
        "lineOrder": OpenEXR.LineOrder(stored["lineOrder"].value[0]),
        "dataWindow": window,
        "displayWindow": window,
    }
    if part.is_tiled:
        tiles = OpenEXR.TileDescription()
        tiles.xSize, tiles.ySize = struct.unpack_from("<II", stored["tiles"].value)
        coding["tiles"] = tiles
    if LEVEL in stored:
        (coding[LEVEL],) = struct.unpack("<f", stored[LEVEL].value)
    return coding


def _with_headers(data: bytes, source: ExrHeader, parts: Sequence[tuple[ExrPart, Mapping[str, Channel]]]) -> bytes:
    """Put the headers of another file into a file that has the same parts, and move its chunks accordingly."""
    header = parse_exr_header(Path("new.exr"), data)
    heads = b""
    for new, (part, channels) in zip(header.parts, parts, strict=True):
        changed = {"channels": channel_bytes(channels), "dataWindow": struct.pack("<4i", *part.display)}
        if new.chunks is not None:
            changed["chunkCount"] = struct.pack("<i", len(new.chunks))
        if part.is_tiled:
            changed["tiles"] = part.attributes["tiles"].value[:8] + b"\0"  # one level
        kept = part.attributes.items()
        heads += header_bytes({name: each._replace(value=changed.get(name, each.value)) for name, each in kept})
    version = header.version | (source.version & LONG_NAMES)
    heads = MAGIC + struct.pack("<I", version) + heads + b"\0" * bool(version & SEVERAL_PARTS)
    tables = np.concatenate([part.chunks for part in header.parts if part.chunks is not None])
    moved = (tables + (len(heads) - header.tables)).astype("<u8").tobytes()
    return heads + moved + data[header.tables + len(moved) :]


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


def _decode(data: bytes, header: ExrHeader, names: Sequence[str], path: Path) -> dict[str, NDArray[Any]]:
    """Return channels as they are stored, (height, width) of their part's data window."""
    import OpenEXR  # noqa: PLC0415

    found: dict[str, NDArray[Any]] = {}
    for number, part in enumerate(header.parts):
        own = {part.full_name(name): name for name in part.channels if part.full_name(name) in names}
        if not own:
            continue
        whole = data if len(header.parts) == 1 and not header.version & SEVERAL_PARTS else _alone(data, header, number)
        try:
            file = OpenEXR.InputFile(io.BytesIO(whole))
            planes = file.channels(list(own.values()))
            file.close()
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            raise damaged(path) from error
        for (name, stored), plane in zip(own.items(), planes, strict=True):
            kind = numpy_types[part.channels[stored].precision]
            found[name] = np.frombuffer(plane, kind).reshape(part.data.size)
    return found


def _alone(data: bytes, header: ExrHeader, number: int) -> bytes:
    """Return one part of several as a file of its own, not decoded, for the decoder that knows one part only."""
    part = header.parts[number]
    if part.chunks is None:
        raise ValueError("a part always has its chunks")
    version = (header.version & ~SEVERAL_PARTS) | (TILED if part.is_tiled else 0)
    head = MAGIC + struct.pack("<I", version) + header_bytes(part.attributes)
    before = chunk_head(part.is_tiled, has_several=True)
    ends = part.chunks + before + 4 + numbers_at(data, part.chunks + before)
    lengths = ends - part.chunks - 4  # without the number of the part
    begins = len(head) + 8 * len(lengths) + np.concatenate([[0], np.cumsum(lengths)[:-1]])
    content = memoryview(data)
    chunks = [content[begin + 4 : end] for begin, end in zip(part.chunks.tolist(), ends.tolist(), strict=True)]
    return b"".join([head, begins.astype("<u8").tobytes(), *chunks])


def _in_display_window(plane: NDArray[Any], data: Window, display: Window) -> NDArray[Any]:
    if data == display:
        return plane
    shown = np.zeros(display.size, plane.dtype)
    left, right = max(data.left, display.left), min(data.right, display.right) + 1
    top, bottom = max(data.top, display.top), min(data.bottom, display.bottom) + 1
    if left < right and top < bottom:
        part = plane[top - data.top : bottom - data.top, left - data.left : right - data.left]
        shown[top - display.top : bottom - display.top, left - display.left : right - display.left] = part
    return shown
