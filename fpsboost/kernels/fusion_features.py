"""What is known of a pair besides its samples, and how many features of a candidate are made of it.

A feature is a number of one square of a window and one candidate; ``fusion_features.h`` computes them, and
`fpsboost.synthesis.fusion_table` names them in order.
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array

SQUARE_FEATURES, CELL_FEATURES, SCALAR_FEATURES = 7, 12, 5
FEATURES = SQUARE_FEATURES + CELL_FEATURES + SCALAR_FEATURES
"""Features that differ from square to square, from cell to cell of the motion fields, or not within a window."""

Luma = Annotated[Array, "float32 (rows, columns)"]
Points = Annotated[Array, "float32 (rows, columns, 5)"]


class PairContext(NamedTuple):
    """What is known of a pair besides the samples of its frames."""

    luma: tuple[Luma, Luma, Luma, Luma]
    """Spline coefficients of the luma at half the size, white 1, of the frame before, both, and the frame after; has no
    rows where there is none."""
    times: tuple[np.float32, np.float32, np.float32, np.float32]
    """Times of the four frames, in intervals from the first of the pair."""
    points: tuple[Points, Points]
    """Of the points of both frames: motion (dx, dy), similarity, 1 over 1 + the forward-backward error in pixels,
    flatness."""
    step: int
    """Pixels between points."""
    landings: Annotated[Array, "float32 (2, rows, columns)"]
    """How many points of either frame land around each point of the in-between frame."""
    support: Annotated[Array, "float32 (rows, columns, capacity)"]
    """Support of each candidate by those of the neighbouring nodes, 0 to 1."""
