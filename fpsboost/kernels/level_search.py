"""Search of one level of the pyramid in both directions: compare the proposed motions, and choose among them.

It is one kernel, as Python would take as long as the kernel between its steps where levels are small.
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, Scratch, compiled
from fpsboost.kernels.planes import PlanePair


class CoarseMotion(NamedTuple):
    """Motion in both directions that a coarser level proposes, at places `spacing` pixels apart."""

    proposed: Annotated[
        Array,
        "float32 (2, down >= -(-height // spacing) and padding >= TILE + LANES + patch_radius, "
        "across >= -(-width // spacing) and patch_radius <= MAX_TILE_PATCH_RADIUS, 2)",
    ]
    """Motion in pixels of that level."""
    expected: Annotated[Array, "float32 (2, down, across, 2)"]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero."""
    ties: Annotated[Array, "float32 (2, down, across)"]
    """Share of the smoothness that applies to the points there."""


class LevelSettings(NamedTuple):
    """Settings of the search of a level.

    The radii, `max_offset` and `row_step` are described in `fpsboost.kernels.tiles.search_tiles`, `smoothness` and
    `slope` in `choose_labels`.
    """

    scale: np.float32
    """Pixels of this level per pixel of the coarser one."""
    spacing: int
    """Distance between the places of the coarser level, pixels of this one."""
    step: int
    refine_radius: int
    max_offset: int
    patch_radius: int
    row_step: int
    labels: int
    """Offsets among which that of a point is chosen."""
    smoothness: np.float32
    slope: np.float32


class Points(NamedTuple):
    """Motion in both directions at points `step` pixels apart, the first at step / 2."""

    flow: Annotated[Array, "float32 (2, rows == -(-height // step), columns == -(-width // step), 2)"]
    similarity: Annotated[Array, "float32 (2, rows, columns)"]


@compiled
def search_level(
    pair: PlanePair,
    coarse: CoarseMotion,
    settings: LevelSettings,
    points: Points,
    scratch: Scratch | None = None,
) -> None:
    """Find the motion of points in both directions, in whole pixels, around the motion that a coarser level proposes.

    The pair is as for `fpsboost.kernels.tiles.search_tiles`; the points are written.
    """


@compiled
def choose_labels(
    count: Annotated[Array, "int32 (rows, columns)"],
    motions: Annotated[Array, "float32 (rows, columns, capacity, 2)"],
    similarity: Annotated[Array, "float32 (rows, columns, capacity)"],
    ties: Annotated[Array, "float32 (rows, columns)"],
    smoothness: np.float32,
    slope: np.float32,
    costs: Annotated[Array, "float32 (rows, columns, padded == (capacity + 7) // 8 * 8)"],
    flow: Annotated[Array, "float32 (rows, columns, 2)"],
    chosen: Annotated[Array, "float32 (rows, columns)"],
    scratch: Scratch | None = None,
) -> None:
    """Choose the label of every node with the lowest cost, aggregated over its neighbours; the first of several.

    This is semi-global matching (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13): the cost of a label is
    aggregated along four paths, from the left, the right, above and below. Along each path, every change of motion has
    a cost, up to a limit, so that motion may be discontinuous at the edge of an object. Every node has its own short
    list of labels instead of a common one.

    - `count`: labels of each node, at least one
    - `motions`: ``(dx, dy)`` of each label, pixels; undefined beyond `count`
    - `similarity`: of each label; its negative is the cost at the node
    - `ties`: share of the smoothness that applies to a node, between two the smaller of both
    - `smoothness`, `slope`: maximum cost of a change of motion between neighbours, and its cost per pixel
    - `costs`: of the paths to each label, out
    - `flow`, `chosen`: motion and similarity of the chosen label, out
    """
