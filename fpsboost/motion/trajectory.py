"""Curved paths: how motion changes from pair to pair.

Between two frames alone everything moves in straight lines at constant speed, which the report names among its
limits. The pairs before and after show whether it speeds up, slows down or turns; from both sides the path is that of
a Catmull-Rom spline, from one side a parabola (Xu et al. 2019, arXiv:1911.00627).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.points import find_accelerations
from fpsboost.motion.field import MotionField, point_places

CONSISTENT = 1.5
"""A vector counts if the way there and back ends this near to where it began, pixels."""

ONE_SIDED = 0.8
"""Share of the acceleration that is believed from one neighbouring pair alone."""

TWO_SIDED = 1.5
"""The same from both. A Catmull-Rom spline has 1, which is exact for motion that is slow to change; the ideal
interpolation of motion that may change from pair to pair, a sinc, has 4 where it is cut off after two frames on each
side."""


class Neighbour(NamedTuple):
    """The motion of the pair before or after."""

    field01: MotionField
    field10: MotionField
    ratio: float
    """Its duration over that of the pair in between."""


def accelerations_at_points(
    onward: tuple[MotionField, MotionField],
    away: tuple[MotionField, MotionField] | None,
    ratio: float,
    spacing: int,
) -> NDArray[Any]:
    """How motion changes at the frame that two pairs share, at points `spacing` apart.

    Parameters
    ----------
    onward : tuple of MotionField
        Motion from the shared frame to the other one of the pair, and back to it.
    away : tuple of MotionField or None
        The same to the other frame of the neighbouring pair, and back; None where there is none.
    ratio : float
        Duration of the neighbouring pair over that of the pair.
    spacing : int
        Pixels; see `fpsboost.motion.field.point_places`.

    Returns
    -------
    (rows, columns, 3) float32
        1 where vectors in both directions lead there and back, and the acceleration in pixels per interval squared;
        else 0.
    """
    y, x = point_places(onward[0].shape, spacing)
    changes = np.zeros((y.size, x.size, 3), np.float32)
    if away is not None:
        fields = *onward, *away
        if len({field.spacing for field in fields}) == 1:
            vectors, shared = [field.vectors for field in fields], onward[0].spacing
        else:
            vectors, shared = [field.flow for field in fields], 1
        find_accelerations(*vectors, shared, *onward[0].shape, y, x, ratio, np.float32(CONSISTENT), changes)
    return changes
