"""Weights of the pixels of a window: how similar both frames are along each candidate motion of its node.

The weight of a candidate at a pixel is its prior weight, by its votes, times an exponential of the report's patch
similarity of the two samples at time t: non-local means over motions instead of over places. Weights are computed on
squares of two by two pixels, and interpolated.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import VALUES_PER_MOTION
from fpsboost.kernels.fusion_features import (
    CELL,
    CELL_FEATURES,
    CELLS,
    SCALAR_FEATURES,
    SQUARE_FEATURES,
    FeatureWork,
    average_patches,
    make_feature_work,
    rows_of_cells,
    spread_across,
    write_decay,
)
from fpsboost.kernels.instruction import Index, fma
from fpsboost.kernels.jit import FINITE_JIT, LANES, njit
from fpsboost.kernels.window_rows import (
    CELLS_PER_ROW,
    SQUARES_PER_ROW,
    SQUARES_PER_WINDOW,
    add_feature_row,
    blend_rows,
    pool_row,
    scale_row,
    upsample_rows,
)
from fpsboost.kernels.window_samples import AREA, WINDOW, Room

MIN_WEIGHT_SUM = np.float32(1e-30)
"""Initial value of sums of weights, which keeps them above zero."""

HIGHEST_LOGIT = np.float32(20)
"""Logarithms of weights are limited to this."""

FOREGROUND_SCALE = np.float32(4)
"""Factor on squared differences for a bandwidth of 0.15 instead of 0.3, at which thin things count as matched."""

FOREGROUND_SHARPNESS = np.float32(10)
"""Logarithm of the factor on the weight of what is certainly in front of the dominant motion of its window."""

HIGHEST_GAIN = np.float32(math.exp(FOREGROUND_SHARPNESS))
"""Factor itself."""

FOREGROUND_AGREEMENT = np.float32(3)
"""Factor on the agreement with the motion fields, which is 1 up to 2 pixels: along an edge motion is ambiguous."""


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
    """Of `fpsboost.kernels.multi_hypothesis`; (SQUARES_PER_WINDOW,) float32."""
    even: NDArray[Any]
    """Coefficients of the features, (rows, FEATURES) float32, of sums of them: for both frames along a candidate, for
    either alone, and for each hinge; plain weights need none."""
    odd: NDArray[Any]
    """What is added to these coefficients for frame 0, and subtracted for frame 1, likewise."""
    factors: NDArray[Any]
    """Of each row the coefficients and the factors that `add_feature_row` takes, (rows * 10,) float32."""


class NodeSums(NamedTuple):
    """Sums over the candidates of a node, each (SQUARES_PER_WINDOW,) float32."""

    weights: NDArray[Any]
    similarities: NDArray[Any]
    """Weighted sum."""
    most_similar: NDArray[Any]
    """Largest similarity of any candidate."""
    reached: NDArray[Any]
    """Plain weights, by which further candidates are skipped."""
    mismatch: NDArray[Any]
    """Mismatch along the dominant motion, that of the candidate which matches most of the window, 0 to 1."""
    dominant: NDArray[Any]
    """Sum of the matches of that candidate, its motion and its acceleration, (5,) float32."""


class Work(NamedTuple):
    """Work arrays for a node; those without a shape are (SQUARES_PER_WINDOW,) float32."""

    room: Room
    squared: NDArray[Any]
    """Squared difference of each square along a candidate."""
    features: FeatureWork
    similarity: NDArray[Any]
    """Sum of the similarities in the patch around each square."""
    weight: NDArray[Any]
    """Weight of a candidate, or of the window."""
    lean: NDArray[Any]
    """Weight of the difference of frame 1 from frame 0, as one of them alone weighs more than its share by time."""
    gain: NDArray[Any]
    """Factor on the weights of a candidate; see `find_foreground`."""
    options: NDArray[Any]
    """Weights of both frames and of either alone, (3 * SQUARES_PER_WINDOW,) float32."""
    upsampled: NDArray[Any]
    """Weight and sums of each sample of a window, (AREA,) float32."""
    values: NDArray[Any]
    leaning: NDArray[Any]
    further_motion: NDArray[Any]
    """(VALUES_PER_MOTION,) float32."""


@njit(**FINITE_JIT)
def start_node(sums):
    """Clear the sums over the candidates of a node."""
    sums.weights[:] = MIN_WEIGHT_SUM
    sums.similarities[:] = 0
    sums.most_similar[:] = 0
    sums.reached[:] = 0
    sums.dominant[:] = 0


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


@njit(**FINITE_JIT)
def weigh_plainly(prior, weighting, work, sums):
    """Compute the plain weights of a candidate from the squared differences in the work arrays, which are overwritten.

    Return the least weight of any square so far, and the least of the largest similarities.
    """
    squared, similarity, weight = work.squared, work.similarity, work.weight
    weights, similarities, most_similar = sums.weights, sums.similarities, sums.most_similar
    sharpness, exponentials = weighting.sharpness, work.lean
    write_decay(squared, 0, np.float32(0), weighting.scale, np.float32(1), exponentials, 0)
    average_patches(exponentials, 0, work.features, similarity, 0)
    write_decay(similarity, 0, sharpness, -sharpness, prior, weight, 0)
    for i in range(Index(SQUARES_PER_WINDOW)):
        weights[i] += weight[i]
        similarities[i] = fma(weight[i], similarity[i], similarities[i])
        most_similar[i] = max(most_similar[i], similarity[i])
    return smallest(weights, squared), smallest(most_similar, squared)


@njit(**FINITE_JIT)
def weigh_features(prior, motion, t, weighting, work, sums):
    """Compute the learnt weights of a candidate from its features; see `weigh_plainly`."""
    features, weight, lean, options, room = work.features, work.weight, work.lean, work.options, work.squared
    weights, similarities, most_similar, reached = sums.weights, sums.similarities, sums.most_similar, sums.reached
    one, count, similar = np.float32(1), Index(SQUARES_PER_WINDOW), features.squares
    sharpness, share1 = weighting.sharpness, np.float32(2) * t
    find_foreground(weighting.scale, motion, t, work, sums)
    sum_features(weighting, features, options)
    for option in range(3):
        share, at = one if option == 0 else np.float32(2) - share1 if option == 1 else share1, option * count
        write_decay(options, at, HIGHEST_LOGIT, -one, share * prior, options, at)
    second, third = Index(SQUARES_PER_WINDOW), Index(2 * SQUARES_PER_WINDOW)
    for i in range(count):
        options[i] *= work.gain[i]
    for i in range(count):
        lean[i] = (one - t) * options[third + i] - t * options[second + i]
        weight[i] = options[i] + options[second + i] + options[third + i]
    for i in range(count):
        weights[i] += weight[i]
        similarities[i] = fma(weight[i], similar[i], similarities[i])
        most_similar[i] = max(most_similar[i], similar[i])
    write_decay(similar, 0, sharpness, -sharpness, prior, room, 0)
    for i in range(count):
        reached[i] += room[i]
    return smallest(reached, room), smallest(most_similar, room)


@njit(**FINITE_JIT)
def find_foreground(scale, motion, t, work, sums):
    """Write the factor by which a candidate gains where it shows what is in front of the dominant motion of the window.

    A thin thing that moves by more than its width leaves no gap in what is behind it: there, both frames agree along
    either motion, and similarity cannot tell which is in front. But what is seen of the thing in both frames disagrees
    along the dominant motion, so it must have moved by another, and must be shown. The squares where both ends of a
    candidate are such squares are its foreground; it gains where its own match holds over the foreground around.
    """
    room, gain, match, both = work.features, work.gain, work.similarity, work.weight
    cells, alone, means, one, half = room.cells, room.sums, room.means, np.float32(1), np.float32(0.5)
    dominant, mismatch = sums.dominant, sums.mismatch
    write_decay(work.squared, 0, np.float32(0), scale * FOREGROUND_SCALE, one, match, 0)
    matched = np.float32(0)
    for i in range(SQUARES_PER_WINDOW):
        matched += match[i]
        gain[i] = one
    if matched > dominant[0]:
        dominant[0], dominant[1:] = matched, motion[:4]
        for i in range(SQUARES_PER_WINDOW):
            mismatch[i] = one - match[i]
        return
    dx, dy, curve = motion[0] - dominant[1], motion[1] - dominant[2], t * (one - t) * half
    apart = min(max(abs(dx), abs(dy)) - one, one)
    if apart <= 0:
        return
    bent_x, bent_y = curve * (motion[2] - dominant[3]), curve * (motion[3] - dominant[4])
    find_mismatch(mismatch, (bent_y - t * dy) * half, (bent_x - t * dx) * half, alone)
    find_mismatch(mismatch, (bent_y + (one - t) * dy) * half, (bent_x + (one - t) * dx) * half, both)
    for i in range(SQUARES_PER_WINDOW):
        cell = 2 * (i // SQUARES_PER_ROW) // CELL * CELLS_PER_ROW + 2 * (i % SQUARES_PER_ROW) // CELL
        # the features "agreement with the field" of both frames
        agreement = min(cells[3 * CELLS + cell], cells[4 * CELLS + cell])
        alone[i] = min(alone[i], both[i]) * apart * min(FOREGROUND_AGREEMENT * agreement, one)
        both[i] = alone[i] * match[i]
    average_patches(both, 0, room, gain, 0)
    average_patches(alone, 0, room, means, 0)
    for i in range(SQUARES_PER_WINDOW):  # of hardly any foreground around, the mean is no evidence
        gain[i] = alone[i] * gain[i] / (means[i] + np.float32(0.02))
    write_decay(gain, 0, FOREGROUND_SHARPNESS, -FOREGROUND_SHARPNESS, HIGHEST_GAIN, gain, 0)


@njit(**FINITE_JIT)
def find_mismatch(mismatch, down, across, moved):
    """Write the mismatch, bilinearly, of the place so many squares on from each square; 0 outside of the window."""
    top, left, size = math.floor(down), math.floor(across), SQUARES_PER_ROW
    below, right = down - np.float32(top), across - np.float32(left)
    moved[:] = 0
    for y, share in ((top, np.float32(1) - below), (top + 1, below)):
        for x, part in ((left, np.float32(1) - right), (left + 1, right)):
            for j in range(max(0, -y), min(size, size - y)):
                for i in range(max(0, -x), min(size, size - x)):
                    moved[j * size + i] += share * part * mismatch[(j + y) * size + i + x]


@njit(**FINITE_JIT)
def sum_features(weighting, features, logits):
    """Write the logarithms of the weights of both frames, of frame 0 alone and of frame 1 alone along a candidate."""
    squares, spread, between = features.squares, features.spread, features.between
    for i in range(Index(3 * SQUARES_PER_WINDOW)):
        logits[i] = 0
    for row in range(weighting.even.shape[0]):
        sum_cells(weighting.even[row], weighting.odd[row], features)
        spread_across(features.sums_of_cells, 0, features, spread, 0)
        spread_across(features.sums_of_cells, CELLS, features, spread, CELLS_PER_ROW * SQUARES_PER_ROW)
        floor = np.float32(-1e9 if row < 2 else 0)  # rows of hinges are the others
        for j in range(SQUARES_PER_ROW):
            first, below, above = rows_of_cells(j, between)
            first *= SQUARES_PER_ROW
            begin = j * SQUARES_PER_ROW
            add_feature_row(squares, begin, spread, first, below, above, weighting.factors, row * 10, floor, logits)


@njit(**FINITE_JIT)
def sum_cells(even, odd, features):
    """Write the even and the odd part of the sum of those features that differ from cell to cell, or not at all."""
    cells, scalars, sums, constant = features.cells, features.scalars, features.sums_of_cells, np.float32(0)
    for n in range(SCALAR_FEATURES):
        constant += even[SQUARE_FEATURES + CELL_FEATURES + n] * scalars[n]
    for k in range(CELLS):
        sums[k], sums[CELLS + k] = constant, 0
    for n in range(CELL_FEATURES):
        scale_row(even[SQUARE_FEATURES + n], cells, n * CELLS, sums, 0)
        scale_row(odd[SQUARE_FEATURES + n], cells, n * CELLS, sums, CELLS)


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
    squares, areas = (
        [np.empty(size, np.float32) for _ in range(count)] for size, count in ((SQUARES_PER_WINDOW, 5), (AREA, 3))
    )
    squared, *others = squares
    options, motion = np.empty(3 * SQUARES_PER_WINDOW, np.float32), np.empty(VALUES_PER_MOTION, np.float32)
    return Work(room, squared, make_feature_work(), *others, options, *areas, motion)


def make_sums() -> NodeSums:
    """Return the sums over the candidates of a node."""
    return NodeSums(*(np.empty(SQUARES_PER_WINDOW, np.float32) for _ in range(5)), np.empty(5, np.float32))
