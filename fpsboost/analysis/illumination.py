"""Illumination compensation: fades, flashes and exposure changes are removed before motion is estimated.

The report's similarity compares colours, so that under a flash every patch matches a wrong one best, and the picture
tears. A gain and an offset for each colour model a fade, a flash or a change of exposure. The model is used only where
it makes the frames more similar.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import has_alpha, normalised
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.motion.components import contrast_components, small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import search_fused

SMALL_COPY_SIDE = 40
"""Longer side of the small copies that are compared, pixels."""

MIN_CHANGE = 0.01
"""Mean change of colour below which the illumination counts as constant; 1 is white."""

MIN_SCORE_GAIN = 0.015
"""Minimum increase of the mean similarity of two frames at which an illumination model is accepted."""

MIN_SCORE = 0.6
"""Minimum mean similarity, under equal illumination, of two frames of one scene."""

MAX_GAIN = 8.0
"""Maximum gain; the minimum is its inverse. Gains beyond these would amplify noise into patterns."""


class _Colours(NamedTuple):
    """Mean and standard deviation of an image's colours, (C,) float32, and the largest value."""

    mean: NDArray[Any]
    deviation: NDArray[Any]
    largest: float


@dataclass(frozen=True)
class IlluminationModel:
    """Change of colours in [0, 1] from frame 0 to frame 1: ``gain * colour + offset``, both (C,) float32."""

    gain: NDArray[Any]
    offset: NDArray[Any]

    def undo(self, image1: Image) -> Image:
        """Return frame 1 under the illumination of frame 0, float32."""
        matched: Image = (normalised(image1) - self.offset) / self.gain
        return matched

    def apply(self, image: Image, t: float, dtype: np.dtype[Any]) -> Image:
        """Return a float32 image under the illumination of frame 0 as it appears at time t, in the frames' `dtype`."""
        lit: Image = image * (1 + (self.gain - 1) * np.float32(t)) + self.offset * np.float32(t)
        if dtype == np.float32:
            return lit
        levels: Image = np.rint(lit.clip(0, 1) * np.iinfo(dtype).max).astype(dtype)
        return levels


def estimate_illumination(image0: FrameCache, image1: FrameCache) -> IlluminationModel | None:
    """Estimate the illumination change between two frames; None if there is none, and of images with alpha."""
    if has_alpha(image0.pixels):
        return None
    small0, small1 = (image.cached(small_copy, SMALL_COPY_SIDE) for image in (image0, image1))
    colours0, colours1 = (image.derived(_measure_colours) for image in (image0, image1))
    white = np.float32(max(1.0, colours0.largest, colours1.largest))
    if white > 1:
        small0, small1 = small0 / white, small1 / white
    illumination = _match_mean_and_deviation(colours0, colours1, white)
    if np.abs(illumination.apply(small0, 1, small0.dtype) - small0).mean() < MIN_CHANGE:
        return None
    exact = _fit_along_motion(small0, small1, _search(small0, illumination.undo(small1)))
    in_lights, illumination = max(
        ((_measure_similarity(small0, small1, each), each) for each in (illumination, exact)),
        key=lambda candidate: sum(candidate[0]),
    )
    before = _search(small0, small1).similarity.mean()
    believed = min(in_lights) > max(MIN_SCORE, before - MIN_SCORE_GAIN) and sum(in_lights) / 2 > before + MIN_SCORE_GAIN
    return IlluminationModel(illumination.gain, illumination.offset * white) if believed else None


def compensate_either(
    image0: FrameCache, image1: FrameCache, illumination: IlluminationModel
) -> tuple[tuple[FrameCache, FrameCache], ...]:
    """Return small copies of two frames, under the illumination of frame 0 and under that of frame 1."""
    small0, small1 = (image.cached(small_copy, SMALL_COPY_SIDE) for image in (image0, image1))
    in_light0, in_light1 = (small0, illumination.undo(small1)), (illumination.apply(small0, 1, small0.dtype), small1)
    return tuple((image0.with_image(first), image1.with_image(second)) for first, second in (in_light0, in_light1))


def _measure_similarity(small0: Image, small1: Image, illumination: IlluminationModel) -> tuple[float, float]:
    """Return the frames' mean similarity under the illumination of each: dark frames look alike, bright ones do not."""
    if not 1 / MAX_GAIN < illumination.gain.min() <= illumination.gain.max() < MAX_GAIN:
        return 0.0, 0.0
    in_light0 = _search(small0, illumination.undo(small1))
    in_light1 = _search(illumination.apply(small0, 1, small0.dtype), small1)
    return float(in_light0.similarity.mean()), float(in_light1.similarity.mean())


def _search(small0: Image, small1: Image) -> MotionField:
    components = contrast_components(small0), contrast_components(small1)
    field01, _ = search_fused(*components, math.ceil(SMALL_COPY_SIDE / 6), 2, "box", 0.09)
    return field01


def _measure_colours(image: FrameCache) -> _Colours:
    """Measure the colours of an image's small copy."""
    small = image.cached(small_copy, SMALL_COPY_SIDE)
    mean, deviation = (each.ravel().astype(np.float32) for each in cv2.meanStdDev(small))
    return _Colours(mean, deviation, float(small.max()))


def _match_mean_and_deviation(colours0: _Colours, colours1: _Colours, white: np.float32) -> IlluminationModel:
    """Return the model that gives both frames the same mean and standard deviation."""
    (mean0, deviation0), (mean1, deviation1) = (
        (colours.mean / white, colours.deviation / white) for colours in (colours0, colours1)
    )
    gain = ((deviation1 + 1e-3) / (deviation0 + 1e-3)).clip(1 / MAX_GAIN, MAX_GAIN)
    return IlluminationModel(gain.astype(np.float32), (mean1 - gain * mean0).astype(np.float32))


def _fit_along_motion(small0: Image, small1: Image, field01: MotionField) -> IlluminationModel:
    """Fit the model by least squares over pixels and their matches, weighted by similarity."""
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
