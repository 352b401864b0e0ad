"""In-between frame along the candidate motions: their weighted mean, or the motion with the largest weight.

Each window is the mean of its samples along the candidates of its node, by the weights of the pixels. Windows are faded
into each other, so that no borders are visible (overlapped block motion compensation, Orchard and Sullivan 1994,
doi:10.1109/83.334974).
"""

from functools import cache
from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.pair_context import PairContext
from fpsboost.kernels.window_samples import SQUARES_PER_ROW, WINDOW, PlaneGroup, Samples, make_plane_group

CONFIDENCE_POWER = 8
"""Power of the similarity that is the confidence: eight corresponds to a bandwidth of about a third, as a few levels
hardly change the weights, but are visible."""


class Weighting(NamedTuple):
    """Parameters of the weights of a node's candidates at each square of its window; see ``pixel_weights.h``."""

    scale: np.float32
    """Factor on squared colour differences."""
    sharpness: np.float32
    """Rate at which a candidate's weight decays as its similarity falls."""
    sufficient_similarity: np.float32
    """Similarity at which, once every pixel of a window has it, the candidates with fewer votes are skipped."""
    min_vote_share: np.float32
    """Remaining candidates are also skipped once the votes of the next one are below this share of the least
    accumulated weight of any pixel."""
    window_shape: Annotated[Array, "float32 (256,)"]
    """Weight of each square of a window, by `window_shape`."""
    even: Annotated[Array, "float32 (10, 24)"]
    """Coefficients of the features of sums of them: for both frames along a candidate, for either alone, and for each
    hinge; plain weights need none."""
    odd: Annotated[Array, "float32 (10, 24)"]
    """Offsets that are added to these coefficients for frame 0, and subtracted for frame 1."""
    factors: Annotated[Array, "float32 (10, 2)"]
    """Factors of these sums in the logarithm of the weight of both frames, and of either alone."""


class ValueRange(NamedTuple):
    """Values of an image."""

    white: np.float32
    """Factor on the blended values."""
    rounding_offset: np.float32
    """Added before truncation."""
    lowest: np.float32
    highest: np.float32
    straight_alpha: bool
    """Whether to divide all other planes by the last one."""


Planes = Annotated[Array, "uint8|uint16|float32 (planes, height, width) strided"]


class Blended(NamedTuple):
    """Generated frame."""

    image: Planes
    """Planes at full resolution, in any order of the axes."""
    further: Planes
    """Planes that are sampled along, any number."""
    confidence: Annotated[Array, "float32 (height, width)"]
    """Has no columns if the confidence is not requested."""


@compiled
def blend_nodes(
    full: PlaneGroup,
    further: PlaneGroup,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    context: PairContext | None,
    value_range: ValueRange,
    blended: Blended,
) -> None:
    """Write the in-between frame, one row of nodes at a time; see `blend_hypotheses`."""


def blend_hypotheses(
    full: tuple[Samples, Samples],
    further: tuple[Samples, Samples],
    subsampling: tuple[int, int],
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    context: PairContext | None,
    value_range: ValueRange,
    blended: Blended,
) -> None:
    """Write the in-between frame; without `context`, by plain weights.

    - `full`: planes of both frames at full resolution; coefficients have SPARE columns or more beyond the right margin
    - `further`: planes of both frames that are sampled along, if any: subsampled chroma, with one sample for two
      columns of pixels, whose differences weigh like those of the full planes; or layers of full resolution, which
      have no say in the weights
    - `subsampling`: rows and columns of pixels per sample of the further planes: (1, 1) for layers, (1 or 2, 2) for
      chroma
    """
    (channels, _, width), has_confidence = blended.image.shape, blended.confidence.shape[1] > 0
    full_group = make_plane_group(*full, (1, 1), channels + 1 + has_confidence, width)
    further_channels, _, further_width = blended.further.shape
    further_group = make_plane_group(*further, subsampling, further_channels + 1, further_width)
    blend_nodes(full_group, further_group, t, candidates, weighting, context, value_range, blended)


@compiled
def compare_candidates(
    layer: PlaneGroup,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    weights: Annotated[Array, "float32 (height, width)"],
    places: Annotated[Array, "float32 (4, height, width)"],
) -> None:
    """Write where each pixel lies along the candidate with the largest weight; see `find_dominant_motion`."""


def find_dominant_motion(
    samples0: Samples,
    samples1: Samples,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    weights: Array,
    places: Array,
) -> None:
    """Write where each pixel lies in both frames along the candidate with the largest weight.

    This is for values that must not be averaged, such as object numbers. Candidates are weighted as in
    `blend_hypotheses`, but the weights of a motion that several nodes list are not added up.

    - `weights`: the largest weights, (height, width) float32; zero at first
    - `places`: column and row in frame 0, and in frame 1, (4, height, width) float32; not written where no candidate
      has any weight
    """
    layer = make_plane_group(samples0, samples1, (1, 1), band_planes=0, width=0)
    compare_candidates(layer, t, candidates, weighting, weights, places)


@cache
def window_shape(spacing: int) -> np.ndarray:
    """Return the weight of each square of a window, (SQUARES_PER_ROW ** 2,) float32, for nodes some pixels apart.

    It rises smoothly from 0 at the border to 1 where no other window overlaps, and the weights of overlapping windows
    add up to 1. Where fewer squares overlap, it rises more slowly at first, so that the first one is no visible step.
    """
    from_border = SQUARES_PER_ROW / 2 - np.abs(np.arange(SQUARES_PER_ROW) + 0.5 - SQUARES_PER_ROW / 2)
    way = np.minimum(from_border * 2 / (WINDOW - spacing), 1)
    smooth = way**2 * (3 - 2 * way) if spacing <= WINDOW // 2 else way**3 * (10 - 15 * way + 6 * way**2)
    return np.outer(smooth, smooth).ravel().astype(np.float32)


@compiled
def describe_node(  # type: ignore[empty-body]
    layer: PlaneGroup,
    row: int,
    column: int,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    context: PairContext,
    features: Annotated[Array, "float32 (capacity, 24, 256)"],
    gains: Annotated[Array, "float32 (capacity, 256)"],
    mixed: Annotated[Array, "float32 (capacity, planes, samples)"],
    change: Annotated[Array, "float32 (capacity, planes, samples)"],
) -> int:
    """Write the inputs of the learnt weights for the compared candidates of a node; return their number.

    - `layer`: whose planes have the frame's full size
    - `features`: of each square of the window; see `fpsboost.synthesis.fusion_table`
    - `gains`: factors on the weights of the foreground of the dominant motion of the window
    - `mixed`, `change`: samples, as those of `fpsboost.kernels.window_samples.PlaneGroup`
    """
