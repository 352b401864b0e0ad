"""Fades, flashes and exposure: when the light changes between two frames, motion is searched for in the same light.

The report's similarity compares colours, so that under a flash everything looks most like something else and tears. A
gain and an offset for each colour say what a fade, a flash or a camera's exposure does. They are believed only where
they make the frames more alike than they were.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image, has_alpha
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.colour import contrast_components, normalised, small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import search_fused

LONGER_SIDE = 40
"""Of the small copies that are compared, pixels."""

MIN_CHANGE = 0.01
"""Mean change of colour below which the light is taken for constant, with 1 for white."""

MIN_SCORE_GAIN = 0.015
"""What a change of light must add to the likeness of the frames to be believed."""

MIN_SCORE = 0.6
"""Likeness that frames of one scene have in one light, at least."""

MAX_GAIN = 8.0
"""More would make patterns out of noise; so would less than its inverse."""


@dataclass(frozen=True)
class IlluminationModel:
    """How colours change from frame 0 to frame 1: ``gain * colour + offset``.

    Attributes
    ----------
    gain, offset : (C,) float32
        For colours in [0, 1].
    """

    gain: NDArray[Any]
    offset: NDArray[Any]

    def undo(self, image1: Image) -> Image:
        """Frame 1 in the light of frame 0, float32."""
        matched: Image = (normalised(image1) - self.offset) / self.gain
        return matched

    def apply(self, image: Image, t: float, dtype: np.dtype[Any]) -> Image:
        """An image in the light of frame 0, float32, as it looks at time t, in the frames' own type."""
        lit: Image = image * (1 + (self.gain - 1) * np.float32(t)) + self.offset * np.float32(t)
        if dtype == np.float32:
            return lit
        levels: Image = np.rint(lit.clip(0, 1) * np.iinfo(dtype).max).astype(dtype)
        return levels


def estimate_illumination(image0: FrameCache, image1: FrameCache) -> IlluminationModel | None:
    """How the light changes between two frames, or None where it does not.

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type. With alpha the light is taken for constant.
    """
    if has_alpha(image0.pixels):
        return None
    small0, small1 = (image.cached(small_copy, LONGER_SIDE) for image in (image0, image1))
    white = np.float32(max(1, small0.max(), small1.max()))
    small0, small1 = small0 / white, small1 / white
    illumination = _same_spread(small0, small1)
    if np.abs(illumination.apply(small0, 1, small0.dtype) - small0).mean() < MIN_CHANGE:
        return None
    exact = _along_motion(small0, small1, _search(small0, illumination.undo(small1)))
    in_lights, illumination = max(
        ((_likeness(small0, small1, each), each) for each in (illumination, exact)), key=lambda known: sum(known[0])
    )
    before = _search(small0, small1).similarity.mean()
    believed = min(in_lights) > max(MIN_SCORE, before - MIN_SCORE_GAIN) and sum(in_lights) / 2 > before + MIN_SCORE_GAIN
    return IlluminationModel(illumination.gain, illumination.offset * white) if believed else None


def compensate_either(
    image0: FrameCache, image1: FrameCache, illumination: IlluminationModel
) -> tuple[tuple[FrameCache, FrameCache], ...]:
    """Small copies of two frames, in the light of frame 0, and in that of frame 1."""
    small0, small1 = (image.cached(small_copy, LONGER_SIDE) for image in (image0, image1))
    in_light0, in_light1 = (small0, illumination.undo(small1)), (illumination.apply(small0, 1, small0.dtype), small1)
    return tuple(
        (
            FrameCache(first, image0.output_position, image0.source_position),
            FrameCache(second, image1.output_position, image1.source_position),
        )
        for first, second in (in_light0, in_light1)
    )


def _likeness(small0: Image, small1: Image, illumination: IlluminationModel) -> tuple[float, float]:
    """How much of frame 0 is found in frame 1, in the light of each: dim frames all look alike, but not bright ones."""
    if not 1 / MAX_GAIN < illumination.gain.min() <= illumination.gain.max() < MAX_GAIN:
        return 0.0, 0.0
    in_light0 = _search(small0, illumination.undo(small1))
    in_light1 = _search(illumination.apply(small0, 1, small0.dtype), small1)
    return float(in_light0.similarity.mean()), float(in_light1.similarity.mean())


def _search(small0: Image, small1: Image) -> MotionField:
    components = contrast_components(small0), contrast_components(small1)
    field01, _ = search_fused(*components, math.ceil(LONGER_SIDE / 6), 2, "box", 0.09)
    return field01


def _same_spread(small0: Image, small1: Image) -> IlluminationModel:
    """The change that gives both frames the same mean and deviation."""
    (mean0, deviation0), (mean1, deviation1) = (
        (small.mean(axis=(0, 1)), small.std(axis=(0, 1))) for small in (small0, small1)
    )
    gain = ((deviation1 + 1e-3) / (deviation0 + 1e-3)).clip(1 / MAX_GAIN, MAX_GAIN)
    return IlluminationModel(gain.astype(np.float32), (mean1 - gain * mean0).astype(np.float32))


def _along_motion(small0: Image, small1: Image, field01: MotionField) -> IlluminationModel:
    """The same by least squares over the pixels that were found again."""
    height, width, channels = small0.shape
    y, x = np.mgrid[:height, :width]
    moved_x = (x + np.rint(field01.flow[..., 0]).astype(int)).clip(0, width - 1)
    moved_y = (y + np.rint(field01.flow[..., 1]).astype(int)).clip(0, height - 1)
    weight = field01.similarity.reshape(-1, 1) + np.float32(1e-6)
    weight /= weight.sum()
    colours0, colours1 = small0.reshape(-1, channels), small1[moved_y, moved_x].reshape(-1, channels)
    mean0, mean1 = ((weight * colours).sum(axis=0) for colours in (colours0, colours1))
    covariance = (weight * (colours0 - mean0) * (colours1 - mean1)).sum(axis=0)
    variance = (weight * (colours0 - mean0) ** 2).sum(axis=0)
    gain = (covariance / (variance + 1e-6)).clip(1 / MAX_GAIN, MAX_GAIN)
    return IlluminationModel(gain.astype(np.float32), (mean1 - gain * mean0).astype(np.float32))
