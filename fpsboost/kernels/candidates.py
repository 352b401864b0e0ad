"""The few motions that may hold around each node of an in-between frame.

Every few pixels of both frames, the motion there is carried to time t. What lands near a node becomes a candidate of
that node; candidates that agree become one, with a vote each. A candidate also has the mean acceleration of its votes:
objects that cross each other keep paths of their own.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import JIT

CELL = 16
"""Distance of the nodes, pixels; each lies in the middle of a cell of this size."""

BAND = 12
"""Rows of nodes that a thread takes at once."""

SUMS = 6
"""What is summed up for a candidate: dx, dy; and of votes whose acceleration is known, votes, ax, ay, ax^2 + ay^2."""


UNKNOWN = np.float32(0.1)
"""Share of a candidate's votes that count as votes for no acceleration."""


@njit(parallel=True, cache=True, **JIT)
def collect_candidates(
    vectors, gradients, accelerations, trust, sign, t, step, support, tolerance, height, width, count, votes, sums
):
    """Add one frame's motion to the nodes' candidates.

    Parameters
    ----------
    vectors : (points down, points across, 2) float32
        Motion at points `step` pixels apart, the first at step / 2, the last within the frame.
    gradients : (points down, points across, 2, 2) float32
        How the motion changes from pixel to pixel: along x, of dx and dy, then along y.
    accelerations : (points down, points across, 3) float32
        Whether the acceleration is known, 1 or 0, and the acceleration, pixels per interval squared, or 0.
    trust : (points down, points across) float32
        What the vote of each point counts, 0 to 1.
    sign : float32
        1 for frame 0, -1 for frame 1: candidates always lead from frame 0 to frame 1.
    t : float32
        Distance in time from the frame, in intervals.
    step : int
    support : float32
        A motion counts for the nodes this near to where it lands, pixels along x and y: the nearer the more.
    tolerance : float32
        Motions that differ by less along x and y are the same, pixels.
    height, width : int
        Size of the frame.
    count : (rows, columns) int32
        Candidates of each node so far; in and out.
    votes : (rows, columns, capacity) float32
        In and out.
    sums : (rows, columns, capacity, SUMS) float32
        Sums over the votes of each candidate; in and out.
    """
    rows, columns, capacity = votes.shape
    one, half, per_cell = np.float32(1), np.float32(0.5), np.float32(1 / CELL)
    middle = np.float32(CELL / 2)
    curve = t * (one - t) * half
    # each thread sees all motions and has nodes of its own: their candidates come in the same order
    for number in prange((rows + BAND - 1) // BAND):
        first, last = np.int64(number) * BAND, min((np.int64(number) + 1) * BAND, rows) - 1
        for i in range(vectors.shape[0]):
            y = np.float32(min(i * step + step // 2, height - 1)) + half  # cells begin before their first pixel
            for j in range(vectors.shape[1]):
                x = np.float32(min(j * step + step // 2, width - 1)) + half
                known, ax, ay = accelerations[i, j, 0], accelerations[i, j, 1], accelerations[i, j, 2]
                landing_x = x + t * vectors[i, j, 0] - curve * ax
                landing_y = y + t * vectors[i, j, 1] - curve * ay
                top = max(math.ceil((landing_y - middle - support) * per_cell), first)
                bottom = min(math.floor((landing_y - middle + support) * per_cell), last)
                left = max(math.ceil((landing_x - middle - support) * per_cell), 0)
                right = min(math.floor((landing_x - middle + support) * per_cell), columns - 1)
                for row in range(top, bottom + 1):
                    down = one - abs(landing_y - middle - np.float32(row * CELL)) / support
                    for column in range(left, right + 1):
                        across = one - abs(landing_x - middle - np.float32(column * CELL)) / support
                        # zoomed and turned motion is extended to the node
                        apart_x = middle + np.float32(column * CELL) - landing_x
                        apart_y = middle + np.float32(row * CELL) - landing_y
                        dx = vectors[i, j, 0] + apart_x * gradients[i, j, 0, 0] + apart_y * gradients[i, j, 1, 0]
                        dy = vectors[i, j, 1] + apart_x * gradients[i, j, 0, 1] + apart_y * gradients[i, j, 1, 1]
                        dx, dy = sign * dx, sign * dy
                        vote = trust[i, j] * down * across
                        if vote <= 0:
                            continue
                        node_votes, node_sums = votes[row, column], sums[row, column]
                        listed = count[row, column]
                        k = 0
                        while k < listed and not (
                            abs(node_sums[k, 0] - dx * node_votes[k]) < tolerance * node_votes[k]
                            and abs(node_sums[k, 1] - dy * node_votes[k]) < tolerance * node_votes[k]
                        ):
                            k += 1
                        if k == capacity:
                            continue
                        if k == listed:
                            count[row, column] += 1
                        node_votes[k] += vote
                        node_sums[k, 0] += vote * dx
                        node_sums[k, 1] += vote * dy
                        vote *= known
                        node_sums[k, 2] += vote
                        node_sums[k, 3] += vote * ax
                        node_sums[k, 4] += vote * ay
                        node_sums[k, 5] += vote * (ax * ax + ay * ay)


@njit(parallel=True, cache=True, **JIT)
def list_candidates(count, votes, sums, still_votes, spread, least_share, motions, energy):
    """The candidates of each node by falling votes, and no motion as the last.

    Parameters
    ----------
    count : (rows, columns) int32
        In and out: how many are listed, which is no more than there is room for.
    votes : (rows, columns, capacity) float32
    sums : (rows, columns, capacity, SUMS) float32
        See `collect_candidates`.
    still_votes : float32
        Votes of no motion.
    spread : float32
        Standard deviation of a candidate's accelerations at which their mean counts half, pixels.
    least_share : float32
        Added to the share of the votes before the logarithm.
    motions : (rows, columns, room, 4) float32 out
        dx, dy, and acceleration ax, ay.
    energy : (rows, columns, room) float32 out
        Negative logarithm of each candidate's share of all votes.
    """
    rows, columns, _ = votes.shape
    room = energy.shape[2]
    for number in prange(rows * columns):
        row, column = np.int64(number) // columns, np.int64(number) % columns
        waiting, node_sums = votes[row, column].copy(), sums[row, column]
        all_votes = waiting.sum() + still_votes
        listed = min(count[row, column], room - 1)
        for place in range(listed):
            k = np.argmax(waiting)
            vote, known = waiting[k], node_sums[k, 2]
            waiting[k] = 0
            motion = motions[row, column, place]
            motion[0], motion[1] = node_sums[k, 0] / vote, node_sums[k, 1] / vote
            motion[2], motion[3] = 0, 0
            if known > 0:
                ax, ay = node_sums[k, 3] / known, node_sums[k, 4] / known
                variance = max(node_sums[k, 5] / known - ax * ax - ay * ay, np.float32(0))
                # vectors that do not agree on how they change are not to be believed
                belief = known / (known + UNKNOWN * vote) * spread * spread / (spread * spread + variance)
                # what stands still is not bent: a held picture stays as it is
                belief *= min(np.float32(4) * (abs(motion[0]) + abs(motion[1])), np.float32(1))
                motion[2], motion[3] = belief * ax, belief * ay
            energy[row, column, place] = -math.log(vote / all_votes + least_share)
        motions[row, column, listed] = 0
        energy[row, column, listed] = -math.log(still_votes / all_votes + least_share)
        count[row, column] = listed + 1


@njit(parallel=True, cache=True, **JIT)
def share_weights(count, costs, least, weights):
    """Weights of each node's candidates by their costs: ``exp(-cost)``, less a threshold, so that none ends abruptly.

    Parameters
    ----------
    count : (rows, columns) int32
    costs : (rows, columns, room) float32
    least : float32
        Weight in that of the best below which a candidate has none.
    weights : (rows, columns, room) float32 out
        Their sum is 1.
    """
    rows, columns = count.shape
    for number in prange(rows * columns):
        row, column = np.int64(number) // columns, np.int64(number) % columns
        node_costs, node_weights, known = costs[row, column], weights[row, column], count[row, column]
        cheapest = node_costs[:known].min()
        node_weights[:] = 0
        for k in range(known):
            node_weights[k] = max(np.float32(math.exp(cheapest - node_costs[k])) - least, np.float32(0))
        total = node_weights.sum()
        for k in range(known):
            node_weights[k] /= total
