"""Repeated patterns, in which many motions are equally similar: what bounds them tells which one is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth import as_type, waves

from fpsboost.method_table import methods

NLM = replace(methods["nlm"], cuts=None)
EACH_ALONE = replace(NLM, estimator=replace(NLM.estimator, smoothness=0))
"""The same, but nobody listens to neighbours."""

MIXED = replace(methods["blend"], cuts=None)


def bars(period, shift, *, degrees=0.0, box=(26, 28, 102, 144), background=(0, 0)):
    """Bright bars with dark gaps of three pixels at any time, turned, within a box that moves over a smooth texture."""
    y, x = np.mgrid[0:128, 0:192].astype(float)
    angle = np.radians(degrees)
    top, left, bottom, right = box

    def at(t):
        u, v = x - t * shift[0], y - t * shift[1]
        place = (np.cos(angle) * u + np.sin(angle) * v) % period
        bright = 0.15 + 0.7 * (np.minimum(place, period - place) - 1).clip(0, 1)[..., np.newaxis]
        across = (u - left + 0.5).clip(0, 1) * (right - u + 0.5).clip(0, 1)
        down = (v - top + 0.5).clip(0, 1) * (bottom - v + 0.5).clip(0, 1)
        share = (across * down)[..., np.newaxis]
        behind = 0.2 + 0.6 * waves(x - t * background[0], y - t * background[1])
        return as_type(behind * (1 - share) + bright * [1, 0.95, 0.9] * share, np.uint8)

    return at


INNER = slice(40, 88), slice(50, 132)
"""Within the bars at the middle of their way."""


def off(interpolator, at):
    """Mean largest difference of a pixel's channels within the bars, halfway."""
    (image,) = interpolator.interpolate(at(0), at(1), [0.5])
    return float(np.abs(image.astype(float) - at(0.5)).max(axis=-1)[INNER].mean())


@pytest.mark.parametrize(("period", "shift"), [(16, 10), (20, 12), (24, 14)])
def test_bars_go_where_their_bounds_go(period, shift):
    """By more than half a period, where a shorter way back is as similar: their ends tell, each alone cannot."""
    at = bars(period, (shift, 0))
    made, alone, mixed = (off(each, at) for each in (NLM, EACH_ALONE, MIXED))
    assert made < mixed / 8
    assert made < alone / 5


@pytest.mark.parametrize(("period", "shift"), [(16, 10), (20, 12)])
def test_bars_from_top_to_bottom_go_where_their_ends_go(period, shift):
    """Also where nothing but their left and right ends can be seen, and the background moves: to a tenth of a level."""
    at = bars(period, (shift, 0), box=(-50, 28, 200, 144), background=(-2, 1))
    made, mixed = (off(each, at) for each in (NLM, MIXED))
    assert made < min(mixed / 4, 0.1)


@pytest.mark.parametrize(("period", "shift", "degrees"), [(16, 10, 8), (20, 12, 8), (16, 10, 20), (24, 14, 20)])
def test_a_turned_grille_does_not_tear(period, shift, degrees):
    """Some degrees from upright, where the way along the bars costs nothing: right, and no worse than each alone."""
    at = bars(period, (shift, 0), degrees=degrees)
    made, alone, mixed = (off(each, at) for each in (NLM, EACH_ALONE, MIXED))
    assert made < mixed / 15
    assert made <= 1.05 * alone


def test_bars_that_stand_still_stay():
    """No motion is a motion like any other: still bars before a moving background are hardly touched."""
    at = bars(16, (0, 0), background=(6, 2))
    assert off(NLM, at) < 0.5
