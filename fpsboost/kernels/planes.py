"""Planes in which the searches compare two frames, by the similarity of their pixels, and smaller copies of a frame.

The similarity of two pixels is the report's exponential (section 3.2, Eqs. 3 and 4), or a linear form of it on bytes.

The product over the colour components of ``exp(-d^2 / (2 v^2))`` is one exponential of a sum. With images scaled by
`colour_scale`, it is ``2^-s`` of a plain sum of squares s, and computed in integers: a polynomial for the fraction of
s, a shift for its integer part. Fixed-point values make every later sum exact, whatever its order, so that running sums
do not drift, ties in flat areas stay ties, and the result does not depend on the number of threads.

The linear form, ``max(1 - sum_c |a_c - b_c| / (4 v), 0)``, falls from 1 to 0 approximately as the exponential does (v
is the bandwidth), and takes a dozen instructions for sixteen pixels.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from fpsboost.kernels.binding import Array, Float, Scratch, compiled
from fpsboost.kernels.constants import FRACTION_BITS, WHITE

CACHE_LINE = 64
"""Bytes; a vector that straddles two lines costs two accesses."""

UNIT = 1 << FRACTION_BITS
"""Fixed-point similarity of two equal pixels."""

TRUNCATION = 4
"""Sum of absolute differences, in units of the bandwidth, at which the similarity reaches 0."""


def colour_scale(bandwidth: float) -> float:
    """Return the factor on colours in [0, 1] after which the similarity is ``2^-(sum of squared differences)``."""
    return math.sqrt(math.log2(math.e) / 2) / bandwidth


def level_scale(bandwidth: float) -> float:
    """Return the levels of a component that ranges over 1: 255, or fewer if the truncation would exceed 255."""
    return WHITE * min(1.0, 1 / (TRUNCATION * bandwidth))


def truncation(bandwidth: float) -> int:
    """Return the sum of absolute differences over all components, in levels, at which the similarity reaches 0."""
    return max(1, round(TRUNCATION * bandwidth * level_scale(bandwidth)))


class PlanePair(NamedTuple):
    """Component planes of two frames of `height` x `width` pixels, with edges repeated over `padding` pixels."""

    planes0: Annotated[Array, "level: uint8|float32 (3, tall == height + 2 * padding, wide)"]
    planes1: Annotated[Array, "level: uint8|float32 (3, tall, wide >= width + 2 * padding + LANES)"]
    padding: int
    height: int
    width: int
    max_similarity: int | np.uint8
    """Similarity of two equal pixels: `truncation` or `UNIT`."""


def aligned_empty(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """Return an array like `numpy.empty`, its last axis rounded up to whole cache lines and its first byte aligned."""
    itemsize = np.dtype(dtype).itemsize
    lanes = CACHE_LINE // itemsize
    rounded = (*shape[:-1], -(-shape[-1] // lanes) * lanes)
    raw = np.empty(math.prod(rounded) * itemsize + CACHE_LINE, np.uint8)
    return np.ndarray(rounded, dtype, raw, -raw.ctypes.data % CACHE_LINE)


class CodeLevels(NamedTuple):
    """Code values of black and of neutral chroma, and luma, where white is 1, and chroma per code value."""

    black: Float
    luma_unit: Float
    neutral: Float
    chroma_unit: Float


@compiled
def split_colours(
    image: Annotated[Array, "uint8|uint16|float32 (height, width, channels <= 4)"],
    normalise: Float,
    scale: Float,
    middle: Float,
    padding: int,
    planes: Annotated[Array, "out uint8 (3, rows == height + 2 * padding, columns >= width + 2 * padding)"],
    scratch: Scratch = None,
) -> None:
    """Write half the luma, twice its difference from the local mean, and mean chroma.

    - `image`: gray or BGR; the planes are multiplied by alpha if there is a second or a fourth channel
    - `normalise`: factor that scales the image's white to 1
    - `scale`, `middle`: levels that represent a difference of 1, and the level of zero difference from the mean
    - `padding`: pixels on every side of the planes
    - `planes`: out, with repeated edges
    """


@compiled
def split_planes(
    y_plane: Annotated[Array, "pixel: uint8|uint16 (height, width)"],
    cb_plane: Annotated[Array, "pixel: uint8|uint16 (down == height or down == -(-height // 2), across)"],
    cr_plane: Annotated[Array, "pixel: uint8|uint16 (down, across == width or across == -(-width // 2))"],
    code_levels: CodeLevels,
    scale: Float,
    middle: Float,
    padding: int,
    planes: Annotated[Array, "out uint8 (3, rows == height + 2 * padding, columns >= width + 2 * padding)"],
    scratch: Scratch = None,
) -> None:
    """Do the same as `split_colours` for an image in planes of luma and chroma.

    Chroma has the shape of luma, or is subsampled by 2 along x or along both axes.
    """


@compiled
def shrink(
    rows: Annotated[Array, "uint8|uint16|float32 (height, values)"],
    small: Annotated[Array, "out float32 (rows <= height, columns <= values // channels, channels)"],
    scratch: Scratch = None,
) -> None:
    """Write the mean over the area of each pixel of a reduced image; partly covered pixels count in part.

    The image is (H, W * C), the reduced one (h, w, C) with h from 1 to H and w from 1 to W.
    """


@compiled
def smooth(
    image: Annotated[Array, "pixel: uint8|uint16|float32 (height, width, channels)"],
    smoothed: Annotated[Array, "out pixel: uint8|uint16|float32 (height, width, channels)"],
    scratch: Scratch = None,
) -> None:
    """Write an image filtered by 1, 4, 6, 4, 1 along both axes, and rounded; its edges are repeated.

    OpenCV does the same, but takes up to five times as long for BGR, and floats are not of the same bits everywhere.
    """
