"""Who comes nearest to the truth, whether that is more than chance, at what price, and what to take.

Methods are compared frame by frame: frames differ far more in how hard they are than methods do on one frame, so the
mean of the paired differences is known much better than either mean. Of several clips, all count alike, however long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.results import Comparison

MAX_STANDARD_ERRORS = 2.0
"""Mean difference in standard errors up to which two methods are level: about 95 %."""

NEGLIGIBLE_DIFFERENCE = 0.3
"""Difference that is hardly seen, dB; the cheapest method within it is recommended too."""


@dataclass(frozen=True)
class Difference:
    """Lead of the best method over another, over the frames that count."""

    method: str
    mean: float
    """Mean of the differences of PSNR, dB."""
    standard_error: float | None
    """Standard error of that mean, dB; None for one frame."""

    @property
    def is_level(self) -> bool:
        """Whether the difference may be chance; what is the same in every frame is level, too."""
        return self.standard_error is None or self.mean <= MAX_STANDARD_ERRORS * self.standard_error


@dataclass(frozen=True)
class Verdict:
    """Outcome of a comparison."""

    best: str
    psnr: float
    """Mean PSNR of the best, dB."""
    frames: int
    ahead: list[Difference]
    level: list[str]
    cheapest: str
    """Method with the least CPU time of those within `NEGLIGIBLE_DIFFERENCE` of the best, itself included."""
    cpu_seconds: dict[str, float]
    """Time to multiply the frames of the whole range by `factor`, by method; NaN if unknown."""
    clip_frames: int
    factor: int
    """Number of frames in the range, and of output frames for each: one more than were hidden at once."""
    sentences: list[str]

    @property
    def text(self) -> str:
        """The sentences as one text."""
        return " ".join(self.sentences)


def judge(comparison: Comparison) -> Verdict:
    """Judge a comparison of one method at least; the terminal, the data and the page all say this."""
    psnr = {each.name: [frame.scores.psnr for frame in comparison.counted(each)] for each in comparison.methods}
    means = {name: float(np.mean(values)) for name, values in psnr.items()}
    count = (comparison.clip_frames - 1) * comparison.hiding.skip
    seconds = {each.name: comparison.mean_seconds(each)[1] * count for each in comparison.methods}
    prices = {name: math.inf if math.isnan(each) else each for name, each in seconds.items()}
    best, *others = sorted(means, key=lambda name: (-means[name], prices[name]))
    ahead = [difference(name, psnr[best], psnr[name]) for name in others]
    near = [name for name in means if means[best] - means[name] <= NEGLIGIBLE_DIFFERENCE]
    verdict = Verdict(
        best=best,
        psnr=means[best],
        frames=len(psnr[best]),
        ahead=ahead,
        level=[each.method for each in ahead if each.is_level],
        cheapest=min(near, key=lambda name: (prices[name], -means[name])),
        cpu_seconds=seconds,
        clip_frames=comparison.clip_frames,
        factor=comparison.hiding.skip + 1,
        sentences=[],
    )
    return replace(verdict, sentences=_say(verdict, means))


def difference(method: str, best: Sequence[float], other: Sequence[float]) -> Difference:
    """Return the mean paired difference of two methods' PSNR, and how well it is known.

    Frames that follow each other resemble each other, so that n of them tell less than n independent ones. The
    differences are taken for a first-order autoregressive process: with r, their correlation from frame to frame as
    estimated from the same frames, the standard error of independent ones is multiplied by sqrt((1 + r) / (1 - r)). A
    negative r counts as none, which never makes the error smaller. Of few frames r is underestimated and two standard
    errors are fewer than 95 %, so that a lead over less than about ten frames is a hint only.
    """
    differences = np.subtract(best, other)
    mean, count = float(differences.mean()), len(differences)
    if count < 2:
        return Difference(method, mean, None)
    apart = differences - mean
    variance = float(apart @ apart)
    correlation = max(0.0, float(apart[1:] @ apart[:-1]) / variance) if variance else 0.0
    independent = math.sqrt(variance / (count - 1) / count)
    return Difference(method, mean, independent * math.sqrt((1 + correlation) / (1 - correlation)))


def _say(verdict: Verdict, means: dict[str, float]) -> list[str]:
    work = f"{'Doubling' if verdict.factor == 2 else f'Making {verdict.factor} of each of'} these "
    work += f"{verdict.clip_frames} frames takes"
    seconds = verdict.cpu_seconds[verdict.best]
    price = f"{work} {verdict.best} {say_seconds(seconds)} of CPU time"
    if math.isnan(seconds):
        price = f"What {verdict.best} costs is not known"
    if not verdict.ahead:
        return [f"{verdict.best} reaches {verdict.psnr:.1f} dB over {_count(verdict.frames)}.", f"{price}."]
    nearest = verdict.ahead[0]
    sentences = []
    if verdict.frames == 1:
        sentences.append(
            f"{verdict.best} comes nearest to the truth with {verdict.psnr:.1f} dB, {nearest.mean:.2f} dB ahead of "
            f"{nearest.method}, but one frame says nothing about others."
        )
    elif verdict.level:
        apart = ", ".join(_apart(each) for each in verdict.ahead if each.is_level)
        sentences.append(
            f"{listed([verdict.best, *verdict.level])} are level: {verdict.best} reaches {verdict.psnr:.1f} dB over "
            f"{_count(verdict.frames)}, and no lead is more than two standard errors ({apart})."
        )
    else:
        sentences.append(
            f"{verdict.best} comes nearest to the truth: {verdict.psnr:.1f} dB over {_count(verdict.frames)}, "
            f"{_apart(nearest)}."
        )
    if verdict.cheapest == verdict.best:
        sentences.append(f"{price}.")
        if not math.isnan(seconds):
            sentences.append(f"Take {verdict.best}: nothing cheaper comes within {NEGLIGIBLE_DIFFERENCE} dB.")
    else:
        less = means[verdict.best] - means[verdict.cheapest]
        cheap = say_seconds(verdict.cpu_seconds[verdict.cheapest])
        sentences.append(
            f"{price}; {work[0].lower()}{work[1:]} {verdict.cheapest} {cheap}."
            if math.isnan(seconds)
            else f"{price}, and {verdict.cheapest} {cheap}."
        )
        sentences.append(
            f"Take {verdict.best} for the best picture, or {verdict.cheapest}, the cheapest within "
            f"{NEGLIGIBLE_DIFFERENCE} dB ({less:.2f} dB less)."
        )
    return sentences


def _apart(ahead: Difference) -> str:
    assert ahead.standard_error is not None
    return f"{ahead.mean:.2f} ± {ahead.standard_error:.2f} dB ahead of {ahead.method}"


def _count(frames: int) -> str:
    return f"{frames} frame{'' if frames == 1 else 's'}"


def listed(words: Sequence[str]) -> str:
    """Return words as a list of a sentence: ``a, b and c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def say_seconds(seconds: float) -> str:
    """Return a time as people say it, with two figures that count.

    Examples
    --------
    >>> say_seconds(0.0123), say_seconds(7.25), say_seconds(95.0), say_seconds(5000.0)
    ('0.012 s', '7.2 s', '95 s', '1 h 23 min')
    """
    if seconds >= 3600:
        hours, minutes = divmod(round(seconds / 60), 60)
        return f"{hours} h {minutes} min"
    if seconds >= 120:
        return f"{round(seconds / 60)} min"
    if 0 < seconds < 10:
        return f"{seconds:.{max(0, 1 - math.floor(math.log10(seconds)))}f} s"
    return f"{seconds:.0f} s"


class MeanOverClips(NamedTuple):
    """Mean PSNR of a method over the clips, and its PSNR on each, dB."""

    method: str
    mean: float
    of_clips: list[float]


def means_over_clips(comparisons: Sequence[Comparison]) -> list[MeanOverClips]:
    """Return the means of every method, in the order of the comparisons."""
    means = []
    for place, method in enumerate(comparisons[0].methods):
        of_clips = [comparison.means(comparison.methods[place]).psnr for comparison in comparisons]
        means.append(MeanOverClips(method.name, float(np.mean(of_clips)), of_clips))
    return means


def judge_all(comparisons: Sequence[Comparison]) -> str:
    """Return in a sentence which method does best on several clips, by more than chance or not."""
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
