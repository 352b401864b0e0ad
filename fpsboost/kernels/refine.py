"""Subpixel refinement of motion: weighted least-squares steps at every point (Lucas and Kanade 1981)."""

from typing import Annotated

from fpsboost.kernels.binding import Array, Float, compiled
from fpsboost.kernels.planes import PlanePair


@compiled
def refine_bidirectional(
    pair: PlanePair,
    step: int,
    tail: Float,
    damping: Float,
    largest: Float,
    steps: int,
    refined: Annotated[Array, "float32 (2, down, across, 2) or empty"],
    flow: Annotated[Array, "out float32 (directions <= 2, down == -(-height // step), across == -(-width // step), 2)"],
) -> None:
    """Refine the vector of every point of both frames, or of frame 0 alone, by least-squares steps on its window.

    A vector is moved to minimise the difference of the two frames in the window. Each pixel of the window is weighted
    by its similarity, as in the search, so that another object in it has no influence.

    - `pair`: in levels, with at least 8 columns more on the right
    - `step`: distance between points, pixels
    - `tail`: rate at which the weight of a pixel falls with its squared difference in levels
    - `damping`: added to the squared gradients; prevents steps in flat areas
    - `largest`: maximum step along x and y, pixels
    - `steps`: maximum number of steps: a vector whose rounded value changes is rounded and refined again
    - `refined`: vectors that were refined before, or none of any frame; a vector that rounds to the same whole pixels
      takes that value
    - `flow`: motion in both directions, or in the first alone, rounded to whole pixels at first; updated in place
    """
