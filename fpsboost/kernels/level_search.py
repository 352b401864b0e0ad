"""Search of one level of the pyramid in one or both directions: compare the proposed motions, and choose among them.

`search_level` does all steps in one kernel, as Python would take as long as the kernel between its steps where levels
are small.

Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
and the neighbours of those in it are therefore collected once, and the similarity of each of them is computed over the
whole tile and summed around each point: the cost is that of a few dozen offsets, whatever the search range.

Each point keeps its most similar offsets, one per local maximum: in a repeated pattern, several are equally similar,
and only the neighbours can tell which one is correct.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float, Scratch, compiled
from fpsboost.kernels.constants import LANES, TILE
from fpsboost.kernels.planes import PlanePair

PADDING = TILE + LANES
"""Maximum distance beyond the frame at which a tile may be compared, pixels."""


class Proposals(NamedTuple):
    """Motion that a coarser level proposes, at places `spacing` pixels apart, the first at spacing / 2."""

    motion: Annotated[
        Array,
        "int32 (places_down >= 1 and padding >= TILE + LANES + patch_radius, "
        "places_across >= 1 and patch_radius <= MAX_TILE_PATCH_RADIUS, 2)",
    ]
    """``(dx, dy)``."""
    expected: Annotated[Array, "int32 (places_down, places_across, 2)"]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero."""
    spacing: int


class OffsetLists(NamedTuple):
    """Most similar offsets of each point in decreasing order, at points `step` pixels apart, the first at step / 2."""

    listed: Annotated[Array, "out int32 (down == -(-height // step), across == -(-width // step))"]
    """Number of offsets of each point."""
    similarity: Annotated[Array, "out float32 (down, across, capacity)"]
    """Mean similarity."""
    flow: Annotated[Array, "out float32 (down, across, capacity, 2)"]
    """Offsets, whole pixels."""
    detail: Annotated[Array, "out float32 (down, across)"]
    """Similarity with itself that the patch loses by one pixel along x and one along y, together."""


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
    smoothness_weight: Annotated[Array, "float32 (2, down, across)"]
    """Weight of the smoothness at the points there."""


class LevelSettings(NamedTuple):
    """Settings of the search of a level.

    `max_offset` and `patch_radius` are described in `search_tiles`, `smoothness` and `slope` in `choose_labels`.
    Offsets within one pixel of each proposal are compared, as the neighbours of an offset tell its similarity at the
    best fraction of a pixel, and every second row of the patches where points are 8 pixels apart and more.
    """

    scale: Float
    """Pixels of this level per pixel of the coarser one."""
    spacing: int
    """Distance between the places of the coarser level, pixels of this one."""
    step: int
    max_offset: int
    patch_radius: int
    labels: int
    """Offsets among which that of a point is chosen."""
    smoothness: Float
    slope: Float


class Points(NamedTuple):
    """Motion in both directions, or from frame 0 alone, at points `step` pixels apart, the first at step / 2."""

    flow: Annotated[Array, "out float32 (directions <= 2, rows == -(-height // step), columns == -(-width // step), 2)"]
    similarity: Annotated[Array, "out float32 (directions, rows, columns)"]


@compiled
def search_tiles(
    pair: PlanePair,
    proposals: Proposals,
    step: int,
    refine_radius: int,
    max_offset: int,
    patch_radius: int,
    row_step: int,
    lists: OffsetLists,
    scratch: Scratch = None,
) -> None:
    """Find the most similar offsets, at least one, at every point of a frame.

    An offset that is more similar than a listed neighbour replaces it, so that most are local maxima.

    - `pair`: in levels, padded by PADDING + patch_radius and LANES more on the right
    - `step`: distance between points, pixels; a divisor of TILE
    - `refine_radius`, `max_offset`: search range around each proposal, along x and y together, and maximum offset along
      x and y, pixels
    - `patch_radius`: radius r of the patch of (2r + 1) x (2r + 1) pixels, at most 10
    - `row_step`: 1, or 2 to compare every second row of the patches; then `step` is a multiple of 4
    """


@compiled
def compare_labels(pair: PlanePair, step: int, patch_radius: int, lists: OffsetLists) -> None:
    """Correct the similarities that `search_tiles` found for what sampling hides, where a fine pattern has rivals.

    An offset misses the motion by up to half a pixel, and a fine pattern is then more similar some periods away, where
    it happens to lie on whole pixels. At points with a detail of 0.3 and more, all offsets that half a pixel along both
    axes may make the most similar one are compared at their best fraction of a pixel, by a least-squares step. Those
    that then differ by no more than a quarter of a pixel may explain, and by a period of the pattern in the frame
    itself, get nearly the same similarity, so that their neighbours decide. Those that lead the patch out of the frame
    by a period get the same one, however much they differ.
    """


@compiled
def search_level(
    pair: PlanePair,
    coarse: CoarseMotion,
    settings: LevelSettings,
    points: Points,
    scratch: Scratch = None,
) -> None:
    """Find the motion of points in whole pixels, around the motion that a coarser level proposes.

    The pair is as for `search_tiles`; the points are written: their motion in both directions, or in the first alone.
    """


@compiled
def choose_labels(
    count: Annotated[Array, "int32 (rows, columns)"],
    motions: Annotated[Array, "float32 (rows, columns, capacity, 2)"],
    similarity: Annotated[Array, "float32 (rows, columns, capacity)"],
    smoothness_weight: Annotated[Array, "float32 (rows, columns)"],
    smoothness: Float,
    slope: Float,
    costs: Annotated[Array, "out float32 (rows, columns, padded == (capacity + 7) // 8 * 8)"],
    flow: Annotated[Array, "out float32 (rows, columns, 2)"],
    chosen: Annotated[Array, "out float32 (rows, columns)"],
    scratch: Scratch = None,
) -> None:
    """Choose the label of every node with the lowest cost, aggregated over its neighbours; the first of several.

    This is semi-global matching (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13): the cost of a label is
    aggregated along four paths, from the left, the right, above and below. Along each path, every change of motion has
    a cost, up to a limit, so that motion may be discontinuous at the edge of an object. Every node has its own short
    list of labels instead of a common one.

    - `count`: labels of each node, at least one
    - `motions`: ``(dx, dy)`` of each label, pixels; undefined beyond `count`
    - `similarity`: of each label; its negative is the cost at the node
    - `smoothness_weight`: of each node, between two the smaller of both
    - `smoothness`, `slope`: maximum cost of a change of motion between neighbours, and its cost per pixel
    - `costs`: of the paths to each label, out
    - `flow`, `chosen`: motion and similarity of the chosen label, out
    """
