"""Calibration of guides: how they show pictures of the frames.

A guide shows the means of the areas of its pixels, of light or of code values, through a linear filter and a curve of
tone. All are fitted to the guides of the two frames, as the frames themselves are known: so a renderer's pixel filter,
a scaler's sharpening and a codec's blur are found by one system of equations. Without guides of the frames, the frame
that is made without a guide takes the place of the frames, and what cannot be told so is taken to be as usual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fpsboost.synthesis.agreement import sample
from fpsboost.synthesis.guide_colours import WHITE, Colours

Size = tuple[int, int]
"""Width and height."""

SMALL = 1.5
"""Ratio of the widths of frames and guides from which on guides count as small."""

RADIUS = 2
"""Radius of the filter, pixels of the guide."""

SIDE = 2 * RADIUS + 1

IDENTITY = np.eye(1, SIDE**2 + 1, SIDE**2 // 2, np.float32)[0]

SAMPLES = 30000
"""Number of values to which a filter is fitted at most, nearly."""

PRIOR = 0.05
"""Usual size of the weights of a filter but for that in the middle."""

TONE_BLUR = 4.0
"""Standard deviation of the blur of the curve of a tone, levels."""

RARE = 0.0002
"""Share of pixels of one level of which half of the tone is believed."""

OFFSET_ROUNDS = 3
"""Rounds in which the offset is corrected."""

LEAST_OFFSET = 0.1
"""Smallest offset that is corrected, pixels of the frames."""


@dataclass(frozen=True)
class Rendition:
    """How a picture of the frames' size is shown by a guide.

    Parameters
    ----------
    colours : Colours
    full, size : (width, height)
        Sizes of the frames and of the guide.
    in_light : bool
        Whether pixels of the guide are means of light, as a renderer's are, and not of code values, as a scaler's are.
    offset : (float, float)
        Place (x, y) in the frames of what the guide shows at 0, in pixels of the frames.
    weights : (SIDE**2 + 1,) float32
        The filter: weights of the means around each pixel, and what is added, in units of `WHITE`.
    tone : (1, 256, 3) float32, or None
        What is added to each level.
    """

    colours: Colours
    full: Size
    size: Size
    in_light: bool = False
    offset: tuple[float, float] = (0.0, 0.0)
    weights: np.ndarray = field(default_factory=lambda: IDENTITY)
    tone: np.ndarray | None = None

    @property
    def factor(self) -> float:
        """Width of the frames as a multiple of that of the guide."""
        return self.full[0] / self.size[0]

    @property
    def is_small(self) -> bool:
        """Whether pixels of the guide show several of the frames."""
        return self.factor >= SMALL

    def averaged(self, values: np.ndarray) -> np.ndarray:
        """Return the means of the areas of the guide's pixels, (h, w, 3) float32: of light, or of levels."""
        levels = self.colours.levels(values)
        pixels = self.colours.light(levels) if self.in_light else levels
        return resized(displaced(pixels, self.offset), self.size, cv2.INTER_AREA)

    def shown(self, values: np.ndarray) -> np.ndarray:
        """Return the levels that a guide has of a picture, (h, w, 3) float32."""
        kernel = self.weights[:-1].reshape(SIDE, SIDE)
        shown = cv2.filter2D(self.averaged(values), -1, kernel) + self.weights[-1] * WHITE
        levels = self.colours.of_light(np.maximum(shown, 0)) if self.in_light else shown
        return levels if self.tone is None else levels + cv2.LUT(as_bytes(levels), self.tone)

    def raised(self, values: np.ndarray, interpolation: int = cv2.INTER_LINEAR) -> np.ndarray:
        """Return values at the pixels of a guide for the pixels of the frames."""
        x, y = self.offset
        return displaced(resized(values, self.full, interpolation), (-x, -y))

    def equalised(self, guide: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return a guide whose levels are as frequent as in its picture, wherever things are in the two."""
        for _ in range(3):  # since a tone is smooth, and uncertain
            ranked = [np.sort(each.reshape(-1, 1, 3), axis=0) for each in (guide, self.shown(values))]
            guide = guide + cv2.LUT(as_bytes(guide), fit_tone(*ranked))
        return guide

    def fitted(self, pictures: Sequence[np.ndarray], guides: Sequence[np.ndarray]) -> Rendition:
        """Return the rendition with the filter that brings pictures closest to their guides.

        The least squares are weighted, so that what moved otherwise does not count (Geman and McClure 1987).
        """
        step = max(1, round((2 * guides[0].size / SAMPLES) ** 0.5))
        windows = [sliding_window_view(self.averaged(each), (SIDE, SIDE), (0, 1)) for each in pictures]
        means = np.vstack([each[::step, ::step].reshape(-1, SIDE**2) for each in windows])
        means = np.hstack([means, np.full((len(means), 1), WHITE)])
        inner = np.s_[RADIUS:-RADIUS:step, RADIUS:-RADIUS:step]
        known = np.hstack([each[inner].ravel() for each in guides])
        difference = (self.colours.light(known) if self.in_light else known) - means @ IDENTITY
        usual = np.median(np.abs(difference))
        weighted = means / (1 + (difference / (2 * usual + 1)) ** 2)[:, np.newaxis]
        squares = weighted.T @ means + ((usual / PRIOR) ** 2 + 1) * np.eye(len(IDENTITY))
        change = np.linalg.solve(squares, weighted.T @ difference)
        return replace(self, weights=(IDENTITY + change).astype(np.float32))


@dataclass(frozen=True)
class Calibration:
    """What is known of guides."""

    rendition: Rendition
    noise: float
    """Standard deviation of their noise, levels."""
    usual: tuple[np.ndarray, np.ndarray]
    """Difference of the guides by which they were calibrated, one below the other, from what they show, and that."""


def calibrate(
    rendition: Rendition,
    pictures: Sequence[np.ndarray],
    guides: Sequence[np.ndarray],
    *,
    are_frames: bool,
    with_tone: bool = True,
) -> Calibration:
    """Find out how guides show pictures.

    Parameters
    ----------
    rendition : Rendition
        Sizes and colours.
    pictures : sequence of (H, W, C)
        Values of the two frames, or of the frame that is made without a guide; see `Colours.values`.
    guides : sequence of (h, w, 3) float32
        Levels of their guides.
    are_frames : bool
        Whether the pictures are the frames, so that all differences from their guides are those of guides.
    with_tone : bool
        Whether guides may have a tone of their own.
    """
    known = np.vstack(guides)
    contrast = squared(known - cv2.blur(known, (3, 3)))
    edges = contrast > np.quantile(contrast[::2, ::2], 0.9)

    def shown(way: Rendition) -> np.ndarray:
        return np.vstack([way.shown(each) for each in pictures])

    def apart(way: Rendition) -> float:
        # the lower part: what moved otherwise is not to count
        return float(np.quantile(squared(shown(way) - known)[edges], 0.4))

    if are_frames:
        rendition = min(rendition, _with_offset(rendition, shown, known), key=apart)
    ways = [rendition, replace(rendition, in_light=True)][: 1 + rendition.is_small]
    if are_frames:
        ways = [way.fitted(pictures, guides) for way in ways]
    rendition = min(ways, key=apart)
    if with_tone and (are_frames or not rendition.is_small):
        rendition = replace(rendition, tone=fit_tone(shown(rendition), known))
    expected = shown(rendition)
    difference = known - expected
    return Calibration(rendition, estimate_noise(difference), (difference, expected))


def _with_offset(rendition: Rendition, shown: Callable[[Rendition], np.ndarray], known: np.ndarray) -> Rendition:
    """Return the rendition with the offset of guides (Evangelidis and Psarakis 2008)."""
    for _ in range(OFFSET_ROUNDS):
        shift = np.eye(2, 3, dtype=np.float32)
        gray, gray_known = (cv2.cvtColor(each, cv2.COLOR_BGR2GRAY) for each in (shown(rendition), known))
        try:
            cv2.findTransformECC(gray, gray_known, shift, cv2.MOTION_TRANSLATION)
        except cv2.error:  # nothing to see
            break
        # the guide shows at x + shift what the frames do at x
        change = shift[:, 2] * rendition.factor
        if np.hypot(*change) < LEAST_OFFSET:
            break
        x, y = rendition.offset - change
        rendition = replace(rendition, offset=(float(x), float(y)))
    return rendition


def fit_tone(shown: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return what is added to each level for the tone of guides, (1, 256, 3) float32.

    Other light has one, and so has noise that is clipped: it is darker near white, and brighter near black.
    """
    curves = []
    for levels, others in zip(cv2.split(shown), cv2.split(known), strict=True):
        places = as_bytes(levels).ravel()
        sums = np.vstack([np.bincount(places, each.ravel(), 256) for each in (others - levels, np.ones_like(levels))])
        total, count = cv2.GaussianBlur(sums, (0, 0), TONE_BLUR, sigmaY=1e-3)
        # a tone that few pixels have is uncertain
        curves.append(total / (count + RARE * places.size))
    return np.array(curves, np.float32).T[np.newaxis]


def as_bytes(levels: np.ndarray) -> np.ndarray:
    """Return levels as 8-bit code values."""
    return np.asarray(np.rint(levels.clip(0, WHITE)).astype(np.uint8))


def estimate_noise(difference: np.ndarray) -> float:
    """Return the standard deviation of fine differences, levels; at least 1."""
    fine = np.abs(difference - cv2.blur(difference, (3, 3)))
    # the lower quartile does not see what moved otherwise; 3 x 3 pixels have 8/9 of the variance
    return max(float(np.quantile(fine[::2, ::2], 0.25)) / 0.3, 1.0)


def squared(difference: np.ndarray) -> np.ndarray:
    """Return the squared difference at each pixel, mean of the colours, (h, w) float32."""
    return cv2.transform(difference * difference, np.full((1, 3), 1 / 3, np.float32))


def resized(values: np.ndarray, size: Size, interpolation: int) -> np.ndarray:
    """Return values at another size; they themselves if it is theirs."""
    return values if values.shape[1::-1] == size else cv2.resize(values, size, interpolation=interpolation)


def displaced(values: np.ndarray, offset: tuple[float, float]) -> np.ndarray:
    """Return the values that lie at an offset (x, y) from each pixel; edges are repeated."""
    if offset == (0, 0):
        return values
    return sample(values, np.broadcast_to(np.array(offset, np.float32), (*values.shape[:2], 2)), cv2.INTER_CUBIC)
