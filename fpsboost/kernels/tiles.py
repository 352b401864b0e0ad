"""Search by tiles over the distinct offsets that a coarser level proposes, at points several pixels apart.

Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
and their neighbours are therefore collected once, and the similarity of each of them is computed over the whole tile
and summed around each point: the cost is that of a few dozen offsets, whatever the search range.

Each point keeps its most similar offsets, one per local maximum: in a repeated pattern, several are equally similar,
and only the neighbours can tell which one is correct.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.planes import LANES, PlanePair

TILE = 32
"""Side of a tile, pixels."""

PROPOSAL_MARGIN = 8
"""Distance beyond the tile within which proposals are collected, pixels."""

PADDING = TILE + LANES
"""Maximum distance beyond the frame at which a tile may be compared, pixels."""

VALUES_PER_ENTRY = 3
"""Number of values per entry of a list: similarity, dx, dy."""

EIGHT = 8
"""Numbers of a vector: points whose lists are kept together, and labels whose costs are computed together."""


class Proposals(NamedTuple):
    """Motion that a coarser level proposes, at places `spacing` pixels apart, the first at spacing / 2."""

    motion: Annotated[Array, "int32 (places down, places across, 2)"]
    """``(dx, dy)``."""
    expected: Annotated[Array, "int32 (places down, places across, 2)"]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero."""
    spacing: int


class OffsetLists(NamedTuple):
    """Most similar offsets of each point in decreasing order, at points `step` pixels apart, the first at step / 2."""

    listed: Annotated[Array, "int32 (points down, points across)"]
    """Number of offsets of each point."""
    similarity: Annotated[Array, "float32 (points down, points across, capacity)"]
    """Mean similarity."""
    flow: Annotated[Array, "float32 (points down, points across, capacity, 2)"]
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
    scratch: Annotated[Array, "uint8 (bytes)"],
) -> None:
    """Find the most similar offsets, at least one, at every point of a frame.

    An offset that is more similar than a listed neighbour replaces it, so that most are local maxima.

    - `pair`: in levels, padded by PADDING + patch_radius and LANES more on the right
    - `step`: distance between points, pixels; a divisor of TILE
    - `refine_radius`, `max_offset`: search range around each proposal, along x and y together, and maximum offset along
      x and y, pixels
    - `patch_radius`: radius r of the patch of (2r + 1) x (2r + 1) pixels, at most 10
    - `row_step`: 1, or 2 to compare every second row of the patches; then `step` is a multiple of 4
    - `scratch`: by `fpsboost.kernels.binding.scratch_of` of `tile_scratch`
    """


def tile_scratch(step: int, refine_radius: int, max_offset: int, spacing: int, capacity: int) -> tuple[int, int, int]:
    """Return the bytes that `search_tiles` needs: flags of all offsets, offsets of a tile, and lists of its points."""
    offsets, places = (2 * max_offset + 1) ** 2, (TILE + 2 * PROPOSAL_MARGIN) // spacing + 2
    proposed = 1 + ((2 * refine_radius + 1) * places) ** 2
    points = max((TILE // step) ** 2, EIGHT)
    return offsets, 8 * min(offsets, proposed), 4 * VALUES_PER_ENTRY * capacity * points
