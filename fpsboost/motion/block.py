"""Motion estimation of video coding: block matching (section 2.1 of the report), and an encoder's own vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import colour_components, has_alpha, normalised
from fpsboost.errors import OptionError, check_choice
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, check_pair
from fpsboost.kernels.block import SearchPlan, match_blocks
from fpsboost.motion.field import MotionField

Pattern = Literal["full", "three-step", "diamond"]

ZERO_OFFSET = np.array([(0, 0)], np.int32)
SQUARE_OFFSETS = np.array([(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)], np.int32)
LARGE_DIAMOND = np.array([(-2, 0), (-1, -1), (-1, 1), (0, -2), (0, 2), (1, -1), (1, 1), (2, 0)], np.int32)
SMALL_DIAMOND = np.array([(-1, 0), (0, -1), (0, 1), (1, 0)], np.int32)
"""Search patterns: offsets from a position, ``(dy, dx)``."""

MAX_BLOCK = 128
MAX_RANGE = 1000


@dataclass(frozen=True)
class BlockMatching:
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

    block_size: int = 16
    search_range: int = 24
    pattern: Pattern = "full"

    def __post_init__(self) -> None:
        if not 2 <= self.block_size <= MAX_BLOCK:
            raise OptionError(f"`block_size` must be from 2 to {MAX_BLOCK} pixels, not {self.block_size}.")
        if not 1 <= self.search_range <= MAX_RANGE:
            raise OptionError(f"`search_range` must be from 1 to {MAX_RANGE} pixels, not {self.search_range}.")
        check_choice("`pattern`", self.pattern, get_args(Pattern))

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.array, image1.array)
        values0, values1 = (image.cached(colour_values) for image in (image0, image1))
        white = white_of(image0.array)
        return self._match(values0, values1, white), self._match(values1, values0, white)

    def _match(self, values0: NDArray[Any], values1: NDArray[Any], white: float) -> MotionField:
        height, width, channels = values0.shape
        rows, columns = -(-height // self.block_size), -(-width // self.block_size)
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
        flow, alike = (
            np.repeat(np.repeat(of_blocks, heights, axis=0), widths, axis=1) for of_blocks in (motion, similarity)
        )
        return MotionField(flow.astype(np.float32), alike.clip(0, 1).astype(np.float32))


def colour_values(image: Image) -> NDArray[Any]:
    """Return the colours as comparable numbers, (H, W, 1 or 3), multiplied by alpha if there is any; see `white_of`."""
    values = normalised(image) if image.dtype == np.float32 else image
    if not has_alpha(image):
        return values.copy()  # kernels are compiled once more for arrays that must not be written to
    colours, alpha = values[..., :-1], values[..., -1:]
    products: NDArray[Any]
    if image.dtype == np.uint8:
        products = colours.astype(np.uint16) * alpha  # uint16 holds the products exactly
    elif image.dtype == np.uint16:
        products = (colours.astype(np.uint32) * alpha // np.iinfo(np.uint16).max).astype(np.uint16)
    else:
        products = colours * alpha
    return products


def white_of(image: Image) -> float:
    """Return the value of white in the `colour_values` of images of this type."""
    if image.dtype == np.float32:
        return 1
    white = int(np.iinfo(image.dtype).max)
    return white**2 if has_alpha(image) and image.dtype == np.uint8 else white


def search_plan(pattern: Pattern, search_range: int) -> SearchPlan:
    """Return the offsets that a pattern compares, relative to the best position so far."""
    if pattern == "full":
        # nearest first: a good match found early allows most later sums to be stopped early
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


Preset = Literal[
    "ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow", "placebo"
]

MACROBLOCK, PARTITION = 16, 8
"""Sides of the largest and the smallest block that has a vector of its own, pixels."""

MIN_CODED_SIDE = 16
"""Minimum side of an encoded frame, pixels; smaller frames are padded."""


@dataclass(frozen=True)
class CodecMotion:
    """Motion vectors of an H.264 stream: the pair is encoded by x264 in memory, and FFmpeg exports the vectors.

    The vectors of a predicted frame point to the source of each of its blocks, to a quarter of a pixel; for the other
    direction, the pair is encoded in reverse order. An encoder minimises the size of the stream, which need not give
    the true motion. Intra-coded blocks have no motion and a similarity of 0; the similarity of all others is 1 minus
    the mean difference to the block at the other end of the vector, rounded to whole pixels, as a share of white.

    The encoder receives 8 bits per component, 4:2:0 chroma subsampling, and an even number of pixels along both sides,
    with repeated edges.

    Parameters
    ----------
    crf : int
        Quality of the stream, from 0 to 51; lower is better.
    preset : {'ultrafast', 'superfast', ..., 'veryslow', 'placebo'}
        Preset of x264, which determines the effort of its motion search.

    Raises
    ------
    OptionError
        A value is out of range; or, when motion is estimated, this FFmpeg has no x264.

    Examples
    --------
    >>> y, x = np.mgrid[0:64, 0:96, 0:3][:2]
    >>> image0, image1 = (
    ...     (128 + 60 * np.sin((x - dx) / 5) + 60 * np.cos(y / 7 + x / 9 - dx / 9)).astype(np.uint8) for dx in (0, 4)
    ... )
    >>> field01, _ = CodecMotion().estimate(FrameCache(image0), FrameCache(image1))
    >>> np.round(np.median(field01.flow, axis=(0, 1))).tolist()
    [4.0, 0.0]
    """

    crf: int = 18
    preset: Preset = "medium"

    def __post_init__(self) -> None:
        if not 0 <= self.crf <= 51:
            raise OptionError(f"crf must be from 0 to 51, not {self.crf}.")
        check_choice("preset", self.preset, get_args(Preset))

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Estimate the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.array, image1.array)
        return self._estimate_one_way(image1, image0), self._estimate_one_way(image0, image1)

    def _estimate_one_way(self, reference: FrameCache, predicted: FrameCache) -> MotionField:
        """Return the motion of the predicted frame's blocks."""
        from fpsboost.io.video.block_vectors import read_block_vectors  # noqa: PLC0415 (only this estimator needs PyAV)

        pictures = reference.cached(_as_yuv), predicted.cached(_as_yuv)
        return _field(read_block_vectors(*pictures, self.crf, self.preset), predicted, reference)


