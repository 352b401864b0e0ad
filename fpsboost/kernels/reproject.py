"""Source pixels of an in-between pixel: the report's two searches (section 3), and splatting as in video coding.

In all kernels, `flow` is the motion of the source frame, and `t` the distance in time from it, in intervals. Sources
are written as ``y * W + x``, and `lands` tells whether a source lands on the target pixel.
"""

from typing import Annotated

from fpsboost.kernels.binding import Array, Float, compiled


@compiled
def search_iteratively(
    flow: Annotated[Array, "float32 (height, width, 2)"],
    t: Float,
    iterations: int,
    source: Annotated[Array, "out int32 (height, width)"],
    lands: Annotated[Array, "out bool (height, width)"],
) -> None:
    """Search the source pixels by fixed-point iteration (Yang et al. 2011): q <- p - t m(q), until q lands on p.

    The iteration starts from q = p. Without success, the result of the first of the iterations is used.
    """


@compiled
def bin_landings(
    flow: Annotated[Array, "float32 (height, width, 2)"],
    t: Float,
    starts: Annotated[Array, "out int32 (ends == height * width + 1,)"],
    members: Annotated[Array, "out int32 (pixels == height * width,)"],
) -> None:
    """Sort all source pixels by the pixel on which they land at time t, in raster order within such a cell.

    Landing positions outside of the frame are assigned to the nearest cell inside. The members of cell c, pixels as ``y
    * W + x``, are ``members[starts[c]:starts[c + 1]]``, out.
    """


@compiled
def search_nearest_landing(
    flow: Annotated[Array, "float32 (height, width, 2)"],
    t: Float,
    search_radius: int,
    starts: Annotated[Array, "int32 (ends == height * width + 1,)"],
    members: Annotated[Array, "int32 (pixels == height * width,)"],
    source: Annotated[Array, "out int32 (height, width)"],
    lands: Annotated[Array, "out bool (height, width)"],
) -> None:
    """Search all sources within the radius, along x and y, for the one that lands nearest to the target: exact brute
    force.

    Cells of `bin_landings` are visited in square rings around the target until no further ring can hold a nearer
    landing position, so that the cost depends on how evenly the landing positions are distributed and not on the
    radius. Of sources that land equally near, the one nearest to the target wins, whatever the direction of the motion,
    and of several such sources the first in raster order.
    """


@compiled
def fetch_both(
    image0: Annotated[Array, "pixel: uint8|uint16|float32 (height, width, channels)"],
    image1: Annotated[Array, "pixel: uint8|uint16|float32 (height, width, channels)"],
    t: Float,
    half: Float,
    source0: Annotated[Array, "int32 (height, width)"],
    lands0: Annotated[Array, "bool (height, width)"],
    source1: Annotated[Array, "int32 (height, width)"],
    lands1: Annotated[Array, "bool (height, width)"],
    out: Annotated[Array, "out pixel: uint8|uint16|float32 (height, width, channels)"],
) -> None:
    """Write the colour of every target: both sources blended in time, or the only source that lands on it.

    `half` is 0.5 to round integers, else 0.
    """


@compiled
def splat(
    flow: Annotated[Array, "float32 (height, width, 2)"],
    similarity: Annotated[Array, "float32 (height, width)"],
    least_similarity: Float,
    t: Float,
    source0: Annotated[Array, "out int32 (height, width)"],
    source1: Annotated[Array, "out int32 (height, width)"],
) -> None:
    """Find the most similar pixel that lands on each target at time t, and its position in both frames.

    Where no pixel of at least that similarity lands, both positions are the target itself. Of equally similar pixels,
    the first in raster order is found; its position in frame 1 is clamped to the frame.
    """
