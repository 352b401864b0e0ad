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

from fpsboost.kernels.binding import Array, compiled, scratch_of
from fpsboost.kernels.planes import LANES, PlanePair

STRIP_WIDTH = 640
"""Columns per pass: wide enough for a small overhead of the patch margins, narrow enough for the caches."""

OFFSETS_PER_PASS = 8
"""Neighbouring offsets processed together row by row."""

ROWS_AT_ONCE = 6
"""Windows with weights, one below the other, that share the reads of their rows."""


class BestOffsets(NamedTuple):
    """Best offset of every pixel of a frame so far."""

    similarity: Annotated[Array, "int32|float32 (height, columns)"]
    """Summed similarity, int32 (box) or float32 (weights), -1 at the start."""
    ranks: Annotated[Array, "int32 (height, columns)"]
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


def search(
    planes0: Array,
    planes1: Array,
    height: int,
    width: int,
    ranks: Array,
    prices: Array,
    found01: BestOffsets,
    found10: BestOffsets,
    weights: Array,
) -> None:
    """Compare every pixel with those to which any offset leads, in both directions.

    With L = LANES, a search radius R and patches of (2r + 1) x (2r + 1) pixels:

    - `planes0`: (3, H + 2r, W + 2r + 2L or more) float32, scaled by `colour_scale`, edges repeated
    - `planes1`: (3, H + 2r, W + 2r + 4L or more) float32, the same; column L + r is the first of the image
    - `ranks`: (2R + 1, 2R + 1) int32, from `rank_offsets`
    - `prices`: (2R + 1, 2R + 1), the type of the similarity, from which they are subtracted; 0 for no motion
    - `found01`: (H, W + L or more)
    - `found10`: (H, W + 2L or more); column L is the first of the image
    - `weights`: those of one axis of a separable window, symmetric, (2r + 1,) float32; not used if the similarity is
      int32, which is the sum over a box. r is at most 20
    """
    scratch = scratch_of(*search_scratch(weights.size, width, prices.dtype == np.int32))
    search_in(planes0, planes1, height, width, ranks, prices, found01, found10, weights, scratch)


@compiled
def search_in(
    planes0: Annotated[Array, "float32 (3, rows, columns)"],
    planes1: Annotated[Array, "float32 (3, rows, columns)"],
    height: int,
    width: int,
    ranks: Annotated[Array, "int32 (offsets, offsets)"],
    prices: Annotated[Array, "int32|float32 (offsets, offsets)"],
    found01: BestOffsets,
    found10: BestOffsets,
    weights: Annotated[Array, "float32 (size,)"],
    scratch: Annotated[Array, "uint8 (bytes)"],
) -> None:
    """Do the work of `search`, given memory for `search_scratch`."""


def search_scratch(size: int, width: int, is_box: bool) -> list[int]:
    """Return the bytes that `search_in` needs: the last rows and a further one of every offset, and all scores."""
    at_once = 1 if is_box else ROWS_AT_ONCE
    columns = (min(width, STRIP_WIDTH) + size + 4 * LANES) // (2 * LANES) * (2 * LANES)
    rows = 4 * (size + at_once - 1) * columns, 4 * columns
    return [*rows * OFFSETS_PER_PASS, 4 * at_once * OFFSETS_PER_PASS * (columns + 4 * LANES)]


class ShortestMotion(NamedTuple):
    """Motion that explains each point."""

    own: Annotated[Array, "float32 (points down, points across)"]
    """Similarity of the point's own motion, 0 to 1; negative where it leads out of the frame."""
    best: Annotated[Array, "float32 (points down, points across)"]
    """Largest similarity of all motions compared."""
    shortest: Annotated[Array, "float32 (points down, points across)"]
    """Larger component of the shortest motion whose similarity is sufficient, pixels."""


@compiled
def find_shortest(
    pair: PlanePair,
    step: int,
    patch_radius: int,
    support_radius: int,
    tolerance: np.float32,
    flow: Annotated[Array, "float32 (points down, points across, 2)"],
    motion: ShortestMotion,
) -> None:
    """Compare each point's motion with the motions of the points around it, and with zero motion.

    In a repeated pattern, many motions are equally similar, and a search for the most similar patch returns any of
    them. Comparison with the shorter motions of the surroundings shows which length is necessary.

    - `pair`: float32, scaled by `colour_scale`; the padding is larger than the radius, and there are LANES columns more
      on the right
    - `step`: distance between points, pixels
    - `patch_radius`: radius r of the compared patch, at most 7 pixels
    - `support_radius`: points in each direction whose motion is compared
    - `tolerance`: amount by which the similarity of a shorter motion may be lower
    - `flow`: rounded to whole pixels for the comparison
    - `motion`: out
    """
