"""Edges of blocks in made frames: steps between pixels on a regular grid that the true frame does not have.

A method that moves or decides by blocks leaves them where it is wrong. Natural edges lie on the lines of a grid no more
often than elsewhere, so what tells is the ratio of the steps on the lines to those half-way between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.metrics import LEVELS, composite_on_black
from fpsboost.frame import Image

PERIODS = (8, 16, 32)
"""Of the grids, pixels: sides of blocks that are common."""

HIGHER = 12
"""A step is higher than so many levels of 255."""

STEEPER = 2
"""And more than so many times as high as the slopes beside it, and as the step of the true frame in its place."""

WRONG = 8
"""And counts only where the mean absolute error around it is more than so many levels of 255."""

AROUND = 17
"""Side of the square for that mean, pixels."""

EXACT = 3
"""Decimals that levels are rounded to, so that those of 8-bit images are whole numbers."""


class GridMeter:
    """Counts the steps in the made frames of one method; see `fpsboost.evaluation.further_metrics.Meter`."""

    def __init__(self) -> None:
        self._counts: list[dict[str, float]] = []

    def shown(self, image: Image) -> None:
        """Ignore a frame that nobody made."""

    def made(self, truth: Image, made: Image) -> None:
        """Count those of one frame."""
        self._counts.append(count_steps(truth, made))

    def values(self) -> list[dict[str, float]]:
        """Return ``grid8_lines``, ``grid8_between`` and so on of every frame."""
        return self._counts


def count_steps(truth: Image, made: Image) -> dict[str, float]:
    """Count the steps of one made frame on the lines of each grid and on the lines half-way between.

    A step is a difference of two pixels beside or below each other, the largest of their channels, under the conditions
    that `HIGHER`, `STEEPER` and `WRONG` name. The lines of a grid run behind every `PERIODS`-th column and row, those
    half-way between lie half a period off.

    Parameters
    ----------
    truth, made : (H, W, C) uint8, uint16 or float32
        Of one size and type.

    Returns
    -------
    dict of str to float
        ``grid8_lines`` and ``grid8_between``, and the same for the other periods: whole numbers.
    """
    true_levels, made_levels = (
        np.round(composite_on_black(image) * np.float32(LEVELS), EXACT) for image in (truth, made)
    )
    error = cv2.boxFilter(np.abs(made_levels - true_levels).mean(axis=2), -1, (AROUND, AROUND))
    across = _steps_by_column(true_levels, made_levels, error)
    down = _steps_by_column(*(np.swapaxes(each, 0, 1) for each in (true_levels, made_levels, error)))
    counts = {}
    for period in PERIODS:
        for name, first in (("lines", period - 1), ("between", period // 2 - 1)):
            counts[f"grid{period}_{name}"] = float(sum(int(steps[first::period].sum()) for steps in (across, down)))
    return counts


def _steps_by_column(truth: NDArray[Any], made: NDArray[Any], error: NDArray[Any]) -> NDArray[Any]:
    """Return the number of steps between each column and the next, (W - 1,) int."""
    height, true_height = (np.abs(np.diff(image, axis=1)).max(axis=2) for image in (made, truth))
    none = np.zeros((height.shape[0], 1), height.dtype)
    left, right = np.hstack([none, height[:, :-1]]), np.hstack([height[:, 1:], none])
    slopes = np.maximum(np.maximum(left, right), true_height)
    is_step = (height > HIGHER) & (STEEPER * slopes < height) & (error[:, :-1] > WRONG)
    counts: NDArray[Any] = np.count_nonzero(is_step, axis=0)
    return counts


def grid_ratios(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the steps on the lines over those half-way between, each summed over all frames: 1 without a visible grid.

    Parameters
    ----------
    rows : sequence of mapping
        Of `count_steps`.

    Returns
    -------
    dict of str to float
        ``grid8`` and so on. Where there are none between, those on the lines are divided by 1; no number where there
        are none at all. Below some 20 steps a ratio is chance.
    """
    ratios = {}
    for period in PERIODS:
        lines, between = (sum(row[f"grid{period}_{name}"] for row in rows) for name in ("lines", "between"))
        ratios[f"grid{period}"] = lines / max(between, 1) if lines or between else float("nan")
    return ratios
