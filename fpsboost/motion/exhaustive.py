"""The report's motion search, exactly as reported: every offset at every pixel, in both directions.

Algorithm 1 of the report ("Image-based Reprojection Using a Non-local Means Algorithm"): for every offset k in the
neighbourhood, the similarity image ``W_k(x) = xi(A(x), B(x + k))`` is summed over the similarity area in two
one-dimensional passes, and the offset with the largest sum is the motion. `docs/method.md` states the method in
formulas, and what the report leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

from fpsboost.colour import colour_components
from fpsboost.errors import OptionError, check_choice
from fpsboost.frame_cache import FrameCache
from fpsboost.image import check_pair
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import Window, search_by_passes, search_fused
from fpsboost.motion.rendered import RenderedVectors
from fpsboost.motion.search_radius import choose_search_radius

Implementation = Literal["fused", "passes"]
MAX_PATCH_RADIUS = 20  # (2r + 1)^2 fixed-point similarities must fit 31 bits


@dataclass(frozen=True)
class ExhaustiveSearch:
    """The report's motion estimator.

    Parameters
    ----------
    search_radius : int or None
        Largest motion that can be found, pixels in x and in y; None for an automatic choice for each pair, see
        `fpsboost.motion.search_radius` (section 4.1).
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

    search_radius: int | None = None
    patch_radius: int = 5
    window: Window = "box"
    v: float = 0.25
    implementation: Implementation = "fused"
    vectors: RenderedVectors | None = None

    def __post_init__(self) -> None:
        if self.search_radius is not None and not 1 <= self.search_radius <= 1000:
            raise OptionError(f"`search_radius` must be 1 to 1000 pixels, not {self.search_radius}.")
        if not 1 <= self.patch_radius <= MAX_PATCH_RADIUS:
            raise OptionError(f"`patch_radius` must be 1 to {MAX_PATCH_RADIUS} pixels, not {self.patch_radius}.")
        if not self.v > 0:
            raise OptionError(f"`v` must be above 0, not {self.v}.")
        check_choice("`window`", self.window, get_args(Window))
        check_choice("`implementation`", self.implementation, get_args(Implementation))

    def with_vectors(self, vectors: RenderedVectors) -> ExhaustiveSearch:
        return replace(self, vectors=vectors)

    def without_vectors(self) -> ExhaustiveSearch:
        return replace(self, vectors=None)

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions, in whole pixels; see `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.array, image1.array)
        radius = self.search_radius or choose_search_radius(image0, image1, self.vectors)
        search = search_fused if self.implementation == "fused" else search_by_passes
        colours0, colours1 = image0.cached(colour_components), image1.cached(colour_components)
        field01, field10 = search(colours0, colours1, radius, self.patch_radius, self.window, self.v)
        return replace(field01, search_radius=radius), replace(field10, search_radius=radius)
