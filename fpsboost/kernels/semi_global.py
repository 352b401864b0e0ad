"""Semi-global matching: every node of a lattice chooses a label that its neighbours can go along with.

The cost of a label at a node is gathered along four paths, from the left, the right, above and below; on its way, each
path pays for every change of motion, up to a limit, so that motion may break at the edge of an object (Hirschmueller
2008, doi:10.1109/TPAMI.2007.1166, Eq. 13). Every node has its own short list of labels instead of a common one.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import FINITE_JIT


@njit(**FINITE_JIT)
def extend_path(before_count, before_motions, before_costs, count, motions, energy, smoothness, slope, costs):
    """One step of a path: the least cost of every label of a node, given those of the node before it.

    Parameters
    ----------
    before_count, count : int
        Labels of the node before and of this one.
    before_motions, motions : (labels, 2 or more) float32
    before_costs : (labels,) float32
    energy : (labels,) float32
        Of this node's labels alone.
    smoothness : float32
        Cost of the largest change of motion.
    slope : float32
        Cost of a change by a pixel, along x and y each.
    costs : (labels,) float32 out
    """
    least = before_costs[0]
    for k in range(1, before_count):
        least = min(least, before_costs[k])
    for k in range(count):
        cheapest = smoothness
        for other in range(before_count):
            change = abs(motions[k, 0] - before_motions[other, 0]) + abs(motions[k, 1] - before_motions[other, 1])
            cheapest = min(cheapest, before_costs[other] - least + min(slope * change, smoothness))
        costs[k] = energy[k] + cheapest


@njit(**FINITE_JIT)
def walk(count, motions, energy, smoothness, slope, costs, total):
    """Add the costs of the paths that lead along a line of nodes, there and back; `costs` is room for one of them."""
    length = count.shape[0]
    share = np.float32(0.25)
    for direction in range(2):
        for n in range(length):
            here = n if direction == 0 else length - 1 - n
            before = here - 1 if direction == 0 else here + 1
            if n == 0:
                for k in range(count[here]):
                    costs[here, k] = energy[here, k]
            else:
                extend_path(
                    count[before],
                    motions[before],
                    costs[before],
                    count[here],
                    motions[here],
                    energy[here],
                    smoothness,
                    slope,
                    costs[here],
                )
            for k in range(count[here]):
                total[here, k] += share * costs[here, k]


@njit(parallel=True, cache=True, **FINITE_JIT)
def smooth_labels(count, motions, energy, smoothness, slope, total):
    """Costs of all labels once their neighbours have been heard.

    Parameters
    ----------
    count : (rows, columns) int32
        Labels of each node, at least one.
    motions : (rows, columns, capacity, 2 or more) float32
        ``(dx, dy)`` of each label, pixels; anything else behind.
    energy : (rows, columns, capacity) float32
        Cost of each label by itself.
    smoothness : float32
        Cost of a change of motion between neighbours, at most.
    slope : float32
        Cost of a change by a pixel.
    total : (rows, columns, capacity) float32 out
        Mean over the four paths; 0 beyond `count`.
    """
    rows, columns, capacity = energy.shape
    total[:] = 0
    for number in prange(rows):
        row = np.int64(number)
        costs = np.empty((columns, capacity), np.float32)
        walk(count[row], motions[row], energy[row], smoothness, slope, costs, total[row])
    for number in prange(columns):
        column = np.int64(number)
        costs = np.empty((rows, capacity), np.float32)
        walk(
            count[:, column],
            motions[:, column],
            energy[:, column],
            smoothness,
            slope,
            costs,
            total[:, column],
        )
