"""Candidate motions around each node of an in-between frame.

The motion at points a few pixels apart in both frames is projected to time t. Motion that lands near a node becomes a
candidate of that node; candidates that agree are merged, and their votes are added up. A candidate also has the mean
acceleration of its votes, so that objects that cross each other keep separate trajectories.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import JIT, njit

SUMS_PER_CANDIDATE = 10
"""Number of sums per candidate: dx, dy; of votes whose acceleration is known, votes, ax, ay, ax^2 + ay^2; and the
gradients of dx and dy along x, then along y."""

VALUES_PER_MOTION = 8
"""Number of values per candidate: dx, dy; acceleration ax, ay; and the gradients of dx and dy along x, then along y."""


UNKNOWN = np.float32(0.1)
"""Share of a candidate's votes that count as votes for zero acceleration."""


class Votes(NamedTuple):
    """Votes of the points of a frame, the first half a step from its corner, the last within it."""

    vectors: NDArray[Any]
    """Motion to the other frame, (points down, points across, 2) float32."""
    gradients: NDArray[Any]
    """Of dx and dy along x, then along y, pixels per pixel, (points down, points across, 2, 2) float32."""
    accelerations: NDArray[Any]
    """Whether it is known, 0 or 1, and pixels per interval squared, or 0; (points down, points across, 3) float32."""
    trust: NDArray[Any]
    """Weight of each vote, 0 to 1, (points down, points across) float32."""


class CollectedVotes(NamedTuple):
    """Votes for the candidates of each node; each node lies at the centre of a cell of `spacing` pixels."""

    listed: NDArray[Any]
    """Candidates of each node so far, (rows, columns) int32."""
    votes: NDArray[Any]
    """Votes of each listed candidate, (rows, columns, capacity) float32."""
    places: NDArray[Any]
    """Where the sums of each listed candidate are, (rows, columns, capacity) int32."""
    sums: NDArray[Any]
    """Sums over the votes of all candidates in the order in which they were found, (rows * columns * capacity,
    SUMS_PER_CANDIDATE) float32; as most nodes have few candidates, most of it is never touched."""
    total: NDArray[Any]
    """Number of candidates of all nodes, (1,) int64."""
    spacing: int


class Candidates(NamedTuple):
    """Candidate motions around each node; nodes are `spacing` pixels apart."""

    listed: NDArray[Any]
    """Number of candidates, (rows, columns) int32."""
    motions: NDArray[Any]
    """(rows, columns, room, VALUES_PER_MOTION) float32."""
    weights: NDArray[Any]
    """At least 0, with a sum of 1; 0 beyond the listed candidates; (rows, columns, room) float32."""
    spacing: int


def no_votes(nodes: tuple[int, int], capacity: int, spacing: int) -> CollectedVotes:
    """Return room for the votes at some rows and columns of nodes."""
    shape = (*nodes, capacity)
    votes, places = np.empty(shape, np.float32), np.empty(shape, np.int32)
    sums = np.empty((votes.size, SUMS_PER_CANDIDATE), np.float32)
    return CollectedVotes(np.zeros(nodes, np.int32), votes, places, sums, np.zeros(1, np.int64), spacing)


