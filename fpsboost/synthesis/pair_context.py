"""The context of a pair of frames for the learnt weights: adjacent frames, and features of the motion fields.

Its record, `PairContext`, is read by the kernels. What does not depend on the time is computed once per pair
(`find_context`), the rest for every time (`context_at`).
"""

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.constants import BLOCKS_2X2_PER_ROW, MARGIN
from fpsboost.kernels.pair_context import PairContext, count_landings, measure_support
from fpsboost.motion.components import gray
from fpsboost.motion.field import point_places
from fpsboost.synthesis import FramePair

FLAT = 0.02
"""Contrast, for white 1, at which ground counts as flat."""

NOTHING = np.empty((0, 0), np.float32)
"""Luma of a frame that does not exist."""


def half_luma(image: FrameCache) -> np.ndarray:
    """Return the luma at half the size, (h, w) float32 with 1 for white, padded as its spline needs it."""
    luma = image.cached(gray)
    even = np.pad(luma, [(0, size % 2) for size in luma.shape], "edge")
    small = cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    padded = cv2.copyMakeBorder(small, MARGIN, MARGIN, MARGIN, MARGIN + BLOCKS_2X2_PER_ROW, cv2.BORDER_REPLICATE)
    return padded.astype(np.float32) * np.float32(1 / 255)


def flatness(image: FrameCache, step: int) -> np.ndarray:
    """Return the flatness around points `step` apart, (rows, columns) float32: 1 without contrast, 0 in texture."""
    luma = image.derived(half_luma)[MARGIN:-MARGIN, MARGIN : -MARGIN - BLOCKS_2X2_PER_ROW]
    detail = luma - cv2.blur(luma, (5, 5))
    variance = cv2.blur(detail * detail, (5, 5))
    y, x = (places // 2 for places in point_places(image.pixels.shape, step))
    return np.asarray(np.exp(variance[np.ix_(y, x)].astype(np.float64) * (-0.5 / FLAT**2)).astype(np.float32))


def find_context(frame_pair: FramePair, step: int, bandwidth: float, sharpness: float) -> PairContext:
    """Return the context of a pair as far as it does not depend on the time; see `context_at`.

    The bandwidth and the sharpness are those of `fpsboost.synthesis.multi_hypothesis.MultiHypothesis`.
    """
    image0 = frame_pair.image0
    image1 = frame_pair.image1
    before = frame_pair.before
    after = frame_pair.after
    luma = (
        NOTHING if before is None or before.other_light else before.image0.derived(half_luma),
        image0.derived(half_luma),
        image1.derived(half_luma),
        NOTHING if after is None or after.other_light else after.image1.derived(half_luma),
    )
    times = -before.duration if before else -1, 0.0, 1.0, 1 + after.duration if after else 2
    fields = frame_pair.field01, frame_pair.field10
    points0, points1 = (
        np.dstack([*field.at_points(step), 1 / (1 + field.errors_at_points(step, back)), image.derived(flatness, step)])
        for image, field, back in zip((image0, image1), fields, fields[::-1], strict=True)
    )
    nothing = np.empty((0, 0, 0), np.float32)
    scale = 1.5 / bandwidth**2
    return PairContext(luma, times, (points0, points1), step, nothing, nothing, scale, sharpness)


def context_at(context: PairContext, t: float, candidates: Candidates) -> PairContext:
    """Return the context with the fields that depend on the time and on the candidates."""
    landings = np.empty((2, *context.points[0].shape[:2]), np.float32)
    for points, time, counts in zip(context.points, (t, 1 - t), landings, strict=True):
        count_landings(points, time, context.step, counts)
    support = np.zeros_like(candidates.weights)
    context = context._replace(landings=landings, support=support.copy())
    measure_support(candidates, context, t, support)
    return context._replace(support=support)
