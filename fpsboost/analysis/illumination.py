"""Illumination compensation: fades, flashes and exposure changes are removed before motion is estimated.

The report's similarity compares colours, so that under a flash every patch matches a wrong one best, and the picture
tears. A gain and an offset for each colour model a fade, a flash or a change of exposure; a smooth map of gains models
what lights up or darkens a part of the picture. Either is used only where it makes the frames more similar.

Models are estimated on thumbnails, where motion is found by exhaustive search; the frames themselves are read only when
a change is undone (`IlluminationModel.undo`) and applied again to the interpolated frame (`IlluminationModel.apply`).
"""

import math
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import cv2
import numpy as np

from fpsboost.colour import has_alpha, normalised
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.motion.components import Components, contrast_components, small_components, small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import search_fused

SMALL_COPY_SIDE = 40
"""Longer side of the small copies that are compared, pixels."""

PATCH_RADIUS = 2  # pixels of these copies
BANDWIDTH = 0.09
"""Bandwidth of their similarity, that of the method."""

MIN_CHANGE = 0.01
"""Mean change of colour below which the illumination counts as constant; 1 is white."""

MIN_SCORE_GAIN = 0.015
"""Minimum increase of the mean similarity of two frames at which an illumination model is accepted."""

MIN_SCORE = 0.6
"""Minimum mean similarity, under equal illumination, of two frames of one scene."""

MAX_GAIN = 8.0
"""Maximum gain; the minimum is its inverse. Gains beyond these would amplify noise into patterns."""

LOCAL_SIDES = SMALL_COPY_SIDE, 2 * SMALL_COPY_SIDE
"""Longer sides of the copies on which a local change of light is looked for and then, if it is likely, measured;
pixels."""

LOCAL_SEARCH_RANGE = 1 / 12
"""Search range on these copies, as a fraction of the longer side."""

LOCAL_MOTION_PENALTY = 0.8
"""Reduction of the similarity by motion as long as the longer side: what light has burnt out is found where it was."""

LOCAL_MIN_GAIN = 0.1
"""Minimum increase of the similarity around a pixel at which a local change of light is accepted."""

LOCAL_MIN_SHARE = 2 / 3
"""Minimum share of the dissimilarity around a pixel that the change explains: a cause explains most of it, and a mere
degree of freedom less."""

LOCAL_MIN_AT_REST = 0.8
"""Minimum similarity, without light, of a place that has become brighter or darker to the same place before. Every
spot of light in `benchmarks/light_spots.py` has such places; half of the pairs of filmed clips have none, and need no
search."""

LOCAL_PROMISING_SHARE = 0.25
"""Share of the required increase that motion without light must reach for its light to be examined further."""

LOCAL_MIN_CHANGE = math.log(1.15)
"""Minimum logarithm of the gain around a pixel, either way: smaller changes do not prevent patches from matching."""

LOCAL_MIN_DETAIL = 0.1
"""Minimum detail of the frame that has less, as a share of that of the other: under light, a surface keeps its
detail."""

LOCAL_CONSISTENCY_TOLERANCE = 1.5
"""Limit of the forward-backward error of motion that confirms a change of light, pixels of the copies."""

LOCAL_MIN_SCORE = 0.7
"""Minimum mean similarity under equal light: gains that differ from place to place make unrelated scenes look alike."""

DARK = 0.02
"""Brightness below which the ratio of two colours is unreliable; 1 is white."""


@dataclass(frozen=True)
class IlluminationModel:
    """Change of colours in [0, 1] from frame 0 to frame 1: ``gain * colour + offset``.

    Parameters
    ----------
    gain, offset : (C,) or (h, w, C) float32
        Values of each colour, or maps of them for copies of the frames if the change is not the same everywhere.

    Examples
    --------
    >>> fade = IlluminationModel(np.full(3, 0.5, np.float32), np.zeros(3, np.float32))
    >>> float(fade.apply(np.full((1, 1, 3), 0.8, np.float32), 0.5, np.dtype(np.float32))[0, 0, 0])  # half of the fade
    0.6000000238418579
    """

    gain: np.ndarray
    offset: np.ndarray

    @property
    def is_local(self) -> bool:
        """Whether the change differs from place to place."""
        return self.gain.ndim > 1

    def undo(self, image1: Image) -> Image:
        """Return frame 1 under the illumination of frame 0, (H, W, C) float32."""
        return np.asarray((normalised(image1) - _at_pixels(self.offset, image1)) / _at_pixels(self.gain, image1))

    def apply(self, image: Image, t: float, dtype: np.dtype[Any]) -> Image:
        """Return a float32 image under the illumination of frame 0 as it appears at time t.

        The result has the frames' `dtype`, rounded and clipped if that is an integer type.
        """
        gain, offset = (_at_pixels(values, image) for values in (self.gain, self.offset))
        lit = image * (1 + (gain - 1) * np.float32(t)) + offset * np.float32(t)
        return lit if dtype == np.float32 else np.asarray(np.rint(lit.clip(0, 1) * np.iinfo(dtype).max).astype(dtype))


