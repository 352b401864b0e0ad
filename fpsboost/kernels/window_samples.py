"""Windows of frames around nodes, and the planes of both frames that are sampled along a candidate.

Each node of an in-between frame has a window, which overlaps those of its neighbours. A candidate is one motion for a
whole window; ``window_samples.h`` samples both frames along it.
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array

SQUARES_PER_ROW = 16
"""Number of squares across a window: one for two pixels, as for subsampled chroma. Each square has one weight: weights
are means over patches, which vary slowly."""

WINDOW = 2 * SQUARES_PER_ROW
"""Side of a window, pixels."""

BLOCK = 8
"""Side of the blocks of a zoomed or turned window that move as their centre does, pixels."""

END_WEIGHT = 0.75
"""Weight of the first and the last of the five squares across a patch: equivalent to sums over patches of nine pixels
around each pixel."""

SPARE = 16
"""Columns of coefficients that are needed beyond the right margin: rows are read sixteen values at a time."""


class Samples(NamedTuple):
    """Planes of an image, and their spline coefficients; see `fpsboost.kernels.spline`."""

    planes: Annotated[Array, "uint8|uint16|float32 (planes, height, width)"]
    """Values."""
    coefficients: Annotated[Array, "float32 (planes, rows, columns)"]
    """Coefficients of the values times `unit`, with repeated edges, (C, H + 2 MARGIN, W + 2 MARGIN + SPARE or more)."""
    unit: np.float32


class PlaneGroup(NamedTuple):
    """Planes of one resolution: samples of both frames, work arrays for one window, and sums over windows.

    A sample stands for `across` columns and `down` rows of pixels.
    """

    frame0: Samples
    frame1: Samples
    down: int
    across: int
    mixed: Annotated[Array, "float32 (planes, samples)"]
    """Samples of a candidate, blended by time."""
    change: Annotated[Array, "float32 (planes, samples)"]
    """Samples of frame 1 minus those of frame 0; 0 where either lies outside of its frame."""
    total: Annotated[Array, "float32 (planes, samples)"]
    """Weighted sums of the samples over the candidates of a node."""
    band: Annotated[Array, "float32 (sums, rows, width)"]
    """Sums over the windows of a row of nodes: weighted values of each plane, weights, and, for the confidence,
    weighted similarities."""


def make_plane_group(
    frame0: Samples, frame1: Samples, subsampling: tuple[int, int], band_planes: int, width: int
) -> PlaneGroup:
    """Return the group of both frames' planes, of so many columns, with a band of so many planes."""
    down, across = subsampling
    tall = WINDOW // down
    mixed, change, total = np.empty((3, frame0.planes.shape[0], tall * WINDOW // across), np.float32)
    return PlaneGroup(
        frame0, frame1, down, across, mixed, change, total, np.zeros((band_planes, tall, width), np.float32)
    )
