"""Block matching as in video coding: for every block of one frame, find the best-matching block of the other frame.

The best match has the lowest sum of absolute differences; of equally good matches, the nearest one. Images are given as
rows of values with the channels of a pixel side by side, so that a row of a block is contiguous in memory.
"""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, compiled


class SearchPlan(NamedTuple):
    """Passes and offsets that `match_blocks` tries."""

    offsets: Annotated[Array, "int32 (offsets, 2)"]
    """``(dy, dx)`` to try relative to the best position so far, pass by pass; the first is no motion."""
    turns: Annotated[Array, "int32 (ends == turns + 1,)"]
    """Pass k tries ``offsets[turns[k]:turns[k + 1]]``, all relative to the best position before the pass."""
    repeated: Annotated[Array, "bool (turns,)"]
    """Whether a pass is repeated for as long as it finds a better position."""


@compiled
def match_blocks(
    rows0: Annotated[Array, "pixel: uint8|uint16|float32 (height, values)"],
    rows1: Annotated[Array, "pixel: uint8|uint16|float32 (height, values)"],
    channels: int,
    block_size: int,
    search_range: int,
    plan: SearchPlan,
    motion: Annotated[Array, "out int32 (rows == -(-height // block_size), columns, 2)"],
    difference: Annotated[
        Array, "out pixel: int64|int64|float32 (rows, columns == -(-values // channels // block_size))"
    ],
) -> None:
    """Find the best match in the second image for every block of the first.

    - `rows0`, `rows1`: (H, W * channels)
    - `block_size`: side of a block, pixels; blocks at the right and at the bottom edge may be smaller
    - `search_range`: largest motion along x and y, pixels; positions outside of the frame are not considered
    - `motion`: ``(dx, dy)``, out
    - `difference`: sums of absolute differences, int64, for float images float32, out
    """
