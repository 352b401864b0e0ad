"""What a guide shows beyond what the frames explain, band by band of a Laplacian pyramid.

Of the difference between a guide and a picture as the guide would show it, that share is added which exceeds the usual
difference of places with as much detail: noise, compression and the blur of denoisers vary with it.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from fpsboost.synthesis.guide_calibration import Rendition, resized, squared

EXCESS = 2.0
"""Multiple of the usual power of a difference from which on the guide shows something else."""

EXACT = 0.65
"""Mean difference, levels, up to which a small guide is what the frame looks like at its size; rounding makes 0.25."""

ROUNDS = 3
"""Rounds of back-projection."""

Average = Callable[..., Any]


def exact_difference(values: np.ndarray, guide: np.ndarray, error: np.ndarray, rendition: Rendition) -> np.ndarray:
    """Return what makes a picture agree with an exact small guide, levels, without detail where it did not.

    It is found by back-projection (Irani and Peleg 1991). Detail that is in a wrong place would stay as thin lines.

    Parameters
    ----------
    values : (H, W, C) float32
        Values of the picture.
    guide : (h, w, 3) float32
        Levels of the guide.
    error : (h, w) float32
        Squared difference of the picture's best part from the guide.
    rendition : Rendition
    """
    picture = rendition.colours.levels(values)
    detail = picture - rendition.raised(resized(picture, rendition.size, cv2.INTER_AREA), cv2.INTER_CUBIC)
    power = resized(squared(detail), rendition.size, cv2.INTER_AREA)
    difference = -rendition.raised(error / (power + error + 1e-3))[..., np.newaxis] * detail
    for _ in range(ROUNDS):
        shown = rendition.shown(rendition.colours.shifted(values, difference))
        difference += rendition.raised(guide - shown, cv2.INTER_CUBIC)
    return np.asarray(difference)


def excess_difference(
    difference: np.ndarray, shown: np.ndarray, known: tuple[np.ndarray, np.ndarray] | None
) -> np.ndarray:
    """Return the part of a difference that is not usual.

    Parameters
    ----------
    difference : (h, w, 3) float32
        Guide minus what it would show of the picture, levels.
    shown : (h, w, 3) float32
        What it would show.
    known : two (h, w, 3) float32, or None
        Usual differences, and beside what; without these, most places are taken to be right.
    """
    levels = int(np.clip(np.log2(min(difference.shape[:2]) / 8), 0, 5))
    bands = split(difference, levels)
    details = split(shown, levels)
    usual, beside = (bands, details) if known is None else (split(each, levels) for each in known)
    average: Average = np.median if known is None else np.mean
    kept = _excess(bands[-1], details[-1], usual[-1], beside[-1], 3, 1, average)
    for k in range(levels - 1, -1, -1):
        kept = _risen(kept, bands[k]) + _excess(bands[k], details[k], usual[k], beside[k], 7, 6, average)
    return kept


def _excess(
    band: np.ndarray,
    detail: np.ndarray,
    usual: np.ndarray,
    beside: np.ndarray,
    side: int,
    bins: int,
    average: Average,
) -> np.ndarray:
    """Return a band scaled by the share of its local power that is not usual beside as much detail."""
    power = _local_power(band, side)
    strength = _local_power(beside, side)
    usual_power = _local_power(usual, side)
    limits = np.quantile(strength[::2, ::2], np.arange(1, bins) / bins)
    index = np.searchsorted(limits, strength)
    means = [average(usual_power[index == k]) if (index == k).any() else 0 for k in range(bins)]
    expected = np.array(means, np.float32)[np.searchsorted(limits, _local_power(detail, side))]
    threshold = EXCESS * cv2.blur(expected, (side, side))
    share = np.maximum(power - threshold, 0) / (power + 1e-3)
    return np.asarray(band * share[..., np.newaxis])


def split(image: np.ndarray, levels: int) -> list[np.ndarray]:
    """Return the bands of a Laplacian pyramid, the finest first (Burt and Adelson 1983)."""
    bands = []
    for _ in range(levels):
        smaller = cv2.pyrDown(image)
        bands.append(image - _risen(smaller, image))
        image = smaller
    return [*bands, image]


def _risen(small: np.ndarray, like: np.ndarray) -> np.ndarray:
    return cv2.pyrUp(small, dstsize=like.shape[1::-1])


def _local_power(band: np.ndarray, side: int) -> np.ndarray:
    return cv2.blur(squared(band), (side, side))
