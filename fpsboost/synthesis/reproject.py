"""The report's second step: every in-between pixel looks for the source pixel that lands on it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError, check_choice
from fpsboost.frame import Image
from fpsboost.kernels.reproject import bin_landings, fetch_both, search_iteratively, search_nearest_landing
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.rounding import rounding_offset

SourceSearch = Literal["iterative", "brute-force"]


@dataclass(frozen=True)
class Reproject:
    """Search both frames for the pixel that moves to the target (section 3 of the report).

    A source is *found* where it lands within half a pixel of the target in x and in y. Found in both frames, the two
    colours are blended in time; found in one, that one is taken, so that what is hidden in one frame comes from the
    other; found in neither, both are blended as they are.

    Parameters
    ----------
    search : {'iterative', 'brute-force'}
        *iterative*: the fixed-point search of Yang et al. 2011 from T - m(T) on, T being the target, with the first
        iteration's result where it fails (section 2.2).
        *brute-force*: of all sources within the search radius, the one that lands nearest; of several, the one nearest
        to the target. Any order of the frame instead would take a pan's colours from one frame alone, and half a pixel
        from where they belong.
    iterations : int
        Limit of the iterative search, at least 1.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    search: SourceSearch = "iterative"
    iterations: int = 10

    def __post_init__(self) -> None:
        check_choice("--search", self.search, get_args(SourceSearch))
        if self.iterations < 1:
            raise OptionError(f"--iterations must be at least 1, not {self.iterations}.")

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; paths are straight, as in the report."""
        image0, image1 = frame_pair.image0.array, frame_pair.image1.array
        for t in times:
            source0, found0 = self.find_sources(frame_pair.field01.flow, t)
            source1, found1 = self.find_sources(frame_pair.field10.flow, 1 - t)
            out = np.empty_like(image0)
            half = rounding_offset(image0)
            fetch_both(image0, image1, np.float32(t), half, source0, found0, source1, found1, out)
            yield out

    def find_sources(self, flow: NDArray[Any], t: float) -> tuple[NDArray[Any], NDArray[Any]]:
        """Find the source of every target pixel in one frame.

        Parameters
        ----------
        flow : (H, W, 2) float32
            Motion of that frame.
        t : float
            Distance in time from that frame to the target, in intervals.

        Returns
        -------
        source : (H, W) int32
            ``y * W + x`` of the source pixel.
        found : (H, W) bool
            Whether it lands within half a pixel of the target.
        """
        height, width = flow.shape[:2]
        source, found = np.empty((height, width), np.int32), np.empty((height, width), np.bool_)
        if self.search == "iterative":
            search_iteratively(flow, np.float32(t), self.iterations, source, found)
            return source, found
        starts, members = np.empty(height * width + 1, np.int32), np.empty(height * width, np.int32)
        bin_landings(flow, np.float32(t), starts, members)
        # no source is further from its landing than the largest motion, which the neighbourhood bounds (section 3)
        radius = math.ceil(float(np.abs(flow).max(initial=0)))
        search_nearest_landing(flow, np.float32(t), radius, starts, members, source, found)
        return source, found
