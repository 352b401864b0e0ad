"""The report's motion search, exactly as reported: every offset, every pixel, both directions.

Algorithm 1 of the report ("Image-based Reprojection Using a Non-local Means Algorithm"): for every offset k in the
neighbourhood, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` is summed over the similarity area in two
one-dimensional passes, and the offset with the largest sum is the motion.

The report leaves two things open. Edges: pixels repeat beyond the border for the sums, and an offset that leads out of
the other frame is no candidate. Ties: where several offsets are equally similar (flat areas), the
smallest motion wins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError, check_choice
from fpsboost.frame import check_pair
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.memory import aligned_empty
from fpsboost.kernels.search import exhaustive_kernel, rank_offsets
from fpsboost.kernels.similarity import UNIT, colour_scale
from fpsboost.motion.colour import Components, colour_components, padded_planes
from fpsboost.motion.field import MotionField
from fpsboost.prepared import PreparedImage

Window = Literal["box", "gaussian"]
Implementation = Literal["fused", "passes"]
LARGEST_PATCH_RADIUS = 20  # (2r + 1)^2 fixed-point similarities must fit 31 bits


@dataclass(frozen=True)
class ExhaustiveSearch:
    """The report's motion estimator.

    Parameters
    ----------
    search_radius : int or None
        Largest motion that can be found, pixels; None chooses it for each pair (`expected_motion` + 20 %,
        section 4.1).
    patch_radius : int
        r of the similarity area of (2r + 1) x (2r + 1) pixels, 1 to 20; 5 in the report.
    window : {'box', 'gaussian'}
        Weights of the similarity area; the Gaussian's variance is half the area's size (section 3.1).
    v : float
        Width of the similarity measure for colours in [0, 1]; 0.25 in the report (section 3.2).
    implementation : {'fused', 'passes'}
        One fused kernel, or full-image passes of OpenCV per offset: the same field, about 20 times slower.

    Raises
    ------
    OptionError
        A value is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(1).integers(0, 256, (32, 48, 3), dtype=np.uint8)
    >>> image0, image1 = PreparedImage(noise), PreparedImage(np.roll(noise, 3, axis=1))
    >>> field01, field10 = ExhaustiveSearch(search_radius=4, patch_radius=2).estimate(image0, image1)
    >>> field01.flow[16, 24].tolist(), field10.flow[16, 24].tolist()
    ([3.0, 0.0], [-3.0, 0.0])
    """

    search_radius: int | None = None
    patch_radius: int = 5
    window: Window = "box"
    v: float = 0.25
    implementation: Implementation = "fused"

    def __post_init__(self) -> None:
        if self.search_radius is not None and not 1 <= self.search_radius <= 1000:
            raise OptionError(f"--search-radius must be 1 to 1000 pixels, not {self.search_radius}.")
        if not 1 <= self.patch_radius <= LARGEST_PATCH_RADIUS:
            raise OptionError(f"--patch-radius must be 1 to {LARGEST_PATCH_RADIUS} pixels, not {self.patch_radius}.")
        if not self.v > 0:
            raise OptionError(f"--v must be above 0, not {self.v}.")
        check_choice("--window", self.window, get_args(Window))
        check_choice("--implementation", self.implementation, get_args(Implementation))

    def estimate(self, image0: PreparedImage, image1: PreparedImage) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`; flows are whole pixels."""
        check_pair(image0.pixels, image1.pixels)
        colours0, colours1 = image0.once(colour_components), image1.once(colour_components)
        radius = self.search_radius or choose_search_radius(colours0, colours1)
        search = search_fused if self.implementation == "fused" else search_by_passes
        return search(colours0, colours1, radius, self.patch_radius, self.window, self.v)


def window_taps(window: Window, patch_radius: int) -> tuple[float, ...]:
    """One axis of the separable window, summing to 1 (section 3.1)."""
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
    window: Window,
    v: float,
    penalty: float = 0.0,
) -> tuple[MotionField, MotionField]:
    """Run the exhaustive search as one fused kernel for both directions.

    Parameters
    ----------
    colours0, colours1 : (H, W, 3) float32
    search_radius, patch_radius, window, v
        As in `ExhaustiveSearch`.
    penalty : float
        What a pixel of motion, in x and in y, costs in units of similarity; nothing in the report.

    Returns
    -------
    field01, field10 : MotionField
        Similarities are those of the winners, less what they paid.
    """
    height, width = colours0.shape[:2]
    taps = None if window == "box" else window_taps(window, patch_radius)
    margin = search_radius + 4
    scale = colour_scale(v)
    planes0 = padded_planes(colours0, patch_radius, 0, LANES, scale)
    planes1 = padded_planes(colours1, patch_radius, margin, margin + LANES, scale)
    score_type = np.int32 if taps is None else np.float32
    widths = width + LANES, width + 2 * margin + 2 * LANES
    best01, best10 = (aligned_empty((height, each), score_type) for each in widths)
    winners01, winners10 = (aligned_empty((height, each), np.int32) for each in widths)
    for best, winners in ((best01, winners01), (best10, winners10)):
        best.fill(-1)
        winners.fill(0)
    ranks, offsets = rank_offsets(search_radius)
    search = exhaustive_kernel(patch_radius, taps)
    share = np.float32(1 / UNIT if taps else 1 / (UNIT * (2 * patch_radius + 1) ** 2))
    lengths = np.abs(np.arange(-search_radius, search_radius + 1))
    prices = ((lengths[:, np.newaxis] + lengths) * (penalty / share)).astype(score_type)
    search(planes0, planes1, height, width, ranks, prices, best01, winners01, best10, winners10)
    inside = slice(margin, margin + width)
    return (
        MotionField(offsets[winners01[:, :width]], best01[:, :width].astype(np.float32) * share),
        MotionField(offsets[winners10[:, inside]], best10[:, inside].astype(np.float32) * share),
    )


