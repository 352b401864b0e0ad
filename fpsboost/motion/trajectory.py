"""Curved trajectories from the change of motion from pair to pair.

Between two frames alone, all motion is linear at constant speed, which the report names among its limits. The pairs
before and after show whether it accelerates, decelerates or turns; with both of them, the trajectory is that of a
Catmull-Rom spline, with one of them a parabola (Xu et al. 2019, arXiv:1911.00627).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.points import FieldLayout, RoundTrip, find_accelerations
from fpsboost.motion.field import MotionField, point_places

CONSISTENT = 1.5
"""Maximum forward-backward error of a valid vector, pixels."""

ONE_SIDED_WEIGHT = 0.8
"""Weight of the acceleration if it is estimated from one neighbouring pair only."""

TWO_SIDED_WEIGHT = 1.5
"""Weight of the acceleration if it is estimated from both neighbouring pairs. A Catmull-Rom spline has 1, which is
exact for slowly changing motion; the ideal interpolation of motion that may change from pair to pair, a sinc, has 4 if
truncated after two frames on each side."""


class Neighbour(NamedTuple):
    """Motion of the pair before or after."""

    field01: MotionField
    field10: MotionField
    ratio: float
    """Duration of the neighbouring pair divided by that of the pair in between."""


def accelerations_at_points(
    onward: tuple[MotionField, MotionField],
    away: tuple[MotionField, MotionField] | None,
    ratio: float,
    spacing: int,
) -> NDArray[Any]:
    """Estimate the acceleration at the frame that two neighbouring pairs share, at points `spacing` apart.

    Parameters
    ----------
    onward : tuple of MotionField
        Motion from the shared frame to the other frame of the pair, and back.
    away : tuple of MotionField or None
        The same to the other frame of the neighbouring pair, and back; None if there is no such pair.
    ratio : float
        Duration of the neighbouring pair divided by that of the pair.
    spacing : int
        Distance between points, pixels; see `fpsboost.motion.field.point_places`.

    Returns
    -------
    (rows, columns, 3) float32
        1 where the vectors in both directions are valid, and the acceleration in pixels per interval squared; else 0.
    """
    y, x = point_places(onward[0].shape, spacing)
    changes = np.zeros((y.size, x.size, 3), np.float32)
    if away is not None:
        fields = *onward, *away
        if len({field.spacing for field in fields}) == 1:
            vectors, shared = [field.vectors for field in fields], onward[0].spacing
        else:
            vectors, shared = [field.flow for field in fields], 1
        trips = RoundTrip(*vectors[:2]), RoundTrip(*vectors[2:])
        layout = FieldLayout(shared, *onward[0].shape)
        find_accelerations(*trips, layout, y, x, ratio, np.float32(CONSISTENT), changes)
    return changes
