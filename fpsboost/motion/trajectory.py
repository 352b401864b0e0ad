"""Curved paths: how motion changes from pair to pair.

Between two frames alone everything moves in straight lines at constant speed, which the report names among its
limits. The pairs before and after show whether it speeds up, slows down or turns; from both sides the path is that of
a Catmull-Rom spline, from one side a parabola (Xu et al. 2019, arXiv:1911.00627).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import CELL
from fpsboost.motion.field import MotionField, round_trip

EVERY = 16
"""One pixel in so many is looked at, along x and y."""

CONSISTENT = 1.5
"""A vector counts if the way there and back ends this near to where it began, pixels."""

ONE_SIDED = 0.6
"""Share of the acceleration that is believed from one neighbouring pair alone."""

TWO_SIDED = 1.5
"""The same from both: more than one, because the mean over a neighbourhood and a time falls short of the peak."""


class Neighbour(NamedTuple):
    """The motion of the pair before or after."""

    field01: MotionField
    field10: MotionField
    ratio: float
    """Its duration over that of the pair in between."""


def find_acceleration(
    field01: MotionField, field10: MotionField, before: Neighbour | None, after: Neighbour | None
) -> NDArray[Any] | None:
    """How the motion through each cell of the frame changes.

    Parameters
    ----------
    field01, field10 : MotionField
        Motion of the pair.
    before, after : Neighbour or None
        Motion of the pairs that share its first and its last frame, where they are known.

    Returns
    -------
    (rows, columns, 2) float32 or None
        Pixels per interval squared, one vector for each cell of `fpsboost.kernels.candidates.CELL` pixels; None where
        there is no neighbour.
    """
    sides: list[NDArray[Any]] = []
    if before is not None:
        sides.append(_at_shared_frame((field01, field10), (before.field10, before.field01), before.ratio))
    if after is not None:
        sides.append(_at_shared_frame((field10, field01), (after.field01, after.field10), after.ratio))
    if not sides:
        return None
    share = ONE_SIDED if len(sides) == 1 else TWO_SIDED / 2
    acceleration: NDArray[Any] = np.sum(sides, axis=0) * np.float32(share)
    return acceleration


def _at_shared_frame(
    this: tuple[MotionField, MotionField], other: tuple[MotionField, MotionField], ratio: float
) -> NDArray[Any]:
    """Acceleration at the frame that two pairs share; each is given as motion from that frame and back to it."""
    onward, sure_onward = _sampled(*this)
    backward, sure_backward = _sampled(*other)
    sure = sure_onward & sure_backward
    # x(1) = v + a / 2 and x(-r) = -r v + r^2 a / 2
    change = (onward * np.float32(ratio) + backward) * np.float32(2 / (ratio + ratio * ratio))
    known = np.where(sure[..., np.newaxis], change, np.float32(0))
    height, width = this[0].flow.shape[:2]
    cells = -(-width // CELL), -(-height // CELL)
    covered = cv2.copyMakeBorder(
        np.dstack([known, sure.astype(np.float32)]),
        0,
        cells[1] * CELL // EVERY - sure.shape[0],
        0,
        cells[0] * CELL // EVERY - sure.shape[1],
        cv2.BORDER_CONSTANT,
    )
    sums = cv2.blur(cv2.resize(covered, cells, interpolation=cv2.INTER_AREA), (3, 3))
    return sums[..., :2] / (sums[..., 2:] + np.float32(0.05))


def _sampled(there: MotionField, back: MotionField) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vectors of every few pixels, and whether the way back agrees."""
    height, width = there.flow.shape[:2]
    flow = there.flow[::EVERY, ::EVERY]
    y, x = np.arange(0, height, EVERY), np.arange(0, width, EVERY)
    landing_x, landing_y = np.rint(x + flow[..., 0]), np.rint(y[:, np.newaxis] + flow[..., 1])
    inside = (landing_x >= 0) & (landing_x < width) & (landing_y >= 0) & (landing_y < height)
    return flow, inside & (round_trip(flow, y, x, back.flow) <= CONSISTENT)
