"""Motion fields as files and as pictures, after Baker et al., "A Database and Evaluation Methodology for Optical Flow"
(2011).

``.flo`` files have one vector per pixel, little-endian: the float 202021.25, width and height as 32-bit integers, then
``dx, dy`` as float32 row by row, y down. A value with a magnitude above 1e9 means that the motion is unknown. Pictures
show direction as hue and length as saturation, no motion as white.
"""

import struct
from pathlib import Path

import numpy as np

from fpsboost.errors import InputError
from fpsboost.io.images.files import content_of

BACKWARD = "_backward.flo"
"""End of the name of a frame's file of motion to the frame before."""
FORWARD = "_forward.flo"
"""End of the name of a frame's file of motion to the next frame."""

MAGIC = struct.pack("<f", 202021.25)
UNKNOWN = 1e10
MAX_KNOWN = 1e9

STEPS = (15, 6, 4, 11, 13, 6)
"""Hues from red to yellow, to green, to cyan, to blue, to magenta, and back to red: as many as the eye tells apart."""

LARGEST_PERCENTILE = 99
"""Percentile of the lengths that is drawn in full saturation; single wrong vectors would make a picture pale."""

BEYOND = np.float32(0.75)
"""Brightness of colours for longer vectors."""


def read_flow(path: Path) -> np.ndarray:
    """Return the motion field of a ``.flo`` file, (H, W, 2) float32 pixels; NaN where it is unknown."""
    data = content_of(path)
    if len(data) < 12 or data[:4] != MAGIC:
        raise InputError(f"{path} is no .flo file of motion vectors; replace it.")
    width, height = struct.unpack("<2i", data[4:12])
    if width < 1 or height < 1 or len(data) != 12 + 8 * width * height:
        raise InputError(f"{path} says {width}x{height} vectors but has {len(data)} bytes; write it again.")
    flow = np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2).astype(np.float32)
    flow[np.abs(flow) > MAX_KNOWN] = np.nan
    return flow


def encode_flow(flow: np.ndarray) -> bytes:
    """Return a motion field, (H, W, 2) float32 pixels, NaN where it is unknown, as the content of a ``.flo`` file."""
    height, width = flow.shape[:2]
    vectors = np.where(np.isnan(flow), UNKNOWN, flow).astype("<f4")
    return MAGIC + struct.pack("<2i", width, height) + vectors.tobytes()


def flow_picture(flow: np.ndarray) -> np.ndarray:
    """Return a motion field, (H, W, 2) float32 pixels, as a picture, (H, W, 3) uint8 BGR; black where it is no number.

    The length in full saturation is the 99th percentile of all, at least 1; longer vectors are drawn darker.
    """
    is_finite = np.isfinite(flow).all(axis=-1)
    vectors = np.where(is_finite[..., np.newaxis], flow, np.float32(0))
    lengths = np.hypot(vectors[..., 0], vectors[..., 1])
    largest = max(float(np.percentile(lengths[is_finite], LARGEST_PERCENTILE)), 1.0) if is_finite.any() else 1.0
    # colours of the wheel, RGB, one row per hue, clockwise from red, to the right
    corners = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
    places = np.concatenate([[0], np.cumsum(STEPS)])
    hues = np.arange(places[-1])
    wheel = np.stack([np.interp(hues, places, corners[:, c]) for c in range(3)], axis=-1).astype(np.float32)
    place = np.mod(np.arctan2(vectors[..., 1], vectors[..., 0]) / (2 * np.pi), 1) * len(wheel)
    first = place.astype(np.intp) % len(wheel)
    share = (place - np.floor(place))[..., np.newaxis]
    hue = (1 - share) * wheel[first] + share * wheel[(first + 1) % len(wheel)]
    radius = (lengths / np.float32(largest))[..., np.newaxis]
    colours = np.where(radius <= 1, 1 - radius * (1 - hue), BEYOND * hue)
    return np.asarray(np.rint(colours[..., ::-1] * 255 * is_finite[..., np.newaxis]).astype(np.uint8))
