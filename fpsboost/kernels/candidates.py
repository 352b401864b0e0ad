"""Candidate motions around each node of an in-between frame.

The motion at points a few pixels apart in both frames is projected to time t. Motion that lands near a node becomes a
candidate of that node; candidates that agree are merged, and their votes are added up. A candidate also has the mean
acceleration of its votes, so that objects that cross each other keep separate trajectories.
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, Float, Scratch, compiled
from fpsboost.kernels.constants import SUMS_PER_CANDIDATE


class Votes(NamedTuple):
    """Votes of the points of a frame, the first half a step from its corner, the last within it."""

    vectors: Annotated[Array, "float32 (down == -(-height // step), across == -(-width // step), 2)"]
    """Motion to the other frame."""
    gradients: Annotated[Array, "float32 (down, across, 2, 2)"]
    """Gradients of dx and dy along x, then along y, pixels per pixel."""
    accelerations: Annotated[Array, "float32 (down, across, 3)"]
    """Whether it is known, 0 or 1, and pixels per interval squared, or 0."""
    trust: Annotated[Array, "float32 (down, across)"]
    """Weight of each vote, 0 to 1."""


class CollectedVotes(NamedTuple):
    """Votes for the candidates of each node; each node lies at the centre of a cell of `spacing` pixels."""

    listed: Annotated[Array, "out int32 (rows, columns)"]
    """Candidates of each node so far."""
    votes: Annotated[Array, "out float32 (rows, columns, capacity)"]
    """Votes of each listed candidate."""
    places: Annotated[Array, "out int32 (rows, columns, capacity)"]
    """Index of each listed candidate in `sums`."""
    sums: Annotated[Array, "out float32 (candidates == rows * columns * capacity, SUMS_PER_CANDIDATE)"]
    """Sums over the votes of all candidates in the order in which they were found; as most nodes have few candidates,
    most of it is never touched."""
    total: Annotated[Array, "out int64 (1,)"]
    """Number of candidates of all nodes."""
    spacing: int


class Candidates(NamedTuple):
    """Candidate motions around each node; nodes are `spacing` pixels apart."""

    listed: Annotated[Array, "int32 (rows, columns)"]
    """Number of candidates."""
    motions: Annotated[Array, "float32 (rows, columns, room, VALUES_PER_MOTION)"]
    """The VALUES_PER_MOTION of each candidate."""
    weights: Annotated[Array, "float32 (rows, columns, room)"]
    """At least 0, with a sum of 1; 0 beyond the listed candidates."""
    spacing: int


def no_votes(nodes: tuple[int, int], capacity: int, spacing: int) -> CollectedVotes:
    """Return room for the votes at some rows and columns of nodes."""
    shape = (*nodes, capacity)
    votes = np.empty(shape, np.float32)
    places = np.empty(shape, np.int32)
    sums = np.empty((votes.size, SUMS_PER_CANDIDATE), np.float32)
    return CollectedVotes(np.zeros(nodes, np.int32), votes, places, sums, np.zeros(1, np.int64), spacing)


@compiled
def collect_candidates(
    points: Votes,
    sign: Float,
    t: Float,
    step: int,
    support: Float,
    tolerance: Float,
    height: int,
    width: int,
    collected: CollectedVotes,
) -> None:
    """Add the motion of one frame to the candidates of the nodes.

    - `sign`: 1 for frame 0, -1 for frame 1: candidates are always motions from frame 0 to frame 1
    - `t`: distance in time from the frame, in intervals
    - `step`: distance between points, pixels
    - `support`: maximum distance along x and y between a node and the landing position of a motion that votes for it,
      pixels; the weight decreases with distance
    - `tolerance`: motions that differ by less than this along x and y are merged, pixels
    """


@compiled
def list_candidates(
    collected: CollectedVotes,
    zero_motion_prior: Float,
    acceleration_tolerance: Float,
    min_share: Float,
    min_weight: Float,
    listed: Annotated[Array, "out int32 (rows, columns)"],
    motions: Annotated[Array, "out float32 (rows, columns, room, VALUES_PER_MOTION)"],
    weights: Annotated[Array, "out float32 (rows, columns, room)"],
    scratch: Scratch = None,
) -> None:
    """Write the candidates of each node, as many as fit, in order of decreasing votes, followed by zero motion.

    - `zero_motion_prior`: votes for zero motion
    - `acceleration_tolerance`: standard deviation of a candidate's accelerations at which their mean is given half its
      weight, pixels
    - `min_share`: added to each candidate's share of all votes
    - `min_weight`: subtracted from each weight, as a share of the largest weight, so that weights fade out continuously
    - `listed`, `motions`, `weights`: of `Candidates`
    """
