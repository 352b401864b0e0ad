"""Painting forward along constructed motion."""

from __future__ import annotations

import numpy as np
from truth import eroded, noise, prepared, translation

from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.blend import Blend
from fpsboost.synthesis.warp import Splat


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
