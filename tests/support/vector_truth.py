"""What a renderer would write of a constructed clip: vectors and depth, as files."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.io.side.flow import encode_flow
from support.exr_truth import write_exr

Array = NDArray[Any]


def save_vectors(path: Path, backward: Array, forward: Array, layer: str = "") -> None:
    """Write one frame's vectors, ``(dx, dy)`` with y down, the way Blender does."""
    x, y = backward[..., 0], -backward[..., 1]
    z, w = -forward[..., 0], forward[..., 1]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, {layer + name: each for name, each in zip("XYZW", (x, y, z, w), strict=True)}, half=False)


def save_flows(folder: Path, name: str, backward: Array, forward: Array) -> None:
    """Write one frame's vectors as a pair of .flo files."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}_backward.flo").write_bytes(encode_flow(backward))
    (folder / f"{name}_forward.flo").write_bytes(encode_flow(forward))


def save_depth(path: Path, depth: Array, channel: str = "Z") -> None:
    """Write one frame's depth."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, {channel: depth}, half=False)


def constant(height: int, width: int, dx: float, dy: float) -> Array:
    """One vector everywhere."""
    return np.broadcast_to(np.array([dx, dy], np.float32), (height, width, 2)).copy()


def save_translation(folder: Path, count: int, size: tuple[int, int], dx: float, dy: float) -> Path:
    """Vectors of a picture that moves by ``(dx, dy)`` from output frame to output frame."""
    for number in range(count):
        save_vectors(folder / f"v_{number:04d}.exr", constant(*size, -dx, -dy), constant(*size, dx, dy))
    return folder


def save_object(
    folder: Path,
    depth_folder: Path,
    size: tuple[int, int],
    box: tuple[int, int, int, int],
    count: int,
    motion: tuple[int, int],
) -> None:
    """Vectors and depth of an object, at distance 2, that moves before a background that stands still at 10.

    In frame 0 it covers `box`, top, left, bottom and right; `motion` is that from frame to frame, (dx, dy).
    """
    for number in range(count):
        left, top = number * motion[0], number * motion[1]
        mask = np.zeros(size, bool)
        mask[box[0] + top : box[2] + top, box[1] + left : box[3] + left] = True
        flow = mask[..., np.newaxis] * np.array(motion, np.float32)
        save_vectors(folder / f"v_{number:04d}.exr", -flow, flow)
        save_depth(depth_folder / f"d_{number:04d}.exr", np.where(mask, np.float32(2), np.float32(10)))
