"""Candidates weighted by what was learnt from drawn scenes: `MultiHypothesis` with `fusion="learnt"`."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from fpsboost.method_table import methods
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis
from support.truth import moving_object, prepared, true_transition

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


def rod_over_lines(width, seed):
    """A dark rod that turns a little, 9 to 13 pixels a frame, over ground with dark contour lines that moves slowly.

    Returns a function of time that gives the frame, and the column of the rod's darkest pixel in each row.
    """
    random = np.random.default_rng(seed)
    heights = cv2.GaussianBlur(random.random((224, 256), np.float32), (0, 0), 14)
    heights = (heights - heights.min()) / np.ptp(heights)
    lines = np.clip((0.16 - 2 * np.abs(heights * 9 % 1 - 0.5)) / 0.1, 0, 1)
    grain = cv2.GaussianBlur(random.standard_normal(heights.shape, np.float32), (0, 0), 1.2)
    ground = 200 - 150 * lines + 36 * grain

    def at(t):
        moved = np.array([[1, 0, -24 - 1.5 * t], [0, 1, -24 - 0.5 * t]])
        image = cv2.warpAffine(ground, moved, (192, 160), flags=cv2.INTER_CUBIC)
        mask = np.zeros((640, 768), np.uint8)
        ends = [(round(256 * x), round(256 * y)) for x, y in ((64 + 9 * t, -10), (104 + 13 * t, 170))]
        cv2.line(mask, *ends, 255, 4 * width, cv2.LINE_AA, shift=6)
        share = cv2.resize(mask, (192, 160), interpolation=cv2.INTER_AREA) / 255
        image = np.rint((image + share * (35 - image)).clip(0, 255)).astype(np.uint8)
        columns = np.where(share > 0.5 * share.max(1, keepdims=True), image, 255).argmin(1)
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), columns

    return at


@pytest.mark.parametrize(("width", "quarters"), [(2, ()), (3, (1 / 4, 3 / 4)), (4, (1 / 4, 3 / 4))])
def test_a_thin_rod_is_whole_near_either_frame(width, quarters):
    """One row in fifteen lacks it at most, also in front of lines as dark, where both frames agree on the ground."""
    nlm, times, lacking, rows = methods["nlm"], (1 / 8, *quarters, 7 / 8), [], np.arange(8, 152)
    for seed in range(4):
        at = rod_over_lines(width, seed)
        before, pair, after = (nlm.pair(*each) for each in pairwise(prepared(*(at(t)[0] for t in (-1, 0, 1, 2)))))
        for t, made in zip(times, nlm.images(pair.between(before, after), times), strict=True):
            truth, columns = at(t)
            around = [made.image[rows, columns[rows] + across, 0].astype(int) for across in range(-2, 3)]
            lacking.append(np.min(around, 0) - truth[rows, columns[rows], 0] > 60)
    assert np.mean(lacking) < 1 / 15
