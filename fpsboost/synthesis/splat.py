"""Forward splatting, as in video coding's motion compensation: pixels are moved along the motion of their blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame import Image
from fpsboost.kernels.reproject import fetch_both
from fpsboost.kernels.splat import splat
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.rounding import rounding_offset


@dataclass(frozen=True)
class Splat:
    """Forward splatting of the pixels of frame 0 to time t (forward reprojection, section 2.1 of the report).

    A pixel of sufficient similarity lands on the nearest target, with the colours of both ends blended in time. Where
    several land, the most similar one is shown, and of several such pixels the first in raster order. Where none lands,
    the frames are blended unchanged.

    Parameters
    ----------
    least_similarity : float
        Minimum similarity of a pixel that is splatted, from 0 to 1.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    least_similarity: float = 0.9

    def __post_init__(self) -> None:
        if not 0 <= self.least_similarity <= 1:
            raise OptionError(f"least_similarity must be from 0 to 1, not {self.least_similarity}.")

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Generate images with the linear motion of frame 0 only; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0, image1 = frame_pair.image0.array, frame_pair.image1.array
        flow, similarity = frame_pair.field01.flow, frame_pair.field01.similarity
        known = np.ones(similarity.shape, np.bool_)  # so that colours are always blended
        for t in times:
            source0, source1 = np.empty(similarity.shape, np.int32), np.empty(similarity.shape, np.int32)
            splat(flow, similarity, np.float32(self.least_similarity), np.float32(t), source0, source1)
            out = np.empty_like(image0)
            fetch_both(image0, image1, np.float32(t), rounding_offset(image0), source0, known, source1, known, out)
            yield out
