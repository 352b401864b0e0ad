"""Fused multiply-add, requested explicitly where it pays off instead of being allowed everywhere.

A compiler that may contract ``a * b + c`` on its own decides anew at every compilation; the same kernel then gave
different bits when it was compiled and when it was loaded from the cache.
"""

from __future__ import annotations

import numpy as np

from fpsboost.kernels.jit import intrinsic, overload, types


def fma(a, b, c):
    """Return ``a * b + c`` of three float32, rounded once."""
    return np.float32(np.float64(a) * np.float64(b) + np.float64(c))


@intrinsic
def _instruction(typing, a, b, c):
    """Emit the processor's fused multiply-add instruction."""
    return types.float32(types.float32, types.float32, types.float32), _emit


def _emit(context, builder, signature, arguments):
    return builder.fma(*arguments)


@overload(fma)
def _compiled(a, b, c):
    """Return the implementation of `fma` within kernels."""
    if not a == b == c == types.float32:
        return None

    def compiled(a, b, c):
        return _instruction(a, b, c)

    return compiled
