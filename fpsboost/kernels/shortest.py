"""Search for the shortest motion around each point that explains the point about as well as its own motion.

In a repeated pattern, many motions are equally similar, and a search for the most similar patch returns any of them.
Comparison with the shorter motions of the surroundings shows which length is necessary.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float, compiled
from fpsboost.kernels.planes import PlanePair


class ShortestMotion(NamedTuple):
    """Motion that explains each point."""

    own: Annotated[Array, "out float32 (down, across and patch_radius < padding)"]
    """Similarity of the point's own motion, 0 to 1; negative where it leads out of the frame."""
    best: Annotated[Array, "out float32 (down, across)"]
    """Largest similarity of all motions compared."""
    shortest: Annotated[Array, "out float32 (down, across)"]
    """Larger component of the shortest motion whose similarity is sufficient, pixels."""


@compiled
def find_shortest(
    pair: PlanePair,
    step: int,
    patch_radius: int,
    support_radius: int,
    tolerance: Float,
    flow: Annotated[Array, "float32 (down == -(-height // step), across == -(-width // step), 2)"],
    motion: ShortestMotion,
) -> None:
    """Compare each point's motion with the motions of the points around it, and with zero motion.

    - `pair`: float32, scaled by `colour_scale`; the padding is larger than the radius, and there are LANES columns more
      on the right
    - `step`: distance between points, pixels
    - `patch_radius`: radius r of the compared patch, at most 7 pixels
    - `support_radius`: points in each direction whose motion is compared
    - `tolerance`: amount by which the similarity of a shorter motion may be lower
    - `flow`: rounded to whole pixels for the comparison
    - `motion`: out
    """
