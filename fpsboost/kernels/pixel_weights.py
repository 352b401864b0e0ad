"""Weights of the pixels of a window: how similar both frames are along each candidate motion of its node.

The weight of a candidate at a pixel is its prior weight, by its votes, times an exponential of the report's patch
similarity of the two samples at time t: non-local means over motions instead of over places. Weights are computed on
squares of two by two pixels, and interpolated.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import VALUES_PER_MOTION
from fpsboost.kernels.instruction import Index, fma
from fpsboost.kernels.jit import FINITE_JIT, LANES, njit
from fpsboost.kernels.window_rows import END_WEIGHT, SQUARES_PER_ROW, blend_rows, pool_row, sum_five, upsample_rows
from fpsboost.kernels.window_samples import AREA, WINDOW, Room

SQUARES_PER_WINDOW = SQUARES_PER_ROW * SQUARES_PER_ROW
"""Number of squares of two by two pixels in a window; each square has one weight."""

PATCH_RADIUS = 2
"""Radius of the patches that are compared at time t, squares; patches are truncated at the border of their window."""

PADDED = SQUARES_PER_ROW + 2 * PATCH_RADIUS
"""Squares in a row of a window with zero padding on both sides, for sums over patches."""

MIN_WEIGHT_SUM = np.float32(1e-30)
"""Initial value of sums of weights, which keeps them above zero."""


class Weighting(NamedTuple):
    """How the candidates of a node are weighted."""

    scale: np.float32
    """Factor on squared colour differences."""
    sharpness: np.float32
    """Rate at which a candidate's weight decays as its similarity falls."""
    sufficient_similarity: np.float32
    """Similarity at which, once every pixel of a window has it, the candidates with fewer votes are skipped."""
    min_vote_share: np.float32
    """Remaining candidates are also skipped once the votes of the next one are below this share of the least
    accumulated weight of any pixel."""
    window_shape: NDArray[Any]
    """Of `fpsboost.kernels.multi_hypothesis`; (SQUARES_PER_WINDOW,) float32, as `patch_shares`."""
    patch_shares: NDArray[Any]


class NodeSums(NamedTuple):
    """Sums over the candidates of a node, each (SQUARES_PER_WINDOW,) float32."""

    weights: NDArray[Any]
    similarities: NDArray[Any]
    """Weighted sum."""
    most_similar: NDArray[Any]
    """Largest similarity of any candidate."""


class Work(NamedTuple):
    """Work arrays for a node; those without a shape are (SQUARES_PER_WINDOW,) float32."""

    room: Room
    squared: NDArray[Any]
    """Squared difference of each square along a candidate."""
    padded: NDArray[Any]
    half_way: NDArray[Any]
    """Both for `sum_patches`."""
    similarity: NDArray[Any]
    """Sum of the similarities in the patch around each square."""
    weight: NDArray[Any]
    """Weight of a candidate, or of the window."""
    upsampled: NDArray[Any]
    """Weight and sums of each sample of a window, (AREA,) float32."""
    values: NDArray[Any]
    further_motion: NDArray[Any]
    """(VALUES_PER_MOTION,) float32."""


@njit(**FINITE_JIT)
def decay(x):
    """Return exp(-x) for x >= 0, accurate to a millionth: a polynomial of x / 64, squared six times."""
    x = min(x, np.float32(60)) * np.float32(1 / 64)
    half, sixth, one = np.float32(0.5), np.float32(1 / 6), np.float32(1)
    p = fma(x, np.float32(-1 / 120), np.float32(1 / 24))
    p = fma(fma(fma(fma(p, x, -sixth), x, half), x, -one), x, one)
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p * p


@njit(**FINITE_JIT)
def start_node(sums):
    """Clear the sums over the candidates of a node."""
    weights, similarities, most_similar = sums
    weights[:] = MIN_WEIGHT_SUM
    similarities[:] = 0
    most_similar[:] = 0


@njit(**FINITE_JIT)
def pool_pixels(distance, squared):
    """Write the mean over the pixels of each square of a window."""
    squared[:] = 0
    for j in range(SQUARES_PER_ROW):
        pool_row(distance, 2 * j * WINDOW, WINDOW, np.float32(0.25), squared, j * SQUARES_PER_ROW)


@njit(**FINITE_JIT)
def pool_chroma(values, down, pooled):
    """Add the mean of its one or two chroma samples to each square of a window."""
    if down == 2:
        for i in range(Index(SQUARES_PER_WINDOW)):
            pooled[i] += values[i]
    else:
        for j in range(SQUARES_PER_ROW):
            begin, to = Index(2 * j * SQUARES_PER_ROW), Index(j * SQUARES_PER_ROW)
            for i in range(Index(SQUARES_PER_ROW)):
                pooled[to + i] += np.float32(0.5) * (values[begin + i] + values[begin + Index(SQUARES_PER_ROW) + i])


