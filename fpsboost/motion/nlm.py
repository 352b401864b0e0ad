"""The default search: the report's patch similarity, coarse to fine.

A small copy of the frames is searched in full; each finer level searches only around what the coarser one found in
the neighbourhood of a tile. The data term is the report's at every level; the components are chosen to see low
contrast, and an offset pays a little for its distance from the coarser level's proposal, which holds flat areas
together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.frame import Image, check_pair
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.refine import WIDE, refine_points
from fpsboost.kernels.similarity import colour_scale
from fpsboost.kernels.tiles import PADDING, TILE, search_tiles
from fpsboost.motion.colour import contrast_components, contrast_planes
from fpsboost.motion.exhaustive import search_fused
from fpsboost.motion.field import MotionField

Pyramid = list[Image]


class Points(NamedTuple):
    """Motion at points some pixels apart."""

    flow: NDArray[Any]
    """(rows, columns, 2) float32."""
    similarity: NDArray[Any]
    """(rows, columns) float32."""


COARSE_STEP = 4
"""Distance of the points on all levels but the finest, pixels."""

DAMPING = np.float32(0.1)
"""Of the least-squares step: holds it back where there is hardly any gradient."""

LONGEST_STEP = np.float32(1)
"""Of the least-squares step, pixels."""


@dataclass(frozen=True)
class CoarseToFine:
    """Non-local means motion, coarse to fine.

    Parameters
    ----------
    reach : float
        Largest motion that can be found, as a share of the frame's longer side.
    patch_radius : int
        r of the patch, 1 to 10, the same at every level.
    v : float
        Width of the similarity measure, for colours in [0, 1].
    penalty : float
        What a pixel of distance from the coarser level's proposal costs, in units of similarity.
    coarsest_side : int
        The pyramid ends where the longer side would fall below this many pixels, and at 1/16 at the latest: small
        fast things vanish in smaller copies.
    step : int
        Distance of the points that have a vector of their own, pixels: 1, 2, 4, 8, 16 or 32.
    finest_level : int
        Where the search ends: 0 at the frames themselves, 1 at half their size.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    reach: float = 1 / 6
    patch_radius: int = 5
    v: float = 0.06
    penalty: float = 0.004
    coarsest_side: int = 60
    step: int = 8
    finest_level: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.reach <= 1:
            raise OptionError(f"reach must be above 0 and at most 1 of the frame, not {self.reach}.")
        if not 1 <= self.patch_radius <= 10:
            raise OptionError(f"--patch-radius must be 1 to 10 pixels for this method, not {self.patch_radius}.")
        if self.step not in {1, 2, 4, 8, 16, 32}:
            raise OptionError(f"step must be 1, 2, 4, 8, 16 or 32 pixels, not {self.step}.")
        if not self.v > 0:
            raise OptionError(f"--v must be above 0, not {self.v}.")

    def estimate(self, image0: Image, image1: Image) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0, image1)
        levels0, levels1 = (pyramid(image, self.coarsest_side) for image in (image0, image1))
        last = min(self.finest_level, len(levels0) - 1)
        coarsest = contrast_components(levels0[-1]), contrast_components(levels1[-1])
        fields = search_fused(*coarsest, self._limit(levels0[-1]), self.patch_radius, "box", self.v, self.penalty)
        found, step = [Points(each.flow, each.similarity) for each in fields], 1
        for level in range(len(levels0) - 2, last - 1, -1):
            spacing, step = step * 2, self.step if level == last else COARSE_STEP
            found = self._search(levels0[level], levels1[level], found, spacing, step, reach=int(level > last))
        field01, field10 = (_at_every_pixel(points, image0, step, 2**last) for points in found)
        return field01, field10

    def _search(
        self, image0: Image, image1: Image, coarser: list[Points], spacing: int, step: int, reach: int
    ) -> list[Points]:
        """Search one level in both directions around what the coarser one found."""
        size, padding = image0.shape[:2], PADDING + self.patch_radius
        planes = [contrast_planes(image, padding, colour_scale(self.v)) for image in (image0, image1)]
        lanes = -(-(TILE + 2 * self.patch_radius) // LANES) * LANES
        found = []
        for points, pair in zip(coarser, (planes, planes[::-1]), strict=True):
            shape = -(-size[0] // step), -(-size[1] // step)
            similarity, flow = np.empty(shape, np.float32), np.empty((*shape, 2), np.float32)
            search_tiles(
                *pair,
                *size,
                np.rint(points.flow * 2).astype(np.int32),
                spacing,
                step,
                reach,
                self._limit(image0),
                self.patch_radius,
                lanes,
                np.float32(self.penalty),
                similarity,
                flow,
            )
            refine_points(*pair, padding, *size, step, WIDE, DAMPING, LONGEST_STEP, flow)
            found.append(Points(flow, similarity))
        return found

    def _limit(self, image: Image) -> int:
        longer_side: int = max(image.shape[:2])
        return math.ceil(self.reach * longer_side) + 1


def _at_every_pixel(points: Points, image: Image, step: int, scale: int) -> MotionField:
    """Every pixel takes what its point has."""
    height, width = image.shape[:2]
    flow, similarity = (
        each.repeat(step * scale, axis=0).repeat(step * scale, axis=1)[:height, :width] for each in points
    )
    return MotionField(np.ascontiguousarray(flow) * np.float32(scale), np.clip(similarity, 0, 1))


def pyramid(image: Image, coarsest_side: int) -> Pyramid:
    """The image and its halves, until the longer side would fall below `coarsest_side`; at most five levels."""
    levels = [image]
    while len(levels) < 5 and max(levels[-1].shape[:2]) >= 2 * coarsest_side:
        height, width = levels[-1].shape[:2]
        half = cv2.resize(levels[-1], ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
        levels.append(half.reshape(half.shape[0], half.shape[1], -1))
    return levels
