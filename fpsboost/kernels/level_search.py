"""Search of one level of the pyramid in both directions: compare what is proposed, and choose among it.

It is one kernel, as Python would take as long as the kernel between its steps where levels are small.
"""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, compiled, scratch_of
from fpsboost.kernels.planes import PlanePair
from fpsboost.kernels.semi_global import EIGHT, label_scratch
from fpsboost.kernels.tiles import tile_scratch


class CoarseMotion(NamedTuple):
    """Motion in both directions that a coarser level proposes, at places `spacing` pixels apart."""

    proposed: Annotated[Array, "float32 (2, places down, places across, 2)"]
    """Motion in pixels of that level."""
    expected: Annotated[Array, "float32 (2, places down, places across, 2)"]
    """Motion that every point there keeps, whatever its similarity, if it is proposed or zero."""
    ties: Annotated[Array, "float32 (2, places down, places across)"]
    """Share of the smoothness that applies to the points there."""


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

    flow: Annotated[Array, "float32 (2, points down, points across, 2)"]
    similarity: Annotated[Array, "float32 (2, points down, points across)"]


def search_level(pair: PlanePair, coarse: CoarseMotion, settings: LevelSettings, points: Points) -> None:
    """Find the motion of points in both directions, in whole pixels, around what a coarser level proposes.

    The pair is as for `fpsboost.kernels.tiles.search_tiles`; the points are written.
    """
    search_level_in(pair, coarse, settings, points, scratch_of(*level_scratch(coarse, settings, points)))


@compiled
def search_level_in(
    pair: PlanePair,
    coarse: CoarseMotion,
    settings: LevelSettings,
    points: Points,
    scratch: Annotated[Array, "uint8 (bytes)"],
) -> None:
    """Do the work of `search_level`, given memory for `level_scratch`."""


def level_scratch(coarse: CoarseMotion, settings: LevelSettings, points: Points) -> tuple[int, ...]:
    """Return the bytes that `search_level_in` needs: its own, and those of both steps."""
    (_, rows, columns), (_, down, across, _), labels = points.similarity.shape, coarse.proposed.shape, settings.labels
    places, nodes = 8 * down * across, 4 * rows * columns
    radii = settings.step, settings.refine_radius, settings.max_offset
    return (
        *(places, places, nodes, nodes * (-(-labels // EIGHT) * EIGHT), nodes, nodes * labels, 2 * nodes * labels),
        *tile_scratch(*radii, settings.spacing, labels),
        *label_scratch(rows * columns, labels),
    )
