"""The report's similarity of two pixels (section 3.2, Eqs. 3 and 4) as a row kernel that vectorises.

The product over the colour components of ``exp(-d^2 / (2 v^2))`` is one exponential of a sum. With images scaled by
`colour_scale`, it is ``2^-s`` of a plain sum of squares s, and computed in integers: a polynomial for the fraction of
s, a shift for its integer part. Fixed-point values make every later sum exact, whatever its order, so that running sums
do not drift, ties in flat areas stay ties, and the result does not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np

from fpsboost.kernels.fma import fma
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
