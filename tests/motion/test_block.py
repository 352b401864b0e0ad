"""Motion estimation of video coding against constructed truth: block matching, and an encoder's own motion."""

import numpy as np
import pytest

from fpsboost.motion.block import BlockMatching, colour_values, white_of
from support.truth import as_type, noise, prepared, translation

every_pattern = pytest.mark.parametrize("pattern", ["full", "three-step", "diamond"])


def whole_blocks(height, width, size, shift):
    """Pixels of the blocks that lie in the other frame as a whole."""
    dx, dy = shift
    inside = np.zeros((height, width), bool)
    for top in range(0, height, size):
        for left in range(0, width, size):
            bottom, right = min(top + size, height), min(left + size, width)
            inside[top:bottom, left:right] = (
                top + dy >= 0 and left + dx >= 0 and bottom + dy <= height and right + dx <= width
            )
    return inside


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_translations_are_found_exactly(channels, dtype):
    """By the full search, in both directions, for any image and a size that no block divides."""
    clip = translation(53, 70, 7, -5, channels, dtype, seed=1)
    fields = BlockMatching(search_range=8).estimate(*clip.prepared)
    for field, flow, sign in zip(fields, (clip.flow01, clip.flow10), (1, -1), strict=True):
        inside = whole_blocks(53, 70, 16, (sign * 7, sign * -5))
        assert inside.any()
        np.testing.assert_array_equal(field.flow[inside], flow[inside])
        np.testing.assert_array_equal(field.similarity[inside], 1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_similarity_is_one_less_the_mean_difference(dtype):
    """A share of white, for every type: what a quarter of white lies between is similar by three quarters."""
    dark, light = (as_type(np.full((20, 24, 3), value), dtype) for value in (0.25, 0.5))
    field, _ = BlockMatching().estimate(*prepared(dark, light))
    assert not field.flow.any()
    np.testing.assert_allclose(field.similarity, 0.75, atol=1 / 255)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_colours_that_alpha_hides_do_not_count(dtype):
    """Values are multiplied by alpha, white where alpha is all; two frames that differ where none is are alike."""
    image0, image1 = (noise(20, 24, 4, dtype, seed).copy() for seed in (1, 2))
    image0[..., 3] = image1[..., 3] = 0
    field, _ = BlockMatching().estimate(*prepared(image0, image1))
    assert not field.flow.any()
    np.testing.assert_array_equal(field.similarity, 1)
    white = np.full((2, 3, 2), 1 if dtype is np.float32 else np.iinfo(dtype).max, dtype)
    np.testing.assert_array_equal(colour_values(white), white_of(white))
    assert colour_values(white).shape == (2, 3, 1)


@every_pattern
def test_what_is_no_number_counts_as_black(pattern):
    """Neither sums nor similarities are spoiled."""
    image = noise(20, 24, 3, np.float32).copy()
    image[5, 7, 1], image[9, 9, 0] = np.nan, np.inf
    field, _ = BlockMatching(pattern=pattern).estimate(*prepared(image, image))
    assert not field.flow.any()
    np.testing.assert_array_equal(field.similarity, 1)
