"""Cubic B-spline interpolation: coefficients computed once per frame, four weights per sample.

Samples of an interpolating cubic spline are as sharp as those of a windowed sinc with eight taps, from a kernel of four
taps; in return, each frame is filtered beforehand (Unser, Aldroubi, Eden 1993, doi:10.1109/78.193220).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import FINITE_JIT, njit

MARGIN = 40
"""Width of the repeated edges beyond the frame, pixels."""

POLE = math.sqrt(3) - 2
"""Pole of the recursive prefilter: its impulse response decays by this factor per pixel."""


@njit(**FINITE_JIT)
def filter_row(weight, before, here, after, out):
    """Write a row plus `weight` times the sum of two others."""
    for x in range(out.size):
        out[x] = fma(weight, before[x] + after[x], here[x])


@njit(**FINITE_JIT)
def copy_row(source, out):
    """Copy a row."""
    for x in range(out.size):
        out[x] = source[x]


@njit(**FINITE_JIT)
def filter_across(source, unit, weights, lines, out):
    """Filter a row of values times `unit`, with repeated edges, horizontally.

    `lines` are two rows for work, of as many columns as `out` and those that the filter reaches on both sides.
    """
    columns, length = source.size, lines.shape[1]
    begin = (length - out.size) // 2 + MARGIN
    line = lines[0]
    inner = line[begin:]
    for x in range(columns):
        inner[x] = np.float32(source[x]) * unit
    for x in range(begin):
        line[x] = inner[0]
    for x in range(columns, inner.size):
        inner[x] = inner[columns - 1]
    for k in range(weights.size):
        distance, line = 1 << k, lines[k % 2]
        length -= 2 * distance
        to = lines[(k + 1) % 2, :length] if k < weights.size - 1 else out
        filter_row(weights[k], line, line[distance:], line[2 * distance :], to)


@njit(**FINITE_JIT)
def filter_down(weights, rows, y, out):
    """Filter vertically what is known now that row y is there, as far as the filter reaches above it.

    `rows` are ring buffers of the latest rows of each filter, the first of which holds row y.
    """
    kept = rows.shape[1]
    for k in range(weights.size):
        distance = 1 << k
        y -= distance
        before, here, after = rows[k, (y - distance) % kept], rows[k, y % kept], rows[k, (y + distance) % kept]
        to = rows[k + 1, y % kept] if k < weights.size - 1 else out
        filter_row(weights[k], before, here, after, to)


@njit(cache=True, **FINITE_JIT)
def find_coefficients(planes, unit, weights, coefficients):
    """Compute the B-spline coefficients of planes whose edges are repeated.

    Parameters
    ----------
    planes : (C, H, W) uint8, uint16 or float32
    unit : float32
        Factor on every value.
    weights : (stages,) float32
        At most five; see `filter_weights`.
    coefficients : (C, H + 2 MARGIN, W + 2 MARGIN or more) float32 out
        The frame begins MARGIN rows and columns from the corner.
    """
    (channels, height, _), (_, tall, width) = planes.shape, coefficients.shape
    stages, reach = weights.size, (1 << weights.size) - 1
    for weight in weights:  # so that flat areas keep their brightness
        gain = np.float32(1) + weight + weight
        unit /= gain * gain
    lines = np.empty((2, width + 2 * reach), np.float32)
    # of what is filtered before these are full, nothing remains
    rows = np.zeros((stages, reach + 2, width), np.float32)
    first, last = MARGIN - reach, MARGIN + height - 1 + reach
    for c in range(channels):
        for y in range(-2 * reach, height + 2 * reach):
            here = rows[0, y % (reach + 2)]
            if y == -2 * reach or 0 < y < height:
                filter_across(planes[c, max(y, 0)], unit, weights, lines, here)
            else:
                copy_row(rows[0, (y - 1) % (reach + 2)], here)
            # rows before the first whole one are written again below
            filter_down(weights, rows, y, coefficients[c, max(MARGIN + y - reach, 0)])
        # farther out, all values around are equal, and so are the coefficients
        for y in range(first):
            copy_row(coefficients[c, first], coefficients[c, y])
        for y in range(last + 1, tall):
            copy_row(coefficients[c, last], coefficients[c, y])


@cache
def filter_weights(precision: float) -> np.ndarray:
    """Return the weights of the filters that turn samples into coefficients, one after the other.

    The prefilter is ``1 / ((1 - p z) (1 - p / z))`` with the pole p, but for a factor, and ``1 / (1 - p z)`` is the
    product of ``1 + (p z)^m`` for m = 1, 2, 4 ... Each m thus gives a symmetric filter: 1 at its centre, and the weight
    ``p^m / (1 + p^2m)`` at a distance of m on both sides.

    Parameters
    ----------
    precision : float
        Maximum error of the spline at the samples, as a share of the largest difference between two of them.

    Returns
    -------
    (stages,) float32
        Weights for the distances 1, 2, 4 ...
    """
    # the first filter that is left out would add up to twice its power of the pole, at both ends and along both axes
    stages = math.ceil(math.log2(math.log(precision / 4) / math.log(-POLE)))
    powers = [POLE ** (1 << k) for k in range(stages)]
    return np.array([power / (1 + power * power) for power in powers], np.float32)


@njit(**FINITE_JIT)
def spline_weights(fraction):
    """Return the weights of the four coefficients around a position."""
    f = fraction
    g = np.float32(1) - f
    sixth, two_thirds, half = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5)
    return (
        sixth * g * g * g,
        two_thirds - half * f * f * (np.float32(2) - f),
        two_thirds - half * g * g * (np.float32(2) - g),
        sixth * f * f * f,
    )
