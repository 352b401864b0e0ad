"""In-between frame as a weighted mean of both frames along every candidate motion.

Each window is the mean of its samples along the candidates of its node, by the weights of the pixels. Windows are faded
into each other, so that no borders are visible (overlapped block motion compensation, Orchard and Sullivan 1994,
doi:10.1109/83.334974).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.fusion_features import Surroundings, describe_candidate
from fpsboost.kernels.instruction import SIXTEEN, Index, fma
from fpsboost.kernels.jit import FINITE_JIT, LANES, borrowed, njit
from fpsboost.kernels.pixel_weights import (
    Weighting,
    make_sums,
    make_work,
    pool_chroma,
    pool_pixels,
    start_node,
    upsample_squares,
    weigh_features,
    weigh_plainly,
)
from fpsboost.kernels.window_rows import SQUARES_PER_ROW, SQUARES_PER_WINDOW, add_row
from fpsboost.kernels.window_samples import WINDOW, Samples, locate_further, locate_window, make_layer, sample_layer

SPARE = LANES
"""Columns of coefficients that are needed beyond the right margin."""

CONFIDENCE_POWER = 8
"""Power of the similarity that is the confidence; see `finish_confidence`."""


class SampledImage(NamedTuple):
    """Image as `blend_hypotheses` reads it; its coefficients have at least SPARE columns beyond the right margin."""

    full: Samples
    """Planes at full resolution."""
    further: Samples
    """Planes that are sampled along, if any: subsampled chroma, with one sample for two columns of pixels, whose
    differences weigh like those of the full planes; or layers of full resolution, which have no say in the weights."""


class ValueRange(NamedTuple):
    """Values of an image."""

    white: np.float32
    """Factor on the blended values."""
    rounding_offset: np.float32
    """Added before truncation."""
    lowest: np.float32
    highest: np.float32
    straight_alpha: bool
    """Whether to divide all other planes by the last one."""


class Target(NamedTuple):
    """Planes to write, as a flat array: every layout of three axes would be compiled by itself."""

    values: NDArray[Any]
    """(size,)."""
    shape: tuple[int, ...]
    """Number of planes, rows and columns."""
    steps: tuple[int, ...]
    """Distance from one plane, row and column to the next in `values`."""

    @classmethod
    def of(cls, planes: NDArray[Any]) -> Self:
        """Return (C, H, W) planes that fill their memory without gaps, in any order of the axes."""
        return cls(planes.ravel(order="K"), planes.shape, tuple(step // planes.itemsize for step in planes.strides))


class Blended(NamedTuple):
    """Generated frame."""

    image: Target
    """Planes at full resolution."""
    further: Target
    """Planes that are sampled along, any number."""
    confidence: NDArray[Any]
    """(height, width) float32; has no columns if the confidence is not requested."""


class Window(NamedTuple):
    """First row and column of the window of a node, which may lie outside of the frame, and the frame's size."""

    top: int
    left: int
    height: int
    width: int


def blend_hypotheses(
    frame0: SampledImage,
    frame1: SampledImage,
    subsampling: tuple[int, int],
    t: np.float32,
    candidates: Candidates,
    weighting: Weighting,
    surroundings: Surroundings | None,
    value_range: ValueRange,
    blended: Blended,
) -> None:
    """Write the in-between frame; without `surroundings`, by plain weights.

    `subsampling` tells how many rows and columns of pixels there are per sample of the further planes: (1, 1) for
    layers, (1 or 2, 2) for chroma.
    """
    (channels, _, width), has_confidence = blended.image.shape, blended.confidence.shape[1] > 0
    full = make_layer(frame0.full, frame1.full, (1, 1), channels + 1 + has_confidence, width)
    further_channels, _, further_width = blended.further.shape
    further = make_layer(frame0.further, frame1.further, subsampling, further_channels + 1, further_width)
    work, sums = make_work(), make_sums()
    blend_nodes(full, further, t, candidates, weighting, surroundings, value_range, work, sums, blended)


