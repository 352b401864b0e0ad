"""The candidate motion with the largest weight at each pixel of an in-between frame.

For values that must not be averaged, such as object numbers. Candidates are weighted as by
`fpsboost.kernels.multi_hypothesis`, but the weights of a motion that several nodes list are not added up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.jit import FINITE_JIT, borrowed, njit
from fpsboost.kernels.pixel_weights import (
    Weighting,
    make_sums,
    make_work,
    pool_pixels,
    start_node,
    upsample_squares,
    weigh_plainly,
)
from fpsboost.kernels.window_rows import SQUARES_PER_WINDOW
from fpsboost.kernels.window_samples import WINDOW, Samples, is_rigid, locate_window, make_layer, sample_layer


@njit(**FINITE_JIT)
def keep_heavier(weight, motion, t, top, left, weights, places):
    """Write where a window's pixels lie in both frames along a motion, wherever its weight is the largest so far."""
    height, width = weights.shape
    one, half = np.float32(1), np.float32(0.5)
    curve, centre = t * (one - t) * half, np.float32((WINDOW - 1) * 0.5)
    turns = np.float32(0) if is_rigid(motion) else one
    for j in range(max(-top, 0), min(height - top, WINDOW)):
        v = (np.float32(j) - centre) * turns
        for i in range(max(-left, 0), min(width - left, WINDOW)):
            y, x = top + j, left + i
            if weight[j * WINDOW + i] <= weights[y, x]:
                continue
            weights[y, x] = weight[j * WINDOW + i]
            u = (np.float32(i) - centre) * turns
            dx, dy = motion[0] + u * motion[4] + v * motion[6], motion[1] + u * motion[5] + v * motion[7]
            places[0, y, x] = np.float32(x) + curve * motion[2] - t * dx
            places[1, y, x] = np.float32(y) + curve * motion[3] - t * dy
            places[2, y, x] = places[0, y, x] + dx
            places[3, y, x] = places[1, y, x] + dy


@njit(cache=True, **FINITE_JIT)
def compare_candidates(layer, t, candidates, weighting, work, sums, weights, places):
    """Write where each pixel lies along the candidate with the largest weight; see `find_dominant_motion`."""
    layer, candidates, weighting, work, sums, weights, places = borrowed(
        (layer, candidates, weighting, work, sums, weights, places)
    )
    (height, width), (rows, columns) = weights.shape, candidates.listed.shape
    spacing, before = candidates.spacing, (WINDOW - candidates.spacing) // 2
    for row in range(rows):
        top = row * spacing - before
        for column in range(columns):
            left = column * spacing - before
            start_node(sums)
            least_weight, least_similar = np.float32(0), np.float32(0)
            for k in range(candidates.listed[row, column]):
                motion, prior = candidates.motions[row, column, k], candidates.weights[row, column, k]
                if prior <= 0:
                    continue
                if prior < weighting.min_vote_share * least_weight or least_similar >= weighting.sufficient_similarity:
                    break
                place = locate_window(top, left, motion, t, height, width, work.room.marks)
                sample_layer(layer, place, motion, work.room)
                squared = work.squared
                pool_pixels(layer.distance, squared)
                least_weight, least_similar = weigh_plainly(prior, weighting, work, sums)
                for i in range(SQUARES_PER_WINDOW):  # not in place: numba loses writes to an element of an attribute
                    squared[i] = work.weight[i] * weighting.window_shape[i]
                upsample_squares(squared, layer.across, layer.down, work.upsampled)
                keep_heavier(work.upsampled, motion, t, top, left, weights, places)


def find_dominant_motion(
    samples0: Samples,
    samples1: Samples,
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    weights: NDArray[Any],
    places: NDArray[Any],
) -> None:
    """Write where each pixel lies in both frames along the candidate with the largest weight.

    - `weights`: the largest weights, (height, width) float32; zero at first
    - `places`: column and row in frame 0, and in frame 1, (4, height, width) float32; not written where no candidate
      has any weight
    """
    layer = make_layer(samples0, samples1, (1, 1), band_planes=0, width=0)
    compare_candidates(layer, t, candidates, weighting, make_work(), make_sums(), weights, places)
