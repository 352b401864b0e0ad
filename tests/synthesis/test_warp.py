"""The plain warp and painting forward, against constructed truth and the warp's own formula."""

import numpy as np
import pytest

from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.blend import Blend
from fpsboost.synthesis.warp import Splat, Warp
from support.truth import affine, as_type, eroded, noise, prepared, translation


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
            rounded = expected if dtype is np.float32 else np.floor(expected + 0.5)
            np.testing.assert_allclose(image[y, x], rounded, rtol=0, atol=1e-6)


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


def field(motion, similarity) -> MotionField:
    """A motion field of any arrays."""
    return MotionField(np.ascontiguousarray(motion, np.float32), np.ascontiguousarray(similarity, np.float32))


def one(synthesizer, image0, image1, field01, t):
    """One image; painting has no use for the way back."""
    nothing = field(np.full_like(field01.flow, np.nan), field01.similarity)
    (image,) = synthesizer.synthesize(FramePair(*prepared(image0, image1), field01, nothing), [t])
    return image


def test_what_moves_is_painted_in_its_place():
    """A translation is exact where both frames show the scene, and both frames mixed elsewhere."""
    clip = translation(40, 48, 8, -4, seed=1)
    for t in (0.25, 0.5, 0.75):
        image = one(Splat(), clip.image0, clip.image1, field(clip.flow01, clip.seen0), t)
        inner = eroded(np.ones((40, 48), bool), 8)
        np.testing.assert_array_equal(image[inner], clip.at(t)[inner])
        bare = slice(0, int(8 * t))
        still = one(Blend(), clip.image0, clip.image1, field(clip.flow01, clip.seen0), t)
        assert np.abs(image[:, bare].astype(int) - still[:, bare]).max() <= 1  # which rounds half to even


def test_unusable_motion_leaves_both_frames_mixed():
    """What is less similar than asked for is not painted, and what is exactly as similar is."""
    clip = translation(20, 24, 4, 2)
    mixed = one(Splat(), clip.image0, clip.image1, field(0 * clip.flow01, clip.seen0), 0.5)
    for similarity, painted in ((0.89, False), (0.9, True)):
        of_all = field(clip.flow01, np.full((20, 24), similarity))
        image = one(Splat(), clip.image0, clip.image1, of_all, 0.5)
        assert (image == mixed).all() == (not painted)
    assert (one(Splat(0.5), clip.image0, clip.image1, of_all, 0.5) == image).all()


def test_the_most_similar_is_seen():
    """Whichever comes first; of the equally similar, the first in raster order."""
    image0, image1 = noise(1, 5, seed=1), noise(1, 5, seed=1)
    motion = np.zeros((1, 5, 2))
    motion[0, 0, 0], motion[0, 4, 0] = 4, -4
    for similarities, winner in (((0.95, 0.97), 4), ((0.97, 0.95), 0), ((0.97, 0.97), 0)):
        similarity = np.zeros((1, 5))
        similarity[0, 0], similarity[0, 4] = similarities
        image = one(Splat(), image0, image1, field(motion, similarity), 0.5)
        expected = (image0[0, winner].astype(int) + image1[0, 4 - winner] + 1) // 2
        np.testing.assert_array_equal(image[0, 2], expected)
