"""What speaks for a candidate at each square of a window: similarities, and what the fields and further frames say.

A feature is a number of one square and one candidate. Those of the samples differ from square to square; those of the
motion fields are looked up for cells of eight pixels, as the fields' own points are that far apart, and interpolated.
`fpsboost.kernels.pixel_weights` makes weights of them.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import Index
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.spline import MARGIN
from fpsboost.kernels.window_rows import (
    CELLS_PER_ROW,
    END_WEIGHT,
    SQUARES_PER_ROW,
    SQUARES_PER_WINDOW,
    decay_row,
    distance_row,
    multiply_row,
    scale_row,
    sum_five,
)
from fpsboost.kernels.window_samples import WINDOW, filter_blocks, filter_rigid, is_rigid

PATCH_RADIUS = 2
"""Radius of the patches that are compared at time t, squares; patches are truncated at the border of their window."""

PADDED = SQUARES_PER_ROW + 2 * PATCH_RADIUS
"""Squares in a row of a window with zero padding on both sides, for sums over patches."""

CELLS = CELLS_PER_ROW * CELLS_PER_ROW
CELL = WINDOW // CELLS_PER_ROW
"""Side of the cells for which the motion fields are looked up, pixels."""

SQUARE_FEATURES, CELL_FEATURES, SCALAR_FEATURES = 7, 12, 5
FEATURES = SQUARE_FEATURES + CELL_FEATURES + SCALAR_FEATURES

FINE, COARSE = np.float32(100), np.float32(9)
"""Factors on squared differences for bandwidths of 0.03 and 0.1 instead of 0.3."""

LUMA_SCALE = np.float32(3 * 0.5 / 0.09)
"""Factor on squared differences of luma that counts them as those of three gray channels at a bandwidth of 0.3."""

FINE_LUMA = np.float32(25)
"""Factor for a bandwidth of 0.06 instead of 0.3."""

LEAST_SUPPORT = np.float32(0.02)
"""Added to the support of a candidate, so that its logarithm has a limit."""


class Surroundings(NamedTuple):
    """What is known of a pair besides the samples of its frames."""

    luma: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]
    """Spline coefficients of the luma at half the size, white 1, of the frame before, both, and the frame after, flat
    float32; empty where there is none."""
    rows: int
    stride: int
    """Rows and columns of these coefficients."""
    times: tuple[np.float32, np.float32, np.float32, np.float32]
    """Times of the four frames, in intervals from the first of the pair."""
    points: tuple[NDArray[Any], NDArray[Any]]
    """Of the points of both frames: motion (dx, dy), similarity, 1 over 1 + the forward-backward error in pixels,
    flatness; (rows, columns, 5) float32."""
    step: int
    """Pixels between points."""
    landings: NDArray[Any]
    """How many points of either frame land around each point of the in-between frame, (2, rows, columns) float32."""
    support: NDArray[Any]
    """Support of each candidate by those of the neighbouring nodes, 0 to 1, (rows, columns, room) float32."""


class FeatureWork(NamedTuple):
    """Work arrays for the features of a candidate, float32."""

    squares: NDArray[Any]
    """(SQUARE_FEATURES * SQUARES_PER_WINDOW,)."""
    cells: NDArray[Any]
    """(CELL_FEATURES * CELLS,)."""
    scalars: NDArray[Any]
    """(SCALAR_FEATURES,)."""
    sums_of_cells: NDArray[Any]
    """(2 * CELLS,)."""
    luma: NDArray[Any]
    """(4 * SQUARES_PER_WINDOW,)."""
    rows: NDArray[Any]
    """Rows filtered horizontally, ((SQUARES_PER_ROW + 3) * SQUARES_PER_ROW,)."""
    padded: NDArray[Any]
    half_way: NDArray[Any]
    """Both for `average_patches`; (PADDED * SQUARES_PER_ROW,)."""
    sums: NDArray[Any]
    """(SQUARES_PER_WINDOW,)."""
    means: NDArray[Any]
    shares: NDArray[Any]
    """Of `patch_shares`."""
    between: NDArray[Any]
    """Of `cell_shares`."""
    spread: NDArray[Any]
    """Rows of cells, interpolated at the squares, of two sums; (2 * CELLS_PER_ROW * SQUARES_PER_ROW,)."""


@njit(**FINITE_JIT)
def write_decay(values, at, offset, factor, part, out, to):
    """Write ``part * exp(-max(offset + factor * value, 0))`` of each square.

    Here and below, the values of a window begin at some index of a flat array, which need not be sliced.
    """
    for j in range(0, SQUARES_PER_WINDOW, SQUARES_PER_ROW):
        decay_row(values, at + j, offset, factor, part, out, to + j)


@njit(**FINITE_JIT)
def write_product(first, at, second, here, out, to):
    """Write the product of two values of each square."""
    for j in range(0, SQUARES_PER_WINDOW, SQUARES_PER_ROW):
        multiply_row(first, at + j, second, here + j, out, to + j)


@njit(**FINITE_JIT)
def write_distance(first, at, second, here, out, to):
    """Write how far two values of each square are apart."""
    for j in range(0, SQUARES_PER_WINDOW, SQUARES_PER_ROW):
        distance_row(first, at + j, second, here + j, out, to + j)


@njit(**FINITE_JIT)
def average_patches(values, at, room, out, to):
    """Write the mean over the patch around each square: sums along columns, then along rows.

    The work arrays have zeros around the window.
    """
    padded, half_way, begin = room.padded, room.half_way, Index(PATCH_RADIUS * SQUARES_PER_ROW)
    for i in range(Index(SQUARES_PER_WINDOW)):
        padded[begin + i] = values[Index(at) + i]
    for j in range(SQUARES_PER_ROW):
        sum_five(padded, j * SQUARES_PER_ROW, SQUARES_PER_ROW, half_way, j * PADDED + PATCH_RADIUS)
    for j in range(SQUARES_PER_ROW):
        sum_five(half_way, j * PADDED, 1, out, to + j * SQUARES_PER_ROW)
    write_product(out, to, room.shares, 0, out, to)


@njit(**FINITE_JIT)
def describe_candidate(squared, scale, window, motion, prior, support, t, around, room):
    """Write the features of a candidate, of which the squared differences at each square are given."""
    fetch_luma(window, motion, t, around, room)
    describe_cells(window, motion, t, around, room)
    describe_squares(squared, scale, around, room)
    scalars = room.scalars
    one = np.float32(1)
    scalars[0] = one
    scalars[1] = prior
    scalars[2] = min((abs(motion[2]) + abs(motion[3])) * np.float32(0.125), one)
    scalars[3] = min(abs(motion[4]) + abs(motion[5]) + abs(motion[6]) + abs(motion[7]), np.float32(0.5))
    scalars[4] = math.log(np.float64(support + LEAST_SUPPORT))  # the same float32 by any library


@njit(**FINITE_JIT)
def describe_squares(squared, scale, around, room):
    """Write the features of the samples, whose squared differences are given for each square."""
    squares, sums, means, nothing, one = room.squares, room.sums, room.means, np.float32(0), np.float32(1)
    size = SQUARES_PER_WINDOW
    write_decay(squared, 0, nothing, scale, one, sums, 0)
    average_patches(sums, 0, room, squares, 0)
    average_patches(squared, 0, room, means, 0)
    for n in range(2):
        write_decay(means, 0, nothing, scale * (FINE if n == 0 else COARSE), one, squares, (1 + n) * size)
    spread_cells(room.sums_of_cells, room, squares, 3 * size)
    luma = room.luma
    for side in range(2):
        to = (4 + side) * size
        if around.luma[3 * side].size == 0:
            for i in range(Index(size)):
                squares[Index(to) + i] = squares[Index(2 * size) + i]
            continue
        write_distance(luma, (1 + side) * size, luma, 3 * side * size, sums, 0)
        write_product(sums, 0, sums, 0, sums, 0)
        average_patches(sums, 0, room, means, 0)
        write_decay(means, 0, nothing, LUMA_SCALE * FINE_LUMA, one, squares, to)
    write_distance(squares, 4 * size, squares, 5 * size, squares, 6 * size)


@njit(**FINITE_JIT)
def fetch_luma(window, motion, t, around, room):
    """Sample the luma of the frames before and after along a candidate, and that of the frame next to each."""
    for k in range(4):
        if around.luma[0 if k < 2 else 3].size:
            fetch_frame(
                around.luma[k], around.times[k], window, motion, t, around, room.rows, room.luma, k * SQUARES_PER_WINDOW
            )


@njit(**FINITE_JIT)
def fetch_frame(coefficients, time, window, motion, t, around, rows, luma, to):
    """Sample the luma of a frame at some time along a candidate."""
    y, x = locate_luma(window.top, window.left, time, motion, t, around)
    size = SQUARES_PER_ROW
    if is_rigid(motion):
        filter_rigid(coefficients, 0, around.stride, y, x, size, size, rows, luma, to)
    else:
        filter_blocks(coefficients, 0, around.rows, around.stride, y, x, time - t, motion, size, size, rows, luma, to)


@njit(**FINITE_JIT)
def locate_luma(top, left, time, motion, t, around):
    """Return where in the luma of a frame at some time a pixel of the in-between frame is along a candidate."""
    half, margin, one = np.float32(0.5), np.float32(MARGIN), np.float32(1)
    bent = (t * (one - t) - time * (one - time)) * half
    x = (np.float32(left) + (time - t) * motion[0] + bent * motion[2]) * half
    y = (np.float32(top) + (time - t) * motion[1] + bent * motion[3]) * half
    x = min(max(x + margin, np.float32(2)), np.float32(around.stride - SQUARES_PER_ROW - MARGIN + 2))
    y = min(max(y + margin, np.float32(2)), np.float32(around.rows - MARGIN + 2))
    return y, x


@njit(**FINITE_JIT)
def describe_cells(window, motion, t, around, room):
    """Write what the motion fields say of a candidate."""
    cells, flatness, one = room.cells, room.sums_of_cells, np.float32(1)
    landings, (rows, columns) = around.landings, around.landings.shape[1:]
    curve, per_step = t * (one - t) * np.float32(0.5), one / np.float32(around.step)
    turns = np.float32(0) if is_rigid(motion) else one
    for v in range(CELLS_PER_ROW):
        down = np.float32(v * CELL + CELL // 2)
        for u in range(CELLS_PER_ROW):
            across, cell = np.float32(u * CELL + CELL // 2), v * CELLS_PER_ROW + u
            from_x, from_y = (across - WINDOW // 2) * turns, (down - WINDOW // 2) * turns
            dx = motion[0] + from_x * motion[4] + from_y * motion[6]
            dy = motion[1] + from_x * motion[5] + from_y * motion[7]
            x, y = np.float32(window.left) + across, np.float32(window.top) + down
            x0, y0 = x - t * dx + curve * motion[2], y - t * dy + curve * motion[3]
            flatness[cell] = 0
            for k in range(2):
                sign = np.float32(1 - 2 * k)
                similar, agree, consistent, flat = look_up(
                    around.points[k], (x0 + k * dx) * per_step, (y0 + k * dy) * per_step, sign * dx, sign * dy
                )
                first = k * CELLS + cell
                cells[first], cells[first + 3 * CELLS], cells[first + 6 * CELLS] = similar, agree, consistent
                flatness[cell] += np.float32(0.5) * flat
            row = min(max(math.floor(y * per_step), 0), rows - 1)
            column = min(max(math.floor(x * per_step), 0), columns - 1)
            cells[9 * CELLS + cell], cells[10 * CELLS + cell] = landings[0, row, column], landings[1, row, column]
            for n in range(cell, CELL_FEATURES * CELLS, 3 * CELLS):
                cells[n + 2 * CELLS] = abs(cells[n] - cells[n + CELLS])


@njit(**FINITE_JIT)
def look_up(points, x, y, dx, dy):
    """Return similarity, agreement with a motion, consistency and flatness at a place in cells, bilinearly."""
    rows, columns, zero, one, half = points.shape[0], points.shape[1], np.float32(0), np.float32(1), np.float32(0.5)
    x = min(max(x - half, zero), np.float32(columns - 1))
    y = min(max(y - half, zero), np.float32(rows - 1))
    left, top = int(x), int(y)
    right, bottom, part_x, part_y = min(left + 1, columns - 1), min(top + 1, rows - 1), x - left, y - top
    similar = agree = consistent = flat = zero
    for row, share in ((top, one - part_y), (bottom, part_y)):
        for column, part in ((left, one - part_x), (right, part_x)):
            point, weight = points[row, column], share * part
            similar += weight * point[2]
            agree += weight / (one + max(abs(point[0] - dx), abs(point[1] - dy)))
            consistent += weight * point[3]
            flat += weight * point[4]
    return similar, agree, consistent, flat


@njit(**FINITE_JIT)
def spread_across(cells, begin, room, rows, to):
    """Interpolate the values of the cells at each square along rows, of which there is one for each row of cells."""
    for i in range(Index(CELLS_PER_ROW * SQUARES_PER_ROW)):
        rows[Index(to) + i] = 0
    for v in range(CELLS_PER_ROW):
        for u in range(CELLS_PER_ROW):
            value = cells[begin + v * CELLS_PER_ROW + u]
            scale_row(value, room.between, u * SQUARES_PER_ROW, rows, to + v * SQUARES_PER_ROW)


@njit(**FINITE_JIT)
def rows_of_cells(j, between):
    """Return the first of two rows of cells between which a row of squares is, and the shares of both."""
    first = min(max((2 * j - CELL // 2) // CELL, 0), CELLS_PER_ROW - 2)
    return first, between[first * SQUARES_PER_ROW + j], between[(first + 1) * SQUARES_PER_ROW + j]


@njit(**FINITE_JIT)
def spread_cells(cells, room, out, to):
    """Interpolate the values of the cells at each square of a window."""
    for i in range(Index(SQUARES_PER_WINDOW)):
        out[Index(to) + i] = 0
    spread_across(cells, 0, room, room.spread, 0)
    for j in range(SQUARES_PER_ROW):
        first, below, above = rows_of_cells(j, room.between)
        scale_row(below, room.spread, first * SQUARES_PER_ROW, out, to + j * SQUARES_PER_ROW)
        scale_row(above, room.spread, (first + 1) * SQUARES_PER_ROW, out, to + j * SQUARES_PER_ROW)


def make_feature_work() -> FeatureWork:
    """Return the work arrays for the features of a candidate."""
    return FeatureWork(
        np.empty(SQUARE_FEATURES * SQUARES_PER_WINDOW, np.float32),
        np.empty(CELL_FEATURES * CELLS, np.float32),
        np.empty(SCALAR_FEATURES, np.float32),
        np.empty(2 * CELLS, np.float32),
        np.empty(4 * SQUARES_PER_WINDOW, np.float32),
        np.empty((SQUARES_PER_ROW + 3) * SQUARES_PER_ROW, np.float32),
        np.zeros(PADDED * SQUARES_PER_ROW, np.float32),
        np.zeros(PADDED * SQUARES_PER_ROW, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        np.empty(SQUARES_PER_WINDOW, np.float32),
        patch_shares(),
        cell_shares(),
        np.empty(2 * CELLS_PER_ROW * SQUARES_PER_ROW, np.float32),
    )


@cache
def patch_shares() -> np.ndarray:
    """Return 1 over the weight of the squares of each patch within its window, (SQUARES_PER_WINDOW,) float32."""
    length = np.convolve(np.ones(SQUARES_PER_ROW), [END_WEIGHT, 1, 1, 1, END_WEIGHT], mode="same")
    return (1 / np.outer(length, length)).ravel().astype(np.float32)


@cache
def cell_shares() -> np.ndarray:
    """Return the share of each cell of a row in each square of a row, (CELLS_PER_ROW * SQUARES_PER_ROW,) float32."""
    squares = SQUARES_PER_ROW // CELLS_PER_ROW
    places = ((np.arange(SQUARES_PER_ROW) + 0.5) / squares - 0.5).clip(0, CELLS_PER_ROW - 1)
    return np.maximum(1 - np.abs(places - np.arange(CELLS_PER_ROW)[:, np.newaxis]), 0).ravel().astype(np.float32)
