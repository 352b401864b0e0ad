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
def add_taps(n, response, here, near, far, sums):
    """Add taps n and n + 1 on either side of a row to its sums; the first two also begin them with the row itself.

    Two taps at once, as every pass reads and writes the whole row.
    """
    weight, farther = response[n], response[n + 1]
    before, after = near
    earlier, later = far
    if n == 1:
        for x in range(sums.size):
            sums[x] = response[0] * here[x]
            sums[x] = fma(weight, before[x] + after[x], fma(farther, earlier[x] + later[x], sums[x]))
    else:
        for x in range(sums.size):
            sums[x] = fma(weight, before[x] + after[x], fma(farther, earlier[x] + later[x], sums[x]))


@njit(inline="always", **FINITE_JIT)
def extend_row(source, unit, taps, row):
    """Write a row of values times `unit`, with the first and the last one repeated `taps` times."""
    for x in range(source.size):
        row[taps + x] = np.float32(source[x]) * unit
    first, last = row[taps], row[taps + source.size - 1]
    for x in range(taps):
        row[x] = first
        row[taps + source.size + x] = last


@njit(cache=True, **FINITE_JIT)
def find_coefficients(planes, unit, response, coefficients):
    """Compute the B-spline coefficients of planes whose edges are repeated.

    Parameters
    ----------
    planes : (C, H, W) uint8, uint16 or float32
    unit : float32
        Factor on every value.
    response : (taps + 1,) float32
        An even number of taps, less than MARGIN; see `filter_response`.
    coefficients : (C, H + 2 MARGIN, W + 2 MARGIN or more) float32 out
        The frame begins MARGIN rows and columns from the corner.
    """
    channels, height, columns = planes.shape
    taps = response.shape[0] - 1
    # farther out, all values around are equal, and so are the coefficients
    first, last, last_row = MARGIN - taps, MARGIN + columns + taps, MARGIN + height - 1 + taps
    width = last - first
    line = np.empty(width + 2 * taps, np.float32)
    down = line[taps : taps + width]
    rows = np.empty((2 * taps + 1, width), np.float32)  # ring buffer of the latest rows, each converted once
    for c, y in np.ndindex(channels, coefficients.shape[1]):
        if 0 < y <= MARGIN - taps or y > last_row:
            here, before = coefficients[c, y], coefficients[c, y - 1]
            for x in range(here.size):
                here[x] = before[x]
            continue
        for fresh in range(y + taps if y > MARGIN - taps + 1 else y - taps, y + taps + 1):
            source = planes[c, min(max(fresh - MARGIN, 0), height - 1)]
            extend_row(source, unit, taps, rows[fresh % len(rows)])
        here = rows[y % len(rows)]
        for n in range(1, taps + 1, 2):
            near = rows[(y - n) % len(rows)], rows[(y + n) % len(rows)]
            far = rows[(y - n - 1) % len(rows)], rows[(y + n + 1) % len(rows)]
            add_taps(n, response, here, near, far, down)
        line[:taps] = line[taps]
        line[taps + width :] = line[taps + width - 1]
        whole = coefficients[c, y]
        across = whole[first:last]
        for n in range(1, taps + 1, 2):
            near, far = (line[taps - n :], line[taps + n :]), (line[taps - n - 1 :], line[taps + n + 1 :])
            add_taps(n, response, down, near, far, across)
        whole[:first] = across[0]
        whole[last:] = across[width - 1]


@cache
def filter_response(precision: float) -> np.ndarray:
    """Return half of the symmetric impulse response that turns samples into coefficients.

    It is (taps + 1,) float32, and the number of taps is even.

    Parameters
    ----------
    precision : float
        Maximum truncation error as a share of the largest difference between two samples.
    """
    taps = math.ceil(math.log(precision) / math.log(-POLE) / 2) * 2
    response = np.array([math.sqrt(3) * POLE**n for n in range(taps + 1)])
    # normalised, so that flat areas keep their brightness despite the truncation
    return (response / (response[0] + 2 * response[1:].sum())).astype(np.float32)


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