Estimate = tuple[float, IlluminationModel]
"""Mean similarity of the small copies under the illumination of either frame, and the model."""

UNCHANGED = IlluminationModel(np.ones(1, np.float32), np.zeros(1, np.float32))
"""Model of constant illumination."""


def _at_pixels(values: np.ndarray, image: Image) -> np.ndarray:
    """Return values of a model for the pixels of an image, enlarged if they are a map."""
    if values.ndim == 1:
        return values
    height, width, channels = image.shape
    return cv2.resize(values, (width, height), interpolation=cv2.INTER_CUBIC).reshape(height, width, channels)


def estimate_illumination(image0: FrameCache, image1: FrameCache) -> IlluminationModel | None:
    """Estimate the illumination change between two frames; None if there is none, or if the images have alpha.

    Of a change of the whole picture and one of a part of it, the first is preferred unless the second makes the frames
    clearly more similar, by `MIN_SCORE_GAIN`.
    """
    if has_alpha(image0.pixels):
        return None
    everywhere = _estimate_everywhere(image0, image1)
    lights = [UNCHANGED] if everywhere is None else [UNCHANGED, everywhere[1]]
    in_part = [_estimate_in_part(image0, image1, light) for light in lights]
    score, model = max((each for each in in_part if each is not None), key=itemgetter(0), default=(0, None))
    # of two explanations that are about as good, the simpler one
    return everywhere[1] if everywhere is not None and score < everywhere[0] + MIN_SCORE_GAIN else model


def _estimate_in_part(image0: FrameCache, image1: FrameCache, everywhere: IlluminationModel) -> Estimate | None:
    """Estimate the change of light that only part of the picture has, on top of `everywhere`; None without one."""
    if max(image0.pixels.shape[:2]) < LOCAL_SIDES[-1]:  # a texture of so few pixels is as smooth as light
        return None
    for side in LOCAL_SIDES:
        other = (
            image1 if everywhere is UNCHANGED else image1.with_image(everywhere.undo(image1.cached(small_copy, side)))
        )
        gain = _find_local_gain(image0, other, side)
        if gain is None:
            return None
    model = IlluminationModel(gain * everywhere.gain, gain * everywhere.offset)
    small0, small1 = _small_copies(image0, image1)
    in_lights = _measure_similarity(small0, small1, model)
    return (sum(in_lights) / 2, model) if min(in_lights) > LOCAL_MIN_SCORE else None


def _small_copies(*images: FrameCache) -> list[Image]:
    """Return small copies of frames."""
    return [image.cached(small_copy, SMALL_COPY_SIDE) for image in images]


def _estimate_everywhere(image0: FrameCache, image1: FrameCache) -> Estimate | None:
    """Estimate the change of light that the whole picture shares; None if there is none."""
    small0, small1 = _small_copies(image0, image1)
    white = np.float32(max(1.0, float(small0.max()), float(small1.max())))
    illumination = _match_mean_and_deviation(small0, small1, white)
    small0 = small0 / white
    small1 = small1 / white
    if np.abs(illumination.apply(small0, 1, small0.dtype) - small0).mean() < MIN_CHANGE:
        return None
    exact = _fit_along_motion(small0, small1, _search(small0, illumination.undo(small1)))
    in_lights, illumination = max(
        ((_measure_similarity(small0, small1, each), each) for each in (illumination, exact)),
        key=lambda candidate: sum(candidate[0]),
    )
    before = _search(small0, small1).similarity.mean()
    score = sum(in_lights) / 2
    believed = min(in_lights) > max(MIN_SCORE, before - MIN_SCORE_GAIN) and score > before + MIN_SCORE_GAIN
    return (score, IlluminationModel(illumination.gain, illumination.offset * white)) if believed else None


def compensate_either(
    image0: FrameCache, image1: FrameCache, illumination: IlluminationModel
) -> tuple[tuple[FrameCache, FrameCache], ...]:
    """Return small copies of two frames, under the illumination of frame 0 and under that of frame 1."""
    small0, small1 = _small_copies(image0, image1)
    in_light0 = (small0, illumination.undo(small1))
    in_light1 = (illumination.apply(small0, 1, small0.dtype), small1)
    return tuple((image0.with_image(first), image1.with_image(second)) for first, second in (in_light0, in_light1))


