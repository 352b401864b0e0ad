"""Splatting of motion and the two-sided bicubic blend, against slow twins and exact images."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import noise
from twins import blended, splatted, uncompiled

from fpsboost.kernels.warp import blend_along, cubic_weights, splat_motion
from fpsboost.synthesis.blend import fill_holes
from fpsboost.synthesis.rounding import rounding_offset, value_range


def blend(image0, image1, motion, t):
    """Call the kernel as `TwoSidedBlend` does."""
    out = np.empty_like(image0)
    motion = np.broadcast_to(np.float32(motion), (*image0.shape[:2], 2)).copy()
    blend_along(image0, image1, motion, np.float32(t), rounding_offset(image0), *value_range(image0), out)
    return out


@settings(deadline=None)
@given(st.integers(1, 8), st.integers(1, 8), st.sampled_from([4, 20, 100]), st.integers(0, 2**32))
def test_splatting_equals_its_slow_twin(height, width, largest, seed):
    """Both directions land where the twin's do, with its scores; motion leaves the frame without harm."""
    random = np.random.default_rng(seed)
    flows = (random.integers(-largest, largest + 1, (2, height, width, 2)) / 8).astype(np.float32)
    similarity = random.random((2, height, width)).astype(np.float32)  # no two alike, so no ties to rounding
    motion, score = np.zeros((height, width, 2), np.float32), np.full((height, width), -1, np.float32)
    expected_motion, expected_score = motion.astype(float), score.astype(float)
    for flow, alike, sign, t in zip(flows, similarity, (1, -1), (0.25, 0.75), strict=True):
        splat_motion(flow, alike, np.float32(sign), np.float32(t), motion, score)
        splatted(flow, alike, sign, t, expected_motion, expected_score)
    np.testing.assert_allclose(score, expected_score, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(motion, expected_motion)


def test_holes_take_the_nearest_vector():
    """Every hole gets the vector of a known pixel that no other is clearly nearer than; known pixels keep theirs."""
    random = np.random.default_rng(1)
    motion = random.normal(size=(15, 19, 2)).astype(np.float32)
    hole = random.random((15, 19)) < 0.8
    filled = fill_holes(motion, hole)
    np.testing.assert_array_equal(filled[~hole], motion[~hole])
    known = np.argwhere(~hole)
    for y, x in np.argwhere(hole):
        distances = np.hypot(*(known - [y, x]).T)
        givers = (motion[tuple(known.T)] == filled[y, x]).all(axis=1)
        assert givers.any()
        assert distances[givers].min() <= distances.min() * 1.1 + 1e-9  # OpenCV's 3 x 3 distance is off by up to 8 %


@pytest.mark.parametrize("hole", [False, True])
def test_fields_without_holes_or_without_anything_else_stay(hole):
    """Nothing to fill, or nothing to fill it with."""
    motion = np.random.default_rng(2).normal(size=(4, 5, 2)).astype(np.float32)
    np.testing.assert_array_equal(fill_holes(motion, np.full((4, 5), hole)), motion)


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.3, 0.5, 0.999])
def test_cubic_weights_are_an_interpolating_partition_of_unity(fraction):
    """The four weights sum to 1, have their centre of mass at the place, and mirror."""
    weights = np.array(uncompiled(cubic_weights)(np.float32(fraction)), float)
    assert weights.sum() == pytest.approx(1, abs=1e-6)
    assert weights @ [-1, 0, 1, 2] == pytest.approx(fraction, abs=1e-6)
    np.testing.assert_allclose(weights, uncompiled(cubic_weights)(np.float32(1 - fraction))[::-1], atol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_blend_equals_its_slow_twin(dtype, channels):
    """Any motion, within the frame and out of it, edges repeated, overshoot cut off, rounded half up."""
    random = np.random.default_rng(channels)
    image0, image1 = (noise(7, 9, channels, dtype, seed).copy() for seed in (1, 2))
    motion = random.normal(size=(7, 9, 2)).astype(np.float32) * 4
    white = 1 if dtype is np.float32 else np.iinfo(dtype).max
    for t in (0.25, 0.5, 0.75):
        out, expected = blend(image0, image1, motion, t), blended(image0, image1, motion, t)
        if dtype is not np.float32:
            expected = np.floor(expected.clip(0, white) + 0.5)
        error = np.abs(out - expected)
        assert error.max() <= (1e-5 if dtype is np.float32 else 1)
        assert (error > 2e-5 * white).mean() < 0.02 or dtype is np.uint16


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_blend_keeps_constants(dtype):
    """A flat image stays flat to the last bit of an integer, whatever the motion, black and white included."""
    motion = np.random.default_rng(1).normal(size=(9, 11, 2)) * 5
    white = 1 if dtype is np.float32 else np.iinfo(dtype).max
    for share in (0, 1 / 3, 1):
        flat = np.full((9, 11, 3), share * white, dtype)
        for t in (0.1, 1 / 3, 0.5):
            np.testing.assert_allclose(blend(flat, flat, motion, t), flat, rtol=1e-6 if dtype is np.float32 else 0)


@pytest.mark.parametrize("t", [0.25, 0.5, 1 / 3])
def test_blend_keeps_linear_ramps(t):
    """Cubic sampling is exact on a ramp away from the edges, at any fraction of a pixel."""
    y, x = np.mgrid[0:20, 0:24].astype(np.float32)
    ramp = np.stack([x / 50, y / 50, (x - y) / 60], axis=-1).astype(np.float32)
    dx, dy = 3.3, -2.7
    moved = np.stack([(x - dx) / 50, (y - dy) / 50, (x - dx - y + dy) / 60], axis=-1).astype(np.float32)
    expected = np.stack([(x - t * dx) / 50, (y - t * dy) / 50, (x - t * dx - y + t * dy) / 60], axis=-1)
    inner = slice(6, -6)
    np.testing.assert_allclose(blend(ramp, moved, (dx, dy), t)[inner, inner], expected[inner, inner], atol=2e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_blend_of_a_whole_translation_is_a_copy(dtype):
    """Where the ends inside of the frames are whole pixels of one colour, the result is that colour."""
    canvas = noise(20, 30, 3, dtype)
    image0, image1 = canvas[4:16, 8:24].copy(), canvas[6:18, 4:20].copy()  # moves by (4, -2)
    out = blend(image0, image1, (4, -2), 0.5)
    y, x = np.mgrid[0:12, 0:16]
    inside0, inside1 = (x >= 2) & (y < 11), (x < 14) & (y >= 1)
    known = inside0 | inside1
    assert (~known).sum() == 4
    np.testing.assert_allclose(out[known], canvas[5:17, 6:22][known], rtol=0, atol=1e-6 if dtype is np.float32 else 0)


def test_an_end_outside_of_the_frame_does_not_count():
    """Where only one end of the motion is inside, its colour is taken alone; with neither, the edges are mixed."""
    image0, image1 = np.full((1, 8, 1), 40, np.uint8), np.full((1, 8, 1), 80, np.uint8)
    expected = [80, 80, 60, 60, 60, 60, 40, 40]  # the first two come from left of frame 0, the last go right
    assert blend(image0, image1, (4, 0), 0.5).ravel().tolist() == expected
    assert (blend(image0, image1, (100, 0), 0.5) == 60).all()


def test_overshoot_is_cut_off():
    """Next to a sharp edge cubic weights leave the range; 8-bit results must not wrap around."""
    step = np.zeros((8, 16, 1), np.uint8)
    step[:, 8:] = 255
    out = blend(step, step, (0, 0.5), 0.5), blend(step, np.roll(step, 1, axis=1), (1, 0), 0.5)
    assert set(np.unique(out[0])) == {0, 255}
    assert (np.diff(out[1][:, 3:13, 0].astype(int), axis=1) >= 0).all()