def search_by_passes(
    colours0: Components, colours1: Components, search_radius: int, patch_radius: int, window: Window, v: float
) -> tuple[MotionField, MotionField]:
    """The same search as the report states it: full-image passes per offset, one direction after the other.

    Parameters and returns are those of `search_fused`.
    """
    padded0, padded1 = (
        cv2.copyMakeBorder(colours, *(patch_radius,) * 4, cv2.BORDER_REPLICATE) for colours in (colours0, colours1)
    )
    taps = np.array(window_taps(window, patch_radius))
    return (
        _passes_one_way(padded0, padded1, search_radius, patch_radius, taps, v),
        _passes_one_way(padded1, padded0, search_radius, patch_radius, taps, v),
    )


def _passes_one_way(
    a: Components, b: Components, search_radius: int, patch_radius: int, taps: NDArray[Any], v: float
) -> MotionField:
    height, width = a.shape[0] - 2 * patch_radius, a.shape[1] - 2 * patch_radius
    flow, best = np.zeros((height, width, 2), np.float32), np.full((height, width), -1, np.float32)
    inner = slice(patch_radius, -patch_radius)
    box = np.ptp(taps) == 0
    exponent = np.full((1, 3), -1 / (2 * v * v), np.float32)
    for dx, dy in rank_offsets(search_radius)[1].astype(int).tolist():
        y0, y1, x0, x1 = max(0, -dy), min(height, height - dy), max(0, -dx), min(width, width - dx)
        if y0 >= y1 or x0 >= x1:
            continue
        y2, x2 = y1 + 2 * patch_radius, x1 + 2 * patch_radius
        difference = cv2.subtract(a[y0:y2, x0:x2], b[y0 + dy : y2 + dy, x0 + dx : x2 + dx])
        w = cv2.exp(cv2.transform(cv2.multiply(difference, difference), exponent))
        s = cv2.boxFilter(w, -1, (len(taps), len(taps))) if box else cv2.sepFilter2D(w, -1, taps, taps)
        s = s[inner, inner]
        better = s > best[y0:y1, x0:x1]
        best[y0:y1, x0:x1][better] = s[better]
        flow[y0:y1, x0:x1][better] = dx, dy
    return MotionField(flow, best)


def expected_motion(colours0: Components, colours1: Components) -> float:
    """The largest motion to expect, from an exhaustive search on a small copy.

    Parameters
    ----------
    colours0, colours1 : (H, W, 3) float32

    Returns
    -------
    float
        Pixels of the full-size frame: the 99.5th percentile of the larger component of the motion, of frames reduced to
        about 160 pixels in width, over the pixels whose way there and back ends where it began; a fifth of the frame's
        longer side where there are none.
    """
    height, width = colours0.shape[:2]
    scale: float = max(1.0, max(height, width) / 160)
    size = max(1, round(width / scale)), max(1, round(height / scale))
    small = [cv2.resize(colours, size, interpolation=cv2.INTER_AREA) for colours in (colours0, colours1)]
    reach = math.ceil(max(size) / 5)
    field01, field10 = search_fused(small[0], small[1], reach, 5, "box", 0.1)
    y, x = np.mgrid[: size[1], : size[0]]
    there = field01.flow.astype(int)
    back = field10.flow[y + there[..., 1], x + there[..., 0]].astype(int)
    consistent = np.abs(there + back).max(axis=2) <= 1
    motion = np.abs(there).max(axis=2)[consistent]
    return scale * float(np.percentile(motion, 99.5) if motion.size else reach)


def choose_search_radius(colours0: Components, colours1: Components) -> int:
    """The report's heuristic (section 4.1): the largest expected motion plus 20 %, at least 4 pixels."""
    return max(4, math.ceil(1.2 * expected_motion(colours0, colours1)))