def _measure_similarity(small0: Image, small1: Image, illumination: IlluminationModel) -> tuple[float, float]:
    """Return the frames' mean similarity under the illumination of each.

    Both are needed: dark frames look alike, and bright ones do not.
    """
    if not 1 / MAX_GAIN < illumination.gain.min() <= illumination.gain.max() < MAX_GAIN:
        return 0.0, 0.0
    in_light0 = _search(small0, illumination.undo(small1))
    in_light1 = _search(illumination.apply(small0, 1, small0.dtype), small1)
    return float(in_light0.similarity.mean()), float(in_light1.similarity.mean())


def _find_local_gain(image0: FrameCache, image1: FrameCache, side: int) -> np.ndarray | None:
    """Return the gain at each pixel of frame 1 where light changes in a part of the picture, else 1.

    Motion is found on small copies without light first, then under the light that follows from it. A change of light is
    accepted around pixels where it explains most of the difference, and as far as the frames are more similar by it.
    Returns (h, w, C) float32, or None if there is no such part.
    """
    reach = side / SMALL_COPY_SIDE
    brightness0, brightness1 = (image.derived(_brightness, side, reach) for image in (image0, image1))
    is_changed = np.abs(np.log(brightness1 / brightness0)) > LOCAL_MIN_CHANGE
    even0, even1 = (image.derived(_components_without_light, side) for image in (image0, image1))
    # of patches that stay where they are, as a search would find it
    similarity = cv2.exp(np.square(even1 - even0).sum(axis=2) * np.float32(-0.5 / BANDWIDTH**2))
    at_rest = cv2.blur(similarity, (2 * PATCH_RADIUS + 1,) * 2)
    if not (is_changed & (at_rest > LOCAL_MIN_AT_REST)).any():
        return None
    small0, small1 = (image.cached(small_copy, side) for image in (image0, image1))
    components0, components1 = (image.derived(small_components, side) for image in (image0, image1))
    before = _smoothed(_search_near(components0, components1)[1].similarity, reach)
    least = np.maximum(LOCAL_MIN_SHARE * (1 - before), LOCAL_MIN_GAIN)

    def explains(gain: np.ndarray, similarity: np.ndarray, share: float = 1) -> np.ndarray:
        gained = _smoothed(similarity, reach) - before
        change = _smoothed(np.abs(np.log(gain)).max(axis=2), reach)
        return np.asarray((gained > share * least) & (change > LOCAL_MIN_CHANGE) & is_changed)

    fields = _search_near(even0, even1)
    gain = _fit_locally(small0, small1, fields)
    if not explains(gain, fields[1].similarity, LOCAL_PROMISING_SHARE).any():
        return None
    fields = _search_near(components0, contrast_components(small1 / gain))
    if not explains(gain, _confirmed(*fields)).any():
        return None
    gain = _fit_locally(small0, small1, fields)
    either = (
        _search_near(components0, contrast_components(small1 / gain)),
        _search_near(contrast_components(small0 * gain), components1),
    )
    is_explained = explains(gain, np.minimum.reduce([_confirmed(*fields) for fields in either]))
    if not is_explained.any():
        return None
    similarity = np.minimum.reduce([field10.similarity for _, field10 in either])
    more_similar = is_explained | (_smoothed(similarity, reach) > before + LOCAL_MIN_GAIN)
    _, regions = cv2.connectedComponents(more_similar.astype(np.uint8))
    accepted = np.isin(regions, np.unique(regions[is_explained])).astype(np.float32)
    detail = [image.derived(_without_light, side).mean(axis=2)[accepted > 0].var() for image in (image0, image1)]
    if min(detail) < LOCAL_MIN_DETAIL * max(detail):  # it turned white or black, which light alone does not do
        return None
    share = _smoothed(cv2.dilate(accepted, np.ones((5, 5), np.uint8)), reach)
    return np.asarray(gain ** share[..., np.newaxis])


def _search_near(components0: Components, components1: Components) -> tuple[MotionField, MotionField]:
    """Search small copies for motion up to `LOCAL_SEARCH_RANGE`, in both directions."""
    side = max(components0.shape[:2])
    radius = math.ceil(LOCAL_SEARCH_RANGE * side)
    penalty = LOCAL_MOTION_PENALTY / side
    return search_fused(components0, components1, radius, PATCH_RADIUS, "box", BANDWIDTH, penalty)


def _components_without_light(image: FrameCache, side: int) -> Components:
    return contrast_components(image.derived(_without_light, side))


