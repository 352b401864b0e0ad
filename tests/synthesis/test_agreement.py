"""Confidence by the agreement of two frames, against truths that are known exactly."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fpsboost import Coding, FrameCache, YCbCrImage
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.agreement import find_motion, measure_agreement
from support.truth import noise

SIZE = 64, 80


def constant_motion(dx: float, dy: float) -> MotionField:
    return MotionField(np.broadcast_to(np.float32([dx, dy]), (*SIZE, 2)).copy(), np.ones(SIZE, np.float32))


def pair_of(image0, image1, dx: float = 0, dy: float = 0) -> FramePair:
    return FramePair(FrameCache(image0), FrameCache(image1), constant_motion(dx, dy), constant_motion(-dx, -dy))


def slow_agreement(image0: np.ndarray, image1: np.ndarray) -> np.ndarray:
    """At rest, square by square: the mean similarity of the 25 squares around each, to the eighth power."""
    squared = ((image0.astype(float) - image1) ** 2).sum(-1) / 255**2
    rows, columns = (length // 2 for length in squared.shape)
    squares = np.exp(-squared.reshape(rows, 2, columns, 2).mean((1, 3)) / 0.18 * 3 / image0.shape[2])
    share = np.float64([0.75, 1, 1, 1, 0.75])
    return cv2.sepFilter2D(squares, -1, share / share.sum(), share / share.sum(), borderType=cv2.BORDER_REPLICATE) ** 8


@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_similarity_of_patches(channels):
    """The same as its slow twin where both frames are smooth enough that squares are not interpolated."""
    image0, image1 = (np.repeat(np.repeat(noise(16, 20, channels, seed=k) // 4, 4, 0), 4, 1) for k in (1, 2))
    measured = measure_agreement(pair_of(image0, image1), 0.5)
    # the upsampled similarity, at the corners of squares, averages to that of the squares
    squares = (measured ** (1 / 8)).reshape(32, 2, 40, 2).mean((1, 3))
    expected = slow_agreement(image0, image1) ** (1 / 8)
    np.testing.assert_allclose(squares[1:-1, 1:-1], expected[1:-1, 1:-1], atol=0.03)
    assert abs(squares - expected).mean() < 0.01


def test_planes_of_luma_count_like_gray():
    """A difference in luma alone counts as one in gray; at any subsampling."""
    coding = Coding(8, 1, full_range=True, chroma_location="left", pixel_format="yuvj420p")
    chroma = np.full((SIZE[0] // 2, SIZE[1] // 2), 128, np.uint8)
    luma = [np.full(SIZE, level, np.uint8) for level in (90, 120)]
    planar = pair_of(*(YCbCrImage((each, chroma, chroma), coding) for each in luma))
    gray = pair_of(*(each[..., np.newaxis] for each in luma))
    np.testing.assert_allclose(measure_agreement(planar, 0.5), measure_agreement(gray, 0.5), atol=1e-4)


@pytest.mark.parametrize("t", [0.25, 0.5])
def test_a_pan_agrees_along_its_motion_alone(t):
    """Where both ends lie in the frames, a pan by whole pixels is certain; without its motion nothing is."""
    image = noise(*SIZE)
    moved = np.roll(image, (4, 8), (0, 1))
    assert measure_agreement(pair_of(image, moved, 8, 4), t)[16:-16, 16:-16].min() > 0.999
    assert measure_agreement(pair_of(image, moved), t).max() < 0.1


def test_the_less_certain_direction_counts():
    """What one direction alone follows is in doubt, as what the other leads to is mixed in."""
    image = noise(*SIZE)
    pair = replace(pair_of(image, np.roll(image, 8, 1), 8), field10=constant_motion(0, 0))
    assert measure_agreement(pair, 0.5)[16:-16, 16:-16].max() < 0.1


def test_numbers_that_are_none_have_a_confidence():
    """NaN, infinity and float32's largest numbers, which damaged files hold."""
    image0, image1 = (noise(*SIZE, dtype=np.float32, seed=seed).copy() for seed in (7, 8))
    image0[10, 10], image0[20, 20], image0[30, 30], image1[40, 40] = np.nan, np.inf, 3e38, -3e38
    measured = measure_agreement(pair_of(image0, image1, 1.5, 0.5), 0.5)
    assert np.isfinite(measured).all()
    assert 0 <= measured.min() <= measured.max() <= 1


def test_motion_through_a_pixel_is_that_of_the_point_that_has_come_there():
    """In a zoom, whose vectors grow with the distance from its centre, to half a pixel's difference."""
    x = np.arange(SIZE[1], dtype=np.float32) - 40
    vectors = np.zeros((*SIZE, 2), np.float32)
    vectors[..., 0] = 0.25 * x
    motion = find_motion(MotionField(vectors, np.ones(SIZE, np.float32)), 0.5)
    np.testing.assert_allclose(motion[..., 0], np.broadcast_to(0.25 * x / 1.125, SIZE), atol=0.2)
