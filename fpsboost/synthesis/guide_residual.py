"""What a guide shows beyond what the frames explain, band by band of a Laplacian pyramid.

Of the difference between a guide and a picture as the guide would show it, that share is added which exceeds the usual
difference of places with as much detail: noise, compression and the blur of denoisers vary with it.
"""

import cv2
import numpy as np

from fpsboost.kernels.constants import BANDS, BINS
from fpsboost.kernels.guided import keep_excess, measure_usual_power
from fpsboost.synthesis.guide_calibration import Rendition, resized, squared

EXCESS = 2.0
"""Multiple of the usual power of a difference from which on the guide shows something else."""

EXACT = 0.65
"""Mean difference, levels, up to which a small guide is what the frame looks like at its size; rounding makes 0.25."""

ROUNDS = 3
"""Rounds of back-projection."""


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


def usual_power(difference: np.ndarray, shown: np.ndarray, *, use_median: bool) -> np.ndarray:
    """Return the usual power of differences, (h, w, 3) float32, beside what is shown there.

    They are those of two guides, one below the other. With `use_median`, they are those of one, and most of them are
    taken to be right. See `fpsboost.kernels.guided.measure_usual_power`.
    """
    usual = np.empty((BANDS, 2, BINS), np.float32)
    measure_usual_power(difference, shown, use_median, usual)
    return usual


def excess_difference(difference: np.ndarray, shown: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """Return the part of a difference that is not usual.

    Parameters
    ----------
    difference : (h, w, 3) float32
        Guide minus what it would show of the picture, levels.
    shown : (h, w, 3) float32
        What it would show.
    usual : (BANDS, 2, BINS) float32
        By `usual_power`.
    """
    kept = np.empty_like(difference)
    keep_excess(difference, shown, usual, EXCESS, kept)
    return kept
