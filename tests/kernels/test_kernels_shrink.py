"""Small copies as means over areas."""

from __future__ import annotations

import numpy as np
import pytest
from truth import noise
from twins import uncompiled

from fpsboost.kernels.shrink import shrink


def covered(length: int, places: int) -> np.ndarray:
    """Which share of each pixel of a row belongs to each of fewer places, (places, length)."""
    edges = np.arange(places + 1) * length / places
    pixel = np.arange(length)
    shares = np.minimum(edges[1:, None], pixel + 1) - np.maximum(edges[:-1, None], pixel)
    return shares.clip(0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(
    ("size", "small"), [((17, 40), (5, 12)), ((6, 8), (6, 8)), ((9, 5), (1, 1)), ((30, 20), (10, 3))]
)
@pytest.mark.parametrize("channels", [1, 3])
def test_a_small_copy_has_the_means_of_its_areas(dtype, size, small, channels):
    """Of whole pixels and of parts of them."""
    image = noise(*size, channels, dtype)
    found = np.empty((*small, channels), np.float32)
    uncompiled(shrink)(image.reshape(size[0], -1), found)
    down, across = (covered(length, places) for length, places in zip(size, small, strict=True))
    expected = np.einsum("vy,ux,yxc->vuc", down, across, image.astype(float)) / (size[0] * size[1] / np.prod(small))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
