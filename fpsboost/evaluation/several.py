"""Comparisons of several clips by the same methods, taken together: clips count alike, however long they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.results import Comparison
from fpsboost.evaluation.verdict import MAX_STANDARD_ERRORS


class MeanOverClips(NamedTuple):
    """PSNR of a method: its mean over the clips, and that of each clip, dB."""

    method: str
    mean: float
    of_clips: list[float]


def means_over_clips(comparisons: Sequence[Comparison]) -> list[MeanOverClips]:
    """Return the means of every method, in the order of the comparisons."""
    found = []
    for place, method in enumerate(comparisons[0].methods):
        of_clips = [comparison.means(comparison.methods[place]).psnr for comparison in comparisons]
        found.append(MeanOverClips(method.name, float(np.mean(of_clips)), of_clips))
    return found


def judge_all(comparisons: Sequence[Comparison]) -> str:
    """Say in a sentence which method does best on several clips, by more than chance or not.

    Returns
    -------
    str
        ``nlm does best in the mean of 3 clips: 33.10 dB, 0.64 ± 0.12 dB more than dis; it is best on all of them.``
    """
    best, *others = sorted(means_over_clips(comparisons), key=lambda each: -each.mean)
    of_all = f"in the mean of {len(comparisons)} clips"
    if not others:
        return f"{best.method} reaches {best.mean:.2f} dB {of_all}."
    differences = np.subtract(best.of_clips, others[0].of_clips)
    mean, error = float(differences.mean()), float(differences.std(ddof=1)) / math.sqrt(len(differences))
    lead = f"{mean:.2f} ± {error:.2f} dB"
    if mean <= MAX_STANDARD_ERRORS * error:
        return (
            f"{best.method} and {others[0].method} are level {of_all}: {best.method} reaches {best.mean:.2f} dB, and "
            f"no lead is more than two standard errors ({lead} ahead of {others[0].method})."
        )
    wins = int((np.argmax([each.of_clips for each in (best, *others)], axis=0) == 0).sum())
    on = "all" if wins == len(comparisons) else str(wins)
    return (
        f"{best.method} does best {of_all}: {best.mean:.2f} dB, {lead} more than {others[0].method}; it is best on "
        f"{on} of them."
    )


def means_as_json(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Return the means over clips as plain data."""
    return {each.method: {"psnr": each.mean, "psnr_of_clips": each.of_clips} for each in means_over_clips(comparisons)}
