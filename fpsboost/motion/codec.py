"""Motion vectors chosen by a video encoder, read back from its stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import colour_components
from fpsboost.errors import OptionError, check_choice
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, check_pair
from fpsboost.motion.block import colour_values, white_of
from fpsboost.motion.field import MotionField

Preset = Literal[
    "ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow", "placebo"
]

MAX_BLOCK, MIN_BLOCK = 16, 8
"""Sides of the largest and the smallest block that has a vector of its own, pixels."""

MIN_SIDE = 16
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
    below, right = (length % 2 + max(0, MIN_SIDE - length) // 2 * 2 for length in (height, width))
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
    cells = np.zeros(
        (-(-height // MAX_BLOCK) * MAX_BLOCK // MIN_BLOCK, -(-width // MAX_BLOCK) * MAX_BLOCK // MIN_BLOCK), np.intp
    )
    top, left = vectors["dst_y"] - vectors["h"] // 2, vectors["dst_x"] - vectors["w"] // 2
    for down in range(0, MAX_BLOCK, MIN_BLOCK):
        for across in range(0, MAX_BLOCK, MIN_BLOCK):
            (which,) = np.nonzero((vectors["h"] > down) & (vectors["w"] > across))
            row, column = (top[which] + down) // MIN_BLOCK, (left[which] + across) // MIN_BLOCK
            within = (row < cells.shape[0]) & (column < cells.shape[1])  # a tiny frame is padded before it is encoded
            cells[row[within], column[within]] = which[within] + 1
    return cells.repeat(MIN_BLOCK, axis=0).repeat(MIN_BLOCK, axis=1)[:height, :width]


def _differences(image: FrameCache, other: FrameCache, flow: NDArray[Any]) -> NDArray[Any]:
    """Return each pixel's difference to the other end of its rounded vector: mean over the channels, white 1."""
    height, width = flow.shape[:2]
    here, there = (each.cached(colour_values) for each in (image, other))
    y, x = np.mgrid[:height, :width]
    end_x, end_y = (np.floor(flow[..., axis] + np.float32(0.5)).astype(np.intp) for axis in (0, 1))
    found = there[(y + end_y).clip(0, height - 1), (x + end_x).clip(0, width - 1)]
    of_pixels: NDArray[Any] = cv2.absdiff(here, found).reshape(here.shape).mean(axis=2) / white_of(image.array)
    return of_pixels
