"""Search for the most similar patch: the report's Algorithm 1 for both directions in one pass.

For one offset k, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` serves both fields: summed over the patch, it is
the score of k at x for A->B, and the score of -k at x + k for B->A. So every offset is computed once, row by row,
without storing a full-size image: only a row of sums across the patch, their sum down the last 2r + 1 rows, and two
comparisons. Some neighbouring offsets are processed together and share the reads of the pixels and of the best scores
so far.
"""

from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.binding import Array, Scratch, compiled


class BestOffsets(NamedTuple):
    """Best offset of every pixel of a frame so far."""

    similarity: Annotated[Array, "out score: int32|float32 (height, columns >= width + 2 * LANES)"]
    """Summed similarity, int32 (box) or float32 (weights), -1 at the start."""
    ranks: Annotated[Array, "out int32 (height, columns)"]
    """Rank of the best offset, 0 at the start."""


@lru_cache(maxsize=32)
def rank_offsets(search_radius: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Order all offsets (dx, dy) within a search radius R by length, so that the smallest motion wins a tie.

    Return the rank of each offset, at ``[dy + R, dx + R]``, (2R + 1, 2R + 1) int32, and the offset of each rank,
    (number of ranks, 2) float32. Both arrays are shared by all callers and read-only.
    """
    dy, dx = np.mgrid[-search_radius : search_radius + 1, -search_radius : search_radius + 1]
    order = np.argsort((dx * dx + dy * dy).ravel(), kind="stable")
    ranks = np.empty(order.size, np.int32)
    ranks[order] = np.arange(order.size)
    offsets = np.stack([dx.ravel()[order], dy.ravel()[order]], axis=-1).astype(np.float32)
    ranks.flags.writeable = offsets.flags.writeable = False
    return ranks.reshape(dx.shape), offsets


@compiled
def search(
    planes0: Annotated[Array, "float32 (3, rows == height + taps - 1, columns0 >= width + taps - 1 + 2 * LANES)"],
    planes1: Annotated[Array, "float32 (3, rows, columns1 >= width + taps - 1 + 4 * LANES)"],
    height: int,
    width: int,
    ranks: Annotated[Array, "int32 (offsets, offsets)"],
    prices: Annotated[Array, "score: int32|float32 (offsets, offsets)"],
    found01: BestOffsets,
    found10: BestOffsets,
    weights: Annotated[Array, "float32 (taps <= 2 * MAX_PATCH_RADIUS + 1,)"],
    scratch: Scratch = None,
) -> None:
    """Compare every pixel with those to which any offset leads, in both directions.

    With L = LANES, a search radius R and patches of (2r + 1) x (2r + 1) pixels:

    - `planes0`: scaled by `colour_scale`, edges repeated
    - `planes1`: the same; column L + r is the first of the image
    - `ranks`: (2R + 1, 2R + 1), from `rank_offsets`
    - `prices`: subtracted from the similarity; 0 for no motion
    - `found10`: column L is the first of the image
    - `weights`: those of one axis of a separable window, symmetric, (2r + 1,); not used if the similarity is int32,
      which is the sum over a box
    """
