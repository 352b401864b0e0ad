"""Does the confidence of a method know where the method errs?"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr
from scoring import Clip, Figures, Made

from fpsboost.evaluation.metrics import absolute_error

BLOCK = 8
"""Side of the blocks whose ranks are compared, pixels."""

REMOVED = tuple(percent / 100 for percent in range(0, 100, 10))
"""Shares of the pixels that are taken away, least confident first."""


def judge_confidence(clip: Clip, made: Made) -> Figures:
    """Return rank correlation, area between the sparsification curves, and both curves, as means over a clip.

    Returns
    -------
    dict of str to float
        `spearman` : rank correlation of 1 - confidence with the absolute error, both as means of blocks.
        `ause` : mean difference of the two curves, 0 for a confidence that ranks as the error itself would.
        `left_10` ... `left_90` : error of the pixels that remain without the least confident 10 ... 90 %, as a share
        of the error of all pixels; 1 throughout for a confidence that knows nothing.
        `oracle_10` ... `oracle_90` : the same without the pixels of the largest error.
    """
    frames = []
    for index in clip.scored:
        error = absolute_error(clip.hidden[index], made.images[index])
        doubt = 1 - made.confidences[index]
        left, oracle = sparsification(error, doubt), sparsification(error, error)
        figures = {"spearman": rank_correlation(error, doubt), "ause": float((left - oracle).mean())}
        for share, ours, best in zip(REMOVED[1:], left[1:], oracle[1:], strict=True):
            figures |= {f"left_{share * 100:.0f}": float(ours), f"oracle_{share * 100:.0f}": float(best)}
        frames.append(figures)
    # a frame without any error, or of one confidence throughout, has no ranks
    return {key: float(np.nanmean([each[key] for each in frames])) for key in frames[0]}


def rank_correlation(error: NDArray[Any], doubt: NDArray[Any]) -> float:
    """Return Spearman's rank correlation of the means of blocks; NaN if either image is constant."""
    first, second = block_means(error).ravel(), block_means(doubt).ravel()
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return float("nan")
    return float(spearmanr(first, second).statistic)


def block_means(values: NDArray[Any]) -> NDArray[Any]:
    """Return the means of whole blocks; incomplete blocks at the right and at the bottom are left out."""
    rows, columns = (length // BLOCK for length in values.shape)
    blocks = values[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    means: NDArray[Any] = blocks.mean(axis=(1, 3))
    return means


def sparsification(error: NDArray[Any], doubt: NDArray[Any]) -> NDArray[Any]:
    """Return the mean error without the most doubtful pixels, for each share of `REMOVED`, relative to that of all."""
    ordered = error.ravel()[np.argsort(doubt, axis=None, kind="stable")].astype(np.float64)
    sums = np.cumsum(ordered)
    kept = np.maximum(np.rint(ordered.size * (1 - np.array(REMOVED))).astype(int), 1)
    if sums[-1] == 0:
        return np.full(len(REMOVED), np.nan)
    curve: NDArray[Any] = sums[kept - 1] / kept / (sums[-1] / ordered.size)
    return curve
