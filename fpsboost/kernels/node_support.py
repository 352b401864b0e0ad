"""What the motion fields say around the nodes: landings of points, and how far neighbouring nodes agree on a motion.

A node alone cannot tell which of several motions of weak texture is right. Each candidate is therefore compared with
those that its neighbours believe in, by their votes and by the luma around them.
"""

from typing import Annotated

import numpy as np

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.fusion_features import PairContext


@compiled
def count_landings(
    points: Annotated[Array, "float32 (rows, columns, 5)"],
    t: np.float32,
    step: int,
    landings: Annotated[Array, "float32 (rows, columns)"],
) -> None:
    """Count how many points of a frame land around each point of the in-between frame, bilinearly, at most 2.

    - `points`: of `fpsboost.kernels.fusion_features.PairContext`
    - `t`: distance in time from the frame, in intervals
    - `step`: pixels between points
    """


@compiled
def measure_support(
    candidates: Candidates,
    context: PairContext,
    t: np.float32,
    beliefs: Annotated[Array, "float32 (rows, columns, capacity)"],
) -> None:
    """Write how far the neighbours of each node agree with each of its candidates, into the support of `context`.

    - `beliefs`: work array
    """
