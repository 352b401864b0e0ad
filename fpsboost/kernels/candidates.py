"""The few motions that may hold in each cell of an in-between frame.

Every few pixels of both frames, the motion there is carried to time t. What lands in a cell or near it becomes a
candidate of that cell; candidates that agree become one, with a vote each.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import JIT

CELL = 16
"""Side of a cell, pixels."""

BAND = 12
"""Rows of cells that a thread takes at once."""


@njit(parallel=True, cache=True, **JIT)
def collect_candidates(flow, trust, sign, t, step, around, tolerance, count, votes, corners, sums):
    """Add one frame's motion to the cells' candidates.

    Parameters
    ----------
    flow : (H, W, 2) float32
        Motion of the frame.
    trust : (points down, points across) float32
        What the vote of each point that is asked counts, 0 to 1.
    sign : float32
        1 for frame 0, -1 for frame 1: candidates always lead from frame 0 to frame 1.
    t : float32
        Distance in time from the frame, in intervals.
    step : int
        One pixel in so many, along x and y, is asked.
    around : float32
        A motion counts for the corners of cells this near to where it lands, pixels: the nearer the more.
    tolerance : float32
        Motions that differ by less along x and y are the same, pixels.
    count : (rows, columns) int32
        Candidates of each cell so far; in and out.
    votes : (rows, columns, capacity) float32
        In and out.
    corners : (rows, columns, capacity, 2, 2) float32
        The share of each corner [bottom, right] in the votes; in and out.
    sums : (rows, columns, capacity, 2) float32
        Sums of the motions of each candidate's votes; in and out.
    """
    height, width = flow.shape[:2]
    rows, columns, capacity = votes.shape
    one, half, per_cell = np.float32(1), np.float32(0.5), np.float32(1 / CELL)
    # each thread sees all motions and has cells of its own: their candidates come in the same order
    for number in prange((rows + BAND - 1) // BAND):
        first, last = np.int64(number) * BAND, min((np.int64(number) + 1) * BAND, rows) - 1
        for y in range(min(step // 2, height - 1), height, step):
            for x in range(min(step // 2, width - 1), width, step):
                weight = trust[y // step, x // step]
                # cells begin half a pixel before their first pixel's middle
                landing_x = np.float32(x) + t * flow[y, x, 0] + half
                landing_y = np.float32(y) + t * flow[y, x, 1] + half
                dx, dy = sign * flow[y, x, 0], sign * flow[y, x, 1]
                top = max(math.floor((landing_y - around) * per_cell), first)
                left = max(math.floor((landing_x - around) * per_cell), 0)
                bottom = min(math.floor((landing_y + around) * per_cell), last)
                right = min(math.floor((landing_x + around) * per_cell), columns - 1)
                for row in range(top, bottom + 1):
                    above = weight * max(one - abs(landing_y - np.float32(row * CELL)) / around, np.float32(0))
                    below = weight * max(one - abs(landing_y - np.float32((row + 1) * CELL)) / around, np.float32(0))
                    for column in range(left, right + 1):
                        before = max(one - abs(landing_x - np.float32(column * CELL)) / around, np.float32(0))
                        behind = max(one - abs(landing_x - np.float32((column + 1) * CELL)) / around, np.float32(0))
                        vote = (above + below) * (before + behind)
                        if vote <= 0:
                            continue
                        cell_votes, cell_sums = votes[row, column], sums[row, column]
                        known = count[row, column]
                        k = 0
                        while k < known and not (
                            abs(cell_sums[k, 0] - dx * cell_votes[k]) < tolerance * cell_votes[k]
                            and abs(cell_sums[k, 1] - dy * cell_votes[k]) < tolerance * cell_votes[k]
                        ):
                            k += 1
                        if k == capacity:
                            continue
                        if k == known:
                            count[row, column] += 1
                        cell_votes[k] += vote
                        cell_sums[k, 0] += dx * vote
                        cell_sums[k, 1] += dy * vote
                        corners[row, column, k, 0, 0] += above * before
                        corners[row, column, k, 0, 1] += above * behind
                        corners[row, column, k, 1, 0] += below * before
                        corners[row, column, k, 1, 1] += below * behind
