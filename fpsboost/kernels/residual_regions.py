"""Residual search at full size for things of a few pixels, which are smaller than any patch."""

from typing import Annotated

from fpsboost.kernels.binding import Array, Scratch, compiled
from fpsboost.kernels.planes import PlanePair


@compiled
def match_residual_regions(
    pair: PlanePair,
    step: int,
    max_offset: int,
    flow: Annotated[Array, "out float32 (2, down == -(-height // step), across == -(-width // step), 2)"],
    similarity: Annotated[Array, "out float32 (2, down, across)"],
    scratch: Scratch = None,
) -> None:
    """Give the points of things of a few pixels their motion.

    Where such a thing is, and where it will be, neither frame explains the other. Connected regions of such pixels,
    which stand out from their surroundings more than their place in the other frame does, are compared with those of
    the other frame. Two that are most similar to each other, by far and not to a place near by, are the same thing. So
    is what a point of the other frame has found at a region, if that is the best match.

    - `pair`: in levels; padding of at least one pixel
    - `step`: distance between points, pixels
    - `max_offset`: maximum offset along x and y, pixels
    - `flow`, `similarity`: of the points in both directions; updated in place where a thing is found
    """
