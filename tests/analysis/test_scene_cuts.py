"""Scene cuts: found where there are some, and only there."""

from collections import Counter
from fractions import Fraction
from itertools import pairwise

import cv2
import numpy as np
import pytest

from fpsboost import CutDetector, Frame, FrameCache, methods, with_neighbours
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, group_duplicates
from support.scenes_of_cuts import make_clips
from support.truth import (
    SCENES,
    affine,
    as_type,
    equal_luma,
    frozen,
    moved_waves,
    moving_object,
    needs_scenes,
    prepared,
    translation,
)


def scene(seed: int, height: int = 90, width: int = 120, channels: int = 3, dtype: type = np.uint8) -> np.ndarray:
    """One of any number of different smooth pictures."""
    return as_type(moved_waves((height, width), 0, 0, channels, seed), dtype)


def is_cut(detector, image0, image1):
    """Whether a scene ends between two frames, before which motion was easy to follow."""
    return detector.is_cut(detector.match_score(image0, image1), 0.9)


MOVES = [(0, 1), (3, 1), (0, 2), (3, 2)]
"""By how much the pictures of two scenes are moved, and which scene each shows."""

BLACK = frozen(np.zeros((90, 120, 3), np.uint8))


@pytest.mark.parametrize("second", [*(scene(seed) for seed in range(2, 6)), BLACK], ids=[*"2345", "black"])
def test_different_scenes_are_cuts(second):
    """Two pictures of nothing in common, or one of nothing at all, both ways."""
    assert is_cut(CutDetector(), *prepared(scene(1), second))
    assert is_cut(CutDetector(), *prepared(second, scene(1)))


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (4, np.uint8), (3, np.uint16), (3, np.float32)])
def test_cuts_are_found_in_images_of_every_kind(channels, dtype):
    """Gray, with alpha, deep and float; and the picture itself is no cut to itself."""
    one, other = scene(1, channels=channels, dtype=dtype), scene(2, channels=channels, dtype=dtype)
    assert is_cut(CutDetector(), *prepared(one, other))
    assert not is_cut(CutDetector(), *prepared(one, one))


@pytest.mark.parametrize("red", [0.25, -0.25], ids=["green and magenta", "azure and orange"])
def test_scenes_of_equal_luma_are_told_apart(red):
    """Where gray says nothing, colours tell a cut, and what a pan of them is."""
    grounds = (2 * moved_waves((90, 120), dx, 0, 1, seed)[..., 0] - 1 for dx, seed in ((0, 1), (0, 2), (7, 1)))
    images = (as_type(equal_luma(0.25 * ground, red * ground), np.uint8) for ground in grounds)
    one, other, moved = map(FrameCache, images)
    assert CutDetector().match_score(one, other) < 0.7
    assert CutDetector().match_score(one, moved) > 0.9


@pytest.mark.parametrize(
    "clip",
    [
        affine(90, 120, shift=(9, 4), seed=1),
        affine(90, 120, shift=(-14, 0), seed=2),
        affine(90, 120, zoom=1.1, seed=3),
        affine(90, 120, degrees=4, seed=4),
        moving_object(90, 120, box=(20, 20, 60, 60), dx=20, dy=10),
    ],
    ids=["pan", "fast pan", "zoom", "rotation", "object"],
)
def test_motion_is_no_cut(clip):
    """Whatever can be followed belongs to one scene."""
    assert not is_cut(CutDetector(), *clip.prepared)
    assert not is_cut(CutDetector(), *prepared(clip.image1, clip.image0))


def test_noise_and_slow_fades_are_no_cut():
    """Grain, and a twentieth of the way to another picture or to black."""
    image = scene(1)
    grain = np.random.default_rng(1).normal(0, 8, image.shape)
    noisy = frozen((image + grain).clip(0, 255).astype(np.uint8))
    assert not is_cut(CutDetector(), *prepared(image, noisy))
    for other in (scene(2), np.zeros_like(image)):
        faded = frozen(np.rint(0.95 * image + 0.05 * other).astype(np.uint8))
        assert not is_cut(CutDetector(), *prepared(image, faded))


def test_the_threshold_runs_from_no_cuts_to_all():
    """0 finds none, 1 finds all."""
    clip = translation(48, 64, 1, 0)
    assert not is_cut(CutDetector(threshold=0), *prepared(scene(1), scene(2)))
    assert is_cut(CutDetector(threshold=1), *clip.prepared)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_broken_pixel_of_a_render_is_no_cut(value):
    """Renderers leave single NaN and infinite pixels in float images; the rest of the frame still counts."""
    image = affine(120, 160, dtype=np.float32).image0
    broken = image.copy()
    broken[30, 40] = value
    assert not is_cut(CutDetector(), *prepared(image, broken))
    assert not is_cut(CutDetector(), *prepared(broken, image))


