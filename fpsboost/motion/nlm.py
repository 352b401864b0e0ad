"""The default search: patch similarity, coarse to fine.

The coarsest level is searched in full by the report's similarity, and each finer level around the proposals of the
coarser one in the neighbourhood of a tile, by a linear form of the similarity (`fpsboost.kernels.planes`). The
components are chosen for sensitivity to low contrast.

In flat areas and repeated patterns, many offsets are equally similar. Every point therefore keeps several, and
semi-global matching chooses among them at every level from the coarsest on, because the levels below cannot correct a
wrong choice. One of the offsets is the one that the coarser level expects, if the tile has compared it; on the coarsest
level it is zero motion, so that the motion of noise is consistent.

A patch that is larger than an object follows the background. What neither frame explains is therefore searched again
with small patches (residual search). Motion found this way whose forward-backward error is small pays a lower
smoothness cost towards its neighbours on the next level. On the last level, what is still unexplained in both frames is
matched as connected regions (`fpsboost.kernels.residual_regions`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import cv2
import numpy as np

from fpsboost.colour import normalised
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, view
from fpsboost.image_checks import check_pair
from fpsboost.kernels.constants import MAX_TILE_PATCH_RADIUS
from fpsboost.kernels.level_search import PADDING, CoarseMotion, LevelSettings, Points, search_level
from fpsboost.kernels.planes import PlanePair, colour_scale, level_scale, smooth, truncation
from fpsboost.kernels.refine import refine_bidirectional
from fpsboost.kernels.residual_regions import match_residual_regions
from fpsboost.kernels.residual_search import relax_smoothness, search_residuals_bidirectional
from fpsboost.motion.components import contrast_components, contrast_planes
from fpsboost.motion.field import MotionField, spread_points
from fpsboost.motion.full_search import search_fused
from fpsboost.options import Checked, PositiveFloat, PositiveInt, Range

COARSEST_STEP = 2
"""Distance between points on the coarsest level, pixels."""

COARSE_STEP = 4
"""Distance between points on all other levels but the finest, pixels."""

DENSE_STEP = 2
"""Distance between points on the level that is re-searched first, pixels: small objects need points well inside of
them."""

DAMPING = 0.1
"""Damping of the least-squares step, in squared bandwidths v: limits it where gradients are small."""

WEIGHT_FALLOFF = 1 / 32
"""Rate at which the weight of a pixel falls in the least-squares step: slower than its similarity, as the fraction of a
pixel is not known yet."""

MAX_STEP_LENGTH = 1.0
"""Maximum least-squares step along x and y, pixels."""

MAX_REFINEMENT_STEPS = 2
"""Maximum number of least-squares steps of a vector."""

SMALL_RADIUS = 2
"""Patch radius r of the residual search, pixels."""

MIN_SIMILARITY = 0.75, 0.7
"""Minimum small-patch similarity at which a vector is accepted, per re-searched level, coarsest first."""

MIN_GAIN = 0.2
"""Minimum increase of that similarity by another vector."""

CONSISTENCY_TOLERANCE = 2.0
"""Maximum forward-backward error of a trusted vector of the residual search, pixels."""

WEAK_SMOOTHNESS = 0.25
"""Share of the smoothness that a trusted vector pays towards its neighbours, so that small islands survive."""


@dataclass(frozen=True)
class CoarseToFine(Checked):
    """Non-local means motion, coarse to fine: the estimator of the default method.

    `docs/method.md` describes and derives each step.

    Parameters
    ----------
    max_motion_share : float
        Largest motion that can be found, as a share of the frame's longer side.
    patch_radius : int
        Patch radius r, 1 to 10 pixels, the same at every level.
    v : float
        Bandwidth of the similarity, for colours in [0, 1].
    labels : int
        Candidate offsets per point: the most similar ones, and the prediction from the coarser level.
    smoothness : float
        Maximum cost of a change of motion between neighbouring points, in units of similarity.
    steepness : float
        Change of motion at which the cost reaches the maximum, in pixels for each pixel between the points.
    coarsest_side : int
        Minimum longer side of a pyramid level, pixels; the pyramid ends at 1/16 at the latest. Small fast objects
        vanish at lower resolutions.
    step : int
        Distance between points with a vector of their own, pixels: 1, 2, 4, 8, 16 or 32.
    finest_level : int
        Level at which the search ends: 0 for the frames themselves, 1 for half their size.

    References
    ----------
    H. Hirschmüller, Stereo Processing by Semiglobal Matching and Mutual Information, TPAMI 2008,
    doi:10.1109/TPAMI.2007.1166: the choice among the candidate offsets of neighbouring points.

    A. Buades, B. Coll and J.-M. Morel, A Non-Local Algorithm for Image Denoising, CVPR 2005, doi:10.1109/CVPR.2005.38:
    the similarity of patches.

    Examples
    --------
    >>> noise = np.random.default_rng(1).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    >>> image0, image1 = FrameCache(noise), FrameCache(np.roll(noise, 4, axis=1))
    >>> field01, _ = CoarseToFine(step=4).estimate(image0, image1)
    >>> field01.spacing, field01.vectors.shape, field01.flow[48, 64].tolist()
    (4, (24, 32, 2), [4.0, 0.0])
    """

    takes_planes: ClassVar[bool] = True

    max_motion_share: Annotated[float, Range(above=0, most=1, unit=" of the frame")] = 1 / 6
    patch_radius: Annotated[int, Range(1, MAX_TILE_PATCH_RADIUS, unit=" pixels")] = 4
    v: PositiveFloat = 0.09
    labels: PositiveInt = 8
    smoothness: Annotated[float, Range(0)] = 1
    steepness: PositiveFloat = 4
    coarsest_side: Annotated[int, Range(1, unit=" pixel")] = 60
    step: Literal[1, 2, 4, 8, 16, 32] = 8
    finest_level: Annotated[int, Range(0)] = 0

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`.

        Vectors are in fractions of a pixel. Similarities are those of the whole-pixel vectors of the finest level,
        clipped to [0, 1].
        """
        *_, (field01, field10) = self._search_levels(image0, image1, 2)
        return field01, field10

    def estimate_onward(self, image0: FrameCache, image1: FrameCache) -> list[MotionField]:
        """Estimate the motion from image 0 to image 1 alone, on each level of the pyramid, the coarsest first.

        The last is the first field of `estimate`. It takes less time, as the last level is searched in one direction.
        """
        return [fields[0] for fields in self._search_levels(image0, image1, 1)]

    def _search_levels(
        self, image0: FrameCache, image1: FrameCache, directions: int
    ) -> Iterator[tuple[MotionField, ...]]:
        """Yield the motion of each level, the coarsest first, in both directions or, on the last one, in the first."""
        check_pair(image0.pixels, image1.pixels)
        levels0, levels1 = (image.cached_for_both_pairs(pyramid, self.coarsest_side) for image in (image0, image1))
        last = min(self.finest_level, len(levels0) - 1)
        pair = self._plane_pair(levels0[-1], levels1[-1])
        found = self._search_coarsest(levels0[-1], levels1[-1], pair)
        step = COARSEST_STEP
        size = image0.pixels.shape[:2]
        yield _fields(found, step, len(levels0) - 1, size)
        for looks, level in enumerate(range(len(levels0) - 2, last - 1, -1)):
            flow = found.flow
            if looks == 1:
                shape = -(-pair.height // DENSE_STEP), -(-pair.width // DENSE_STEP)
                flow = np.stack([spread_points(each, shape, COARSE_STEP // DENSE_STEP) for each in flow])
                step = DENSE_STEP
            if 1 <= looks <= len(MIN_SIMILARITY):
                coarse = self._search_residuals(pair, flow, step, MIN_SIMILARITY[looks - 1])
            else:
                coarse = CoarseMotion(flow, flow, np.ones(flow.shape[:3], np.float32))
            spacing = step * 2
            step = self.step if level == last else COARSE_STEP
            pair = self._plane_pair(levels0[level], levels1[level])
            searched = directions if level == last else 2
            found = self._search(pair, coarse, 2, spacing, step, searched)
            if searched > 1 and level == last:
                match_residual_regions(pair, step, self._max_offset(pair), found.flow, found.similarity)
            yield _fields(found, step, level, size)

    def _search_coarsest(self, image0: FrameCache, image1: FrameCache, pair: PlanePair) -> Points:
        """Search for every offset at every pixel, then let all points of a tile compare the offsets found in it."""
        components = image0.cached(contrast_components), image1.cached(contrast_components)
        fields = search_fused(*components, self._max_offset(pair), self.patch_radius, "box", self.v)
        flow = np.stack([field.flow for field in fields])
        coarse = CoarseMotion(flow, np.zeros_like(flow), np.ones(flow.shape[:3], np.float32))
        return self._search(pair, coarse, 1, 1, COARSEST_STEP)

    def _search(
        self,
        pair: PlanePair,
        coarse: CoarseMotion,
        scale: int,
        spacing: int,
        step: int,
        directions: int = 2,
    ) -> Points:
        """Search one level in both directions, or in the first one, and refine the vectors to a fraction of a pixel.

        `scale` is the size of this level relative to the coarser one that `coarse` is the motion of, `spacing` the
        distance of that motion's points in pixels of this level, and `step` the distance of the points whose motion is
        returned.
        """
        settings = LevelSettings(
            scale,
            spacing,
            step,
            self._max_offset(pair),
            self.patch_radius,
            self.labels,
            self.smoothness,
            self.smoothness / (self.steepness * step),
        )
        shape = directions, -(-pair.height // step), -(-pair.width // step)
        found = Points(np.empty((*shape, 2), np.float32), np.empty(shape, np.float32))
        search_level(pair, coarse, settings, found)
        self._refine(pair, np.empty((2, 0, 0, 2), np.float32), found.flow, step)
        return found

    def _search_residuals(self, pair: PlanePair, flow: np.ndarray, step: int, min_similarity: float) -> CoarseMotion:
        """Return the motion including that of small objects, and the smoothness weights of the next level.

        Small objects are those whose motion their surroundings do not predict.
        """
        looked = flow.copy()
        smoothness_weight = np.empty(flow.shape[:3], np.float32)
        similarity = np.empty((2, *smoothness_weight.shape), np.float32)
        search_residuals_bidirectional(
            pair, step, self._max_offset(pair), SMALL_RADIUS, min_similarity, MIN_GAIN, looked, similarity
        )
        self._refine(pair, flow, looked, step)
        relax_smoothness(looked, flow, step, CONSISTENCY_TOLERANCE, WEAK_SMOOTHNESS, smoothness_weight)
        return CoarseMotion(looked, flow, smoothness_weight)

    def _refine(self, pair: PlanePair, known: np.ndarray, flow: np.ndarray, step: int) -> None:
        """Refine the motion in both directions to a fraction of a pixel, in place.

        Vectors that equal those in `known` have been refined before and are left as they are.
        """
        refine_bidirectional(pair, step, *self._in_levels, MAX_STEP_LENGTH, MAX_REFINEMENT_STEPS, known, flow)

    @cached_property
    def _in_levels(self) -> tuple[float, float]:
        """WEIGHT_FALLOFF and DAMPING, converted from squared bandwidths to squared levels of the byte planes."""
        squared = (level_scale(self.v) / colour_scale(self.v)) ** 2  # levels per bandwidth
        return WEIGHT_FALLOFF / squared, DAMPING * squared

    def _plane_pair(self, image0: FrameCache, image1: FrameCache) -> PlanePair:
        """Return the planes that the kernels compare, of two images of one pyramid level."""
        padding = PADDING + self.patch_radius
        planes0, planes1 = (image.cached(contrast_planes, padding, self.v) for image in (image0, image1))
        height, width = image0.pixels.shape[:2]
        return PlanePair(planes0, planes1, padding, height, width, np.uint8(truncation(self.v)))

    def _max_offset(self, pair: PlanePair) -> int:
        """Return the largest offset that is compared on a level, pixels; one more than the motion, for its fraction."""
        return math.ceil(self.max_motion_share * max(pair.height, pair.width)) + 1


def _fields(found: Points, step: int, level: int, size: tuple[int, int]) -> tuple[MotionField, ...]:
    """Return what was found on a level as motion of the image, whose size is given."""
    scale = 2**level
    vectors = found.flow * np.float32(scale)
    similarities = found.similarity.clip(0, 1)
    return tuple(MotionField(*each, None, step * scale, size) for each in zip(vectors, similarities, strict=True))


def pyramid(image: Pixels, coarsest_side: int) -> list[FrameCache]:
    """Return the image and its halved copies, the largest first; at most five levels.

    The longer side of the smallest level is at least `coarsest_side` pixels, unless the image itself is smaller.
    """
    if image.dtype == np.float32:  # NaN and infinity would spread
        image = normalised(view(image).array())
    levels = [image]
    while len(levels) < 5 and max(levels[-1].shape[:2]) >= 2 * coarsest_side:
        levels.append(halved(levels[-1]))
    return [FrameCache(level) for level in levels]


def halved(image: Pixels) -> Pixels:
    """Return the image at half its size, rounded up; chroma planes that have that size already are unchanged.

    The image is low-pass filtered first to avoid aliasing, as aliased patterns have another motion (Burt and Adelson
    1983, doi:10.1109/TCOM.1983.1095851).
    """
    height, width = ((length + 1) // 2 for length in image.shape[:2])

    def half(pixels: np.ndarray) -> np.ndarray:
        if pixels.shape[:2] == (height, width):
            return pixels
        smoothed = np.empty_like(pixels, order="C")
        smooth(np.atleast_3d(np.ascontiguousarray(pixels)), np.atleast_3d(smoothed))
        return cv2.resize(smoothed, (width, height), interpolation=cv2.INTER_AREA)

    return view(image).map(half)
