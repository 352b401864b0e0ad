"""The candidate motion with the largest weight at each pixel of an in-between frame.

For values that must not be averaged, such as object numbers. Candidates are weighted as by
`fpsboost.kernels.multi_hypothesis`, but the weights of a motion that several nodes list are not added up.
"""

from typing import Annotated

import numpy as np

from fpsboost.kernels.binding import Array, compiled
from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.pixel_weights import Weighting
from fpsboost.kernels.window_samples import PlaneGroup, Samples, make_plane_group


@compiled
def compare_candidates(
    layer: PlaneGroup,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    weights: Annotated[Array, "float32 (height, width)"],
    places: Annotated[Array, "float32 (4, height, width)"],
) -> None:
    """Write where each pixel lies along the candidate with the largest weight; see `find_dominant_motion`."""


def find_dominant_motion(
    samples0: Samples,
    samples1: Samples,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    weights: Array,
    places: Array,
) -> None:
    """Write where each pixel lies in both frames along the candidate with the largest weight.

    - `weights`: the largest weights, (height, width) float32; zero at first
    - `places`: column and row in frame 0, and in frame 1, (4, height, width) float32; not written where no candidate
      has any weight
    """
    layer = make_plane_group(samples0, samples1, (1, 1), band_planes=0, width=0)
    compare_candidates(layer, t, candidates, weighting, weights, places)
