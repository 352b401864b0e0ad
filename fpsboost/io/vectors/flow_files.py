"""Reading and writing of optical flow in Middlebury's ``.flo`` format, one vector per pixel (Baker et al., "A Database
and Evaluation Methodology for Optical Flow", 2011).

Little-endian: the float 202021.25, width and height as 32-bit integers, then ``dx, dy`` as float32 row by row, y down.
A value with a magnitude above 1e9 means that the motion is unknown.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import InputError, OutputError, explained

MAGIC = struct.pack("<f", 202021.25)
UNKNOWN = 1e10
MAX_KNOWN = 1e9


def read_flow(path: Path) -> NDArray[Any]:
    """Read a motion field.

    Returns
    -------
    (H, W, 2) float32
        ``(dx, dy)`` in pixels; NaN where it is unknown.

    Raises
    ------
    InputError
        The file cannot be read, is of another format, or its length does not match its size.
    """
    with explained(InputError, "read", path, "check that it exists and that you may read it"):
        data = path.read_bytes()
    if len(data) < 12 or data[:4] != MAGIC:
        raise InputError(f"{path} is no .flo file of motion vectors; replace it.")
    width, height = struct.unpack("<2i", data[4:12])
    if width < 1 or height < 1 or len(data) != 12 + 8 * width * height:
        raise InputError(f"{path} says {width}x{height} vectors but has {len(data)} bytes; write it again.")
    flow = np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2).astype(np.float32)
    flow[np.abs(flow) > MAX_KNOWN] = np.nan
    return flow


def write_flow(path: Path, flow: NDArray[Any]) -> None:
    """Write a motion field.

    Parameters
    ----------
    path : Path
    flow : (H, W, 2) float32
        ``(dx, dy)`` in pixels; NaN where it is unknown.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with explained(OutputError, "write", path, "check the free space and the permissions"):
        path.write_bytes(encode_flow(flow))


def encode_flow(flow: NDArray[Any]) -> bytes:
    """Turn a motion field into the content of a file; see `write_flow`."""
    height, width = flow.shape[:2]
    vectors = np.where(np.isnan(flow), UNKNOWN, flow).astype("<f4")
    return MAGIC + struct.pack("<2i", width, height) + vectors.tobytes()