@njit(cache=True, **JIT)
def collect_candidates(points, sign, t, step, support, tolerance, height, width, collected):
    """Add the motion of one frame to the candidates of the nodes.

    - `sign`: 1 for frame 0, -1 for frame 1: candidates are always motions from frame 0 to frame 1
    - `t`: distance in time from the frame, in intervals
    - `step`: distance between points, pixels
    - `support`: maximum distance along x and y between a node and the landing position of a motion that votes for it,
      pixels; the weight decreases with distance
    - `tolerance`: motions that differ by less than this along x and y are merged, pixels
    """
    vectors, gradients, accelerations, trust = points
    count, votes, places, sums, total, spacing = collected
    rows, columns, capacity = votes.shape
    one, half = np.float32(1), np.float32(0.5)
    middle = half * np.float32(spacing)
    curve = t * (one - t) * half
    for i in range(vectors.shape[0]):
        y = np.float32(min(i * step + step // 2, height - 1)) + half  # relative to the frame corner
        for j in range(vectors.shape[1]):
            x = np.float32(min(j * step + step // 2, width - 1)) + half
            certainty, ax, ay = accelerations[i, j, 0], accelerations[i, j, 1], accelerations[i, j, 2]
            landing_x = x + t * vectors[i, j, 0] - curve * ax
            landing_y = y + t * vectors[i, j, 1] - curve * ay
            first_y, last_y = seen_by_both(vectors[i, j, 1], t, height)
            first_x, last_x = seen_by_both(vectors[i, j, 0], t, width)
            top, bottom = nodes_within(landing_y, support, first_y, last_y, spacing, rows)
            left, right = nodes_within(landing_x, support, first_x, last_x, spacing, columns)
            for row in range(top, bottom + 1):
                y_of_node = min(max(middle + np.float32(row * spacing), first_y), last_y)
                down = one - abs(landing_y - y_of_node) / support
                for column in range(left, right + 1):
                    x_of_node = min(max(middle + np.float32(column * spacing), first_x), last_x)
                    across = one - abs(landing_x - x_of_node) / support
                    # extrapolate zoom and rotation to the node
                    apart_x = middle + np.float32(column * spacing) - landing_x
                    apart_y = middle + np.float32(row * spacing) - landing_y
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
                        its = sums[places[row, column, k]]
                        apart = max(abs(its[0] - dx * share), abs(its[1] - dy * share))
                        if apart < tolerance * share:
                            break
                        k += 1
                    if k == capacity:
                        continue
                    if k == listed:
                        count[row, column] += 1
                        votes[row, column, k] = 0
                        places[row, column, k] = total[0]
                        sums[total[0]] = 0
                        total[0] += 1
                    votes[row, column, k] += vote
                    its = sums[places[row, column, k]]
                    its[0] += vote * dx
                    its[1] += vote * dy
                    turned = sign * vote
                    its[6] += turned * gradients[i, j, 0, 0]
                    its[7] += turned * gradients[i, j, 0, 1]
                    its[8] += turned * gradients[i, j, 1, 0]
                    its[9] += turned * gradients[i, j, 1, 1]
                    vote *= certainty
                    its[2] += vote
                    its[3] += vote * ax
                    its[4] += vote * ay
                    its[5] += vote * (ax * ax + ay * ay)


@njit(**JIT)
def seen_by_both(motion, t, size):
    """Return from where to where, along one axis, what moves like this is within both frames.

    `motion` is that from a frame to the other, `t` the distance in time from this frame.
    """
    zero, one = np.float32(0), np.float32(1)
    first = max(t * motion, (t - one) * motion, zero)
    last = np.float32(size) - max(-t * motion, (one - t) * motion, zero)
    return first, max(first, last)


@njit(**JIT)
def nodes_within(landing, support, first, last, spacing, count):
    """Return the first and the last node in whose support a motion lands; beyond `first` and `last` all are as these.

    What moves in from outside, or out, is seen by one frame alone, and no motion is found for it: it is likely to move
    as what is next to it.
    """
    middle, per_cell = np.float32(0.5) * np.float32(spacing), np.float32(1) / np.float32(spacing)
    top = max(math.ceil((landing - middle - support) * per_cell), 0) if landing - support > first else 0
    bottom = min(math.floor((landing - middle + support) * per_cell), count - 1)
    return top, bottom if landing + support < last else count - 1


@njit(cache=True, **JIT)
def list_candidates(collected, zero_motion_prior, acceleration_tolerance, min_share, min_weight, candidates):
    """Write the candidates of each node, as many as fit, in order of decreasing votes, followed by zero motion.

    - `zero_motion_prior`: votes for zero motion
    - `acceleration_tolerance`: standard deviation of a candidate's accelerations at which their mean is given half its
      weight, pixels
    - `min_share`: added to each candidate's share of all votes
    - `min_weight`: subtracted from each weight, as a share of the largest weight, so that weights fade out continuously
    """
    count, votes, places, sums, _, _ = collected
    listed_count, motions, weights, _ = candidates
    rows, columns, capacity = votes.shape
    room, waiting = weights.shape[2], np.empty(capacity, np.float32)
    for row, column in np.ndindex(rows, columns):
        node_weights, all_votes = weights[row, column], np.float32(0)
        for k in range(count[row, column]):
            waiting[k] = votes[row, column, k]
            all_votes += waiting[k]
        all_votes += zero_motion_prior
        listed = min(count[row, column], room - 1)
        node_weights[:] = 0
        for place in range(listed):
            k = 0
            for other in range(1, count[row, column]):
                if waiting[other] > waiting[k]:
                    k = other
            its = sums[places[row, column, k]]
            vote, sure = waiting[k], its[2]
            waiting[k] = 0
            motion = motions[row, column, place]
            motion[0], motion[1] = its[0] / vote, its[1] / vote
            motion[2], motion[3] = 0, 0
            for n in range(4):
                motion[4 + n] = its[6 + n] / vote
            if sure > 0:
                ax, ay = its[3] / sure, its[4] / sure
                variance = max(its[5] / sure - ax * ax - ay * ay, np.float32(0))
                # the acceleration is unreliable if the votes disagree on it
                belief = (
                    sure
                    / (sure + UNKNOWN * vote)
                    * acceleration_tolerance
                    * acceleration_tolerance
                    / (acceleration_tolerance * acceleration_tolerance + variance)
                )
                # zero motion has no acceleration: a frozen frame stays unchanged
                belief *= min(np.float32(4) * (abs(motion[0]) + abs(motion[1])), np.float32(1))
                motion[2], motion[3] = belief * ax, belief * ay
            node_weights[place] = vote / all_votes + min_share
        motions[row, column, listed] = 0
        node_weights[listed] = zero_motion_prior / all_votes + min_share
        listed_count[row, column] = listed + 1
        best, total = np.float32(0), np.float32(0)
        for place in range(listed + 1):
            best = max(best, node_weights[place])
        for place in range(listed + 1):
            node_weights[place] = max(node_weights[place] - min_weight * best, np.float32(0))
            total += node_weights[place]
        for place in range(listed + 1):
            node_weights[place] /= total
