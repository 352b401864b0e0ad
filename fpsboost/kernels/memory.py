"""Arrays whose rows start on cache lines: a vector that straddles two lines costs two accesses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

CACHE_LINE = 64


def aligned_empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array like `numpy.empty`, its last axis rounded up to whole cache lines and its first byte aligned.

    Parameters
    ----------
    shape : tuple of int
    dtype : data type

    Returns
    -------
    ndarray
        Contiguous; the last axis may be longer than requested.

    Examples
    --------
    >>> aligned_empty((2, 5), np.float32).shape
    (2, 16)
    """
    itemsize = np.dtype(dtype).itemsize
    lanes = CACHE_LINE // itemsize
    rounded = (*shape[:-1], -(-shape[-1] // lanes) * lanes)
    raw = np.empty(math.prod(rounded) * itemsize + CACHE_LINE, np.uint8)
    return np.ndarray(rounded, dtype, raw, -raw.ctypes.data % CACHE_LINE)
