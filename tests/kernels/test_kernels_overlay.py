"""Pixels that stand still in front of moving surroundings, against a slow twin."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fpsboost.kernels.constants import STATIC_CONTRAST
from fpsboost.kernels.overlay import FourFrames, mark_overlay
from support.planes import points
from support.twins import marked


def mark(images, motion, spacing, own, own_spacing, shortest=1.0, same=8, different=25):
    """The kernel on four images; what was in its output before does not matter."""
    marks = np.full(images[0].shape, 77, np.uint8)
    motion, own, shortest = np.array(motion, np.float32), np.array(own, np.float32), np.float32(shortest)
    mark_overlay(FourFrames(*images), motion, spacing, own, own_spacing, shortest, same, different, marks)
    return marks


def clip(height, width, seed, share=0.8):
    """Four images of few levels, some of them on the limits, most pixels the same in all but for a few levels."""
    random = np.random.default_rng(seed)
    first, *others = random.choice([0, 25, 26, 128, 229, 230, 255], (4, height, width))
    for other in others:
        nearly = first + random.integers(-9, 10, first.shape)
        other[:] = np.where(random.random(first.shape) < share, nearly.clip(0, 255), other)
    return [image.astype(np.uint8) for image in (first, *others)]


@settings(max_examples=30)
@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.sampled_from([1, 4, 7, 32]),
    st.sampled_from([1, 3, 8]),
    st.sampled_from([0, 1, 3, 12, 100, 10**7]),
    st.sampled_from([1, 257]),
    st.sampled_from([(8, 25), (0, 0), (0, 254), (255, 255)]),
    st.integers(0, 2**32),
)
@example(33, 37, 8, 4, 6, 1, (8, 25), 5)
def test_marks_equal_their_slow_twin(height, width, spacing, own_spacing, largest, unit, levels, seed):
    """Images of 8 and 16 bits, any limits, any motion, also far out of the frame, and blocks that are cut off."""
    images, random = clip(height, width, seed), np.random.default_rng(seed)
    # in quarters of pixels, so that halves are common; some blocks are still
    motion, own = (
        random.integers(-4 * largest, 4 * largest + 1, (*points((height, width), size), 2)) / 4
        for size in (spacing, own_spacing)
    )
    if unit > 1:
        images = [image.astype(np.uint16) * unit for image in images]
    given = motion, spacing, own, own_spacing, 1.0, *(level * unit for level in levels)
    np.testing.assert_array_equal(mark(images, *given), marked(images, *given))


def test_a_dot_before_a_moving_background_stands_out():
    """The dot does; the flat background, which would look the same if it moved, stays, and what changes does not."""
    images = [np.full((12, 20), 100, np.uint8) for _ in range(4)]
    for image, changing in zip(images, (0, 50, 100, 150), strict=True):
        image[5, 9], image[8, 4] = 200, changing
    marks = mark(images, np.full((1, 1, 2), (0, 3)), 20, np.full((1, 1, 2), (0, 3)), 20)
    assert np.argwhere(marks == STATIC_CONTRAST).tolist() == [[5, 9]]
    # three rows at the top and the bottom could have come from outside, and only stay
    assert np.argwhere(marks == 0).tolist() == [[8, 4]]


@pytest.mark.parametrize(("moving", "standing"), [(4, 6), (5, 0)])
def test_a_block_that_follows_its_points_has_no_overlay(moving, standing):
    """Five of six dots that are seen where they would move to are too many for chance; four are not."""
    images = [np.full((12, 20), 100, np.uint8) for _ in range(4)]
    for image in images:
        image[5, 2:14:2] = 200
    own = np.zeros((12, 20, 2))
    own[5, 2 : 2 + 2 * moving] = 2, 0
    marks = mark(images, np.full((1, 1, 2), (0, 3)), 20, own, 1)
    assert np.count_nonzero(marks == STATIC_CONTRAST) == standing
