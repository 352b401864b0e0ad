"""The few motions that may hold around each node of an in-between frame.

Every few pixels of both frames, the motion there is carried to time t. What lands near a node becomes a candidate of
that node; candidates that agree become one, with a vote each. A candidate also has the mean acceleration of its votes:
objects that cross each other keep paths of their own.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fpsboost.kernels.jit import JIT

CELL = 16
"""Distance of the nodes, pixels; each lies in the middle of a cell of this size."""

SUMS = 10
"""What is summed up for a candidate: dx, dy; of votes whose acceleration is known, votes, ax, ay, ax^2 + ay^2; and how
dx and dy change along x, then along y."""

MOTION = 8
"""Numbers of a candidate: dx, dy; acceleration ax, ay; and how dx and dy change along x, then along y."""


UNKNOWN = np.float32(0.1)
"""Share of a candidate's votes that count as votes for no acceleration."""


@njit(cache=True, **JIT)
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
    for i in range(vectors.shape[0]):
        y = np.float32(min(i * step + step // 2, height - 1)) + half  # cells begin before their first pixel
        for j in range(vectors.shape[1]):
            x = np.float32(min(j * step + step // 2, width - 1)) + half
            known, ax, ay = accelerations[i, j, 0], accelerations[i, j, 1], accelerations[i, j, 2]
            landing_x = x + t * vectors[i, j, 0] - curve * ax
            landing_y = y + t * vectors[i, j, 1] - curve * ay
            top = max(math.ceil((landing_y - middle - support) * per_cell), 0)
            bottom = min(math.floor((landing_y - middle + support) * per_cell), rows - 1)
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
                    listed = count[row, column]
                    k = 0
                    while k < listed:
                        share = votes[row, column, k]
                        apart = abs(sums[row, column, k, 0] - dx * share)
                        apart = max(apart, abs(sums[row, column, k, 1] - dy * share))
                        if apart < tolerance * share:
                            break
                        k += 1
                    if k == capacity:
                        continue
                    if k == listed:
                        count[row, column] += 1
                    votes[row, column, k] += vote
                    sums[row, column, k, 0] += vote * dx
                    sums[row, column, k, 1] += vote * dy
                    turned = sign * vote
                    sums[row, column, k, 6] += turned * gradients[i, j, 0, 0]
                    sums[row, column, k, 7] += turned * gradients[i, j, 0, 1]
                    sums[row, column, k, 8] += turned * gradients[i, j, 1, 0]
                    sums[row, column, k, 9] += turned * gradients[i, j, 1, 1]
                    vote *= known
                    sums[row, column, k, 2] += vote
                    sums[row, column, k, 3] += vote * ax
                    sums[row, column, k, 4] += vote * ay
                    sums[row, column, k, 5] += vote * (ax * ax + ay * ay)


@njit(cache=True, **JIT)
def list_candidates(count, votes, sums, still_votes, spread, least_share, least, motions, weights):
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
        Added to each candidate's share of all votes.
    least : float32
        What is taken off each weight, as a share of the best's, so that none ends abruptly.
    motions : (rows, columns, room, MOTION) float32 out
    weights : (rows, columns, room) float32 out
        At least 0; their sum is 1. Those beyond the listed ones are 0.
    """
    rows, columns, capacity = votes.shape
    room, waiting = weights.shape[2], np.empty(capacity, np.float32)
    for row, column in np.ndindex(rows, columns):
        node_sums, node_weights, all_votes = sums[row, column], weights[row, column], np.float32(0)
        for k in range(count[row, column]):
            waiting[k] = votes[row, column, k]
            all_votes += waiting[k]
        all_votes += still_votes
        listed = min(count[row, column], room - 1)
        node_weights[:] = 0
        for place in range(listed):
            k = 0
            for other in range(1, count[row, column]):
                if waiting[other] > waiting[k]:
                    k = other
            vote, known = waiting[k], node_sums[k, 2]
            waiting[k] = 0
            motion = motions[row, column, place]
            motion[0], motion[1] = node_sums[k, 0] / vote, node_sums[k, 1] / vote
            motion[2], motion[3] = 0, 0
            for n in range(4):
                motion[4 + n] = node_sums[k, 6 + n] / vote
            if known > 0:
                ax, ay = node_sums[k, 3] / known, node_sums[k, 4] / known
                variance = max(node_sums[k, 5] / known - ax * ax - ay * ay, np.float32(0))
                # vectors that do not agree on how they change are not to be believed
                belief = known / (known + UNKNOWN * vote) * spread * spread / (spread * spread + variance)
                # what stands still is not bent: a held picture stays as it is
                belief *= min(np.float32(4) * (abs(motion[0]) + abs(motion[1])), np.float32(1))
                motion[2], motion[3] = belief * ax, belief * ay
            node_weights[place] = vote / all_votes + least_share
        motions[row, column, listed] = 0
        node_weights[listed] = still_votes / all_votes + least_share
        count[row, column] = listed + 1
        best, total = np.float32(0), np.float32(0)
        for place in range(listed + 1):
            best = max(best, node_weights[place])
        for place in range(listed + 1):
            node_weights[place] = max(node_weights[place] - least * best, np.float32(0))
            total += node_weights[place]
        for place in range(listed + 1):
            node_weights[place] /= total
