"""Images as padded planes in levels, against slow twins."""

from __future__ import annotations

import numpy as np
import pytest
from truth import noise
from twins import split_codes, split_levels, with_repeated_edges

from fpsboost.kernels.contrast import CodeLevels, finish_planes, split_colours, split_planes
from fpsboost.kernels.levels import WHITE, level_scale

PADDING = 3
UNTOUCHED = 77

SIZES = [(1, 1), (2, 3), (5, 7), (6, 40)]
SCALES = [np.float32(level_scale(v)) for v in (0.09, 0.4)]


def untouched(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """What kernels write to: luma, and planes with more room on the right than on the left."""
    height, width = size
    planes = np.full((3, height + 2 * PADDING, width + 2 * PADDING + 5), UNTOUCHED, np.uint8)
    return np.empty(size, np.float32), planes


def assert_rounded(found: np.ndarray, exact: np.ndarray) -> None:
    """Every level is the nearest one, or one of the two that are equally near but for float32."""
    assert found.dtype == np.uint8
    assert np.abs(found - exact).max() <= 0.5 + 1e-4


def assert_split(expected: list[np.ndarray], luma: np.ndarray, planes: np.ndarray) -> None:
    """Luma and two planes are what they should be, and nothing else was written."""
    height, width = luma.shape
    np.testing.assert_allclose(luma, expected[0], rtol=1e-5, atol=1e-6)
    inside = np.s_[PADDING : PADDING + height, PADDING : PADDING + width]
    for plane, levels in zip(planes[::2], expected[1:], strict=True):
        assert_rounded(plane[inside], levels)
        plane[inside] = UNTOUCHED
    assert (planes == UNTOUCHED).all()


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_splitting_colours_equals_its_slow_twin(dtype, channels, size, scale):
    """Luma, half luma and mean chroma of any type and number of channels; light beyond white is the highest level."""
    image = noise(*size, channels, dtype, seed=7).copy()
    if dtype == np.float32:
        image[..., : min(channels, 3)] *= 3
    white = 1 if dtype == np.float32 else np.iinfo(dtype).max
    luma, planes = untouched(size)
    split_colours(image, np.float32(1 / white), scale, np.int64(PADDING), luma, planes)
    assert_split(split_levels(image, white, scale), luma, planes)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("steps", [(1, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize(
    ("dtype", "levels"),
    [(np.uint8, (16, 219, 128, 224)), (np.uint8, (0, 255, 128, 255)), (np.uint16, (64, 876, 512, 896))],
)
def test_splitting_planes_equals_its_slow_twin(dtype, levels, steps, size, scale):
    """The same of luma and chroma as video has them, chroma of every size; codes below black are black."""
    if size[1] == 1 and steps[1] == 2:
        steps = (steps[0], 1)  # one column of chroma is as wide as the picture
    random, most = np.random.default_rng(3), 2 * levels[2]
    small = tuple(-(-length // step) for length, step in zip(size, steps, strict=True))
    codes = [random.integers(0, most, shape).astype(dtype) for shape in (size, small, small)]
    luma, planes = untouched(size)
    black, luma_span, neutral, chroma_span = levels
    units = (np.float32(value) for value in (black, 1 / luma_span, neutral, 1 / chroma_span))
    split_planes(*codes, CodeLevels(*units), scale, np.int64(PADDING), luma, planes)
    assert_split(split_codes(codes, levels, scale), luma, planes)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("size", SIZES)
def test_finishing_planes_equals_its_slow_twin(size, scale):
    """The second plane is twice the luma less its surroundings around the middle; all three go on as at their edges."""
    random = np.random.default_rng(5)
    luma, around = (random.random(size).astype(np.float32) for _ in range(2))
    _, planes = untouched(size)
    height, width = size
    inside = np.s_[PADDING : PADDING + height, PADDING : PADDING + width]
    given = random.integers(0, WHITE + 1, (3, *size)).astype(np.uint8)
    planes[:, *inside] = given
    finish_planes(luma, around, scale, np.float32(128), np.int64(PADDING), planes)
    high_pass = (2 * scale * (luma.astype(float) - around) + 128).clip(0, WHITE)
    assert_rounded(planes[1][inside], high_pass)
    for plane, values in zip(planes, (given[0], planes[1][inside], given[2]), strict=True):
        np.testing.assert_array_equal(plane, with_repeated_edges(values, PADDING, PADDING, plane.shape))
