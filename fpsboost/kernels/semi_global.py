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

from fpsboost.kernels.instruction import AS_GIVEN, EIGHT, FLOAT, INDEX, REAL, Index, instruction, vector
from fpsboost.kernels.jit import FINITE_JIT, cgutils, njit

MISSING_LABEL_COST = np.float32(1e30)
"""Cost of a label that a node does not have."""

PATHS_AT_ONCE = 4
"""Neighbouring paths that are followed together: a processor works on one node of each at the same time."""

_VECTOR = vector(REAL, EIGHT)


class Labels(NamedTuple):
    """Labels of all nodes, flat float32, with room for a multiple of EIGHT labels at every node."""

    x: NDArray[Any]
    """Motion along x, then along y, pixels; 0 for labels that a node does not have."""
    y: NDArray[Any]
    energy: NDArray[Any]
    """Data costs; `MISSING_LABEL_COST` for labels that a node does not have."""
    ties: NDArray[Any]
    """Share of the smoothness that applies to each node."""


def extend_paths(x, y, energy, costs, total, here, before, room, slope, limit):
    """Extend the cheapest paths to the labels of a node by the labels of the next node.

    - `x`, `y`, `energy`: as in `Labels`
    - `costs`: cost of the cheapest path to each label, without that of the cheapest of its node, (size,) float32; read
      at `before`, written at `here`
    - `total`: to which the costs of the paths to `here` are added, (size,) float32
    - `here`, `before`: indices of the first label of both nodes; no bounds are checked
    - `room`: number of labels of a node, a multiple of EIGHT
    - `slope`, `limit`: cost of a change of motion per pixel, and its maximum
    """
    own, others = slice(here, here + room), range(before, before + room)
    changes = [abs(x[own] - x[other]) + abs(y[own] - y[other]) for other in others]
    reached = [costs[other] + np.minimum(slope * change, limit) for other, change in zip(others, changes, strict=True)]
    extended = energy[own] + np.min(reached, axis=0)
    costs[own] = extended - extended.min()
    total[own] += extended


@instruction(extend_paths, *(AS_GIVEN,) * 5, INDEX, INDEX, INDEX, FLOAT, FLOAT)
def _build_extend_paths(code, x, y, energy, costs, total, here, before, room, slope, limit):
    builder, slopes, limits = code.builder, code.broadcast(slope, _VECTOR), code.broadcast(limit, _VECTOR)
    groups = builder.udiv(room, room.type(EIGHT))

    def smaller(first, second):
        return builder.select(builder.fcmp_ordered("<", second, first), second, first)

    def lower(variable, value):
        builder.store(smaller(builder.load(variable), value), variable)

    def along(first, group):
        return builder.add(first, builder.mul(group, group.type(EIGHT)))

    highest = code.fill(float(np.finfo(np.float32).max), _VECTOR)
    lowest, cheapest = (cgutils.alloca_once_value(builder, highest) for _ in range(2))
    builder.store(highest, lowest)
    with cgutils.for_range(builder, groups) as own:
        at = along(here, own.index)
        dx, dy = x.load(at, _VECTOR), y.load(at, _VECTOR)
        builder.store(highest, cheapest)
        with cgutils.for_range(builder, groups) as others:
            for lane in range(EIGHT):
                other = code.add(along(before, others.index), lane)
                across, down = (
                    code.call("fabs", builder.fsub(d, code.broadcast(axis.load(other, REAL), _VECTOR)))
                    for d, axis in ((dx, x), (dy, y))
                )
                price = smaller(limits, builder.fmul(slopes, builder.fadd(across, down)))
                lower(cheapest, builder.fadd(code.broadcast(costs.load(other, REAL), _VECTOR), price))
        extended = builder.fadd(energy.load(at, _VECTOR), builder.load(cheapest))
        lower(lowest, extended)
        costs.store(extended, at)
        total.store(builder.fadd(total.load(at, _VECTOR), extended), at)
    least = builder.load(lowest)
    for distance in (4, 2, 1):  # afterwards every lane holds the least of all
        least = smaller(least, code.choose(least, [lane ^ distance for lane in range(EIGHT)]))
    with cgutils.for_range(builder, groups) as own:
        at = along(here, own.index)
        costs.store(builder.fsub(costs.load(at, _VECTOR), least), at)


class Paths(NamedTuple):
    """Parallel paths through the lattice.

    The first begins at node `begin`; its `length` nodes are `step` apart, and the next of the `parallel` paths begins
    `aside` nodes on.
    """

    begin: int
    step: int
    length: int
    aside: int
    parallel: int


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
def add_path_costs(paths, labels, room, smoothness, slope, costs, total):
    """Add the costs of parallel paths to the total; each node has room for so many labels.

    The work array `costs` has a further node, at which all costs are 0.
    """
    begin, step, length, aside, parallel = paths
    x, y, energy, ties = labels
    for first in range(0, parallel, PATHS_AT_ONCE):
        for n in range(length):
            for path in range(first, min(first + PATHS_AT_ONCE, parallel)):
                node = begin + path * aside + n * step
                # no change has a cost at the first node, which has no predecessor
                before = node - step if n else ties.size
                tie = min(ties[Index(node)], ties[Index(before)]) if n else np.float32(0)
                extend_paths(
                    x, y, energy, costs, total, node * room, before * room, room, tie * slope, tie * smoothness
                )


@njit(**FINITE_JIT)
def choose_labels(count, motions, similarity, ties, smoothness, slope, costs, flow, chosen):
    """Choose the label of every node with the lowest cost, aggregated over its neighbours; the first of several.

    - `count`: labels of each node, at least one, (rows, columns) int32
    - `motions`: ``(dx, dy)`` of each label, pixels, (rows, columns, capacity, 2) float32; undefined beyond `count`
    - `similarity`: of each label, (rows, columns, capacity) float32; its negative is the cost at the node
    - `ties`: share of the smoothness that applies to a node, between two the smaller of both, (rows, columns) float32
    - `smoothness`, `slope`: maximum cost of a change of motion between neighbours, and its cost per pixel
    - `costs`: (rows, columns, capacity rounded up to a multiple of EIGHT) float32 out; undefined beyond `count`
    - `flow`, `chosen`: motion and similarity of the chosen label, (rows, columns, 2) and (rows, columns) float32 out
    """
    rows, columns, room = costs.shape
    size, last = costs.size + room, rows * columns - 1  # with a node before the first of every path
    labels = Labels(np.zeros(size, np.float32), np.zeros(size, np.float32), np.empty(size, np.float32), ties.ravel())
    align_labels(count, motions, similarity, Index(room), labels)
    path_costs, total = np.zeros(size, np.float32), costs.ravel()
    total[:] = 0
    for direction in range(4):
        is_vertical, begin, sign = direction > 1, last * (direction % 2), 1 - 2 * (direction % 2)
        step, length, aside, parallel = (columns, rows, 1, columns) if is_vertical else (1, columns, columns, rows)
        paths = Paths(begin, sign * step, length, sign * aside, parallel)
        add_path_costs(paths, labels, room, smoothness, slope, path_costs, total)
    for row in range(Index(rows)):
        for column in range(Index(columns)):
            best = Index(0)
            for k in range(Index(1), Index(count[row, column])):
                if costs[row, column, k] < costs[row, column, best]:
                    best = Index(k)
            flow[row, column, 0] = motions[row, column, best, 0]
            flow[row, column, 1] = motions[row, column, best, 1]
            chosen[row, column] = similarity[row, column, best]
