"""How far the report's search must look: the largest motion of a pair of frames, plus 20 % (section 4.1).

The renderer knows the largest motion. Where it is not asked, it is estimated from regular motion fields, because the
most similar patch by itself is no evidence: in a pattern it may be many periods away.

- OpenCV's DIS flow is regular. A vector of it counts where it leads there and back, and as long as the shortest motion
  found around it that explains the point as well.
- What no vector around a point explains is looked up in the coarse-to-fine search, which sees things that are small and
  fast. Its vectors count where they explain a good part of a connected region: a thing that moves by itself is
  explained as a whole, while chance matches in what changes are scattered.

What counts is a lower bound: edges, occlusions and things that change are left out, and they are often the fastest.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame_cache import FrameCache
from fpsboost.io.vector_folder import VectorFolder
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.shortest import find_shortest
from fpsboost.kernels.similarity import colour_scale
from fpsboost.motion.colour import contrast_components, padded_planes, small_copy
from fpsboost.motion.field import MotionField, forward_backward_error, point_places
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis
from fpsboost.motion.rendered import RenderedMotion

MARGIN = 1.2
"""The report's: the radius is the largest motion plus 20 %."""

MIN_RADIUS_SHARE = 1 / 32
"""Of the frame's longer side, the least radius. Refraction moves faster than the surfaces that a renderer's vectors
follow: a glass cube that turns slowly, its surfaces by 2.5 pixels, needs 12 in a picture of 384."""

MIN_RADIUS = 4
"""Pixels, for the smallest frames."""

UNSEEN = 4 / 3
"""How much larger than what counts the largest motion is taken to be. Over 36 pairs of rendered frames with known
vectors, it was 0.9 to 1.9 times that, and 1.0 in pans."""

LONGER_SIDE = 640
"""Frames are reduced to it, pixels."""

MAX_MOTION = 1 / 4
"""Of the frame's longer side, the largest motion that is looked for."""

STEP = 4
"""Distance of the points that are looked at, pixels."""

AROUND = 4
"""Points each way whose motion may explain a point as well: 16 pixels."""

BORDER = 16
"""How far around the frame its edges are repeated, pixels: a window farther out would see nothing else."""

PATCH_RADIUS = 5
"""Of the patches that are compared, the report's."""

BANDWIDTH = 0.09
"""Bandwidth of the similarity, that of the default method."""

CONSISTENCY_TOLERANCE = 0.5
"""Pixels by which a vector of DIS may miss on the way back: all that counts is exact to less than a pixel."""

TOLERANCE = 0.2
"""Similarity that a shorter motion may lack, and that a longer one must add."""

MIN_SIMILARITY = 0.5
"""Below it, a motion explains nothing."""

EXPLAINED = 0.7
"""From it on, a point needs no other explanation."""

MIN_SHARE = 0.2
"""Of a connected region that is not explained, the part that a thing's own motion explains: the rest is what it covers
and uncovers."""

MIN_POINTS = math.ceil(2 * (2 * PATCH_RADIUS + 1) ** 2 / STEP**2)
"""Of a thing that moves by itself: twice a patch. What is smaller goes with its surroundings in a patch of the report's
size, and cannot be told from chance."""