@njit(inline="always", **FINITE_JIT)
def weigh_candidate(prior, weighting, work, sums):
    """Compute the weights of a candidate from the squared differences in the work arrays, which are overwritten.

    Return the least weight of any square so far, and the least of the largest similarities.
    """
    squared, similarity = work.squared, work.similarity
    weights, _, most_similar = sums
    for i in range(SQUARES_PER_WINDOW):
        squared[i] = decay(squared[i] * weighting.scale)
    sum_patches(squared, work.padded, work.half_way, similarity)
    weigh_squares(prior, weighting.sharpness, similarity, weighting.patch_shares, work.weight, sums)
    return smallest(weights, squared), smallest(most_similar, squared)


@njit(**FINITE_JIT)
def sum_patches(values, padded, half_way, sums):
    """Sum the values over the patch around each square of a window, vertically, then horizontally.

    `padded` and `half_way` have zeros around the window.
    """
    for i in range(Index(SQUARES_PER_WINDOW)):
        padded[Index(PATCH_RADIUS * SQUARES_PER_ROW) + i] = values[i]
    for j in range(SQUARES_PER_ROW):
        sum_five(padded, j * SQUARES_PER_ROW, SQUARES_PER_ROW, half_way, j * PADDED + PATCH_RADIUS)
    for j in range(SQUARES_PER_ROW):
        sum_five(half_way, j * PADDED, 1, sums, j * SQUARES_PER_ROW)


@njit(**FINITE_JIT)
def weigh_squares(prior, sharpness, similarity, patch_shares, weight, sums):
    """Compute the weights of a candidate from the similarities in its patches, and add them to the sums of the node."""
    weights, similarities, most_similar = sums
    for i in range(SQUARES_PER_WINDOW):
        mean = similarity[i] * patch_shares[i]
        w = prior * decay(sharpness * (np.float32(1) - mean))
        weight[i] = w
        weights[i] += w
        similarities[i] = fma(w, mean, similarities[i])
        most_similar[i] = max(most_similar[i], mean)


@njit(**FINITE_JIT)
def smallest(values, room):
    """Return the minimum of a window's values, computed by repeated halving.

    A compiler does not reorder comparisons, and a sequential minimum would be limited by their latency.
    """
    size = SQUARES_PER_WINDOW // 2
    for i in range(size):
        room[i] = min(values[i], values[i + size])
    while size > LANES:
        size //= 2
        for i in range(size):
            room[i] = min(room[i], room[i + size])
    least = room[0]
    for i in range(1, LANES):
        least = min(least, room[i])
    return least


@njit(**FINITE_JIT)
def upsample_squares(squares, across, down, upsampled):
    """Interpolate the values of the squares at each sample, of `across` x `down` pixels.

    Without interpolation, steps would be visible where no candidate fits.
    """
    for j in range(WINDOW // down):
        row = j * down // 2
        near, far = row * SQUARES_PER_ROW, min(max(row + 2 * (j % 2) - 1, 0), SQUARES_PER_ROW - 1) * SQUARES_PER_ROW
        if across == 1:
            upsample_rows(squares, near, far, upsampled, j * WINDOW)
        elif down == 1:
            blend_rows(squares, near, far, upsampled, j * SQUARES_PER_ROW)
        else:
            blend_rows(squares, near, near, upsampled, j * SQUARES_PER_ROW)


def make_work() -> Work:
    """Return the work arrays for a node."""
    room = Room(*(np.empty(size, np.float32) for size in ((WINDOW + 3) * WINDOW, AREA, AREA, 16, (4, WINDOW))))
    return Work(
        room,
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.zeros(PADDED * SQUARES_PER_ROW, np.float32),
        np.zeros(PADDED * SQUARES_PER_ROW, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.empty(AREA, np.float32),
        np.empty(AREA, np.float32),
        np.empty(VALUES_PER_MOTION, np.float32),
    )


def make_sums() -> NodeSums:
    """Return the sums over the candidates of a node."""
    return NodeSums(*(np.empty(SQUARES_PER_WINDOW, np.float32) for _ in range(3)))


@cache
def patch_shares() -> np.ndarray:
    """Return 1 over the weight of the squares of each patch within its window, (SQUARES_PER_WINDOW,) float32."""
    length = np.convolve(np.ones(SQUARES_PER_ROW), [END_WEIGHT, 1, 1, 1, END_WEIGHT], mode="same")
    return (1 / np.outer(length, length)).ravel().astype(np.float32)
