"""In-between frame along the candidate motions: their weighted mean, or the motion with the largest weight.

Each window is the mean of its samples along the candidates of its node, by the weights of the pixels. Windows are faded
into each other, so that no borders are visible (overlapped block motion compensation, Orchard and Sullivan 1994,
doi:10.1109/83.334974).
"""

from functools import cache
from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, Float, Scratch, compiled
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.constants import BLOCKS_2X2_PER_ROW, WINDOW
from fpsboost.kernels.pair_context import PairContext
from fpsboost.kernels.window_samples import PlaneGroup


class Weighting(NamedTuple):
    """Parameters of the weights of a node's candidates at each 2x2 block of its window; see ``pixel_weights.h``."""

    scale: Float
    """Factor on squared colour differences."""
    sharpness: Float
    """Rate at which a candidate's weight decays as its similarity falls."""
    sufficient_similarity: Float
    """Similarity at which, once every pixel of a window has it, the candidates with fewer votes are skipped."""
    min_vote_share: Float
    """Remaining candidates are also skipped once the votes of the next one are below this share of the least
    accumulated weight of any pixel."""
    window_shape: Annotated[Array, "float32 (BLOCKS_2X2,)"]
    """Weight of each 2x2 block of a window, by `window_shape`."""
    even: Annotated[Array, "float32 (FEATURE_SUMS, FEATURES)"]
    """Coefficients of the features in weighted sums. Rows: 0 both frames, 1 one frame alone, 2 to 9 hinge units. The
    part that is the same for both frames; plain weights need none."""
    odd: Annotated[Array, "float32 (FEATURE_SUMS, FEATURES)"]
    """The part that is added to these coefficients for frame 0, and subtracted for frame 1."""
    factors: Annotated[Array, "float32 (FEATURE_SUMS, 2)"]
    """Factors of these sums in the logarithm of the weight of both frames, and of either alone."""


class ValueRange(NamedTuple):
    """Values of an image."""

    white: Float
    """Factor on the blended values."""
    rounding_offset: Float
    """Added before truncation."""
    lowest: Float
    highest: Float
    straight_alpha: bool
    """Whether to divide all other planes by the last one."""


class Blended(NamedTuple):
    """Generated frame."""

    image: Annotated[Array, "out uint8|uint16|float32 (sampled, height, width) strided"]
    """Planes at full resolution, in any order of the axes."""
    further: Annotated[
        Array,
        "out uint8|uint16|float32 "
        "(sampled, own_height == height or planes == 0, own_width == width or planes == 0) strided",
        "further",
    ]
    """Planes that are sampled along, any number."""
    confidence: Annotated[Array, "out float32 (height, width) or empty"]
    """Is empty if the confidence is not requested."""


@compiled
def blend_hypotheses(
    full: PlaneGroup,
    further: Annotated[PlaneGroup, "further"],
    t: Float,
    candidates: Candidates,
    weighting: Weighting,
    context: PairContext | None,
    value_range: ValueRange,
    blended: Blended,
    scratch: Scratch = None,
) -> None:
    """Write the in-between frame, one row of nodes at a time; without `context`, by plain weights.

    - `full`: planes of both frames at full resolution; coefficients have SPARE columns or more beyond the right margin
    - `further`: planes of both frames that are sampled along, if any: subsampled chroma, with one sample for two
      columns of pixels, whose differences weigh like those of the full planes; or layers of full resolution, which
      have no say in the weights
    """


@compiled
def find_dominant_motion(
    layer: PlaneGroup,
    t: Float,
    candidates: Candidates,
    weighting: Weighting,
    weights: Annotated[Array, "out float32 (height, width)"],
    places: Annotated[Array, "out float32 (4, height, width)"],
    scratch: Scratch = None,
) -> None:
    """Write where each pixel lies in both frames along the candidate with the largest weight.

    This is for values that must not be averaged, such as object numbers. Candidates are weighted as in
    `blend_hypotheses`, but the weights of a motion that several nodes list are not added up.

    - `layer`: at full resolution
    - `weights`: the largest weights; zero at first
    - `places`: column and row in frame 0, and in frame 1; not written where no candidate has any weight
    """


@cache
def window_shape(spacing: int) -> np.ndarray:
    """Return the weight of each 2x2 block of a window, (BLOCKS_2X2,) float32, for nodes some pixels apart.

    It rises smoothly from 0 at the border to 1 where no other window overlaps, and the weights of overlapping windows
    add up to 1. Where fewer blocks overlap, it rises more slowly at first, so that the first one is no visible step.
    """
    from_border = BLOCKS_2X2_PER_ROW / 2 - np.abs(np.arange(BLOCKS_2X2_PER_ROW) + 0.5 - BLOCKS_2X2_PER_ROW / 2)
    way = np.minimum(from_border * 2 / (WINDOW - spacing), 1)
    smooth = way**2 * (3 - 2 * way) if spacing <= WINDOW // 2 else way**3 * (10 - 15 * way + 6 * way**2)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


@compiled
def extract_features(
    layer: PlaneGroup,
    row: int,
    column: int,
    t: Float,
    candidates: Candidates,
    weighting: Weighting,
    context: PairContext,
    features: Annotated[Array, "out float32 (room, FEATURES, BLOCKS_2X2)"],
    gains: Annotated[Array, "out float32 (room, BLOCKS_2X2)"],
    mixed: Annotated[Array, "out float32 (room, planes, samples == WINDOW * WINDOW)"],
    change: Annotated[Array, "out float32 (room, planes, samples)"],
    count: Annotated[Array, "out int64 (1,)"],
    scratch: Scratch = None,
) -> None:
    """Write the inputs of the learnt weights for the compared candidates of a node.

    - `layer`: whose planes have the frame's full size
    - `features`: of each 2x2 block of the window; see `fpsboost.synthesis.fusion_table`
    - `gains`: factors on the weights of the foreground of the dominant motion of the window
    - `mixed`, `change`: samples of the candidate, blended by time; and those of frame 1 minus those of frame 0, 0 where
      either lies outside of its frame
    - `count`: number of compared candidates, out
    """
