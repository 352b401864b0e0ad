"""The report's motion search, exactly as reported: every offset at every pixel, in both directions.

Algorithm 1 of the report ("Image-based Reprojection Using a Non-local Means Algorithm"): for every offset k in the
neighbourhood, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` is summed over the similarity area in two
one-dimensional passes, and the offset with the largest sum is the motion. `docs/method.md` states the method in
formulas, and what the report leaves open.

The search radius is the largest motion of a pair of frames, plus 20 % (section 4.1). The renderer knows the largest
motion. Without its vectors, it is estimated from regularised motion fields, because the most similar patch by itself is
no evidence: in a repeated pattern, it may be many periods away.

- OpenCV's DIS flow is regularised. A vector of it is used if its forward-backward error is small, with the length of
  the shortest motion in its neighbourhood that explains the point as well.
- Points that no vector around them explains are looked up in the coarse-to-fine search, which finds small and fast
  objects. Its vectors are used if they explain a good part of a connected region: an object that moves by itself is
  explained as a whole, while chance matches in changing areas are scattered.

The result is a lower bound: edges, occlusions and changing areas are left out, and they are often the fastest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, Literal

import cv2
import numpy as np

from fpsboost.colour import colour_components
from fpsboost.frame_cache import FrameCache
from fpsboost.image_checks import check_pair
from fpsboost.kernels.constants import MAX_PATCH_RADIUS
from fpsboost.kernels.planes import UNIT, PlanePair, colour_scale
from fpsboost.kernels.shortest import ShortestMotion, find_shortest
from fpsboost.motion.components import contrast_components, padded_planes, small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import PatchWindow, search_by_passes, search_fused
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis
from fpsboost.motion.rendered import RenderedMotion, RenderedVectors
from fpsboost.options import Checked, PositiveFloat, Range

Implementation = Literal["fused", "passes"]
"""One fused kernel, or passes of OpenCV over whole images, as Algorithm 1 of the report is written."""


@dataclass(frozen=True)
class ExhaustiveSearch(Checked):
    """The report's motion estimator: of all offsets within the search radius, the one with the most similar patch.

    The cost grows with the number of offsets, ``(2 search_radius + 1)**2``.

    Parameters
    ----------
    search_radius : int or None
        Largest motion that can be found, pixels in x and in y; None chooses it for each pair, see
        `choose_search_radius` (section 4.1).
    patch_radius : int
        Radius r of the similarity area of (2r + 1) x (2r + 1) pixels, 1 to 20; 5 in the report.
    window : {'box', 'gaussian'}
        Weights of the similarity area; the Gaussian's variance is half the area's side (section 3.1).
    v : float
        Standard deviation of the similarity measure for colours in [0, 1]; 0.25 in the report (section 3.2), which
        calls v a variance but squares it in Eq. 3.
    implementation : {'fused', 'passes'}
        One fused kernel, or full-image passes of OpenCV per offset: the same field, about 19 times slower.
    vectors : RenderedVectors or None
        A renderer's motion vectors; if given, they determine the search radius.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(1).integers(0, 256, (32, 48, 3), dtype=np.uint8)
    >>> image0, image1 = FrameCache(noise), FrameCache(np.roll(noise, 3, axis=1))
    >>> field01, field10 = ExhaustiveSearch(search_radius=4, patch_radius=2).estimate(image0, image1)
    >>> field01.flow[16, 24].tolist(), field10.flow[16, 24].tolist()
    ([3.0, 0.0], [-3.0, 0.0])
    """

    needs_every_frame: ClassVar[bool] = False

    search_radius: Annotated[int, Range(1, 1000, unit=" pixels")] | None = None
    patch_radius: Annotated[int, Range(1, MAX_PATCH_RADIUS, unit=" pixels")] = 5
    window: PatchWindow = "box"
    v: PositiveFloat = 0.25
    implementation: Implementation = "fused"
    vectors: RenderedVectors | None = None

    def without_vectors(self) -> ExhaustiveSearch:
        """Return the same search with a radius that is estimated from the images."""
        return replace(self, vectors=None)

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions, in whole pixels; see `fpsboost.motion.MotionEstimator.estimate`.

        The fields hold the search radius that was used. Images are compared as BGR colours, as in the report.
        """
        check_pair(image0.array, image1.array)
        radius = self.search_radius or choose_search_radius(image0, image1, self.vectors)
        search = search_fused if self.implementation == "fused" else search_by_passes
        colours0 = image0.cached(colour_components)
        colours1 = image1.cached(colour_components)
        field01, field10 = search(colours0, colours1, radius, self.patch_radius, self.window, self.v)
        return replace(field01, search_radius=radius), replace(field10, search_radius=radius)


