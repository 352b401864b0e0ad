"""Semi-global matching: choose a label for every node of a lattice that is consistent with its neighbours.

The cost of a label at a node is aggregated along four paths, from the left, the right, above and below. Along each
path, every change of motion has a cost, up to a limit, so that motion may be discontinuous at the edge of an object
(Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13). Every node has its own short list of labels instead of a
common one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import BORROWING, FINITE_JIT, njit
from fpsboost.kernels.lanes import EIGHT, relax_eight
from fpsboost.kernels.tiles import Index

MISSING_LABEL_COST = np.float32(1e30)
"""Cost of a label that a node does not have."""


class Labels(NamedTuple):
    """Labels of all nodes, as for `smooth_labels`, flattened."""

    listed: NDArray[Any]
    motions: NDArray[Any]
    energy: NDArray[Any]
    ties: NDArray[Any]
    capacity: int
    """Maximum number of labels of a node."""


class PathRoom(NamedTuple):
    """Work arrays for the labels of two nodes of a path, with `capacity` rounded up to a multiple of EIGHT."""

    x: NDArray[Any]
    """Motion of the labels along x, (2 room,) float32."""
    y: NDArray[Any]
    """Motion of the labels along y, (2 room,) float32."""
    costs: NDArray[Any]
    """Least costs of the labels, (2 room,) float32."""
    cheapest: NDArray[Any]
    """Cost of the cheapest transition to each label of a node, (room,) float32."""


@njit(**FINITE_JIT)
def add_path_costs(begin, apart, length, labels, smoothness, slope, spaces, total):
    """Add the costs of the path along a line of nodes.

    Parameters
    ----------
    begin, apart, length : int
        Index of the first node, distance to the next, and number of nodes.
    labels : Labels
    smoothness, slope
        As for `smooth_labels`.
    spaces : PathRoom
    total : flat float32
        Updated in place.
    """
    count, motions, energy, ties, capacity = labels
    x, y, costs, cheapest = spaces
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
            cheapest[k] = limit  # 0 at the first node, which has no predecessor
        if n:
            for k in range(Index(0), Index(room), Index(EIGHT)):
                for other in range(Index(0), Index(room), Index(EIGHT)):
                    relax_eight(x, y, here + k, before + other, costs, least, rise, limit, cheapest, k)
        least = MISSING_LABEL_COST
        for k in range(known):
            cost = energy[first + k] + cheapest[k]
            costs[here + k] = cost
            total[first + k] += share * cost
            least = min(least, cost)
        for k in range(known, Index(room)):
            x[here + k], y[here + k], costs[here + k] = 0, 0, MISSING_LABEL_COST
        before, tie_before = here, ties[node]


@njit(cache=True, **FINITE_JIT)
def smooth_labels(count, motions, energy, ties, smoothness, slope, total):
    """Compute the costs of all labels, aggregated over their neighbours.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    motions : (rows, columns, capacity, 2) float32
        ``(dx, dy)`` of each label, pixels; undefined beyond `count`.
    energy : (rows, columns, capacity) float32
        Data cost of each label.
    ties : (rows, columns) float32
        Share of the smoothness that applies to a node; between two nodes, the smaller of both.
    smoothness : float32
        Maximum cost of a change of motion between neighbours.
    slope : float32
        Cost of a change of motion per pixel.
    total : (rows, columns, capacity) float32 out
        Mean cost over the four paths; 0 beyond `count`.
    """
    rows, columns, capacity = energy.shape
    total[:] = 0
    labels = Labels(count.ravel(), motions.ravel(), energy.ravel(), ties.ravel(), capacity)
    room = (capacity + EIGHT - 1) // EIGHT * EIGHT
    x, y, costs = np.zeros(2 * room, np.float32), np.zeros(2 * room, np.float32), np.zeros(2 * room, np.float32)
    spaces, last = PathRoom(x, y, costs, np.empty(room, np.float32)), (rows - 1) * columns
    onward = np.int64(1)  # not a literal, for which the paths would be compiled again
    for row in range(rows):
        add_path_costs(row * columns, onward, columns, labels, smoothness, slope, spaces, total.ravel())
        add_path_costs(row * columns + columns - 1, -onward, columns, labels, smoothness, slope, spaces, total.ravel())
    for column in range(columns):
        add_path_costs(column, columns, rows, labels, smoothness, slope, spaces, total.ravel())
        add_path_costs(last + column, -columns, rows, labels, smoothness, slope, spaces, total.ravel())


@njit(cache=True, **FINITE_JIT, **BORROWING)
def choose_labels(count, costs, motions, similarity, flow, chosen):
    """Choose the label with the lowest cost for every node, the first of those with equal cost.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    costs : (rows, columns, capacity) float32
    motions : (rows, columns, capacity, 2 or more) float32
    similarity : (rows, columns, capacity) float32
    flow : (rows, columns, 2) float32 out
        Motion of the chosen label.
    chosen : (rows, columns) float32 out
        Similarity of the chosen label.
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
