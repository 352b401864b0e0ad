"""Calibration of a guide: how a picture of the frames would look as one, and how far guides usually are from that.

The guides of the two frames show it, as the frames themselves are known. Without these, the frame that is made without
a guide takes the place of the frames, and what cannot be told so is taken to be as usual: no offset, the same shading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from fpsboost.synthesis.agreement import sample
from fpsboost.synthesis.guide_colours import Colours

Size = tuple[int, int]
"""Width and height."""

SMALL = 1.5
"""Ratio of the widths of frames and guides from which on guides count as small."""

BLURS = (0.0, 0.2, 0.4, 0.6)
"""Pixel filters of renderers that are tried, beyond a box: standard deviations in pixels of the guide."""

BETTER = 0.8
"""Share of the difference that must be left for a pixel filter, or scaling in light, to be found."""

TONE_BINS = 24
MAX_TONE = 64  # largest change of a level by the curve of a tone, on the scale of `WHITE`

NOISY = 3.0
"""Standard deviation of noise, levels, from which on a guide counts as noisy."""

OTHER_SHADING = 0.13
"""Share of the contrast of the guides of the frames that the frames do not explain from which on their light or shading
is another one."""


@dataclass(frozen=True)
class Rendition:
    """How a picture of the frames' size is shown by a guide.

    Parameters
    ----------
    colours : Colours
    white : float32
        White of the frames.
    full, size : (width, height)
        Sizes of the frames and of the guide.
    in_light : bool
        Whether pixels of the guide are means of light, as a renderer's are, and not of code values, as a scaler's are.
    blur : float
        Blur beyond that of the area of a pixel, standard deviation in pixels of the guide.
    offset : (float, float)
        Place (x, y) in the frames of what the guide shows at 0, in pixels of the frames.
    tone : tuple of three (n,) float32, or None
        What is added to levels from -MAX_TONE to WHITE + MAX_TONE, for each colour.
    """

    colours: Colours
    white: np.float32
    full: Size
    size: Size
    in_light: bool = False
    blur: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    tone: tuple[np.ndarray, ...] | None = None

    @property
    def factor(self) -> float:
        """Width of the frames as a multiple of that of the guide."""
        return self.full[0] / self.size[0]

    @property
    def is_small(self) -> bool:
        """Whether pixels of the guide show several of the frames."""
        return self.factor >= SMALL

    def shown(self, values: np.ndarray) -> np.ndarray:
        """Return the levels that a guide has of a picture, (h, w, 3) float32."""
        if not self.in_light or not self.is_small:
            scaled = self._scaled(values)
            levels = self.colours.levels(scaled, self.white)
        else:
            light = self.colours.light(self.colours.levels(values, self.white))
            levels = self.colours.of_light(np.maximum(self._scaled(light), 0))
        return levels if self.tone is None else with_tone(levels, self.tone)

    def _scaled(self, values: np.ndarray) -> np.ndarray:
        if self.blur:
            values = cv2.GaussianBlur(values, (0, 0), self.blur * self.factor)
        if self.offset != (0, 0):
            values = displaced(values, self.offset)
        return resized(values, self.size, cv2.INTER_AREA).reshape(*self.size[::-1], -1)

    def raised(self, values: np.ndarray, interpolation: int = cv2.INTER_LINEAR) -> np.ndarray:
        """Return values at the pixels of a guide for the pixels of the frames."""
        full = resized(values, self.full, interpolation)
        x, y = self.offset
        return full if self.offset == (0, 0) else displaced(full, (-x, -y))

    def motion(self, flow: np.ndarray) -> np.ndarray:
        """Return the motion (dx, dy) from the places of a guide of any size for the pixels of the frames, in these."""
        height, width = flow.shape[:2]
        scale = np.array([self.full[0] / width, self.full[1] / height], np.float32)
        return self.raised(flow * scale)


@dataclass(frozen=True)
class Calibration:
    """What is known of the guides of a pair."""

    rendition: Rendition
    noise: float
    """Standard deviation of their noise, levels."""
    is_other: bool
    """Whether their light or shading is another one, so that only guides are comparable with guides."""
    usual: tuple[np.ndarray, np.ndarray] | None
    """Difference of the guides of both frames, one below the other, from what they show, and that; None without
    these."""

    @property
    def is_noisy(self) -> bool:
        """Whether there is more noise than of the rounding to levels."""
        return self.noise >= NOISY


def calibrate(
    rendition: Rendition,
    guide: np.ndarray,
    key_guides: Sequence[np.ndarray],
    keys: Sequence[np.ndarray],
    made: np.ndarray,
) -> Calibration:
    """Find out how guides show pictures.

    Parameters
    ----------
    rendition : Rendition
        Sizes and colours.
    guide : (h, w, 3) float32
        Levels of the guide.
    key_guides : two of the same, or none
    keys : two (H, W, C)
        Values of the frames; see `Colours.values`.
    made : (H, W, C)
        Those of the frame that is made without a guide.
    """
    if key_guides:
        rendition = _with_offset(rendition, key_guides, keys)
        pictures = list(keys)
        known = np.vstack(key_guides)
    else:
        pictures = [made]
        known = guide
    if rendition.is_small:
        rendition = _with_pixel_filter(rendition, pictures, known)
    shown = _shown(rendition, pictures)
    if key_guides or not rendition.is_small:
        rendition = replace(rendition, tone=fit_tone(shown, known))
        shown = _shown(rendition, pictures)
    noise = estimate_noise(known - shown)
    is_other = bool(key_guides) and _unexplained(known, shown, noise) > OTHER_SHADING
    return Calibration(rendition, noise, is_other, (known - shown, shown) if key_guides else None)


def _shown(rendition: Rendition, pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return what guides show of pictures, one below the other."""
    return np.vstack([rendition.shown(each) for each in pictures])