@njit(cache=True, **FINITE_JIT)
def blend_nodes(full, further, t, candidates, weighting, around, value_range, work, sums, blended):
    """Write the in-between frame, one row of nodes at a time; see `blend_hypotheses`."""
    full, further, candidates, weighting, around, work, sums, blended = borrowed(
        (full, further, candidates, weighting, around, work, sums, blended)
    )
    (channels, height, width), (rows, columns) = blended.image.shape, candidates.listed.shape
    has_confidence, further_planes = blended.confidence.shape[1] > 0, blended.further.shape[0]
    spacing, before = candidates.spacing, (WINDOW - candidates.spacing) // 2
    for row in range(rows):
        top = row * spacing - before
        for column in range(columns):
            window = Window(top, column * spacing - before, height, width)
            count = candidates.listed[row, column]
            motions, priors = candidates.motions[row, column, :count], candidates.weights[row, column, :count]
            node = row, column
            sum_candidates(full, further, window, t, motions, priors, node, weighting, around, work, sums)
            weigh_window(weighting.window_shape, sums.weights, work.weight)
            add_node(full, window, work.weight, sums, work.upsampled, work.values)
            add_node(further, window, work.weight, sums, work.upsampled, work.values)
        # the windows of the next row of nodes overlap the rows below
        first, last = max(-top, 0), spacing if row < rows - 1 else min(height - top, WINDOW)
        if has_confidence:
            finish_confidence(full.band[channels], full.band[channels + 1], first, last, top, blended.confidence)
        finish_layer(full, first, last, top, spacing, value_range, blended.image)
        if further_planes:
            finish_layer(further, first, last, top, spacing, value_range, blended.further)


@njit(inline="always", **FINITE_JIT)
def sum_candidates(full, further, window, t, motions, priors, node, weighting, around, work, sums):
    """Sum the samples of a window over the candidates of its node, whose prior weights are those by their votes."""
    room, further_motion, has_further = work.room, work.further_motion, further.mixed.shape[0] > 0
    total, further_total = full.total, further.total
    total[:] = 0
    further_total[:] = 0
    start_node(sums)
    least_weight, least_similar = np.float32(0), np.float32(0)
    for k in range(priors.size):
        prior = priors[k]
        if prior <= 0:
            continue
        if prior < weighting.min_vote_share * least_weight or least_similar >= weighting.sufficient_similarity:
            break
        motion = motions[k]
        place = locate_window(window.top, window.left, motion, t, window.height, window.width, room.marks)
        sample_layer(full, place, motion, room)
        pool_pixels(full.distance, work.squared)
        if has_further:
            there = locate_further(place, motion, further.down, further.across, further_motion)
            sample_layer(further, there, further_motion, room)
            if further.across > 1:
                pool_chroma(further.distance, further.down, work.squared)
        least_weight, least_similar = weigh_candidate(prior, window, node, k, motion, t, weighting, around, work, sums)
        add_samples(full, around, work)
        if has_further:
            add_samples(further, around, work)


@njit(**FINITE_JIT)
def weigh_candidate(prior, window, node, k, motion, t, weighting, around, work, sums):
    """Compute the weights of candidate k of a node; plain ones, and only these are compiled, if `around` is None."""
    if around is None:
        return weigh_plainly(prior, weighting, work, sums)
    support = around.support[node[0], node[1], k]
    describe_candidate(work.squared, weighting.scale, window, motion, prior, support, t, around, work.features)
    return weigh_features(prior, motion, t, weighting, work, sums)


@njit(**FINITE_JIT)
def add_samples(layer, around, work):
    """Add the samples of a candidate, times their weights, to the sums of the node."""
    mixed, change, total, upsampled, leaning = layer.mixed, layer.change, layer.total, work.upsampled, work.leaning
    upsample_squares(work.weight, layer.across, layer.down, upsampled)
    for c in range(Index(mixed.shape[0])):
        for i in range(Index(mixed.shape[1])):
            total[c, i] = fma(upsampled[i], mixed[c, i], total[c, i])
    if around is not None:
        upsample_squares(work.lean, layer.across, layer.down, leaning)
        for c in range(Index(mixed.shape[0])):
            for i in range(Index(mixed.shape[1])):
                total[c, i] = fma(leaning[i], change[c, i], total[c, i])


@njit(**FINITE_JIT)
def weigh_window(shape, sums, weight):
    """Weigh the squares of a node's window: more where it is more similar than others, but with no visible border."""
    for i in range(SQUARES_PER_WINDOW):
        weight[i] = shape[i] / math.sqrt(sums[i])