@pytest.mark.parametrize(
    ("scores", "is_cut"),
    [
        ((0.3, 0.45, 0.42), False),
        ((0.2, 0.45, 0.42), True),
        ((0.3, 0.9, 0.2), True),
        ((0.6, 0.97, 0.97), True),
        ((0.7, 0.95, 0.7), False),
        ((0.8, 1, 1), False),
        ((0.05, 0.05, 0.04), True),
        # without neighbours too little is known; with one, a rest before motion goes on is not taken for one
        ((0.1,), True),
        ((0.2,), False),
        ((0.3,), False),
        ((0.3, 0.9), True),
        ((0.6, 0.95), False),
        ((0.3, 0.4), False),
    ],
)
def test_a_cut_stands_out_from_its_neighbours(scores, is_cut):
    """Where everything is hard to follow nothing is cut; a short shot between two cuts has two."""
    assert CutDetector().is_cut(*scores) == is_cut
    assert not CutDetector(threshold=0).is_cut(0.0, *scores[1:])


@needs_scenes
@pytest.mark.parametrize("scene_name", ["glass", "reflective", "texture"])
def test_the_rendered_scenes_hold_no_cut(scene_name):
    """Nor with every second frame hidden, as a sequence or two alone, though turning glass shows other things."""
    paths = sorted((SCENES / scene_name).glob("*.png"))
    images = [FrameCache(cv2.imread(str(path))) for path in paths]
    pairs = [methods["nlm"].pair(*pair) for pair in zip(images[:-2], images[2:], strict=True)]
    assert len(pairs) == 23
    assert not any(pair.is_cut for pair in pairs)
    for pairs_of_a_sequence in (pairs[::2], pairs[1::2]):
        assert not any(pair.is_cut for pair in with_neighbours(pairs_of_a_sequence))


def pairs_of(images, durations):
    """The pairs of a sequence of frames, of these durations."""
    return [methods["nlm"].pair(*each, time) for each, time in zip(pairwise(images), durations, strict=True)]


@needs_scenes
@pytest.mark.parametrize("scene_name", ["glass", "reflective", "texture"])
def test_frames_farther_apart_in_time_match_less_and_are_no_cut(scene_name):
    """Where four frames are missing, the scene goes on; in a pair as short as those around it, that would be a cut."""
    paths = [SCENES / scene_name / f"{number:04}.png" for number in (6, 7, 12, 13)]
    images = [FrameCache(cv2.imread(str(path))) for path in paths]
    before, pair, after = pairs_of(images, (1, 5, 1))
    assert not pair.between(before, after).is_cut
    assert methods["nlm"].pair(*images[1:3]).between(before, after).is_cut == (scene_name == "reflective")


@pytest.mark.parametrize("duration", [1, 5, 30])
def test_cuts_after_a_pause_are_found(duration):
    """However long a picture stands before the scene changes, and whether its repeats are frames or a pause."""
    one, same, other, moved = (as_type(moved_waves((90, 120), dx, 0, 3, seed), np.uint8) for dx, seed in MOVES)
    images = prepared(one, same, other, moved)
    before, pair, after = pairs_of(images, (1, duration, 1))
    assert pair.between(before, after).is_cut


def found_cuts(frames):
    """The pairs of a clip of 24 frames per second that a conversion takes for cuts."""
    shown = (SourceFrame(Frame(image, Fraction(k, 24), Fraction(1, 24))) for k, image in enumerate(frames))
    held = list(group_duplicates(shown, DuplicateDetector()))
    pairs = [methods["nlm"].pair(first[0], second[0]) for first, second in pairwise(held)]
    ends = np.cumsum([len(each) for each in held]) - 1
    return {int(end) for end, pair in zip(ends, with_neighbours(pairs), strict=False) if pair.is_cut}


@pytest.mark.slow
def test_cuts_are_told_from_all_that_only_looks_like_one():
    """Of constructed cuts 95 in 100 are found, and of what is found 95 in 100 are cuts."""
    right, false, missed = Counter(), Counter(), Counter()
    for clip in make_clips(2):
        found = found_cuts(clip.frames)
        right[clip.name] += len(found & clip.cuts)
        false[clip.name] += len(found - clip.cuts)
        missed[clip.name] += len(clip.cuts - found)
    assert right.total() / (right.total() + false.total()) > 0.95, +false
    assert right.total() / (right.total() + missed.total()) > 0.95, +missed
