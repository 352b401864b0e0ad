"""Cubic B-spline interpolation: coefficients computed once per frame, four weights per sample along each axis.

Samples of an interpolating cubic spline are as sharp as those of a windowed sinc with eight taps, from a kernel of four
taps; in return, each frame is filtered beforehand (Unser, Aldroubi, Eden 1993, doi:10.1109/78.193220).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.instruction import AS_GIVEN, EIGHT, FLOAT, INDEX, REAL, SIXTEEN, fma, instruction, vector
from fpsboost.kernels.jit import FINITE_JIT, borrowed, njit

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
    ring_size = rows.shape[1]
    for k in range(weights.size):
        distance = 1 << k
        y -= distance
        before, after = rows[k, (y - distance) % ring_size], rows[k, (y + distance) % ring_size]
        to = rows[k + 1, y % ring_size] if k < weights.size - 1 else out
        filter_row(weights[k], before, rows[k, y % ring_size], after, to)


def find_coefficients(
    planes: NDArray[Any], unit: np.float32, weights: NDArray[Any], coefficients: NDArray[Any]
) -> None:
    """Compute the B-spline coefficients of planes, (C, H, W) uint8, uint16 or float32, whose edges are repeated.

    - `unit`: factor on every value
    - `weights`: at most five, by `filter_weights`
    - `coefficients`: (C, H + 2 MARGIN, W + 2 MARGIN or more) float32 out; the frame begins MARGIN rows and columns from
      the corner
    """
    stages, reach, width = weights.size, (1 << weights.size) - 1, coefficients.shape[2]
    lines = np.empty((2, width + 2 * reach), np.float32)
    # of what is filtered before these are full, nothing remains
    rows = np.zeros((stages, reach + 2, width), np.float32)
    filter_planes(planes, unit, weights, lines, rows, coefficients)


@njit(cache=True, **FINITE_JIT)
def filter_planes(planes, unit, weights, lines, rows, coefficients):
    """Compute the coefficients of planes in place of `find_coefficients`, which makes the work arrays."""
    planes, weights, lines, rows, coefficients = borrowed((planes, weights, lines, rows, coefficients))
    (channels, height, _), tall, reach = planes.shape, coefficients.shape[1], (1 << weights.size) - 1
    for weight in weights:  # so that flat areas keep their brightness
        gain = np.float32(1) + weight + weight
        unit /= gain * gain
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
    """Return the weights of the filters that turn samples into coefficients, one after the other, (stages,) float32.

    The prefilter is ``1 / ((1 - p z) (1 - p / z))`` with the pole p, but for a factor, and ``1 / (1 - p z)`` is the
    product of ``1 + (p z)^m`` for m = 1, 2, 4 ... Each m thus gives a symmetric filter: 1 at its centre, and the weight
    ``p^m / (1 + p^2m)`` at a distance of m on both sides. The precision is the maximum error of the spline at the
    samples, as a share of the largest difference between two of them.
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


def row_filter(length: int) -> Callable[..., None]:
    """Return a function that applies a four-tap filter to `length` values of a row."""
    lanes = vector(REAL, length)

    def filter_values(source, begin, step, w0, w1, w2, w3, out, target):
        """Write `length` values from index `target` on, ``w0 s[0] + w1 s[1] + w2 s[2] + w3 s[3]``.

        ``s[n]`` begins at index ``begin + n * step`` of the source; no bounds are checked.
        """
        taps = [source[begin + n * step :][:length] for n in range(4)]
        out[target : target + length] = w0 * taps[0] + w1 * taps[1] + w2 * taps[2] + w3 * taps[3]

    @instruction(filter_values, AS_GIVEN, INDEX, INDEX, *(FLOAT,) * 4, AS_GIVEN, INDEX)
    def build(code, source, begin, step, w0, w1, w2, w3, out, target):
        values = [source.load(place, lanes) for place in code.steps(begin, step, 4)]
        out.store(code.weighted_sum(values, [code.broadcast(weight, lanes) for weight in (w0, w1, w2, w3)]), target)

    return filter_values


filter_eight, filter_sixteen = row_filter(EIGHT), row_filter(SIXTEEN)


class Source(NamedTuple):
    """One of the two frames, as seen from the frame between them."""

    coefficients: NDArray[Any]
    """(C, H + 2 MARGIN, W + 2 MARGIN or more) float32, by `find_coefficients`."""
    motion: NDArray[Any]
    """Motion from each pixel of the frame between to this frame, (H, W, 2) float32."""
    is_visible: NDArray[Any]
    """Whether this frame shows the surface that the pixel belongs to, (H, W) bool."""


@njit(**FINITE_JIT)
def locate(source, i, j):
    """Return the first of the 4 x 4 coefficients around the end of a pixel's motion, and their weights in y and x.

    Beyond the frame, edges are repeated.
    """
    height, width, _ = source.motion.shape
    margin, beyond = np.float32(MARGIN), np.float32(-1)
    y = min(max(np.float32(i) + source.motion[i, j, 1], beyond), np.float32(height)) + margin
    x = min(max(np.float32(j) + source.motion[i, j, 0], beyond), np.float32(width)) + margin
    top, left = int(y), int(x)
    return top - 1, left - 1, spline_weights(y - np.float32(top)), spline_weights(x - np.float32(left))


@njit(**FINITE_JIT)
def sample_spline(plane, place):
    """Return the value of a plane of coefficients at a position; see `locate`."""
    top, left, down, across = place
    value = np.float32(0)
    for j in range(4):
        row, part = plane[top + j], np.float32(0)
        for i in range(4):
            part = fma(across[i], row[left + i], part)
        value = fma(down[j], part, value)
    return value


@njit(cache=True, **FINITE_JIT)
def mix_along(source0, source1, t, mixed, squared):
    """Mix both frames in time along their motions; a frame that does not show the surface has no weight.

    - `t`: weight of frame 1 where both are visible, or none is
    - `mixed`: (C, H, W) float32 out
    - `squared`: squared difference of the two frames, summed over the planes, (H, W) float32 out; 0 where one of them
      is not visible
    """
    channels, height, width = mixed.shape
    for i, j in np.ndindex(height, width):
        seen0, seen1 = source0.is_visible[i, j], source1.is_visible[i, j]
        share = t if seen0 == seen1 else np.float32(seen1)
        place0, place1 = locate(source0, i, j), locate(source1, i, j)
        distance = np.float32(0)
        for c in range(channels):
            value = sample_spline(source0.coefficients[c], place0)
            difference = sample_spline(source1.coefficients[c], place1) - value
            mixed[c, i, j] = fma(share, difference, value)
            distance = fma(difference, difference, distance)
        squared[i, j] = distance if seen0 and seen1 else np.float32(0)
