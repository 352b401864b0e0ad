"""Cubic spline interpolation: coefficients computed once per frame, four weights per sample along each axis.

Samples of an interpolating cubic spline are as sharp as those of a windowed sinc with eight taps, from a kernel of four
taps; in return, each frame is filtered beforehand (Unser, Aldroubi, Eden 1993, doi:10.1109/78.193220). The kernel is
that of O-MOMS (Blu, Thevenaz, Unser 2001, doi:10.1109/83.931101), the cubic B-spline with a share of its second
derivative, which is sharper still; ``spline_samples.h`` says when it is sharpened.
"""

import math
from functools import cache
from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, Float, Scratch, compiled

POLE = (math.sqrt(105) - 13) / 8
"""Pole of the recursive prefilter: its impulse response decays by this factor per pixel."""


@compiled
def find_coefficients(
    planes: Annotated[Array, "uint8|uint16|float32 (channels, height, width)"],
    unit: Float,
    weights: Annotated[Array, "float32 (stages <= 5,)"],
    coefficients: Annotated[
        Array, "out float32 (channels, rows == height + 2 * MARGIN, columns >= width + 2 * MARGIN)"
    ],
    scratch: Scratch = None,
) -> None:
    """Compute the spline coefficients of planes, whose edges are repeated.

    - `unit`: factor on every value
    - `weights`: by `filter_weights`
    - `coefficients`: out; the frame begins MARGIN rows and columns from the corner
    """


@cache
def filter_weights(precision: float) -> np.ndarray:
    """Return the weights of the filters that turn samples into coefficients, one after the other, (stages,) float32.

    The prefilter is ``1 / ((1 - p z) (1 - p / z))`` with the pole p, but for a factor, and ``1 / (1 - p z)`` is the
    product of ``1 + (p z)^m`` for m = 1, 2, 4 ... Each m thus gives a symmetric filter: 1 at its centre, and the weight
    ``p^m / (1 + p^2m)`` at a distance of m on both sides. The precision is the maximum error of the spline at the
    samples, as a share of the largest difference between two of them.
    """
    # the first filter that is left out would add up to twice its power of the pole, at both ends and along both axes
    stages = math.ceil(math.log2(math.log(precision / 4, -POLE)))
    powers = [POLE ** (1 << k) for k in range(stages)]
    return np.array([power / (1 + power * power) for power in powers], np.float32)


class Source(NamedTuple):
    """One of the two frames, as seen from the frame between them."""

    coefficients: Annotated[Array, "float32 (channels, rows == height + 2 * MARGIN, columns >= width + 2 * MARGIN)"]
    """By `find_coefficients`."""
    motion: Annotated[Array, "float32 (height, width, 2)"]
    """Motion from each pixel of the frame between to this frame."""
    is_visible: Annotated[Array, "bool (height, width)"]
    """Whether this frame shows the surface that the pixel belongs to."""


@compiled
def mix_along(
    source0: Source,
    source1: Source,
    t: Float,
    mixed: Annotated[Array, "out float32 (channels, height, width)"],
    squared: Annotated[Array, "out float32 (height, width)"],
) -> None:
    """Mix both frames in time along their motions; a frame that does not show the surface has no weight.

    - `t`: weight of frame 1 where both are visible, or none is
    - `mixed`: out
    - `squared`: squared difference of the two frames, summed over the planes, out; 0 where one of them is not visible
    """