def choose_search_radius(image0: FrameCache, image1: FrameCache, vectors: VectorFolder | None = None) -> int:
    """Choose the report's search radius for two frames (section 4.1).

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    vectors : VectorFolder, optional
        The renderer's motion, which is estimated where it is not given.

    Returns
    -------
    int
        Pixels in x and in y: the largest motion plus 20 %, and at least 1/32 of the frame's longer side.

    Raises
    ------
    OptionError, InputError
        As `fpsboost.io.vector_folder.RenderedMotion.estimate`.

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
        radius = max(MARGIN * largest, least)
    else:
        radius = MARGIN * max(UNSEEN * expected_motion(image0, image1), least)
    # vectors in half floats must not push a whole number over the next one
    return min(max(MIN_RADIUS, math.ceil(radius - 1e-3)), max(MIN_RADIUS, longer_side))


def expected_motion(image0: FrameCache, image1: FrameCache) -> float:
    """Estimate the largest motion of two frames from what of it is certain.

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.

    Returns
    -------
    float
        Larger component, pixels of the frames: a lower bound; see `UNSEEN`.
    """
    scale: float = max(1.0, max(image0.pixels.shape[:2]) / LONGER_SIDE)
    if scale > 1:
        image0, image1 = (FrameCache(image.cached(small_copy, LONGER_SIDE)) for image in (image0, image1))
    regular = Dis("medium").estimate(image0, image1)
    detailed = CoarseToFine(reach=MAX_MOTION, step=STEP).estimate(image0, image1)
    planes0, planes1 = (
        padded_planes(image.cached(contrast_components), BORDER, 0, 2 * LANES, colour_scale(BANDWIDTH))
        for image in (image0, image1)
    )
    size = image0.pixels.shape[:2]
    largest = 0.0
    for planes, there, back in (((planes0, planes1), 0, 1), ((planes1, planes0), 1, 0)):
        compared = _compare(*planes, size, regular[there], AROUND)
        certain = _round_trip(regular[there], regular[back], size) <= CONSISTENCY_TOLERANCE
        certain &= compared.own >= MIN_SIMILARITY
        longest = _longest_of_neighbours(np.where(certain, compared.shortest, 0))
        gain = _compare(*planes, size, detailed[there], 0).own - compared.best
        round_trips = _round_trip(detailed[there], detailed[back], size)
        things = _longest_of_things(detailed[there], round_trips, gain, compared.best < EXPLAINED)
        largest = max(largest, longest, things)
    return scale * largest


class _Compared(NamedTuple):
    """What `find_shortest` finds out, each (points down, points across) float32."""

    own: NDArray[Any]
    best: NDArray[Any]
    shortest: NDArray[Any]


def _compare(
    planes0: NDArray[Any], planes1: NDArray[Any], size: tuple[int, ...], field: MotionField, around: int
) -> _Compared:
    points, _ = field.at_points(STEP)
    results = _Compared(*(np.empty(points.shape[:2], np.float32) for _ in range(3)))
    find_shortest(
        planes0,
        planes1,
        BORDER,
        *size,
        STEP,
        PATCH_RADIUS,
        LANES,
        around,
        np.float32(TOLERANCE),
        points,
        *results,
    )
    return results


def _round_trip(there: MotionField, back: MotionField, size: tuple[int, ...]) -> NDArray[Any]:
    return forward_backward_error(there.at_points(STEP)[0], *point_places(size, STEP), back)


def _longest_of_neighbours(lengths: NDArray[Any]) -> float:
    """The largest length that two neighbouring points have: a single one may be chance."""
    across = np.minimum(lengths[:, 1:], lengths[:, :-1])
    down = np.minimum(lengths[1:], lengths[:-1])
    return float(max(across.max(initial=0), down.max(initial=0)))


def _longest_of_things(
    field: MotionField, round_trips: NDArray[Any], gain: NDArray[Any], unexplained: NDArray[Any]
) -> float:
    """The largest motion of things that move by themselves, of which the regular field knows nothing."""
    lengths = np.abs(field.at_points(STEP)[0]).max(axis=-1)
    gained = unexplained & (gain >= TOLERANCE) & (round_trips <= 1 + 0.05 * lengths)
    count, labels = cv2.connectedComponents(unexplained.astype(np.uint8))
    points, gains = (np.bincount(labels[mask], minlength=count) for mask in (unexplained, gained))
    things = np.flatnonzero((gains >= MIN_POINTS) & (gains >= MIN_SHARE * points))
    # nine tenths: of a thing's many points, some are matched elsewhere
    return max((float(np.percentile(lengths[gained & (labels == thing)], 90)) for thing in things), default=0.0)
