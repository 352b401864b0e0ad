"""Candidates weighted by what was learnt from drawn scenes: `MultiHypothesis` with `fusion="learnt"`."""

from dataclasses import replace

import numpy as np
import pytest
from test_synthesis import true_transition
from truth import moving_object, translation

from fpsboost.motion.field import MotionField
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis

LEARNT = MultiHypothesis(fusion="learnt")


def test_a_clip_played_backwards_gives_the_same_frames():
    """Frames at t of a pair are those at 1 - t of the pair reversed, but for rounding."""
    pair = true_transition(moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4))
    reverse = replace(pair, image0=pair.image1, image1=pair.image0, field01=pair.field10, field10=pair.field01)
    (forwards,), (backwards,) = LEARNT.synthesize(pair, [0.25]), LEARNT.synthesize(reverse, [0.75])
    assert np.abs(forwards.astype(int) - backwards).max() <= 3


def test_weights_are_continuous():
    """Motion that differs by a hundredth of a pixel makes an image that differs by a level or two."""
    pair = true_transition(moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4))
    moved = replace(pair, field01=replace(pair.field01, vectors=pair.field01.vectors + np.float32(0.01)))
    images = [next(LEARNT.synthesize(each, [0.5])).astype(int) for each in (pair, moved)]
    assert np.abs(images[0] - images[1]).max() <= 2


def test_frames_near_a_frame_are_like_it():
    """At a time of 1/1000, nothing of the other frame is seen, also where it is covered."""
    clip = moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4)
    first, last = LEARNT.synthesize(true_transition(clip), [0.001, 0.999])
    assert np.abs(first.astype(int) - clip.image0).mean() < 0.5
    assert np.abs(last.astype(int) - clip.image1).mean() < 0.5


@pytest.mark.parametrize("spacing", [16, 24])
def test_the_motion_of_a_coarse_level_helps_where_the_finer_one_is_not_consistent(spacing):
    """Fields that lead nowhere and back by far are outvoted by coarser ones, which are right here."""
    clip = translation(64, 96, 6, 2, seed=3)
    pair, random = true_transition(clip), np.random.default_rng(1)
    fields = [
        MotionField(
            random.uniform(-40, 40, (8, 12, 2)).astype(np.float32), np.ones((8, 12), np.float32), None, 8, (64, 96)
        )
        for _ in range(2)
    ]
    guided = [replace(field, coarse=coarse) for field, coarse in zip(fields, (pair.field01, pair.field10), strict=True)]
    off = []
    for field01, field10 in (fields, guided):
        synthesizer = replace(LEARNT, node_spacing=spacing, support_radius=32)
        (image,) = synthesizer.synthesize(replace(pair, field01=field01, field10=field10), [0.5])
        off.append(np.abs(image.astype(int) - clip.at(0.5))[10:-10, 10:-10].mean())
    assert off[1] < off[0] / 4
