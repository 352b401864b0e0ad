"""What video coding's motion compensation makes of a pair: blocks moved along their motion and painted."""

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
    """Paint the pixels of frame 0 where they are at time t (forward reprojection, section 2.1 of the report).

    A pixel that looks enough like what it moves to lands on the nearest place, with the colours of both ends mixed in
    time. Where several land, the most similar one is seen, the first in raster order of those. Where none lands, the
    frames are mixed as they are.

    Parameters
    ----------
    least_similarity : float
        Pixels whose motion has less are not painted; from 0 to 1.

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
        """See `fpsboost.synthesis.Synthesizer.synthesize`; only the motion of frame 0 is followed, straight."""
        image0, image1 = frame_pair.image0.array, frame_pair.image1.array
        flow, similarity = frame_pair.field01.flow, frame_pair.field01.similarity
        known = np.ones(similarity.shape, np.bool_)  # so that colours are always mixed
        for t in times:
            source0, source1 = np.empty(similarity.shape, np.int32), np.empty(similarity.shape, np.int32)
            splat(flow, similarity, np.float32(self.least_similarity), np.float32(t), source0, source1)
            out = np.empty_like(image0)
            fetch_both(image0, image1, np.float32(t), rounding_offset(image0), source0, known, source1, known, out)
            yield out
