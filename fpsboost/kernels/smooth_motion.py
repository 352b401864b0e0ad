"""Pictures along motion that is interpolated between points: samples of one, and weighted sums of several.

Neither the motion of every pixel nor its weight is stored: both are interpolated row by row from the values of points,
or of a smaller picture. Samples are those of the usual cubic filter over 4 x 4 pixels (Keys 1981,
doi:10.1109/TASSP.1981.1163711, with a = -0.75), at positions rounded to `FRACTIONS` of a pixel; edges are repeated.

Motion and places are in units of a picture's width and height, so that they hold for pictures of any size. The layout
of points is ``((spacing_x, spacing_y), (left, top))``: the distances between them, and the corner from which the first
one lies half of these away.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Scratch, compiled


class SmoothMotion(NamedTuple):
    """Motion of points, between which it is interpolated."""

    vectors: Annotated[Array, "float32 (down >= 1, across >= 1, 2)"]
    """``(dx, dy)``."""
    layout: Annotated[Array, "float32 (2, 2)"]


@compiled
def sample_along(
    picture: Annotated[Array, "float32 (height, width, channels <= 4)"],
    motion: SmoothMotion,
    sampled: Annotated[Array, "out float32 (height, width, channels)"],
    scratch: Scratch = None,
) -> None:
    """Write the values at the end of the motion from each pixel."""


@compiled
def add_along(
    picture: Annotated[Array, "float32 (height, width, channels <= 4)"],
    motion: SmoothMotion | None,
    weights: Annotated[Array, "float32 (rows >= 1, columns >= 1)"],
    layout: Annotated[Array, "float32 (2, 2)"],
    total: Annotated[Array, "out float32 (height, width, channels)"],
    sums: Annotated[Array, "out float32 (height, width, 1)"],
    scratch: Scratch = None,
) -> None:
    """Add the weighted values at the end of the motion from each pixel, or those of the pixel itself without motion.

    - `weights`, `layout`: weights of points, between which they are interpolated, and the layout of these
    - `total`, `sums`: of the weighted values and of the weights, updated in place
    """
