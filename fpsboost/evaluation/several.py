"""Comparisons of several clips by the same methods, taken together: clips count alike, however long they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.results import Comparison

MAX_LEVEL = 0.005
"""Methods are said to be level if their means differ by no more, dB: that is what two digits show."""


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
    """Say in a sentence which method does best on several clips.

    Returns
    -------
    str
        ``nlm does best in the mean of 3 clips: 33.10 dB, 0.64 dB more than dis; it is best on 2 of them.``
    """
    best, *others = sorted(means_over_clips(comparisons), key=lambda each: -each.mean)
    of_all = f"in the mean of {len(comparisons)} clips"
    if not others:
        return f"{best.method} reaches {best.mean:.2f} dB {of_all}."
    highest = [max(each.of_clips[place] for each in (best, *others)) for place in range(len(comparisons))]
    wins = sum(mine >= top - MAX_LEVEL for mine, top in zip(best.of_clips, highest, strict=True))
    ahead = best.mean - others[0].mean
    on = "all" if wins == len(comparisons) else "none" if wins == 0 else str(wins)
    if ahead <= MAX_LEVEL:
        return f"{best.method} and {others[0].method} are level {of_all}: {best.mean:.2f} dB."
    return (
        f"{best.method} does best {of_all}: {best.mean:.2f} dB, {ahead:.2f} dB more than {others[0].method}; it is "
        f"best on {on} of them."
    )


def means_as_json(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Return the means over clips as plain data."""
    return {each.method: {"psnr": each.mean, "psnr_of_clips": each.of_clips} for each in means_over_clips(comparisons)}
