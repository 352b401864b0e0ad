"""Candidates weighted by what was learnt from drawn scenes: `MultiHypothesis` with `fusion="learnt"`."""

from dataclasses import replace

import numpy as np
import pytest
from test_synthesis import true_transition
from truth import moving_object

from fpsboost.synthesis.multi_hypothesis import MultiHypothesis

LEARNT = MultiHypothesis(fusion="learnt")


def test_a_clip_played_backwards_gives_the_same_frames():
    """Frames at t of a pair are those at 1 - t of the pair reversed, but for rounding."""
    pair = true_transition(moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4))
    reverse = replace(pair, image0=pair.image1, image1=pair.image0, field01=pair.field10, field10=pair.field01)
    (forwards,), (backwards,) = LEARNT.synthesize(pair, [0.25]), LEARNT.synthesize(reverse, [0.75])
    assert np.abs(forwards.astype(int) - backwards).max() <= 3


def test_weights_are_continuous():
    """Motion that differs by three thousandths of a pixel makes an image that differs by a level or two."""
    pair = true_transition(moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4))
    moved = replace(pair, field01=replace(pair.field01, vectors=pair.field01.vectors + np.float32(0.003)))
    images = [next(LEARNT.synthesize(each, [0.5])).astype(int) for each in (pair, moved)]
    assert np.abs(images[0] - images[1]).max() <= 2


def test_frames_near_a_frame_are_like_it():
    """At a time of 1/1000, nothing of the other frame is seen, also where it is covered."""
    clip = moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4)
    first, last = LEARNT.synthesize(true_transition(clip), [0.001, 0.999])
    assert np.abs(first.astype(int) - clip.image0).mean() < 0.5
    assert np.abs(last.astype(int) - clip.image1).mean() < 0.5


@pytest.mark.parametrize("width", [6, 8])
@pytest.mark.parametrize("dx", [12, 16])
def test_a_thin_thing_stays_in_front(width, dx):
    """A bar that moves by more than its width is shown halfway, although both frames agree on the ground behind it."""
    clip = moving_object(96, 112, box=(20, 40, 76, 40 + width), dx=dx, dy=0)
    (image,) = LEARNT.synthesize(true_transition(clip), [0.5])
    bar = slice(24, 72), slice(40 + dx // 2, 40 + dx // 2 + width)
    assert np.abs(image[bar].astype(int) - clip.at(0.5)[bar]).mean() < 15