RADIUS_MARGIN = 1.2
"""Ratio of the radius to the largest motion: the report's 20 % more."""

MIN_RADIUS_SHARE = 1 / 32
"""Minimum radius as a share of the frame's longer side. Refraction moves faster than the surfaces that a renderer's
vectors follow: a slowly rotating glass cube whose surfaces move by 2.5 pixels needs a radius of 12 in a frame of
384."""

MIN_RADIUS = 4
"""Minimum radius, pixels, for the smallest frames."""

UNDERESTIMATION_FACTOR = 4 / 3
"""Assumed ratio of the largest motion to the lower bound. Over 36 pairs of rendered frames with known vectors, it was
0.9 to 1.9, and 1.0 in pans."""

MAX_LONGER_SIDE = 640
"""Maximum longer side, pixels; larger frames are reduced to it."""

MAX_MOTION_SHARE = 1 / 4
"""Search range as a share of the frame's longer side."""

STEP: Final = 4
"""Distance between the points that are compared, pixels."""

NEIGHBOURHOOD_RADIUS = 4
"""Points in each direction whose motion may explain a point as well: 16 pixels."""

EDGE_PADDING = 16
"""Width of the repeated edges around the frame, pixels: a window farther outside would contain nothing else."""

PATCH_RADIUS = 5
"""Radius of the patches that are compared, as in the report, pixels."""

BANDWIDTH = 0.09
"""Bandwidth of the similarity, as in the default method."""

CONSISTENCY_TOLERANCE = 0.5
"""Maximum forward-backward error of a valid vector of DIS, pixels: all valid vectors are exact to less than a pixel."""

SIMILARITY_TOLERANCE = 0.2
"""Amount by which the similarity of a shorter motion may be lower, and that of a longer one must be higher."""

MIN_SIMILARITY = 0.5
"""Minimum similarity of a motion that explains a point."""

EXPLAINED_SIMILARITY = 0.7
"""Similarity from which on a point needs no other explanation."""

MIN_EXPLAINED_SHARE = 0.15
"""Minimum share of a connected unexplained region that an object's own motion explains; the rest is what it occludes
and uncovers."""

MIN_OBJECT_POINTS = math.ceil(2 * (2 * PATCH_RADIUS + 1) ** 2 / STEP**2)
"""Minimum number of points of an object that moves by itself: twice a patch. A smaller object follows its surroundings
in a patch of the report's size, and cannot be distinguished from chance."""


def choose_search_radius(image0: FrameCache, image1: FrameCache, vectors: RenderedVectors | None = None) -> int:
    """Choose the report's search radius in x and in y for two frames (section 4.1).

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    vectors : RenderedVectors or None
        A renderer's motion vectors, which give the largest motion; else it is estimated by `expected_motion`.

    Returns
    -------
    int
        Pixels: the largest motion plus 20 %, at least 1/32 of the frame's longer side and at most all of it.

    Raises
    ------
    OptionError, InputError
        The vectors do not belong to these frames; see `fpsboost.motion.rendered.RenderedMotion.estimate`.

    Examples
    --------
    >>> noise = np.random.default_rng(1).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    >>> radius = choose_search_radius(FrameCache(noise), FrameCache(np.roll(noise, 10, axis=1)))
    >>> 12 <= radius <= 20
    True
    """
    longer_side: int = max(image0.pixels.shape[:2])
    least = MIN_RADIUS_SHARE * longer_side
    if vectors is not None:
        fields = RenderedMotion(vectors).estimate(image0, image1)
        largest = max(float(np.abs(field.flow).max()) for field in fields)
        radius = max(RADIUS_MARGIN * largest, least)
    else:
        radius = RADIUS_MARGIN * max(UNDERESTIMATION_FACTOR * expected_motion(image0, image1), least)
    # rounding errors of half-float vectors must not increase the radius by one
    return min(max(MIN_RADIUS, math.ceil(radius - 1e-3)), max(MIN_RADIUS, longer_side))


