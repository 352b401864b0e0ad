"""Fused multiply-add, asked for where it pays instead of allowed everywhere.

A compiler that may contract ``a * b + c`` by itself decides anew with every compilation, and the same kernel gave
different bits when it was compiled and when it was loaded from the cache.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import intrinsic, overload


def fma(a, b, c):
    """``a * b + c`` of three float32, rounded once."""
    return np.float32(np.float64(a) * np.float64(b) + np.float64(c))


@intrinsic
def _instruction(typing, a, b, c):
    """The processor's own instruction."""
    return types.float32(types.float32, types.float32, types.float32), _emit


def _emit(context, builder, signature, arguments):
    return builder.fma(*arguments)


@overload(fma, inline="always")
def _compiled(a, b, c):
    """What `fma` is within kernels."""
    if not a == b == c == types.float32:
        return None

    def compiled(a, b, c):
        return _instruction(a, b, c)

    return compiled
