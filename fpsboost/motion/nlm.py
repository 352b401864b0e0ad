"""The default search: patch similarity, coarse to fine.

Search a small copy of the frames in full by the report's similarity, and each finer level around what the coarser one
found in the neighbourhood of a tile, by a linear form of the similarity (`fpsboost.kernels.levels`). The components are
chosen to see low contrast.

In flat areas and repeated patterns many offsets are equally similar. Every point therefore keeps several, and
semi-global matching chooses among them at every level from the coarsest on, because the levels below cannot mend a
wrong choice. One of the offsets is the one that the coarser level expects, where the tile has compared it; on the
coarsest level it is no motion, so that noise agrees on something.

A patch that is larger than an object follows the background. What neither frame explains is therefore searched again
with small patches (residual search). A motion found this way that leads there and back is held less firmly to its
neighbours on the next level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.frame import Pixels, check_pair
from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.levels import level_scale, truncation
from fpsboost.kernels.points import measure_forward_backward_errors
from fpsboost.kernels.refine import refine_points
from fpsboost.kernels.residual_search import measure_point_similarity, search_residuals
from fpsboost.kernels.semi_global import choose_labels, smooth_labels
from fpsboost.kernels.similarity import colour_scale
from fpsboost.kernels.tiles import PADDING, search_tiles
from fpsboost.motion.colour import contrast_components, contrast_planes, normalised
from fpsboost.motion.field import MotionField, spread_points
from fpsboost.motion.full_search import search_fused
from fpsboost.ycbcr import YCbCrImage


class Points(NamedTuple):
    """Motion at points some pixels apart."""

    flow: NDArray[Any]
    """(rows, columns, 2) float32."""
    similarity: NDArray[Any]
    """(rows, columns) float32."""


COARSEST_STEP = 2
"""Distance of the points on the coarsest level, pixels."""

COARSE_STEP = 4
"""The same on all other levels but the finest."""

DENSE_STEP = 2
"""The same on the level that is re-searched first: small objects need points well inside of them, pixels."""

DAMPING = 0.1
"""Of the least-squares step, in squared widths v: holds it back where there is hardly any gradient."""

WEIGHT_FALLOFF = 1 / 32
"""How fast the weight of a pixel falls in it: slower than its similarity, as the fraction is not known yet."""

MAX_REFINEMENT = np.float32(1)
"""Of the least-squares step, pixels."""

UNKNOWN_MOTION = np.float32(1e6)
"""Motion that no vector has."""

MAX_REFINEMENTS = 2
"""Least-squares steps of a vector, at most."""

SMALL_RADIUS = 2
"""r of the patch that looks for small things."""

MIN_SIMILARITY = np.float32(0.75), np.float32(0.7)
"""Minimum small-patch similarity at which a vector is accepted, per re-searched level, coarsest first."""

MIN_GAIN = np.float32(0.2)
"""Minimum increase of that similarity by another vector."""

CONSISTENCY_TOLERANCE = 1
"""Maximum forward-backward error of a vector of the residual search that is believed, pixels."""

WEAK_SMOOTHNESS = np.float32(0.25)
"""Share of the smoothness that a believed vector pays towards its neighbours, so that small islands survive."""


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
    labels : int
        Offsets that each point keeps, to choose from: the most similar ones, and what the coarser level expects.
    smoothness : float
        What a change of motion between neighbouring points costs at most, in units of similarity.
    steepness : float
        Change of motion that costs as much, in pixels for each pixel between the points.
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

    takes_planes: ClassVar[bool] = True

    reach: float = 1 / 8
    patch_radius: int = 5
    v: float = 0.09
    labels: int = 8
    smoothness: float = 1
    steepness: float = 4
    coarsest_side: int = 60
    step: int = 8
    finest_level: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.reach <= 1:
            raise OptionError(f"reach must be above 0 and at most 1 of the frame, not {self.reach}.")
        if not 1 <= self.patch_radius <= 10:
            raise OptionError(f"--patch-radius must be 1 to 10 pixels for this method, not {self.patch_radius}.")
        if self.labels < 1:
            raise OptionError(f"labels must be at least 1, not {self.labels}.")
        if not self.smoothness >= 0:
            raise OptionError(f"smoothness must be at least 0, not {self.smoothness}.")
        if not self.steepness > 0:
            raise OptionError(f"steepness must be above 0, not {self.steepness}.")
        if self.coarsest_side < 1:
            raise OptionError(f"coarsest_side must be at least 1 pixel, not {self.coarsest_side}.")
        if self.finest_level < 0:
            raise OptionError(f"finest_level must be at least 0, not {self.finest_level}.")
        if self.step not in {1, 2, 4, 8, 16, 32}:
            raise OptionError(f"step must be 1, 2, 4, 8, 16 or 32 pixels, not {self.step}.")
        if not self.v > 0:
            raise OptionError(f"--v must be above 0, not {self.v}.")

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.pixels, image1.pixels)
        levels0, levels1 = (image.cached_for_both_pairs(pyramid, self.coarsest_side) for image in (image0, image1))
        last = min(self.finest_level, len(levels0) - 1)
        found, step = self._search_coarsest(levels0[-1], levels1[-1]), COARSEST_STEP
        for level in range(len(levels0) - 2, last - 1, -1):
            spacing, step = step * 2, self.step if level == last else COARSE_STEP
            proposals, ties = [points.flow for points in found], [_firm(points.flow) for points in found]
            looks = len(levels0) - 2 - level
            if 1 <= looks <= len(MIN_SIMILARITY):
                coarser = levels0[level + 1], levels1[level + 1]
                if looks == 1:
                    found = [_denser(points, coarser[0].pixels.shape) for points in found]
                    spacing = 2 * DENSE_STEP
                proposals = [points.flow for points in found]
                proposals, ties = self._search_residuals(*coarser, proposals, spacing // 2, MIN_SIMILARITY[looks - 1])
            found = self._search(
                levels0[level],
                levels1[level],
                [points.flow * 2 for points in found],
                [flow * 2 for flow in proposals],
                ties,
                spacing,
                step,
                # where a pixel off is many in the end, and where nothing below mends it
                reach=int(level in (last, len(levels0) - 2)),
                every=2 if level == last and step % 4 == 0 else 1,
            )
        (height, width), spacing, scale = image0.pixels.shape[:2], step * 2**last, np.float32(2**last)
        field01, field10 = (
            MotionField(points.flow * scale, points.similarity.clip(0, 1), spacing=spacing, size=(height, width))
            for points in found
        )
        return field01, field10

    def _search_coarsest(self, image0: FrameCache, image1: FrameCache) -> list[Points]:
        """Search for every offset at every pixel; what is found then is tried by all points of a tile."""
        components = image0.cached(contrast_components), image1.cached(contrast_components)
        limit = self._limit(image0.pixels)
        fields = search_fused(*components, limit, self.patch_radius, "box", self.v)
        found = [field.flow for field in fields]
        still, ties = [np.zeros_like(flow) for flow in found], [_firm(flow) for flow in found]
        return self._search(image0, image1, still, found, ties, 1, COARSEST_STEP, reach=0)

    def _search(
        self,
        image0: FrameCache,
        image1: FrameCache,
        expected: list[NDArray[Any]],
        proposals: list[NDArray[Any]],
        ties: list[NDArray[Any]],
        spacing: int,
        step: int,
        reach: int,
        every: int = 1,
    ) -> list[Points]:
        """Search one level in both directions around proposals, at points `step` apart; see `search_tiles`.

        `ties`, for each proposal, is the share of the smoothness that holds its points to their neighbours.
        """
        size = image0.pixels.shape[:2]
        found = []
        shape = -(-size[0] // step), -(-size[1] // step)
        for likely, proposed, tie, pair in zip(expected, proposals, ties, self._both_ways(image0, image1), strict=True):
            count, similarity = np.empty(shape, np.int32), np.empty((*shape, self.labels), np.float32)
            flows = np.empty((*shape, self.labels, 2), np.float32)
            search_tiles(
                *pair,
                self._alike,
                *size,
                np.rint(proposed).astype(np.int32),
                np.rint(likely).astype(np.int32),
                spacing,
                step,
                reach,
                self._limit(image0.pixels),
                self.patch_radius,
                every,
                count,
                similarity,
                flows,
            )
            rows, columns = (
                np.minimum((np.arange(points) * step + step // 2) // spacing, places - 1)
                for points, places in zip(shape, tie.shape, strict=True)
            )
            found.append(self._chosen(count, similarity, flows, tie[np.ix_(rows, columns)], step))
        unknown = [np.full_like(points.flow, UNKNOWN_MOTION) for points in found]
        self._refine(image0, image1, [points.flow for points in found], unknown, step)
        return found

    def _chosen(
        self, count: NDArray[Any], similarity: NDArray[Any], flows: NDArray[Any], ties: NDArray[Any], step: int
    ) -> Points:
        """Of every point's offsets the one that goes best with the neighbours' and is similar, too."""
        costs = np.empty_like(similarity)
        slope = self.smoothness / (self.steepness * step)
        smooth_labels(count, flows, -similarity, ties, np.float32(self.smoothness), np.float32(slope), costs)
        points = Points(np.empty((*count.shape, 2), np.float32), np.empty(count.shape, np.float32))
        choose_labels(count, costs, flows, similarity, *points)
        return points

    def _search_residuals(
        self,
        image0: FrameCache,
        image1: FrameCache,
        flows: list[NDArray[Any]],
        step: int,
        enough: np.float32,
    ) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
        """Motion of small things, too, where that of their surroundings does not explain what is seen; and its ties."""
        size, padding, limit = image0.pixels.shape[:2], PADDING + self.patch_radius, self._limit(image0.pixels)
        pairs = self._both_ways(image0, image1)
        known = [np.empty(flow.shape[:2], np.float32) for flow in flows]
        for flow, pair, similarity in zip(flows, pairs, known, strict=True):
            measure_point_similarity(*pair, self._alike, padding, *size, step, SMALL_RADIUS, flow, similarity)
        looked = [flow.copy() for flow in flows]
        around = [cv2.erode(similarity, np.ones((3, 3), np.uint8)) for similarity in known]  # least of the neighbours'
        for flow, pair, here, there in zip(looked, pairs, known, around[::-1], strict=True):
            search_residuals(
                *pair, self._alike, padding, *size, step, limit, SMALL_RADIUS, here, there, enough, MIN_GAIN, flow
            )
        self._refine(image0, image1, looked, flows, step)
        ties = []
        for flow, replaced, back in zip(flows, looked, looked[::-1], strict=True):
            (rows, columns), distance, apart = flow.shape[:2], _firm(flow), np.float32(step)
            places = np.arange(rows), np.arange(columns)
            # counted in points: the one nearest to where a vector leads answers, not the one whose pixels it hits
            measure_forward_backward_errors(replaced / apart, *places, back / apart, 1, rows, columns, distance)
            believed = (np.abs(replaced - flow).max(axis=2) > 1) & (distance * apart <= CONSISTENCY_TOLERANCE)
            ties.append(np.where(believed, WEAK_SMOOTHNESS, np.float32(1)))
        return looked, ties

    def _refine(
        self,
        image0: FrameCache,
        image1: FrameCache,
        flows: list[NDArray[Any]],
        known: list[NDArray[Any]],
        step: int,
    ) -> None:
        """Make motion in both directions exact, in place."""
        size, padding = image0.pixels.shape[:2], PADDING + self.patch_radius
        squared = (level_scale(self.v) / colour_scale(self.v)) ** 2  # levels for each width
        tail, damping = np.float32(WEIGHT_FALLOFF / squared), np.float32(DAMPING * squared)
        for flow, refined, pair in zip(flows, known, self._both_ways(image0, image1), strict=True):
            refine_points(*pair, padding, *size, step, tail, damping, MAX_REFINEMENT, MAX_REFINEMENTS, refined, flow)

    def _both_ways(self, image0: FrameCache, image1: FrameCache) -> tuple[tuple[NDArray[Any], NDArray[Any]], ...]:
        """What the kernels compare, from frame 0 to frame 1 and back."""
        planes0, planes1 = (
            image.cached(contrast_planes, PADDING + self.patch_radius, self.v) for image in (image0, image1)
        )
        return (planes0, planes1), (planes1, planes0)

    @property
    def _alike(self) -> np.uint8:
        """The similarity of two equal pixels."""
        return np.uint8(truncation(self.v))

    def _limit(self, image: Pixels) -> int:
        longer_side: int = max(image.shape[:2])
        return math.ceil(self.reach * longer_side) + 1


def _firm(flow: NDArray[Any]) -> NDArray[Any]:
    """Ties of points that hold on to their neighbours as all do."""
    return np.ones(flow.shape[:2], np.float32)


def _denser(points: Points, size: tuple[int, ...]) -> Points:
    """Points COARSE_STEP apart as points DENSE_STEP apart."""
    shape = -(-size[0] // DENSE_STEP), -(-size[1] // DENSE_STEP)
    return Points(*(spread_points(each, shape, COARSE_STEP // DENSE_STEP) for each in points))


def pyramid(image: Pixels, coarsest_side: int) -> list[FrameCache]:
    """The image and its halves, until the longer side would fall below `coarsest_side`; at most five levels."""
    if isinstance(image, np.ndarray) and image.dtype == np.float32:  # what is no number would spread
        image = normalised(image)
    levels = [image]
    while len(levels) < 5 and max(levels[-1].shape[:2]) >= 2 * coarsest_side:
        levels.append(halved(levels[-1]))
    return [FrameCache(level) for level in levels]


def halved(image: Pixels) -> Pixels:
    """The image at half its size, rounded up; of one in planes, chroma stays as it is where it has that size.

    What is finer than a half can show is filtered out first, or patterns would show in it as others that move otherwise
    (Burt and Adelson 1983, doi:10.1109/TCOM.1983.1095851).
    """
    height, width = ((length + 1) // 2 for length in image.shape[:2])

    def half(pixels: NDArray[Any]) -> NDArray[Any]:
        if pixels.shape[:2] == (height, width):
            return pixels
        smooth = cv2.GaussianBlur(pixels, (5, 5), 0, borderType=cv2.BORDER_REPLICATE)  # 1, 4, 6, 4, 1
        return cv2.resize(smooth, (width, height), interpolation=cv2.INTER_AREA)

    return image.mapped(half) if isinstance(image, YCbCrImage) else half(image).reshape(height, width, -1)
