"""Semi-global matching: every node of a lattice chooses a label that its neighbours can go along with.

The cost of a label at a node is gathered along four paths, from the left, the right, above and below; on its way, each
path pays for every change of motion, up to a limit, so that motion may break at the edge of an object (Hirschmueller
2008, doi:10.1109/TPAMI.2007.1166, Eq. 13). Every node has its own short list of labels instead of a common one.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.lanes import EIGHT, relax_eight
from fpsboost.kernels.tiles import Index

UNREACHABLE = np.float32(1e30)
"""Cost of a label that a node has not."""


@njit(**FINITE_JIT)
def walk(
    begin, apart, length, count, motions, energy, ties, smoothness, slope, capacity, x, y, costs, cheapest, total
):  # fmt: skip
    """Add the costs of the path that leads along a line of nodes.

    Parameters
    ----------
    begin, apart, length : int
        Number of the first node, distance to the next, and how many there are.
    count, motions, energy, ties, smoothness, slope
        As for `smooth_labels`, flat.
    capacity : int
        Labels of a node, at most.
    x, y, costs : (2 room,) float32
        Room for the motions and for the least costs of the labels of two nodes, `capacity` rounded up to EIGHT each.
    cheapest : (room,) float32
        Room.
    total : flat float32
        In and out.
    """
    share, room = np.float32(0.25), cheapest.size
    before, least, tie_before = Index(room), np.float32(0), np.float32(0)
    for n in range(length):
        node = Index(begin + n * apart)
        here, first, known = Index(room) - before, node * Index(capacity), Index(count[node])
        for k in range(known):
            x[here + k], y[here + k] = motions[Index(2) * (first + k)], motions[Index(2) * (first + k) + Index(1)]
        tie = min(ties[node], tie_before)
        limit, rise = tie * smoothness, tie * slope
        for k in range(Index(room)):
            cheapest[k] = limit  # nothing at the first node, which ties to none before
        if n:
            for k in range(Index(0), Index(room), Index(EIGHT)):
                for other in range(Index(0), Index(room), Index(EIGHT)):
                    relax_eight(x, y, here + k, before + other, costs, least, rise, limit, cheapest, k)
        least = UNREACHABLE
        for k in range(known):
            cost = energy[first + k] + cheapest[k]
            costs[here + k] = cost
            total[first + k] += share * cost
            least = min(least, cost)
        for k in range(known, Index(room)):
            x[here + k], y[here + k], costs[here + k] = 0, 0, UNREACHABLE
        before, tie_before = here, ties[node]


@njit(cache=True, **FINITE_JIT)
def smooth_labels(count, motions, energy, ties, smoothness, slope, total):
    """Costs of all labels once their neighbours have been heard.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    motions : (rows, columns, capacity, 2) float32
        ``(dx, dy)`` of each label, pixels; anything else behind.
    energy : (rows, columns, capacity) float32
        Cost of each label by itself.
    ties : (rows, columns) float32
        Share of the smoothness that holds a node to its neighbours; between two nodes, the smaller one.
    smoothness : float32
        Cost of a change of motion between neighbours, at most.
    slope : float32
        Cost of a change by a pixel.
    total : (rows, columns, capacity) float32 out
        Mean over the four paths; 0 beyond `count`.
    """
    rows, columns, capacity = energy.shape
    total[:] = 0
    nodes = count.ravel(), motions.ravel(), energy.ravel(), ties.ravel(), smoothness, slope, capacity
    room = (capacity + EIGHT - 1) // EIGHT * EIGHT
    spaces = np.zeros(2 * room, np.float32), np.zeros(2 * room, np.float32), np.zeros(2 * room, np.float32)
    cheapest, last = np.empty(room, np.float32), (rows - 1) * columns
    for row in range(rows):
        walk(row * columns, 1, columns, *nodes, *spaces, cheapest, total.ravel())
        walk(row * columns + columns - 1, -1, columns, *nodes, *spaces, cheapest, total.ravel())
    for column in range(columns):
        walk(column, columns, rows, *nodes, *spaces, cheapest, total.ravel())
        walk(last + column, -columns, rows, *nodes, *spaces, cheapest, total.ravel())


@njit(cache=True, **FINITE_JIT)
def choose_labels(count, costs, motions, similarity, flow, chosen):
    """Of every node's labels the cheapest, the first of those that cost the same.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    costs : (rows, columns, capacity) float32
    motions : (rows, columns, capacity, 2 or more) float32
    similarity : (rows, columns, capacity) float32
    flow : (rows, columns, 2) float32 out
        Motion of the label.
    chosen : (rows, columns) float32 out
        Its similarity.
    """
    rows, columns = count.shape
    for row in range(Index(rows)):
        for column in range(Index(columns)):
            best = Index(0)
            for k in range(Index(1), Index(count[row, column])):
                if costs[row, column, k] < costs[row, column, best]:
                    best = Index(k)
            flow[row, column, 0] = motions[row, column, best, 0]
            flow[row, column, 1] = motions[row, column, best, 1]
            chosen[row, column] = similarity[row, column, best]
