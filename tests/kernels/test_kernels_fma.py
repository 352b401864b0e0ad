"""Fused multiply-add rounds once, compiled or not."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from fpsboost.kernels.fma import fma
from fpsboost.kernels.jit import njit


@njit()
def compiled(a, b, c):
    """The kernels' own."""
    return fma(a, b, c)


numbers = st.floats(-100, 100, width=32, allow_subnormal=False).map(np.float32)


@given(numbers, numbers, numbers)
def test_the_result_is_the_nearest_number(a, b, c):
    """No float32 lies nearer to the exact result than the one given."""
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    assume(exact == 0 or abs(exact) > 1e-30)
    found = np.float32(compiled(a, b, c))
    for other in (np.nextafter(found, np.float32(-np.inf)), np.nextafter(found, np.float32(np.inf))):
        assert abs(Fraction(float(found)) - exact) <= abs(Fraction(float(other)) - exact)
