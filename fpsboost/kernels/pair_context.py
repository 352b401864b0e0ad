"""Context of a pair besides its samples, for the learnt weights, and the number of features of a candidate.

A feature is a number of one square of a window and one candidate; ``fusion_features.h`` computes them, and
`fpsboost.synthesis.fusion_table` names them in order.

A node alone cannot tell which of several motions of weak texture is right. Each candidate is therefore compared with
those that its neighbours believe in, by their votes and by the luma around them (`measure_support`).
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.candidates import Candidates

SQUARE_FEATURES, CELL_FEATURES, SCALAR_FEATURES = 7, 12, 5
FEATURES = SQUARE_FEATURES + CELL_FEATURES + SCALAR_FEATURES
"""Features that differ from square to square, from cell to cell of the motion fields, or not within a window."""

Luma = Annotated[Array, "float32 (rows, columns)"]
Points = Annotated[Array, "float32 (rows, columns, 5)"]


class PairContext(NamedTuple):
    """Context of a pair besides the samples of its frames."""

    luma: tuple[Luma, Luma, Luma, Luma]
    """Spline coefficients of the luma at half the size, white 1, of the frame before, both, and the frame after; has no
    rows where there is none."""
    times: tuple[np.float32, np.float32, np.float32, np.float32]
    """Times of the four frames, in intervals from the first of the pair."""
    points: tuple[Points, Points]
    """Features of the points of both frames: motion (dx, dy), similarity, 1 over 1 + the forward-backward error in
    pixels, flatness."""
    step: int
    """Pixels between points."""
    landings: Annotated[Array, "float32 (2, rows, columns)"]
    """Number of points of either frame that land around each point of the in-between frame."""
    support: Annotated[Array, "float32 (rows, columns, capacity)"]
    """Support of each candidate by those of the neighbouring nodes, 0 to 1."""


@compiled
def count_landings(
    points: Annotated[Array, "float32 (rows, columns, 5)"],
    t: np.float32,
    step: int,
    landings: Annotated[Array, "float32 (rows, columns)"],
) -> None:
    """Count how many points of a frame land around each point of the in-between frame, bilinearly, at most 2.

    - `points`: of `PairContext`
    - `t`: distance in time from the frame, in intervals
    - `step`: pixels between points
    """


@compiled
def measure_support(
    candidates: Candidates,
    context: PairContext,
    t: np.float32,
    beliefs: Annotated[Array, "float32 (rows, columns, capacity)"],
) -> None:
    """Write how far the neighbours of each node agree with each of its candidates, into the support of `context`.

    - `beliefs`: work array
    """
