"""Similarity of two pixels: the report's exponential (section 3.2, Eqs. 3 and 4), and a linear form of it on bytes.

The product over the colour components of ``exp(-d^2 / (2 v^2))`` is one exponential of a sum. With images scaled by
`colour_scale`, it is ``2^-s`` of a plain sum of squares s, and computed in integers: a polynomial for the fraction of
s, a shift for its integer part. Fixed-point values make every later sum exact, whatever its order, so that running sums
do not drift, ties in flat areas stay ties, and the result does not depend on the number of threads.

The linear form, ``max(1 - sum_c |a_c - b_c| / (4 v), 0)``, falls from 1 to 0 approximately as the exponential does (v
is the bandwidth), and takes a dozen instructions for sixteen pixels.
"""

from __future__ import annotations

import math

import numpy as np

from fpsboost.kernels.instruction import AS_GIVEN, BYTE, INDEX, SIXTEEN, UINT8, WORD, fma, instruction, vector
from fpsboost.kernels.jit import FINITE_JIT, njit

FRACTION_BITS = 20
UNIT = 1 << FRACTION_BITS
"""Fixed-point similarity of two equal pixels."""

_CHEBYSHEV = np.polynomial.chebyshev.Chebyshev.interpolate(lambda f: 2.0**-f, 5, domain=[0, 1])
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c) for c in _CHEBYSHEV.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]).coef * UNIT
)
_ROUNDED_C0 = np.float32(_C0 + np.float32(0.5))

COEFFICIENTS = _ROUNDED_C0, _C1, _C2, _C3, _C4, _C5
"""Coefficients of the polynomial that approximates `UNIT` times 2^-f for a fraction f, the constant, which includes the
rounding offset, first."""

MAX_SQUARED_DISTANCE = np.float32(FRACTION_BITS + 1)
"""Sum of squared differences at and above which the similarity is 0."""

WHITE = 255
"""Largest level."""

TRUNCATION = 4
"""Sum of absolute differences, in units of the bandwidth, at which the similarity reaches 0."""

_BYTES, _WORDS = vector(BYTE, SIXTEEN), vector(WORD, SIXTEEN)


def colour_scale(bandwidth: float) -> float:
    """Return the factor on colours in [0, 1] after which the similarity is ``2^-(sum of squared differences)``."""
    return math.sqrt(math.log2(math.e) / 2) / bandwidth


@njit(inline="always", **FINITE_JIT)
def similarity(a0, a1, a2, b0, b1, b2):
    """Return the fixed-point similarity of two pixels given as three scaled components each."""
    d0 = a0 - b0
    d1 = a1 - b1
    d2 = a2 - b2
    s = min(fma(d2, d2, fma(d1, d1, d0 * d0)), MAX_SQUARED_DISTANCE)
    whole = np.int32(s)
    f = s - np.float32(whole)
    p = fma(fma(fma(fma(fma(_C5, f, _C4), f, _C3), f, _C2), f, _C1), f, _ROUNDED_C0)
    # np.right_shift keeps 32 bits where >> would widen to 64 and halve the lanes
    return np.right_shift(np.int32(p), whole)


def level_scale(bandwidth: float) -> float:
    """Return the levels of a component that ranges over 1: 255, or fewer if the truncation would exceed 255."""
    return WHITE * min(1.0, 1 / (TRUNCATION * bandwidth))


def truncation(bandwidth: float) -> int:
    """Return the sum of absolute differences over all components, in levels, at which the similarity reaches 0."""
    return max(1, round(TRUNCATION * bandwidth * level_scale(bandwidth)))


def compare_sixteen(first, place0, second, place1, plane, most, sums, before, after):
    """Add the similarities, 0 to `most`, of sixteen pairs of pixels to the sums of sixteen pixels.

    - `first`, `second`: (size,) uint8
    - `place0`, `place1`: index of the first pixel in the first of three planes, `plane` apart; no bounds are checked
    - `most`: similarity of two equal pixels, as returned by `truncation`
    - `sums`: (size,) uint16, of which sixteen are read from index `before` on and written from `after` on
    """
    pixels = first[place0:][:SIXTEEN], first[place0 + plane :][:SIXTEEN], first[place0 + 2 * plane :][:SIXTEEN]
    _compare(pixels, second, place1, plane, most, sums, before, after)


def compare_one(first, place0, second, place1, plane, most, sums, before, after):
    """Do the same as `compare_sixteen`, but compare one pixel with sixteen."""
    pixels = first[place0], first[place0 + plane], first[place0 + 2 * plane]
    _compare(pixels, second, place1, plane, most, sums, before, after)


def _compare(pixels, second, place1, plane, most, sums, before, after):
    differences = sum(abs(second[place1 + c * plane :][:SIXTEEN].astype(int) - pixels[c]) for c in range(3))
    sums[after : after + SIXTEEN] = sums[before : before + SIXTEEN] + (most - differences).clip(0)


_ARGUMENTS = AS_GIVEN, INDEX, AS_GIVEN, INDEX, INDEX, UINT8, AS_GIVEN, INDEX, INDEX


@instruction(compare_sixteen, *_ARGUMENTS)
def _build_compare_sixteen(code, first, place0, second, place1, plane, most, sums, before, after):
    pixels = [first.load(place, _BYTES) for place in code.steps(place0, plane, 3)]
    _build_compare(code, pixels, second, place1, plane, most, sums, before, after)


@instruction(compare_one, *_ARGUMENTS)
def _build_compare_one(code, first, place0, second, place1, plane, most, sums, before, after):
    pixels = [code.broadcast(first.load(place, BYTE), _BYTES) for place in code.steps(place0, plane, 3)]
    _build_compare(code, pixels, second, place1, plane, most, sums, before, after)


def _build_compare(code, pixels, second, place1, plane, most, sums, before, after):
    builder, differences = code.builder, None
    for a, place in zip(pixels, code.steps(place1, plane, 3), strict=True):
        b = second.load(place, _BYTES)
        difference = builder.sub(code.call("umax", a, b), code.call("umin", a, b))
        differences = difference if differences is None else code.call("uadd.sat", differences, difference)
    similarities = builder.zext(code.call("usub.sat", code.broadcast(most, _BYTES), differences), _WORDS)
    sums.store(builder.add(sums.load(before, _WORDS), similarities), after)