def expected_motion(image0: FrameCache, image1: FrameCache) -> float:
    """Estimate the largest motion of two frames along x or y, pixels: a lower bound; see `UNDERESTIMATION_FACTOR`.

    Larger frames are reduced to `MAX_LONGER_SIDE`. Each direction contributes the longest consistent motion of the
    regularised field, and the longest motion of an object that this field has missed.
    """
    scale: float = max(1.0, max(image0.pixels.shape[:2]) / MAX_LONGER_SIDE)
    if scale > 1:
        image0, image1 = (FrameCache(image.cached(small_copy, MAX_LONGER_SIDE)) for image in (image0, image1))
    regular = Dis("medium").estimate(image0, image1)
    detailed = CoarseToFine(max_motion_share=MAX_MOTION_SHARE, step=STEP).estimate(image0, image1)
    planes0, planes1 = (
        padded_planes(image.cached(contrast_components), EDGE_PADDING, colour_scale(BANDWIDTH))
        for image in (image0, image1)
    )
    largest = 0.0
    for planes, there, back in (((planes0, planes1), 0, 1), ((planes1, planes0), 1, 0)):
        compared = _compare(*planes, regular[there], NEIGHBOURHOOD_RADIUS)
        certain = regular[there].errors_at_points(STEP, regular[back]) <= CONSISTENCY_TOLERANCE
        certain &= compared.own >= MIN_SIMILARITY
        longest = _largest_neighbour_motion(np.where(certain, compared.shortest, 0))
        gain = _compare(*planes, detailed[there], 0).own - compared.best
        round_trips = detailed[there].errors_at_points(STEP, detailed[back])
        things = _largest_object_motion(detailed[there], round_trips, gain, compared.best < EXPLAINED_SIMILARITY)
        largest = max(largest, longest, things)
    return scale * largest


def _compare(planes0: np.ndarray, planes1: np.ndarray, field: MotionField, around: int) -> ShortestMotion:
    """Compare the patch around each point with those that motion leads to; points are `STEP` apart.

    Besides a point's own motion, that of the points up to `around` points away is compared. Returns the similarity of
    the own motion, the best similarity, and the length of the shortest motion that is about as good.
    """
    points, _ = field.at_points(STEP)
    found = ShortestMotion(*(np.empty(points.shape[:2], np.float32) for _ in range(3)))
    pair = PlanePair(planes0, planes1, EDGE_PADDING, *field.shape, UNIT)
    find_shortest(pair, STEP, PATCH_RADIUS, around, SIMILARITY_TOLERANCE, points, found)
    return found


def _largest_neighbour_motion(lengths: np.ndarray) -> float:
    """Return the largest length that two neighbouring points have; that of a single point may be chance."""
    across = np.minimum(lengths[:, 1:], lengths[:, :-1])
    down = np.minimum(lengths[1:], lengths[:-1])
    return float(max(across.max(initial=0), down.max(initial=0)))


def _largest_object_motion(
    field: MotionField, round_trips: np.ndarray, gain: np.ndarray, unexplained: np.ndarray
) -> float:
    """Return the largest motion of objects that move by themselves and are missing from the regularised field, pixels.

    `round_trips` are the forward-backward errors of the detailed field, pixels; `gain` is how much more similar its
    motion is than the best of the regularised one; `unexplained` marks the points that no regularised motion explains.
    """
    lengths = np.abs(field.at_points(STEP)[0]).max(axis=-1)
    gained = unexplained & (gain >= SIMILARITY_TOLERANCE) & (round_trips <= 1 + 0.05 * lengths)
    count, labels = cv2.connectedComponents(unexplained.astype(np.uint8))
    points, gains = (np.bincount(labels[mask], minlength=count) for mask in (unexplained, gained))
    things = np.flatnonzero((gains >= MIN_OBJECT_POINTS) & (gains >= MIN_EXPLAINED_SHARE * points))
    # 90th percentile, as some of the many points of an object are mismatched
    return max((float(np.percentile(lengths[gained & (labels == thing)], 90)) for thing in things), default=0.0)
