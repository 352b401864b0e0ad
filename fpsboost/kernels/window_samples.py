"""Windows of frames around nodes, and the planes of both frames that are sampled along a candidate.

Each node of an in-between frame has a window, which overlaps those of its neighbours. A candidate is one motion for a
whole window; ``window_samples.h`` samples both frames along it.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float


class Samples(NamedTuple):
    """Planes of an image, and their spline coefficients; see `fpsboost.kernels.spline`."""

    planes: Annotated[Array, "uint8|uint16|float32 (planes, height, width)"]
    """Values."""
    coefficients: Annotated[
        Array,
        "float32 (sampled == planes or sampled == 2 * planes, tall == height + 2 * MARGIN or planes == 0, "
        "wide >= width + 2 * MARGIN + SPARE or planes == 0)",
    ]
    """Coefficients of the values times `unit`, with repeated edges; of any size if there are no planes. A second set is
    sampled as further planes."""
    unit: Float


class PlaneGroup(NamedTuple):
    """Planes of both frames of one resolution. A sample stands for `across` columns and `down` rows of pixels."""

    frame0: Samples
    frame1: Samples
    down: int
    """1 for full resolution and layers, 1 or 2 for chroma."""
    across: int
    """1 for full resolution and layers, 2 for chroma."""