def _without_light(image: FrameCache, side: int) -> Image:
    """Return a small copy in which all surroundings of a pixel are equally bright."""
    brightness = image.derived(_brightness, side, side / 60)
    return image.cached(small_copy, side) * (np.float32(0.5) / brightness)[..., np.newaxis]


def _brightness(image: FrameCache, side: int, deviation: float) -> np.ndarray:
    """Return the brightness around each pixel of a small copy, (h, w), above zero even where colours are negative."""
    mean = np.mean(cv2.split(image.cached(small_copy, side)), axis=0)
    return np.asarray(np.maximum(_smoothed(mean, deviation), 0) + np.float32(DARK))


def _smoothed(values: np.ndarray, deviation: float) -> np.ndarray:
    """Return values smoothed by a Gaussian, in the same shape."""
    smooth = cv2.GaussianBlur(values, (0, 0), deviation, borderType=cv2.BORDER_REPLICATE)
    return smooth.reshape(values.shape)


def _ends(field: MotionField) -> tuple[np.ndarray, np.ndarray]:
    """Return the row and the column at the end of each whole-pixel vector, which the search keeps inside."""
    moved = field.flow.astype(int)
    rows, columns = np.indices(field.similarity.shape)
    return rows + moved[..., 1], columns + moved[..., 0]


def _returns(there: MotionField, back: MotionField) -> np.ndarray:
    """Return whether the way there and back ends where it began, within a tolerance, (h, w) bool."""
    errors = np.square(there.flow + back.flow[_ends(there)]).sum(axis=2)
    return np.asarray(errors < LOCAL_CONSISTENCY_TOLERANCE**2)


def _confirmed(field01: MotionField, field10: MotionField) -> np.ndarray:
    """Return the similarity of frame 1's pixels to their matches in frame 0 if the motion there leads back, else 0."""
    return np.asarray(field10.similarity * _returns(field10, field01))


def _fit_locally(small0: Image, small1: Image, fields: tuple[MotionField, MotionField]) -> np.ndarray:
    """Fit a gain around each pixel of frame 1 by least squares over pixels and their matches in frame 0."""
    field01, field10 = fields
    matched = small0[_ends(field10)]
    returns = _returns(field10, field01)
    weight = (field10.similarity.clip(0, 1) * np.where(returns, np.float32(1), np.float32(0.05)))[..., np.newaxis]
    deviation = max(small0.shape[:2]) / 80
    products, squares = (_smoothed(weight * matched * other, deviation) for other in (small1, matched))
    return ((products + 1e-3) / (squares + 1e-3)).clip(1 / MAX_GAIN, MAX_GAIN).astype(np.float32)


def _search(small0: Image, small1: Image) -> MotionField:
    """Search small copies for motion from frame 0 to frame 1."""
    components = contrast_components(small0), contrast_components(small1)
    field01, _ = search_fused(*components, math.ceil(SMALL_COPY_SIDE / 6), PATCH_RADIUS, "box", BANDWIDTH)
    return field01


def _match_mean_and_deviation(small0: Image, small1: Image, white: np.float32) -> IlluminationModel:
    """Return the model that gives both frames, divided by `white`, the same mean and standard deviation."""
    (mean0, deviation0), (mean1, deviation1) = (
        [each.ravel().astype(np.float32) / white for each in cv2.meanStdDev(small)] for small in (small0, small1)
    )
    return _model_between(mean0, mean1, (deviation1 + 1e-3) / (deviation0 + 1e-3))


def _fit_along_motion(small0: Image, small1: Image, field01: MotionField) -> IlluminationModel:
    """Fit the model by least squares over pixels and their matches, weighted by similarity."""
    weight = field01.similarity.reshape(-1, 1) + np.float32(1e-6)
    weight /= weight.sum()
    colours0, colours1 = (small.reshape(-1, small.shape[2]) for small in (small0, small1[_ends(field01)]))
    mean0, mean1 = ((weight * colours).sum(axis=0) for colours in (colours0, colours1))
    covariance = (weight * (colours0 - mean0) * (colours1 - mean1)).sum(axis=0)
    variance = (weight * (colours0 - mean0) ** 2).sum(axis=0)
    return _model_between(mean0, mean1, covariance / (variance + 1e-6))


def _model_between(mean0: np.ndarray, mean1: np.ndarray, gain: np.ndarray) -> IlluminationModel:
    """Return the model that leads from one mean to another by a gain within limits."""
    gain = gain.clip(1 / MAX_GAIN, MAX_GAIN)
    return IlluminationModel(gain.astype(np.float32), (mean1 - gain * mean0).astype(np.float32))
