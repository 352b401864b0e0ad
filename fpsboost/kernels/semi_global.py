"""Semi-global matching: every node of a lattice chooses a label that its neighbours can go along with.

The cost of a label at a node is gathered along four paths, from the left, the right, above and below; on its way, each
path pays for every change of motion, up to a limit, so that motion may break at the edge of an object (Hirschmueller
2008, doi:10.1109/TPAMI.2007.1166, Eq. 13). Every node has its own short list of labels instead of a common one.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fpsboost.kernels.jit import FINITE_JIT
from fpsboost.kernels.tiles import Index


@njit(**FINITE_JIT)
def walk(count, motions, energy, ties, smoothness, slope, costs, total):
    """Add the costs of the paths that lead along a line of nodes, there and back.

    Parameters
    ----------
    count : (length,) int32
    motions : (length, labels, 2 or more) float32
    energy : (length, labels) float32
    ties : (length,) float32
    smoothness, slope : float32
        As for `smooth_labels`.
    costs : (length or more, labels) float32
        Room for the least cost of every label, given those of the nodes before.
    total : (length, labels) float32
        In and out.
    """
    length = count.shape[0]
    share = np.float32(0.25)
    for direction in range(2):
        before = Index(0)
        for n in range(length):
            here = Index(n if direction == 0 else length - 1 - n)
            known = Index(count[before] if n else 0)  # labels that a path can come from
            tie = min(ties[here], ties[before])
            limit, rise = tie * smoothness, tie * slope
            least = costs[before, Index(0)]
            for other in range(Index(1), known):
                least = min(least, costs[before, other])
            for k in range(Index(count[here])):
                cheapest = limit if known else np.float32(0)
                for other in range(known):
                    change = abs(motions[here, k, 0] - motions[before, other, 0])
                    change += abs(motions[here, k, 1] - motions[before, other, 1])
                    cheapest = min(cheapest, costs[before, other] - least + min(rise * change, limit))
                costs[here, k] = energy[here, k] + cheapest
                total[here, k] += share * costs[here, k]
            before = here


@njit(cache=True, **FINITE_JIT)
def smooth_labels(count, motions, energy, ties, smoothness, slope, total):
    """Costs of all labels once their neighbours have been heard.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    motions : (rows, columns, capacity, 2 or more) float32
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
    costs = np.empty((max(rows, columns), capacity), np.float32)
    for row in range(rows):
        walk(count[row], motions[row], energy[row], ties[row], smoothness, slope, costs, total[row])
    for column in range(columns):
        walk(
            count[:, column],
            motions[:, column],
            energy[:, column],
            ties[:, column],
            smoothness,
            slope,
            costs,
            total[:, column],
        )


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
    for number in range(rows):
        row = Index(number)
        for column in range(Index(columns)):
            best = Index(0)
            for k in range(Index(1), Index(count[row, column])):
                if costs[row, column, k] < costs[row, column, best]:
                    best = Index(k)
            flow[row, column, 0] = motions[row, column, best, 0]
            flow[row, column, 1] = motions[row, column, best, 1]
            chosen[row, column] = similarity[row, column, best]
