"""Search of one level of the pyramid in both directions: compare what is proposed, and choose among it.

It is one kernel, as Python would take as long as the kernel between its steps where levels are small.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import EIGHT
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.planes import opposite
from fpsboost.kernels.semi_global import choose_labels
from fpsboost.kernels.tiles import OffsetLists, Proposals, search_tiles


class CoarseMotion(NamedTuple):
    """Motion in both directions that a coarser level proposes, at places `spacing` pixels apart."""

    proposed: NDArray[Any]
    """Motion in pixels of that level, (2, places down, places across, 2) float32."""
    expected: NDArray[Any]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero; the same shape."""
    ties: NDArray[Any]
    """Share of the smoothness that applies to the points there, (2, places down, places across) float32."""


class LevelSettings(NamedTuple):
    """How a level is searched.

    The radii, `max_offset` and `row_step` are described in `fpsboost.kernels.tiles.search_tiles`, `smoothness` and
    `slope` in `fpsboost.kernels.semi_global.choose_labels`.
    """

    scale: np.float32
    """Pixels of this level per pixel of the coarser one."""
    spacing: int
    """Distance between the places of the coarser level, pixels of this one."""
    step: int
    refine_radius: int
    max_offset: int
    patch_radius: int
    row_step: int
    labels: int
    """Offsets among which that of a point is chosen."""
    smoothness: np.float32
    slope: np.float32


class Points(NamedTuple):
    """Motion in both directions at points `step` pixels apart, the first at step / 2."""

    flow: NDArray[Any]
    """(2, points down, points across, 2) float32."""
    similarity: NDArray[Any]
    """(2, points down, points across) float32."""


@njit(**FINITE_JIT)
def whole_pixels(motion, scale):
    """Return motion in units of another scale, rounded, as int32."""
    rounded = np.empty(motion.shape, np.int32)
    for row in range(motion.shape[0]):
        for column in range(motion.shape[1]):
            for axis in range(2):
                rounded[row, column, axis] = np.int32(np.rint(motion[row, column, axis] * scale))
    return rounded


@njit(**FINITE_JIT)
def share_ties(ties, spacing, step, height, width, shared):
    """Give points `step` apart the ties of the places `spacing` apart in which they lie."""
    for row in range(shared.shape[0]):
        place = min(row * step + step // 2, height - 1) // spacing
        for column in range(shared.shape[1]):
            shared[row, column] = ties[place, min(column * step + step // 2, width - 1) // spacing]


@njit(cache=True, **FINITE_JIT)
def search_level(pair, coarse, settings, points):
    """Find the motion of points in both directions, in whole pixels, around what a coarser level proposes.

    The pair is as for `fpsboost.kernels.tiles.search_tiles`; the points are written.
    """
    _, rows, columns = points.similarity.shape
    count, ties = np.empty((rows, columns), np.int32), np.empty((rows, columns), np.float32)
    similarity = np.empty((rows, columns, settings.labels), np.float32)
    offsets = np.empty((rows, columns, settings.labels, 2), np.float32)
    costs = np.empty((rows, columns, (settings.labels + EIGHT - 1) // EIGHT * EIGHT), np.float32)
    for direction in range(2):
        proposed, expected = (
            whole_pixels(coarse.proposed[direction], settings.scale),
            whole_pixels(coarse.expected[direction], settings.scale),
        )
        search_tiles(
            pair,
            Proposals(proposed, expected, settings.spacing),
            settings.step,
            settings.refine_radius,
            settings.max_offset,
            settings.patch_radius,
            settings.row_step,
            OffsetLists(count, similarity, offsets),
        )
        share_ties(coarse.ties[direction], settings.spacing, settings.step, pair.height, pair.width, ties)
        flow, chosen = points.flow[direction], points.similarity[direction]
        choose_labels(count, offsets, similarity, ties, settings.smoothness, settings.slope, costs, flow, chosen)
        pair = opposite(pair)
