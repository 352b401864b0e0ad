"""The default search: the report's patch similarity, coarse to fine.

A small copy of the frames is searched in full; each finer level searches only around what the coarser one found in
the neighbourhood of a tile. The data term is the report's at every level; the components are chosen to see low
contrast, and an offset pays a little for its distance from the coarser level's proposal, which holds flat areas
together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.frame import Image, check_pair
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.similarity import colour_scale
from fpsboost.kernels.tiles import PADDING, tile_kernel
from fpsboost.motion.colour import Components, contrast_components, padded_planes
from fpsboost.motion.exhaustive import search_fused
from fpsboost.motion.field import MotionField

Pyramid = list[Image]


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

    def __post_init__(self) -> None:
        if not 0 < self.reach <= 1:
            raise OptionError(f"reach must be above 0 and at most 1 of the frame, not {self.reach}.")
        if not 1 <= self.patch_radius <= 10:
            raise OptionError(f"--patch-radius must be 1 to 10 pixels for this method, not {self.patch_radius}.")
        if not self.v > 0:
            raise OptionError(f"--v must be above 0, not {self.v}.")

    def estimate(self, image0: Image, image1: Image) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`; flows are whole pixels."""
        check_pair(image0, image1)
        levels0, levels1 = (
            [contrast_components(image) for image in pyramid(image, self.coarsest_side)] for image in (image0, image1)
        )
        limits = [math.ceil(self.reach * max(each.shape[:2])) + 1 for each in levels0]
        coarsest = levels0[-1], levels1[-1], limits[-1]
        field01, field10 = search_fused(*coarsest, self.patch_radius, "box", self.v, self.penalty)
        padding, scale = PADDING + self.patch_radius, colour_scale(self.v)
        for finer0, finer1, limit in zip(levels0[-2::-1], levels1[-2::-1], limits[-2::-1], strict=True):
            planes0, planes1 = (padded_planes(each, padding, 0, LANES, scale) for each in (finer0, finer1))
            size = finer0.shape[:2]
            field01 = self._refine(planes0, planes1, size, field01, limit)
            field10 = self._refine(planes1, planes0, size, field10, limit)
        return field01, field10

    def _refine(
        self, planes0: NDArray[Any], planes1: NDArray[Any], size: tuple[int, ...], coarser: MotionField, limit: int
    ) -> MotionField:
        """Search around what the coarser level found."""
        guess = _doubled(coarser.flow, *size)
        best, flow = np.empty(size, np.float32), np.empty((*size, 2), np.float32)
        search = tile_kernel(self.patch_radius)
        search(planes0, planes1, guess, 1, limit, np.float32(self.penalty), best, flow)
        return MotionField(flow, np.clip(best, 0, 1))


def pyramid(image: Image, coarsest_side: int) -> Pyramid:
    """The image and its halves, until the longer side would fall below `coarsest_side`; at most five levels."""
    levels = [image]
    while len(levels) < 5 and max(levels[-1].shape[:2]) >= 2 * coarsest_side:
        height, width = levels[-1].shape[:2]
        half = cv2.resize(levels[-1], ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
        levels.append(half.reshape(half.shape[0], half.shape[1], -1))
    return levels


def search_full(
    components0: Components,
    components1: Components,
    search_radius: int,
    patch_radius: int,
    v: float,
    penalty: float = 0.0,
) -> MotionField:
    """Search every offset within a radius, at a price for its distance from zero; meant for small images.

    Parameters
    ----------
    components0, components1 : (H, W, 3) float32
    search_radius, patch_radius : int
        Pixels.
    v, penalty : float
        As in `CoarseToFine`.
    """
    still = np.zeros((*components0.shape[:2], 2), np.int32)
    return _search(components0, components1, still, search_radius, search_radius, patch_radius, v, penalty)


def _search(
    components0: Components,
    components1: Components,
    guess: NDArray[Any],
    reach: int,
    limit: int,
    patch_radius: int,
    v: float,
    penalty: float,
) -> MotionField:
    padding, scale = PADDING + patch_radius, colour_scale(v)
    planes0, planes1 = (padded_planes(each, padding, 0, LANES, scale) for each in (components0, components1))
    best, flow = np.empty(guess.shape[:2], np.float32), np.empty(guess.shape, np.float32)
    tile_kernel(patch_radius)(planes0, planes1, guess, reach, limit, np.float32(penalty), best, flow)
    return MotionField(flow, np.clip(best, 0, 1))


def _doubled(flow: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """A coarser level's motion as (H, W, 2) int32 for the next finer one: outliers out, size and vectors doubled."""
    cleaned = cv2.merge([cv2.medianBlur(axis, 5) for axis in cv2.split(flow)])
    return (cv2.resize(cleaned, (width, height), interpolation=cv2.INTER_NEAREST) * 2).astype(np.int32)
