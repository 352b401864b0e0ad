"""Residual search for small objects that the motion of their surroundings does not explain.

A patch that is much larger than an object follows the background, and the object is lost on the coarsest level already.
But then neither the object nor, in the other frame, its new position has a match along the motion of the surroundings.
Points that small patches do not explain are therefore compared with the points of the other frame that are not
explained either (`search_residuals_bidirectional`). Things of a few pixels are smaller than any patch: at full size,
connected regions of unexplained pixels are compared instead (`fpsboost.kernels.residual_regions`).
"""

from typing import Annotated

from fpsboost.kernels.binding import Array, Float, compiled
from fpsboost.kernels.planes import PlanePair


@compiled
def search_residuals_bidirectional(
    pair: PlanePair,
    step: int,
    max_offset: int,
    patch_radius: int,
    min_similarity: Float,
    better: Float,
    flow: Annotated[Array, "out float32 (2, down == -(-height // step), across == -(-width // step), 2)"],
    similarity: Annotated[Array, "out float32 (2, 2, down, across and patch_radius < padding)"],
) -> None:
    """Replace the motion of unexplained points by motion to unexplained positions of the other frame, in whole pixels.

    A position in the other frame counts as unexplained if the point there, or one of its neighbours, is.

    - `pair`: in levels; the padding is larger than the radius
    - `step`: distance between points, at most 16 pixels
    - `max_offset`: maximum offset along x and y, pixels
    - `patch_radius`: radius r of the small patches at both ends of a point's motion, at most 7 pixels
    - `min_similarity`: similarity of these patches, 0 to 1, at which a point counts as explained
    - `better`: minimum increase of the similarity by another motion
    - `flow`: in both directions; updated in place
    - `similarity`: that of the points of both frames, and where runs of unexplained ones end, out
    """


@compiled
def relax_smoothness(
    flow: Annotated[Array, "float32 (2, down, across, 2)"],
    before: Annotated[Array, "float32 (2, down, across, 2)"],
    step: Float,
    tolerance: Float,
    weak: Float,
    smoothness_weight: Annotated[Array, "out float32 (2, down, across)"],
) -> None:
    """Give points with new motion that the other frame confirms a smaller weight of the smoothness.

    - `flow`, `before`: motion in both directions after and before the residual search; new motion differs by more than
      a pixel along x or y
    - `step`: distance between points, pixels
    - `tolerance`: maximum forward-backward error of new motion, pixels
    - `weak`: weight of the smoothness at points with such motion; it is 1 at all others
    - `smoothness_weight`: out
    """
