"""Where errors are expected: what moves, what is hidden in one of the frames, and what the method itself doubts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.hiding import Interval
from fpsboost.method_table import methods
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import Transition
from fpsboost.synthesis.fuse import Fuse

MOVES = 1.0
"""Shortest motion from one shown frame to the next that counts as moving, pixels."""

CONSISTENT = 1.5
"""The way there and back ends this near to where it began, or a pixel is hidden in one of the frames, pixels."""

CERTAIN = 0.5
"""Confidence above which the default trusts itself."""

NAMES, OUTSIDES = ("moving", "occluded", "uncertain"), ("still", "visible", "certain")
"""Areas, and what lies outside of each."""


class Regions(NamedTuple):
    """Areas of one hidden frame, each (H, W) bool."""

    moving: NDArray[Any]
    occluded: NDArray[Any]
    uncertain: NDArray[Any]


def find_regions(interval: Interval) -> Iterator[Regions]:
    """The areas of every hidden frame of an interval, as the default method sees the shown ones.

    They are the same for every method that is compared, and no method's own: only the true frames could tell better.

    Parameters
    ----------
    interval : Interval
    """
    interpolator = methods["nlm"]
    pair = interpolator.pair(*interval.prepared())
    times = [float(hidden.t) for hidden in interval.hidden]
    field01, field10 = pair.fields
    assert isinstance(interpolator.synthesizer, Fuse)
    fused = interpolator.synthesizer.fuse(Transition(*pair.in_one_light, field01, field10), times)
    for each, t in zip(fused, times, strict=True):
        moving, occluded = _landed((field01, field10), t)
        yield Regions(moving, occluded, each.confidence < CERTAIN)


def _landed(fields: Sequence[MotionField], t: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Where moving and hidden pixels of both frames are at time t."""
    size = fields[0].flow.shape[:2]
    marks = np.zeros((2, *size), np.uint8)
    for here, other, time in ((fields[0], fields[1], t), (fields[1], fields[0], 1 - t)):
        y, x = np.mgrid[: size[0], : size[1]].astype(np.float32)
        returned = cv2.remap(other.flow, x + here.flow[..., 0], y + here.flow[..., 1], cv2.INTER_NEAREST)
        hidden = np.linalg.norm(here.flow + returned, axis=-1) > CONSISTENT
        rows = np.rint(y + time * here.flow[..., 1]).astype(int)
        columns = np.rint(x + time * here.flow[..., 0]).astype(int)
        inside = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
        for mark, chosen in zip(marks, (np.abs(here.flow).max(axis=-1) > MOVES, hidden), strict=True):
            chosen = chosen & inside  # noqa: PLW2901
            mark[rows[chosen], columns[chosen]] = 1
    # landings leave gaps
    closed = [cv2.morphologyEx(mark, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) for mark in marks]
    moving, occluded = (mark > 0 for mark in closed)
    return moving, occluded
