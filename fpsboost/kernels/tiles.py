"""Search by tiles over the distinct offsets that a coarser level proposes, at points several pixels apart.

Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
and their neighbours are therefore collected once, and the similarity of each of them is computed over the whole tile
and summed around each point: the cost is that of a few dozen offsets, whatever the search range.

Each point keeps its most similar offsets, one per local maximum: in a repeated pattern, several are equally similar,
and only the neighbours can tell which one is correct.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Scratch, compiled
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

    listed: Annotated[Array, "int32 (down == -(-height // step), across == -(-width // step))"]
    """Number of offsets of each point."""
    similarity: Annotated[Array, "float32 (down, across, capacity)"]
    """Mean similarity."""
    flow: Annotated[Array, "float32 (down, across, capacity, 2)"]
    """Offsets, whole pixels."""


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
    scratch: Scratch | None = None,
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
