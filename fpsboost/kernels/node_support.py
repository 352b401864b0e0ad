"""What the motion fields say around the nodes: landings of points, and how far neighbouring nodes agree on a motion.

A node alone cannot tell which of several motions of weak texture is right. Each candidate is therefore compared with
those that its neighbours believe in, by their votes and by the luma around them.
"""

from __future__ import annotations

import math

import numpy as np

from fpsboost.kernels.fusion_features import LUMA_SCALE, locate_luma
from fpsboost.kernels.instruction import EIGHT, SIXTEEN
from fpsboost.kernels.jit import FINITE_JIT, borrowed, njit
from fpsboost.kernels.window_rows import decay_row, distance_row, multiply_row
from fpsboost.kernels.window_samples import filter_blocks

AREA = EIGHT * EIGHT
"""Samples of luma around a node that are compared."""

SHARPNESS = np.float32(18)
"""Rate at which the belief in a candidate decays as its similarity falls, as that of plain weights."""


@njit(cache=True, **FINITE_JIT)
def count_landings(points, t, step, landings):
    """Count how many points of a frame land around each point of the in-between frame, bilinearly, at most 2.

    - `points`: of `fpsboost.kernels.fusion_features.Surroundings`
    - `t`: distance in time from the frame, in intervals
    - `step`: pixels between points
    """
    rows, columns = landings.shape
    one, most = np.float32(1), np.float32(2)
    landings[:] = 0
    for i in range(rows):
        for j in range(columns):
            x, y = np.float32(j) + t * points[i, j, 0] / step, np.float32(i) + t * points[i, j, 1] / step
            left, top = math.floor(x), math.floor(y)
            for row in range(max(top, 0), min(top + 2, rows)):
                for column in range(max(left, 0), min(left + 2, columns)):
                    share = (one - abs(x - np.float32(column))) * (one - abs(y - np.float32(row)))
                    landings[row, column] = min(landings[row, column] + share, most)


@njit(cache=True, **FINITE_JIT)
def measure_support(candidates, around, t, rows, luma, beliefs):
    """Write how far the neighbours of each node agree with each of its candidates, into the support of `around`.

    - `rows`, `luma`: work arrays, ((EIGHT + 3) * EIGHT,) and (2 * AREA,) float32
    - `beliefs`: likewise, as the weights of the candidates
    """
    candidates, around, rows, luma, beliefs = borrowed((candidates, around, rows, luma, beliefs))
    (listed, motions, _, _), support = candidates, around.support
    for row in range(listed.shape[0]):
        for column in range(listed.shape[1]):
            believe_node(row, column, candidates, around, t, rows, luma, beliefs)
    for row in range(listed.shape[0]):
        for column in range(listed.shape[1]):
            for k in range(listed[row, column]):
                support[row, column, k] = agreement(row, column, motions[row, column, k], listed, motions, beliefs)


@njit(**FINITE_JIT)
def believe_node(row, column, candidates, around, t, rows, luma, beliefs):
    """Write the belief in each candidate of a node, with a sum of 1."""
    listed, motions, weights, spacing = candidates
    top, left = row * spacing + spacing // 2 - EIGHT, column * spacing + spacing // 2 - EIGHT
    count, total, one = listed[row, column], np.float32(0), np.float32(1)
    for k in range(count):
        belief = weights[row, column, k]
        if belief > 0 and count > 1:
            motion = motions[row, column, k]
            for n in range(2):
                time = np.float32(n)
                y, x = locate_luma(top, left, time, motion, t, around)
                filter_blocks(
                    around.luma[1 + n],
                    0,
                    around.rows,
                    around.stride,
                    y,
                    x,
                    time - t,
                    motion,
                    EIGHT,
                    EIGHT,
                    rows,
                    luma,
                    n * AREA,
                )
            alike = np.float32(0)
            for i in range(0, AREA, SIXTEEN):
                distance_row(luma, i, luma, AREA + i, luma, i)
                multiply_row(luma, i, luma, i, luma, i)
                decay_row(luma, i, np.float32(0), LUMA_SCALE, np.float32(1 / AREA), luma, i)
            for i in range(AREA):
                alike += luma[i]
            belief *= np.float32(math.exp(np.float64(SHARPNESS * (alike - one))))
        beliefs[row, column, k] = belief
        total += belief
    for k in range(count):
        beliefs[row, column, k] /= max(total, np.float32(1e-20))


@njit(**FINITE_JIT)
def agreement(row, column, motion, listed, motions, beliefs):
    """Return how far the neighbours of a node agree with a motion, 0 to 1: beliefs, less for a motion that differs."""
    total, nodes = np.float32(0), np.float32(0)
    for y in range(max(row - 1, 0), min(row + 2, listed.shape[0])):
        for x in range(max(column - 1, 0), min(column + 2, listed.shape[1])):
            if y == row and x == column:
                continue
            nodes += np.float32(1)
            for n in range(listed[y, x]):
                apart = max(abs(motions[y, x, n, 0] - motion[0]), abs(motions[y, x, n, 1] - motion[1]))
                total += beliefs[y, x, n] / (np.float32(1) + apart)
    return total / max(nodes, np.float32(1))
