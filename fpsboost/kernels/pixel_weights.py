"""How the candidates of a node are weighed at each square of its window; ``pixel_weights.h`` weighs them."""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.pair_context import PairContext
from fpsboost.kernels.window_samples import PlaneGroup


class Weighting(NamedTuple):
    """How the candidates of a node are weighted."""

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
    """Weight of each square of a window, of `fpsboost.kernels.multi_hypothesis`."""
    even: Annotated[Array, "float32 (10, 24)"]
    """Coefficients of the features of sums of them: for both frames along a candidate, for either alone, and for each
    hinge; plain weights need none."""
    odd: Annotated[Array, "float32 (10, 24)"]
    """What is added to these coefficients for frame 0, and subtracted for frame 1."""
    factors: Annotated[Array, "float32 (10, 2)"]
    """Factors of these sums in the logarithm of the weight of both frames, and of either alone."""


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
    """Write what learnt weights are made of for the candidates of a node that are compared; return their number.

    - `layer`: whose planes have the frame's full size
    - `features`: of each square of the window; see `fpsboost.synthesis.fusion_table`
    - `gains`: factors on the weights of what is in front of the dominant motion of the window
    - `mixed`, `change`: samples, as those of `fpsboost.kernels.window_samples.PlaneGroup`
    """