@njit(**FINITE_JIT)
def add_node(layer, window, weight, sums, upsampled, values):
    """Add the mean of a node's window to the band of a layer, and the sums of its weights and similarities."""
    channels, across, down = layer.mixed.shape[0], layer.across, layer.down
    if channels == 0:
        return
    first_y, last_y = max(-window.top, 0) // down, (min(window.height - window.top, WINDOW) + down - 1) // down
    first_x, last_x = max(-window.left, 0) // across, (min(window.width - window.left, WINDOW) + across - 1) // across
    left = window.left // across
    upsample_squares(weight, across, down, upsampled)
    for c in range(channels):
        add_window(upsampled, layer.wide, layer.total[c], first_y, last_y, first_x, last_x, left, layer.band[c])
    upsample_squares(sums.weights, across, down, values)
    add_window(upsampled, layer.wide, values, first_y, last_y, first_x, last_x, left, layer.band[channels])
    if layer.band.shape[0] > channels + 1:
        upsample_squares(sums.similarities, across, down, values)
        add_window(upsampled, layer.wide, values, first_y, last_y, first_x, last_x, left, layer.band[channels + 1])


@njit(**FINITE_JIT)
def add_window(weight, wide, values, first_y, last_y, first_x, last_x, left, band):
    """Add the part of a weighted window within the frame to a plane of a band, in which it begins at `left`."""
    columns, flat = band.shape[1], band.reshape(band.size)
    for j in range(first_y, last_y):
        here, there = j * wide, j * columns + left
        if last_x - first_x < wide:
            for i in range(first_x, last_x):
                flat[there + i] += weight[here + i] * values[here + i]
        else:
            for i in range(0, wide, SIXTEEN):
                add_row(weight, here + i, values, here + i, flat, there + i)


@njit(**FINITE_JIT)
def finish_layer(layer, first, last, top, rows, value_range, image):
    """Write rows of pixels of a layer that no further window contributes to, and shift its band up by `rows`."""
    down = layer.down
    finish_rows(layer.band, first // down, (last + down - 1) // down, top // down, value_range, image)
    shift_rows_up(layer.band, rows // down)


@njit(**FINITE_JIT)
def finish_rows(band, first, last, top, value_range, image):
    """Normalise rows of a band in place, and write them to the image; the band begins at `top`."""
    white, offset, lowest, highest, straight_alpha = value_range
    to, (channels, _, width), (plane, row, column) = image.values, image.shape, image.steps
    column = Index(column)
    for j in range(first, last):
        weight = band[channels, j]
        for c in range(channels):
            values = band[c, j]
            for x in range(width):
                values[x] /= weight[x]
        for c in range(channels):
            values, alpha, begin = band[c, j], band[channels - 1, j], Index(c * plane + (top + j) * row)
            divides = straight_alpha and c < channels - 1
            for x in range(Index(width)):
                value = values[x]
                if divides:
                    value /= max(alpha[x], np.float32(1e-6))
                value = min(max(value * white + offset, lowest), highest)
                to[begin + x * column] = to.dtype.type(value)


@njit(**FINITE_JIT)
def finish_confidence(weights, similarities, first, last, top, confidence):
    """Write rows of the confidence: the weighted mean similarity to the eighth power.

    This corresponds to a bandwidth of about a third: a few levels hardly change the weights, but are visible.
    """
    for j in range(first, last):
        for x in range(confidence.shape[1]):
            trust = min(similarities[j, x] / weights[j, x], np.float32(1))
            trust *= trust
            trust *= trust
            confidence[top + j, x] = trust * trust


@njit(**FINITE_JIT)
def shift_rows_up(band, rows):
    """Shift the rows of a band up by `rows`, and fill the rows below with zeros."""
    planes, height, width = band.shape
    for c in range(planes):
        for j in range(height - rows):
            for x in range(width):
                band[c, j, x] = band[c, j + rows, x]
        for j in range(height - rows, height):
            for x in range(width):
                band[c, j, x] = 0


@cache
def window_shape(spacing: int) -> np.ndarray:
    """Return the weight of each square of a window, (SQUARES_PER_WINDOW,) float32, for nodes some pixels apart.

    It rises smoothly from 0 at the border to 1 where no other window overlaps, and the weights of overlapping windows
    add up to 1. Where fewer squares overlap, it rises more slowly at first, so that the first one is no visible step.
    """
    from_border = SQUARES_PER_ROW / 2 - np.abs(np.arange(SQUARES_PER_ROW) + 0.5 - SQUARES_PER_ROW / 2)
    way = np.minimum(from_border * 2 / (WINDOW - spacing), 1)
    smooth = way**2 * (3 - 2 * way) if spacing <= WINDOW // 2 else way**3 * (10 - 15 * way + 6 * way**2)
    return np.outer(smooth, smooth).ravel().astype(np.float32)
