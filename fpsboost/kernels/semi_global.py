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

from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.lanes import extend_paths
from fpsboost.kernels.tiles import Index

MISSING_LABEL_COST = np.float32(1e30)
"""Cost of a label that a node does not have."""

PATHS_AT_ONCE = 4
"""Neighbouring paths that are followed together: a processor works on one node of each at the same time."""


class Labels(NamedTuple):
    """Labels of all nodes, flat, with room for a multiple of EIGHT labels at every node."""

    x: NDArray[Any]
    """Motion along x, pixels, float32; 0 for labels that a node does not have."""
    y: NDArray[Any]
    """Motion along y."""
    energy: NDArray[Any]
    """Data costs, float32; `MISSING_LABEL_COST` for labels that a node does not have."""
    ties: NDArray[Any]
    """Share of the smoothness that applies to each node, float32."""


@njit(**FINITE_JIT)
def align_labels(count, motions, similarity, room, labels):
    """Copy the labels of all nodes, `room` for each node, with the similarity as a negative cost."""
    x, y, energy, _ = labels
    rows, columns, _ = similarity.shape
    energy[:] = MISSING_LABEL_COST
    for row in range(Index(rows)):
        for column in range(Index(columns)):
            first = (row * Index(columns) + column) * room
            for k in range(Index(count[row, column])):
                x[first + k], y[first + k] = motions[row, column, k, 0], motions[row, column, k, 1]
                energy[first + k] = -similarity[row, column, k]


@njit(**FINITE_JIT)
def add_path_costs(begin, apart, length, aside, parallel, labels, room, smoothness, slope, costs, total):
    """Add the costs of parallel paths.

    Parameters
    ----------
    begin, apart, length : int
        Index of the first node of the first path, distance to its next node, and number of its nodes.
    aside, parallel : int
        Distance to the first node of the next path, and number of paths.
    labels : Labels
    room : int
        Number of labels of a node.
    smoothness, slope
        As for `choose_labels`.
    costs : flat float32
        Work array, with room for a further node, at which all costs are 0.
    total : flat float32
        Updated in place.
    """
    x, y, energy, ties = labels
    for first in range(0, parallel, PATHS_AT_ONCE):
        for n in range(length):
            for path in range(first, min(first + PATHS_AT_ONCE, parallel)):
                node = begin + path * aside + n * apart
                # no change has a cost at the first node, which has no predecessor
                before = node - apart if n else ties.size
                tie = min(ties[Index(node)], ties[Index(before)]) if n else np.float32(0)
                extend_paths(
                    x, y, energy, costs, total, node * room, before * room, room, tie * slope, tie * smoothness
                )


@njit(**FINITE_JIT)
def choose_labels(count, motions, similarity, ties, smoothness, slope, costs, flow, chosen):
    """Choose the label of every node with the lowest cost, aggregated over its neighbours; the first of several.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    motions : (rows, columns, capacity, 2) float32
        ``(dx, dy)`` of each label, pixels; undefined beyond `count`.
    similarity : (rows, columns, capacity) float32
        Similarity of each label, whose negative is its cost at the node.
    ties : (rows, columns) float32
        Share of the smoothness that applies to a node; between two nodes, the smaller of both.
    smoothness : float32
        Maximum cost of a change of motion between neighbours.
    slope : float32
        Cost of a change of motion per pixel.
    costs : (rows, columns, capacity rounded up to a multiple of EIGHT) float32 out
        Sum of the costs of each label over the four directions; undefined beyond `count`.
    flow : (rows, columns, 2) float32 out
        Motion of the chosen label.
    chosen : (rows, columns) float32 out
        Similarity of the chosen label.
    """
    rows, columns, room = costs.shape
    size, last = costs.size + room, rows * columns - 1  # with a node before the first of every path
    labels = Labels(np.zeros(size, np.float32), np.zeros(size, np.float32), np.empty(size, np.float32), ties.ravel())
    align_labels(count, motions, similarity, Index(room), labels)
    path_costs, total = np.zeros(size, np.float32), costs.ravel()
    total[:] = 0
    for direction in range(4):
        is_vertical, begin, sign = direction > 1, last * (direction % 2), 1 - 2 * (direction % 2)
        apart, length, aside, parallel = (columns, rows, 1, columns) if is_vertical else (1, columns, columns, rows)
        add_path_costs(
            begin, sign * apart, length, sign * aside, parallel, labels, room, smoothness, slope, path_costs, total
        )
    for row in range(Index(rows)):
        for column in range(Index(columns)):
            best = Index(0)
            for k in range(Index(1), Index(count[row, column])):
                if costs[row, column, k] < costs[row, column, best]:
                    best = Index(k)
            flow[row, column, 0] = motions[row, column, best, 0]
            flow[row, column, 1] = motions[row, column, best, 1]
            chosen[row, column] = similarity[row, column, best]