def _as_yuv(image: Image) -> NDArray[Any]:
    """Convert an image to yuv420p with an even number of pixels along both sides: (H * 3 / 2, W) uint8."""
    if image.dtype == np.uint8 and image.shape[2] == 3:
        colours = image
    else:
        components = colour_components(image)
        if image.shape[2] < 3:
            components = np.repeat(components[..., :1], 3, axis=2)
        colours = np.clip(components * 255 + 0.5, 0, 255).astype(np.uint8)
    height, width = image.shape[:2]
    below, right = (length % 2 + max(0, MIN_CODED_SIDE - length) // 2 * 2 for length in (height, width))
    even = cv2.copyMakeBorder(colours, 0, below, 0, right, cv2.BORDER_REPLICATE)
    return cv2.cvtColor(even, cv2.COLOR_BGR2YUV_I420)


def _field(vectors: NDArray[Any], image: FrameCache, other: FrameCache) -> MotionField:
    height, width = image.array.shape[:2]
    numbers = _block_numbers(vectors, height, width)
    motions = np.zeros((len(vectors) + 1, 2), np.float32)
    for axis, name in enumerate(("motion_x", "motion_y")):
        motions[1:, axis] = vectors[name] / vectors["motion_scale"]
    flow = motions[numbers]
    differences = np.bincount(numbers.ravel(), _differences(image, other, flow).ravel(), len(motions))
    sizes = np.bincount(numbers.ravel(), minlength=len(motions))
    similarities = (1 - differences / np.maximum(sizes, 1)).clip(0, 1).astype(np.float32)
    similarities[0] = 0
    return MotionField(flow, similarities[numbers])


def _block_numbers(vectors: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """Return the number of the vector of each pixel, counted from 1; 0 without a vector: (H, W)."""
    cells = np.zeros([-(-side // MACROBLOCK) * MACROBLOCK // PARTITION for side in (height, width)], np.intp)
    top, left = vectors["dst_y"] - vectors["h"] // 2, vectors["dst_x"] - vectors["w"] // 2
    for down in range(0, MACROBLOCK, PARTITION):
        for across in range(0, MACROBLOCK, PARTITION):
            (which,) = np.nonzero((vectors["h"] > down) & (vectors["w"] > across))
            row, column = (top[which] + down) // PARTITION, (left[which] + across) // PARTITION
            within = (row < cells.shape[0]) & (column < cells.shape[1])  # a tiny frame is padded before it is encoded
            cells[row[within], column[within]] = which[within] + 1
    return cells.repeat(PARTITION, axis=0).repeat(PARTITION, axis=1)[:height, :width]


def _differences(image: FrameCache, other: FrameCache, flow: NDArray[Any]) -> NDArray[Any]:
    """Return each pixel's difference to the other end of its rounded vector: mean over the channels, white 1."""
    height, width = flow.shape[:2]
    here, there = (each.cached(colour_values) for each in (image, other))
    y, x = np.mgrid[:height, :width]
    end_x, end_y = (np.floor(flow[..., axis] + np.float32(0.5)).astype(np.intp) for axis in (0, 1))
    found = there[(y + end_y).clip(0, height - 1), (x + end_x).clip(0, width - 1)]
    of_pixels: NDArray[Any] = cv2.absdiff(here, found).reshape(here.shape).mean(axis=2) / white_of(image.array)
    return of_pixels