def _with_offset(rendition: Rendition, key_guides: Sequence[np.ndarray], keys: Sequence[np.ndarray]) -> Rendition:
    """Return the rendition with the offset of the guides, if there is one that brings both closer to the frames."""
    width, height = rendition.size
    inner = np.zeros((height, width), np.uint8)
    inner[MARGIN:-MARGIN, MARGIN:-MARGIN] = 1
    known = _stacked_gray(key_guides)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-5)
    moved = rendition
    for _ in range(OFFSET_ROUNDS):
        shown = _stacked_gray([moved.shown(key) for key in keys])
        shift = np.eye(2, 3, dtype=np.float32)
        try:
            cv2.findTransformECC(shown, known, shift, cv2.MOTION_TRANSLATION, stop, np.vstack([inner, inner]), 3)
        except cv2.error:  # nothing to see
            return rendition
        # the guide shows at x + shift what the frames do at x
        x, y = moved.offset
        scale = rendition.factor
        moved = replace(moved, offset=(x - float(shift[0, 2]) * scale, y - float(shift[1, 2]) * scale))
    if max(map(abs, moved.offset)) < LEAST_OFFSET:
        return rendition
    closer = all(
        np.std(moved.shown(key) - guide) < CLOSER * np.std(rendition.shown(key) - guide)
        for key, guide in zip(keys, key_guides, strict=True)
    )
    return moved if closer else rendition


OFFSET_ROUNDS = 3
"""Rounds in which the offset is corrected."""

MARGIN = 4
"""Width of the edge of guides that is not compared, pixels."""

LEAST_OFFSET = 0.1
"""Smallest offset that is corrected, pixels of the frames."""

CLOSER = 0.95
"""Share of the difference that must be left of both guides for an offset to be found."""


def _stacked_gray(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return the gray of levels, one below the other."""
    return np.vstack([cv2.cvtColor(each, cv2.COLOR_BGR2GRAY) for each in pictures])


def _with_pixel_filter(rendition: Rendition, pictures: Sequence[np.ndarray], known: np.ndarray) -> Rendition:
    """Return the rendition with the filter, and the scale of averages, that brings most of the pictures closest."""
    contrast = np.abs(known - cv2.blur(known, (3, 3))).max(axis=2)
    edges = contrast > np.quantile(contrast, 0.7)

    def apart(way: Rendition) -> float:
        # the lower part: what moved otherwise is not to count
        return float(np.quantile(np.abs(_shown(way, pictures) - known)[edges], 0.4))

    ways = [replace(rendition, in_light=light, blur=blur) for light in (False, True) for blur in BLURS]
    found = min(ways, key=apart)
    return found if apart(found) < BETTER * apart(rendition) else rendition


def fit_tone(shown: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the curve of each colour from what is shown to the tone of guides; see `Rendition`.

    Other light has one, and so has noise that is clipped: it is darker near white, and brighter near black.
    """
    centres = (np.arange(TONE_BINS) + 0.5) * (256 / TONE_BINS)
    curves = []
    for channel in range(3):
        levels = shown[..., channel].ravel()
        difference = (known[..., channel].ravel() - levels).clip(-MAX_TONE, MAX_TONE)
        index = np.clip(levels * (TONE_BINS / 256), 0, TONE_BINS - 1).astype(np.intp)
        count = np.bincount(index, minlength=TONE_BINS)
        shift = np.bincount(index, difference, TONE_BINS) / (count + 0.002 * levels.size)
        curves.append(np.interp(np.arange(-MAX_TONE, 256 + MAX_TONE), centres, shift).astype(np.float32))
    return tuple(curves)


def with_tone(levels: np.ndarray, tone: Sequence[np.ndarray]) -> np.ndarray:
    """Return levels in another tone."""
    index = np.clip(np.rint(levels) + MAX_TONE, 0, len(tone[0]) - 1).astype(np.intp)
    return np.asarray(levels + np.stack([curve[index[..., k]] for k, curve in enumerate(tone)], axis=2))


def estimate_noise(difference: np.ndarray) -> float:
    """Return the standard deviation of fine differences, levels; at least 1."""
    fine = np.abs(difference - cv2.blur(difference, (3, 3)))
    # the lower quartile does not see what moved otherwise; 3 x 3 pixels have 8/9 of the variance
    return max(float(np.quantile(fine, 0.25)) / 0.3186 * 1.06, 1.0)


def _unexplained(known: np.ndarray, shown: np.ndarray, noise: float) -> float:
    """Return the share of the coarse contrast of guides that what they show does not explain."""
    smooth = cv2.blur(known, (5, 5))
    apart = np.mean((smooth - cv2.blur(shown, (5, 5))) ** 2) - noise**2 / 25
    contrast = np.mean((smooth - cv2.blur(known, (31, 31))) ** 2)
    return float(max(apart, 0) / max(contrast, 1))


def resized(values: np.ndarray, size: Size, interpolation: int) -> np.ndarray:
    """Return values at another size; they themselves if it is theirs."""
    return values if values.shape[1::-1] == size else cv2.resize(values, size, interpolation=interpolation)


def displaced(values: np.ndarray, offset: tuple[float, float]) -> np.ndarray:
    """Return the values that lie at an offset (x, y) from each pixel; edges are repeated."""
    return sample(values, np.broadcast_to(np.array(offset, np.float32), (*values.shape[:2], 2)), cv2.INTER_CUBIC)
