"""Motion estimation of video coding: block matching (section 2.1 of the report).

It serves as a baseline: a block has one vector, chosen by the lowest sum of absolute differences (SAD), which is the
cheapest prediction and not necessarily the true motion.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fpsboost.colour import has_alpha, normalised
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.image_checks import check_pair
from fpsboost.kernels.block import SearchPlan, match_blocks
from fpsboost.motion.field import MotionField
from fpsboost.options import Checked, Pattern, Range

ZERO_OFFSET = np.array([(0, 0)], np.int32)
SQUARE_OFFSETS = np.array([(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)], np.int32)
LARGE_DIAMOND = np.array([(-2, 0), (-1, -1), (-1, 1), (0, -2), (0, 2), (1, -1), (1, 1), (2, 0)], np.int32)
SMALL_DIAMOND = np.array([(-1, 0), (0, -1), (0, 1), (1, 0)], np.int32)
"""Offsets that the patterns compare around a position, pixels, ``(dy, dx)``."""

MAX_BLOCK = 128
"""Largest side of a block, pixels."""
MAX_RANGE = 1000
"""Largest search range, pixels: the full pattern compares ``(2 range + 1)**2`` offsets."""


@dataclass(frozen=True)
class BlockMatching(Checked):
    """Block matching: each block's motion has the lowest sum of absolute differences to the other frame.

    The sum is Equation 1 of the report, over all colour channels, multiplied by alpha if there is alpha. Of equally
    good positions, the nearest one is chosen. Both directions are searched independently. The similarity of a block is
    1 minus the mean difference of its values, as a share of white: where it is low, the motion is not usable.

    Parameters
    ----------
    block_size : int
        Side of a block, pixels, from 2 to 128; blocks at the right and at the bottom edge may be smaller.
    search_range : int
        Largest motion along x and y, whole pixels, from 1 to 1000; only positions within the frame are compared.
    pattern : {'full', 'three-step', 'diamond'}
        *full*: every offset. *three-step*: eight positions around the best so far, at step sizes that halve (Koga et
        al. 1981). *diamond*: a diamond of positions that follows the best one, then a smaller one (Zhu and Ma 2000,
        doi:10.1109/83.821744).

    Examples
    --------
    >>> frame = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> moved = np.roll(frame, (2, 5), axis=(0, 1))
    >>> field01, _ = BlockMatching().estimate(FrameCache(frame), FrameCache(moved))
    >>> field01.flow[20, 30].tolist(), float(field01.similarity[20, 30])
    ([5.0, 2.0], 1.0)
    """

    block_size: Annotated[int, Range(2, MAX_BLOCK, unit=" pixels")] = 16
    search_range: Annotated[int, Range(1, MAX_RANGE, unit=" pixels")] = 24
    pattern: Pattern = "full"

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`.

        All pixels of a block share its vector, so the fields are constant within blocks.
        """
        check_pair(image0.array, image1.array)
        values0, values1 = (image.cached(colour_values) for image in (image0, image1))
        white = white_of(image0.array)
        return self._match(values0, values1, white), self._match(values1, values0, white)

    def _match(self, values0: np.ndarray, values1: np.ndarray, white: float) -> MotionField:
        """Return the motion of the first frame's blocks to the second frame.

        The values are (H, W, 1 or 3) as `colour_values` returns them, and `white` is that of `white_of`.
        """
        height, width, channels = values0.shape
        rows = -(-height // self.block_size)
        columns = -(-width // self.block_size)
        motion = np.empty((rows, columns, 2), np.int32)
        difference = np.empty((rows, columns), np.float32 if values0.dtype == np.float32 else np.int64)
        match_blocks(
            values0.reshape(height, -1),
            values1.reshape(height, -1),
            channels,
            self.block_size,
            self.search_range,
            search_plan(self.pattern, self.search_range),
            motion,
            difference,
        )
        heights, widths = (
            np.minimum(self.block_size, length - np.arange(0, length, self.block_size)) for length in (height, width)
        )
        similarity = 1 - difference / (np.outer(heights, widths) * channels * white)
        return MotionField(motion, similarity.clip(0, 1), spacing=self.block_size, size=(height, width))


def colour_values(image: Image) -> np.ndarray:
    """Return the colours as comparable numbers, (H, W, 1 or 3), multiplied by alpha if there is any; see `white_of`.

    Multiplication by alpha lets fully transparent pixels match each other whatever their stored colours. uint8 with
    alpha becomes uint16, so that no precision is lost; all other images keep their type.
    """
    values = normalised(image) if image.dtype == np.float32 else image
    if not has_alpha(image):
        return np.ascontiguousarray(values)
    colours = values[..., :-1]
    alpha = values[..., -1:]
    if image.dtype == np.uint8:
        return np.asarray(colours.astype(np.uint16) * alpha)  # uint16 holds the products exactly
    if image.dtype == np.uint16:
        return np.asarray((colours.astype(np.uint32) * alpha // np.iinfo(np.uint16).max).astype(np.uint16))
    return np.asarray(colours * alpha)


def white_of(image: Image) -> float:
    """Return the value of white in the `colour_values` of images of this type: 1, 255, 255 squared, or 65535.

    Examples
    --------
    >>> white_of(np.zeros((1, 1, 3), np.uint8)), white_of(np.zeros((1, 1, 4), np.uint8))
    (255, 65025)
    """
    if image.dtype == np.float32:
        return 1
    white = int(np.iinfo(image.dtype).max)
    return white**2 if has_alpha(image) and image.dtype == np.uint8 else white


def search_plan(pattern: Pattern, search_range: int) -> SearchPlan:
    """Return the offsets that a pattern compares, relative to the best position so far, in rounds.

    The full pattern has one round. The three-step search has a round for each step size. The diamond search repeats its
    second round, the large diamond, until the centre is the best position.
    """
    if pattern == "full":
        # nearest first: a good match that is found early ends most later sums early, as soon as they exceed it
        along = np.arange(-search_range, search_range + 1, dtype=np.int32)
        offsets = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
        turns = [offsets[np.argsort((offsets**2).sum(axis=1), kind="stable")]]
    elif pattern == "three-step":
        # the steps add up to at least the search range
        steps = [2**power for power in reversed(range(search_range.bit_length()))]
        turns = [ZERO_OFFSET, *(step * SQUARE_OFFSETS for step in steps)]
    else:
        turns = [ZERO_OFFSET, LARGE_DIAMOND, SMALL_DIAMOND]
    return SearchPlan(
        np.concatenate(turns),
        np.cumsum([0, *map(len, turns)], dtype=np.int32),
        np.array([turn is LARGE_DIAMOND for turn in turns]),
    )
