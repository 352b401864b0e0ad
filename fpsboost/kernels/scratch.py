"""Memory for the work arrays of compiled kernels, which allocate none themselves."""

import numpy as np

from fpsboost.kernels.binding import Array

ALIGNMENT = 64
"""Bytes of a cache line, at which every piece begins."""


def scratch_of(*sizes: int) -> Array:
    """Return memory for pieces of these sizes, bytes, as ``fpsboost/native/scratch.h`` takes them from it."""
    return np.empty(sum(-(-size // ALIGNMENT) for size in sizes) * ALIGNMENT + ALIGNMENT, np.uint8)
