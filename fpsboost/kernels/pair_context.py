"""Context of a pair besides its samples, for the learnt weights.

A feature is a number of one 2x2 block of a window and one candidate; ``fusion_features.h`` computes them, and
`fpsboost.synthesis.fusion_table` names them in order.

A node alone cannot tell which of several motions of weak texture is right. Each candidate is therefore compared with
those that its neighbours believe in, by their votes and by the luma around them (`measure_support`).
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float, Scratch, compiled
from fpsboost.kernels.candidates import Candidates

Luma = Annotated[Array, "float32 (luma_rows, luma_columns)"]
OtherLuma = Annotated[Array, "float32 (luma_rows, luma_columns) or empty"]
FieldFeatures = Annotated[Array, "float32 (points_down, points_across, 5)"]


class PairContext(NamedTuple):
    """Context of a pair besides the samples of its frames."""

    luma: tuple[OtherLuma, Luma, Luma, OtherLuma]
    """Spline coefficients of the luma at half the size, white 1, of the frame before, both, and the frame after; empty
    where there is none."""
    times: tuple[Float, Float, Float, Float]
    """Times of the four frames, in intervals from the first of the pair."""
    points: tuple[FieldFeatures, FieldFeatures]
    """Features of the points of both frames: motion (dx, dy), similarity, 1 over 1 + the forward-backward error in
    pixels, flatness."""
    step: int
    """Pixels between points."""
    landings: Annotated[Array, "float32 (2, points_down, points_across)"]
    """Number of points of either frame that land around each point of the in-between frame."""
    support: Annotated[Array, "float32 (rows, columns, room)"]
    """Support of each candidate by those of the neighbouring nodes, 0 to 1."""
    luma_scale: Float
    """Factor on squared differences of luma, as the sum of three gray channels at the bandwidth of the synthesis."""
    sharpness: Float
    """Rate at which the belief in a candidate decays as the similarity of the luma falls."""


@compiled
def count_landings(
    points: Annotated[Array, "float32 (rows, columns, 5)"],
    t: Float,
    step: int,
    landings: Annotated[Array, "out float32 (rows, columns)"],
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
    t: Float,
    support: Annotated[Array, "out float32 (rows, columns, room)"],
    scratch: Scratch = None,
) -> None:
    """Write how far the neighbours of each node agree with each of its candidates, the support of `PairContext`.

    The support in the context is not read.
    """
