"""Block matching against a slow twin, and the shorter search patterns against the full one."""

import numpy as np
import pytest

from fpsboost.kernels.block import match_blocks
from fpsboost.motion.block import search_plan
from support.truth import noise, translation
from support.twins import matched_blocks

every_pattern = pytest.mark.parametrize("pattern", ["full", "three-step", "diamond"])


def matched(image0, image1, block_size, search_range, pattern="full"):
    """Call the kernel."""
    height, width, channels = image0.shape
    size = -(-height // block_size), -(-width // block_size)
    motion = np.full((*size, 2), 99, np.int32)
    difference = np.full(size, -1, np.float32 if image0.dtype == np.float32 else np.int64)
    rows0, rows1 = (image.reshape(height, -1).copy() for image in (image0, image1))
    plan = search_plan(pattern, search_range)
    match_blocks(rows0, rows1, channels, block_size, search_range, plan, motion, difference)
    return motion, difference


@pytest.mark.parametrize(
    ("dtype", "level"),
    [
        (np.uint8, 1),
        (np.uint16, 1),
        (np.float32, np.float32(2**-20)),
        *((np.uint8, level) for level in (128, 80, 64, 50)),
    ],
)
@pytest.mark.parametrize(("channels", "block_size", "search_range"), [(1, 3, 4), (1, 4, 3), (3, 5, 2), (3, 8, 4)])
def test_full_search_equals_its_slow_twin(dtype, level, channels, block_size, search_range):
    """Same vectors and sums of integers; float sums to rounding; smaller blocks at the edges.

    With few colours many places are as good: the nearest one is taken, then the uppermost, then the leftmost.
    """
    image0, image1 = (noise(11, 17, channels, dtype, seed) // level * level for seed in (1, 2))
    motion, difference = matched(image0, image1, block_size, search_range)
    expected_motion, expected_difference = matched_blocks(image0, image1, block_size, search_range)
    np.testing.assert_array_equal(motion, expected_motion)
    np.testing.assert_allclose(difference, expected_difference, rtol=1e-5 if dtype is np.float32 else 0)


@every_pattern
@pytest.mark.parametrize("search_range", [1, 2, 5])
def test_matches_stay_in_range_and_in_the_frame(pattern, search_range):
    """What is found is within both, and its sum is what the block and its match differ by."""
    image0, image1 = noise(13, 18, seed=1), noise(13, 18, seed=2)
    motion, difference = matched(image0, image1, 4, search_range, pattern)
    assert np.abs(motion).max() <= search_range
    for (row, column), total in np.ndenumerate(difference):
        (dx, dy), top, left = motion[row, column].tolist(), 4 * row, 4 * column
        here = image0[top : top + 4, left : left + 4].astype(int)
        there = image1[top + dy : top + dy + here.shape[0], left + dx : left + dx + here.shape[1]]
        assert top + dy >= 0
        assert left + dx >= 0
        assert here.shape == there.shape
        assert np.abs(here - there).sum() == total


@every_pattern
def test_no_pattern_beats_the_full_search_or_is_worse_than_staying(pattern):
    """The sums lie between that of the best place and that of no motion."""
    clip = translation(24, 32, 2, 1, seed=4)
    (_, best), (_, found) = (matched(clip.image0, clip.image1, 8, 4, which) for which in ("full", pattern))
    _, still = matched_blocks(clip.image0, clip.image1, 8, 0)
    assert (best <= found).all()
    assert (found <= still).all()


@every_pattern
def test_steps_reach_the_end_of_the_range(pattern):
    """A slope leads every pattern to the farthest place, along both axes and back."""
    slope = np.broadcast_to(np.arange(100, 148), (48, 48))[..., np.newaxis]
    for axis, image in enumerate((slope, slope.swapaxes(0, 1))):
        for sign in (-1, 1):
            image0, image1 = (each.astype(np.uint16) for each in (image, image - sign * 14))
            motion, _ = matched(image0, image1, 16, 7, pattern)
            assert motion[1, 1].tolist() == [sign * 7 * (axis == 0), sign * 7 * (axis == 1)]
