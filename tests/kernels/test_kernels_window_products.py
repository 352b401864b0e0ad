"""Sums of products of gradients and changes over a window."""

from __future__ import annotations

import numpy as np
from twins import uncompiled

from fpsboost.kernels.jit import njit
from fpsboost.kernels.window_products import PRODUCT_COUNT, WINDOW_SIDE, window_products


@njit()
def summed(first, start0, second, start1, stride, plane, tail, sums):
    """Call the compiled form."""
    window_products(first, start0, second, start1, stride, plane, tail, sums)


def test_products_are_summed_alike_compiled_and_not():
    """As pixel by pixel, with the largest differences that bytes can have, too."""
    random, stride, rows = np.random.default_rng(1), 40, 20
    for largest in (16, 256):
        frames = random.integers(0, largest, (2, 3, rows, stride)).astype(np.uint8)
        frames[:, :, 3:6] = frames[:, :, 3:6] // (largest - 1) * (largest - 1)
        (y0, x0), (y1, x1), tail = (3, 4), (5, 9), np.float32(1 / 5000)
        expected = np.zeros(PRODUCT_COUNT)
        for y, x in np.ndindex(WINDOW_SIDE, WINDOW_SIDE):
            here, there = (
                frame[:, y + at_y : y + at_y + 3, x + at_x : x + at_x + 3].astype(float)
                for frame, at_y, at_x in zip(frames, (y0, y1), (x0, x1), strict=True)
            )
            both, change = here + there, (there - here)[:, 1, 1]
            along_x, along_y = both[:, 1, 2] - both[:, 1, 0], both[:, 2, 1] - both[:, 0, 1]
            pairs = (along_x, along_x), (along_x, along_y), (along_y, along_y), (along_x, change), (along_y, change)
            products = np.array([one @ other for one, other in (*pairs, (change, change))])
            expected += products * (1 + tail * products[-1]) ** -4
        flat = [frame.ravel() for frame in frames]
        for call in (summed, uncompiled(summed)):
            sums = np.empty(PRODUCT_COUNT, np.float32)
            call(flat[0], y0 * stride + x0, flat[1], y1 * stride + x1, stride, rows * stride, tail, sums)
            np.testing.assert_allclose(sums, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
