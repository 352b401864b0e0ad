"""Both frames sampled along a motion per pixel, against a slow twin."""

from __future__ import annotations

import numpy as np
import pytest
from twins import bspline

from fpsboost.kernels.rendered import Source, mix_along
from fpsboost.kernels.spline import MARGIN


@pytest.mark.parametrize("seed", range(4))
def test_the_kernel_does_as_its_twin(seed):
    """Both frames are sampled by the spline at the end of each motion, and hidden ones have no weight."""
    random = np.random.default_rng(seed)
    size, t = (7, 9), np.float32(0.3)
    sources = [
        Source(
            random.random((2, size[0] + 2 * MARGIN, size[1] + 2 * MARGIN), np.float32),
            random.normal(0, 6, (*size, 2)).astype(np.float32),
            random.random(size) < 0.7,
        )
        for _ in range(2)
    ]
    mixed, squared = np.empty((2, *size), np.float32), np.empty(size, np.float32)
    mix_along(*sources, t, mixed, squared)
    for place in np.ndindex(size):
        seen0, seen1 = (source.is_visible[place] for source in sources)
        share = t if seen0 == seen1 else float(seen1)
        value0, value1 = (_sampled(source, place) for source in sources)
        np.testing.assert_allclose(mixed[:, *place], value0 + share * (value1 - value0), rtol=1e-4, atol=1e-5)
        expected = ((value1 - value0) ** 2).sum() if seen0 and seen1 else 0
        np.testing.assert_allclose(squared[place], expected, rtol=1e-3, atol=1e-6)


def _sampled(source: Source, place: tuple[int, int]) -> np.ndarray:
    (i, j), (dx, dy) = place, source.motion[place].astype(float)
    height, width = source.motion.shape[:2]
    y, x = np.clip(i + dy, -1, height) + MARGIN, np.clip(j + dx, -1, width) + MARGIN
    rows, columns = np.arange(int(y) - 1, int(y) + 3), np.arange(int(x) - 1, int(x) + 3)
    weights = np.outer([bspline(y - row) for row in rows], [bspline(x - column) for column in columns])
    return np.array([(weights * plane[np.ix_(rows, columns)]).sum() for plane in source.coefficients])
