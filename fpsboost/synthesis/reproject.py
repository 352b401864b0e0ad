"""The report's second step: search the source pixel that lands on each in-between pixel.

It follows one motion per pixel, unlike `MultiHypothesis`, and takes colours at whole pixels, as the report does.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fpsboost.image import Image, rounding_offset
from fpsboost.kernels.reproject import bin_landings, fetch_both, search_iteratively, search_nearest_landing
from fpsboost.options import Checked, PositiveInt
from fpsboost.synthesis import FramePair

SourceSearch = Literal["iterative", "brute-force"]
"""Search of the source pixel: by iteration from the target, or among all pixels that land nearby."""


@dataclass(frozen=True)
class Reproject(Checked):
    """Search of both frames for the pixel that moves to the target (section 3 of the report).

    A source is *found* if it lands within half a pixel of the target in x and in y. If it is found in both frames, the
    two colours are blended in time; if in one, that one is used, so that pixels occluded in one frame come from the
    other; if in neither, both are blended unchanged.

    Parameters
    ----------
    search : {'iterative', 'brute-force'}
        *iterative*: the fixed-point search of Yang et al. 2011 from T - m(T) on, where T is the target, with the first
        iteration's result if it fails (section 2.2). *brute-force*: of all sources within the search radius, the one
        that lands nearest; of several, the one nearest to the target. A choice by raster order would instead take a
        pan's colours from one frame alone, at an offset of half a pixel.
    iterations : int
        Maximum number of iterations of the iterative search, at least 1.

    References
    ----------
    L. Yang, Y.-C. Tse, P. V. Sander, J. Lawrence, D. Nehab, H. Hoppe and C. L. Wilkins, Image-based Bidirectional Scene
    Reprojection, ACM Transactions on Graphics 2011, doi:10.1145/2070781.2024184

    Examples
    --------
    >>> from fpsboost import FrameCache
    >>> from fpsboost.motion.exhaustive import ExhaustiveSearch
    >>> noise = np.random.default_rng(1).integers(0, 256, (32, 48, 3), dtype=np.uint8)
    >>> image0, image1 = FrameCache(noise), FrameCache(np.roll(noise, 4, axis=1))
    >>> fields = ExhaustiveSearch(search_radius=6, patch_radius=2).estimate(image0, image1)
    >>> (middle,) = Reproject().synthesize(FramePair(image0, image1, *fields), [0.5])
    >>> bool((middle[8:24, 12:36] == np.roll(noise, 2, axis=1)[8:24, 12:36]).all())
    True
    """

    search: SourceSearch = "iterative"
    iterations: PositiveInt = 10

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Generate images on linear trajectories; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0, image1 = (np.ascontiguousarray(image.array) for image in (frame_pair.image0, frame_pair.image1))
        for t in times:
            source0, found0 = self.find_sources(frame_pair.field01.flow, t)
            source1, found1 = self.find_sources(frame_pair.field10.flow, 1 - t)
            out = np.empty_like(image0)
            fetch_both(image0, image1, t, rounding_offset(image0), source0, found0, source1, found1, out)
            yield out

    def find_sources(self, flow: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Find the source of every target pixel in one frame, given its motion.

        Parameters
        ----------
        flow : (H, W, 2) float32
            Motion of the frame's pixels over the whole interval.
        t : float
            Time from the frame to the target, as a share of the interval.

        Returns
        -------
        source : (H, W) int32
            Index ``y * W + x`` of the source pixel.
        found : (H, W) bool
            Whether it lands within half a pixel of the target.
        """
        height, width = flow.shape[:2]
        source = np.empty((height, width), np.int32)
        found = np.empty((height, width), np.bool_)
        if self.search == "iterative":
            search_iteratively(flow, t, self.iterations, source, found)
            return source, found
        starts = np.empty(height * width + 1, np.int32)
        members = np.empty(height * width, np.int32)
        bin_landings(flow, t, starts, members)
        # no source is further from its landing position than the largest motion, which bounds the search (section 3)
        radius = math.ceil(min(float(np.abs(flow).max(initial=0)), max(height, width)))
        search_nearest_landing(flow, t, radius, starts, members, source, found)
        return source, found
