"""Search for every offset at every pixel, in both directions: a fused kernel, and OpenCV passes as its reference.

Edges: pixels are repeated beyond the border for the sums, and an offset that leads out of the other frame is not a
candidate. Ties: if several offsets are equally similar (flat areas), the smallest motion wins.

Both functions take images of three components, (H, W, 3) float32 with values around [0, 1]: the colours in
`ExhaustiveSearch`, contrast components on the coarsest level of `CoarseToFine` and on thumbnails.
"""

from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np

from fpsboost.kernels.constants import LANES
from fpsboost.kernels.full_search import BestOffsets, rank_offsets, search
from fpsboost.kernels.planes import UNIT, colour_scale
from fpsboost.motion.components import Components, padded_planes
from fpsboost.motion.field import MotionField

PatchWindow = Literal["box", "gaussian"]
"""Weights of the pixels of a patch: equal, or a Gaussian."""


def window_taps(window: PatchWindow, patch_radius: int) -> tuple[float, ...]:
    """Return the weights of one axis of the separable window, which sum to 1 (section 3.1).

    There are ``2 patch_radius + 1``. The report gives the Gaussian "a variance of 0.5 times the size of the similarity
    area", which is taken literally: a variance of (2r + 1) / 2 pixels squared. See `docs/method.md` for the results of
    the other reading.
    """
    size = 2 * patch_radius + 1
    if window == "box":
        return (1 / size,) * size
    weights = np.exp(-(np.arange(-patch_radius, patch_radius + 1) ** 2) / (2 * 0.5 * size))
    return tuple((weights / weights.sum()).tolist())


def search_fused(
    colours0: Components,
    colours1: Components,
    search_radius: int,
    patch_radius: int,
    window: PatchWindow,
    bandwidth: float,
    penalty: float = 0.0,
) -> tuple[MotionField, MotionField]:
    """Search every offset with one fused kernel for both directions.

    Parameters
    ----------
    colours0, colours1 : (H, W, 3) float32
        Components of both images.
    search_radius, patch_radius : int
        Largest motion in x and in y, and radius of the patches, pixels.
    window : {'box', 'gaussian'}
        Weights of the pixels of a patch.
    bandwidth : float
        Standard deviation v of the similarity measure.
    penalty : float
        Cost of a pixel of motion, in x and in y, in units of similarity; 0 in the report.

    Returns
    -------
    field01, field10 : MotionField
        Motion in whole pixels, with the similarities of the best offsets minus their penalties.
    """
    height, width = colours0.shape[:2]
    is_box = window == "box"
    weights = np.array(window_taps(window, patch_radius), np.float32)
    scale = colour_scale(bandwidth)
    planes0 = padded_planes(colours0, patch_radius, scale)
    planes1 = padded_planes(colours1, patch_radius, scale, LANES)
    score_type = np.int32 if is_box else np.float32
    shape = height, width + 2 * LANES
    found01, found10 = (BestOffsets(np.full(shape, -1, score_type), np.zeros(shape, np.int32)) for _ in range(2))
    ranks, offsets = rank_offsets(search_radius)
    share = np.float32(1 / (UNIT * (2 * patch_radius + 1) ** 2) if is_box else 1 / UNIT)
    penalties = _motion_penalties(search_radius, penalty / share, score_type)
    search(planes0, planes1, height, width, ranks, penalties, found01, found10, weights)
    field01, field10 = (
        MotionField(
            offsets.take(found.ranks[:, inside], axis=0), found.similarity[:, inside].astype(np.float32) * share
        )
        for found, inside in ((found01, slice(width)), (found10, slice(LANES, LANES + width)))
    )
    return field01, field10


@lru_cache(maxsize=32)  # the same for every frame of a clip
def _motion_penalties(search_radius: int, per_pixel: float, dtype: type[np.number[Any]]) -> np.ndarray:
    """Return the penalty of every offset, by its length along x and y together; read-only.

    `per_pixel` is on the scale of the sums that the kernel compares.
    """
    lengths = np.abs(np.arange(-search_radius, search_radius + 1))
    penalties = ((lengths[:, np.newaxis] + lengths) * per_pixel).astype(dtype)
    penalties.flags.writeable = False
    return penalties


def search_by_passes(
    colours0: Components,
    colours1: Components,
    search_radius: int,
    patch_radius: int,
    window: PatchWindow,
    bandwidth: float,
) -> tuple[MotionField, MotionField]:
    """Search every offset as the report states it: full-image passes per offset, one direction after the other.

    Parameters and results are those of `search_fused` without a penalty. It states plainly what the kernel computes.
    """
    padded0, padded1 = (
        cv2.copyMakeBorder(colours, *(patch_radius,) * 4, cv2.BORDER_REPLICATE) for colours in (colours0, colours1)
    )
    taps = np.array(window_taps(window, patch_radius))
    return (
        _passes_one_way(padded0, padded1, search_radius, patch_radius, taps, bandwidth),
        _passes_one_way(padded1, padded0, search_radius, patch_radius, taps, bandwidth),
    )


def _passes_one_way(
    a: Components, b: Components, search_radius: int, patch_radius: int, taps: np.ndarray, bandwidth: float
) -> MotionField:
    """Return the motion from image `a` to image `b`, both padded by the patch radius."""
    height = a.shape[0] - 2 * patch_radius
    width = a.shape[1] - 2 * patch_radius
    flow = np.zeros((height, width, 2), np.float32)
    best = np.full((height, width), -1, np.float32)
    inner = slice(patch_radius, -patch_radius)
    box = np.ptp(taps) == 0
    exponent = np.full((1, 3), -1 / (2 * bandwidth * bandwidth), np.float32)
    # shortest motion first: a later offset must be more similar, so that ties go to the smallest motion
    for dx, dy in rank_offsets(search_radius)[1].astype(int).tolist():
        y0 = max(0, -dy)
        y1 = min(height, height - dy)
        x0 = max(0, -dx)
        x1 = min(width, width - dx)
        if y0 >= y1 or x0 >= x1:
            continue
        y2 = y1 + 2 * patch_radius
        x2 = x1 + 2 * patch_radius
        difference = cv2.subtract(a[y0:y2, x0:x2], b[y0 + dy : y2 + dy, x0 + dx : x2 + dx])
        w = cv2.exp(cv2.transform(cv2.multiply(difference, difference), exponent))
        s = cv2.boxFilter(w, -1, (len(taps), len(taps))) if box else cv2.sepFilter2D(w, -1, taps, taps)
        s = s[inner, inner]
        better = s > best[y0:y1, x0:x1]
        best[y0:y1, x0:x1][better] = s[better]
        flow[y0:y1, x0:x1][better] = dx, dy
    return MotionField(flow, best)
