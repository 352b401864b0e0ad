"""Planes in which frames are compared, and small copies, against slow twins."""

from itertools import product

import cv2
import numpy as np
import pytest

from fpsboost.kernels.constants import HIGH_PASS_SIZE, WHITE
from fpsboost.kernels.planes import CodeLevels, level_scale, shrink, smooth, split_colours, split_planes, truncation
from fpsboost.motion.components import contrast_components, contrast_planes
from support.truth import noise
from support.twins import split_codes, split_levels

PADDING = 3
MIDDLE = np.float32(128)

# the high-pass looks four pixels around, and keeps ten rows
SIZES = [(1, 1), (2, 3), (5, 7), (6, 40), (11, 2), (27, 9)]
SCALES = [np.float32(level_scale(v)) for v in (0.09, 0.4)]


def empty_planes(size: tuple[int, int]) -> np.ndarray:
    """What kernels write to, with more room on the right than on the left."""
    height, width = size
    return np.full((3, height + 2 * PADDING, width + 2 * PADDING + 5), 77, np.uint8)


def assert_split(expected: list[np.ndarray], scale: np.float32, planes: np.ndarray) -> None:
    """The first and the third plane are what they should be, the second is the high-pass; edges are repeated.

    Every level is the nearest one, or one of the two that are equally near but for float32.
    """
    luma, first, third = expected
    height, width = luma.shape
    mean = cv2.blur(luma, (HIGH_PASS_SIZE, HIGH_PASS_SIZE), borderType=cv2.BORDER_REFLECT_101)
    high_pass = (2 * scale * (luma - mean) + MIDDLE).clip(0, WHITE)
    for plane, levels in zip(planes, (first, high_pass, third), strict=True):
        inside = plane[PADDING : PADDING + height, PADDING : PADDING + width]
        assert inside.dtype == np.uint8
        assert np.abs(inside - levels).max() <= 0.5 + 1e-4
        np.testing.assert_array_equal(plane, np.pad(inside, ((PADDING, PADDING), (PADDING, PADDING + 5)), "edge"))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_splitting_colours_equals_its_slow_twin(dtype, channels):
    """Half luma, its high-pass and mean chroma of any type and number of channels; beyond white is the last level."""
    white = 1 if dtype == np.float32 else np.iinfo(dtype).max
    for size, scale in product(SIZES, SCALES):
        image = noise(*size, channels, dtype, seed=7).copy()
        if dtype == np.float32:
            image[..., : min(channels, 3)] *= 3
        planes = empty_planes(size)
        split_colours(image, np.float32(1 / white), scale, MIDDLE, np.int64(PADDING), planes)
        assert_split(split_levels(image, white, scale), scale, planes)


@pytest.mark.parametrize("steps", [(1, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize(
    ("dtype", "levels"),
    [(np.uint8, (16, 219, 128, 224)), (np.uint8, (0, 255, 128, 255)), (np.uint16, (64, 876, 512, 896))],
)
def test_splitting_planes_equals_its_slow_twin(dtype, levels, steps):
    """The same of luma and chroma as video has them, chroma of every size; codes below black are black."""
    black, luma_span, neutral, chroma_span = levels
    units = CodeLevels(*map(np.float32, (black, 1 / luma_span, neutral, 1 / chroma_span)))
    for size, scale in product(SIZES, SCALES):
        random, most = np.random.default_rng(3), 2 * levels[2]
        # one column of chroma is as wide as the picture
        across = steps[1] if size[1] > 1 else 1
        small = -(-size[0] // steps[0]), -(-size[1] // across)
        codes = [random.integers(0, most, shape).astype(dtype) for shape in (size, small, small)]
        planes = empty_planes(size)
        split_planes(*codes, units, scale, MIDDLE, np.int64(PADDING), planes)
        assert_split(split_codes(codes, levels, scale), scale, planes)


@pytest.mark.parametrize(("v", "most"), [(0.0001, 1), (0.05, 51), (0.09, 92), (0.25, 255), (2.0, 255)])
def test_the_truncation_is_four_widths(v, most):
    """In levels, from one on; where four widths are more than white, the levels are scaled down instead."""
    assert truncation(v) == most
    assert level_scale(v) == pytest.approx(min(255, 255 / (4 * v)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_levels_are_those_of_the_components(dtype):
    """Half luma, twice the high-pass around the middle, and chroma; beyond the frame as at its edge."""
    random, padding, v = np.random.default_rng(4), 20, 0.09
    image = random.random((9, 14, 3)) * 0.3 + 0.3
    image = image.astype(dtype) if dtype == np.float32 else (image * np.iinfo(dtype).max).astype(dtype)
    expected = contrast_components(image) * level_scale(v) + [0, 128, 0]
    levels = contrast_planes(image, padding, v).transpose(1, 2, 0)
    assert np.abs(levels[padding : padding + 9, padding : padding + 14] - expected.clip(0, WHITE)).max() < 0.51
    np.testing.assert_array_equal(levels[:padding, padding], np.broadcast_to(levels[padding, padding], (padding, 3)))
    np.testing.assert_array_equal(levels[padding, -1], levels[padding, padding + 13])


def covered(length: int, places: int) -> np.ndarray:
    """Which share of each pixel of a row belongs to each of fewer places, (places, length)."""
    edges = np.arange(places + 1) * length / places
    pixel = np.arange(length)
    return (np.minimum(edges[1:, None], pixel + 1) - np.maximum(edges[:-1, None], pixel)).clip(0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(
    ("size", "small"), [((17, 40), (5, 12)), ((6, 8), (6, 8)), ((9, 5), (1, 1)), ((30, 20), (10, 3))]
)
@pytest.mark.parametrize("channels", [1, 3])
def test_a_small_copy_has_the_means_of_its_areas(dtype, size, small, channels):
    """Of whole pixels and of parts of them."""
    image = noise(*size, channels, dtype)
    found = np.empty((*small, channels), np.float32)
    shrink(image.reshape(size[0], -1), found)
    down, across = (covered(length, places) for length, places in zip(size, small, strict=True))
    expected = np.einsum("vy,ux,yxc->vuc", down, across, image.astype(float)) / (size[0] * size[1] / np.prod(small))
    np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (4, 130), (37, 6)])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_a_smoothed_image_is_what_opencv_makes_of_it(dtype, size, channels):
    """To the bit where codes are whole numbers; also of extremes beside each other."""
    white = 1 if dtype == np.float32 else np.iinfo(dtype).max
    image = np.where(noise(*size, 1, np.uint8) < 64, white, noise(*size, channels, dtype)).astype(dtype)
    found = np.empty_like(image)
    smooth(image, found)
    expected = cv2.GaussianBlur(image, (5, 5), 0, borderType=cv2.BORDER_REPLICATE).reshape(image.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 if dtype == np.float32 else 0)
