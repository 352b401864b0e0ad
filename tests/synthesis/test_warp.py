"""The plain warp against constructed truth and its own formula."""

from __future__ import annotations

import numpy as np
import pytest
from truth import affine, as_type, eroded, noise, prepared

from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.warp import Warp


def warped(image0, image1, flow01, flow10, t):
    """One image."""
    fields = (MotionField(np.array(flow, np.float32), np.ones(flow.shape[:2], np.float32)) for flow in (flow01, flow10))
    (image,) = Warp().synthesize(FramePair(*prepared(image0, image1), *fields), [t])
    return image


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_formula(channels, dtype):
    """Whole motion, a different one at every pixel: the mean of two pixels of the frames, edges repeated."""
    random = np.random.default_rng(1)
    image0, image1 = (noise(9, 11, channels, dtype, seed) for seed in (1, 2))
    flow01, flow10 = (4.0 * random.integers(-2, 3, (9, 11, 2)) for _ in range(2))
    for t in (0.25, 0.5, 0.75):
        image = warped(image0, image1, flow01, flow10, t)
        for y, x in np.ndindex(9, 11):
            at0 = np.clip([y - t * flow01[y, x, 1], x - t * flow01[y, x, 0]], 0, (8, 10)).astype(int)
            at1 = np.clip([y - (1 - t) * flow10[y, x, 1], x - (1 - t) * flow10[y, x, 0]], 0, (8, 10)).astype(int)
            expected = (1 - t) * image0[tuple(at0)].astype(float) + t * image1[tuple(at1)]
            if dtype is np.float32:
                np.testing.assert_allclose(image[y, x], expected, atol=1e-6)
            else:
                np.testing.assert_array_equal(image[y, x], np.floor(expected + 0.5))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("t", [0.25, 0.5, 0.75])
def test_a_smooth_translation_is_right(channels, t):
    """To a few levels of 255, which bilinear sampling costs; mixing the frames is ten times as far off."""
    clip = affine(60, 72, shift=(5.3, -2.6), channels=channels, seed=2)
    inner = eroded(np.ones((60, 72), bool), 8)
    off = np.abs(warped(clip.image0, clip.image1, clip.flow01, clip.flow10, t).astype(float) - clip.at(t))[inner]
    mixed = np.abs((1 - t) * clip.image0 + t * clip.image1.astype(float) - clip.at(t))[inner]
    assert off.mean() < 3
    assert off.mean() < mixed.mean() / 8


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colours_that_alpha_hides_do_not_bleed(dtype):
    """Beside what is seen, where one frame fetches half of it and half of bright pink that is not, nothing is pink."""
    image = np.zeros((8, 16, 4))
    image[..., :] = 1, 0, 1, 0
    image[:, :8] = 0.2, 0.6, 0.2, 1
    image = as_type(image, dtype)
    half = np.zeros((8, 16, 2))
    half[..., 0] = 1
    made, white = warped(image, image, half, -half, 0.5).astype(float) / np.iinfo(dtype).max, np.iinfo(dtype).max
    np.testing.assert_allclose(made[:, 8], np.broadcast_to([0.2, 0.6, 0.2, 0.25], (8, 4)), atol=1 / 255)
    np.testing.assert_allclose(made[:, 9:], np.broadcast_to([1, 0, 1, 0], (8, 7, 4)), atol=1 / white)
