"""Verdict of a comparison: the best method, whether its lead is significant, its cost, and a recommendation.

Methods are compared frame by frame: frames differ far more in how hard they are than methods do on one frame, so the
mean of the paired differences is known much more accurately than either mean. Several clips count alike, however long.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fpsboost.errors import format_duration
from fpsboost.evaluation.results import Comparison, mean
from fpsboost.media import counted

MAX_STANDARD_ERRORS = 2.0
"""Mean difference in standard errors up to which two methods are level: about 95 %."""

NEGLIGIBLE_DIFFERENCE = 0.3
"""Difference that is hardly visible, dB; the cheapest method within it is recommended too."""


@dataclass(frozen=True)
class Difference:
    """Lead of the best method over another, over the frames that count."""

    method: str
    """Name of the other method."""
    mean: float
    """Mean of the differences of PSNR, dB."""
    standard_error: float | None
    """Standard error of that mean, dB; None for one frame."""

    @property
    def is_level(self) -> bool:
        """Whether the difference may be chance; equal results in every frame are level, too."""
        return self.standard_error is None or self.mean <= MAX_STANDARD_ERRORS * self.standard_error


@dataclass(frozen=True)
class Verdict:
    """Outcome of a comparison."""

    best: str
    """Method with the highest mean PSNR."""
    psnr: float
    """Mean PSNR of the best, dB."""
    frames: int
    """Number of frames that count."""
    ahead: list[Difference]
    """Its lead over each of the other methods, by decreasing PSNR."""
    level: list[str]
    """Methods that are level with it."""
    cheapest: str
    """Method with the least CPU time of those within `NEGLIGIBLE_DIFFERENCE` of the best, itself included."""
    cpu_seconds: dict[str, float]
    """Time to multiply the frames of the whole range by `factor`, by method; NaN if unknown."""
    clip_frames: int
    """Number of frames in the range."""
    factor: int
    """Output frames for each of them: one more than were hidden at once."""
    sentences: list[str]
    """Recommendation and reasons, then the figures behind them."""


def judge(comparison: Comparison) -> Verdict:
    """Judge a comparison of at least one method; the terminal, the data and the page all show the result."""
    psnr = {each.name: [frame.scores.psnr for frame in comparison.counted(each)] for each in comparison.methods}
    means = {name: float(np.mean(values)) for name, values in psnr.items()}
    seconds = _cpu_seconds(comparison)
    best, *others = sorted(means, key=lambda name: (-means[name], _price(seconds[name])))
    ahead = [difference(name, psnr[best], psnr[name]) for name in others]
    verdict = Verdict(
        best=best,
        psnr=means[best],
        frames=len(psnr[best]),
        ahead=ahead,
        level=[each.method for each in ahead if each.is_level],
        cheapest=_cheapest(best, ahead, seconds),
        cpu_seconds=seconds,
        clip_frames=comparison.clip_frames,
        factor=comparison.hold_out.skip + 1,
        sentences=[],
    )
    return replace(verdict, sentences=_say(verdict))


def _cpu_seconds(comparison: Comparison) -> dict[str, float]:
    """Return the CPU time of each method for the whole range, seconds; NaN if unknown."""
    count = (comparison.clip_frames - 1) * comparison.hold_out.skip
    return {each.name: comparison.means(each)["cpu_seconds"] * count for each in comparison.methods}


def _cheapest(best: str, ahead: Sequence[Difference], seconds: Mapping[str, float]) -> str:
    """Return the method with the least CPU time of those that are about as good as the best."""
    near = {best: 0.0} | {each.method: each.mean for each in ahead if each.mean <= NEGLIGIBLE_DIFFERENCE}
    return min(near, key=lambda name: (_price(seconds[name]), near[name]))


def _price(seconds: float) -> float:
    """Return the CPU time for comparisons; infinite if unknown."""
    return math.inf if math.isnan(seconds) else seconds


def difference(method: str, best: Sequence[float], other: Sequence[float]) -> Difference:
    """Return the mean paired difference of two methods' PSNR, and its standard error.

    Consecutive frames resemble each other, so that n of them carry less information than n independent ones. The
    differences are modelled as a first-order autoregressive process: with r, their correlation from frame to frame as
    estimated from the same frames, the standard error of independent ones is multiplied by sqrt((1 + r) / (1 - r)). A
    negative r counts as none, which never makes the error smaller. With few frames r is underestimated and two standard
    errors are fewer than 95 %, so that a lead over less than about ten frames is only a hint.

    Examples
    --------
    >>> lead = difference("blend", [30.0, 31.0, 32.0], [29.0, 30.5, 30.5])
    >>> lead.mean, lead.is_level
    (1.0, False)
    """
    differences = np.subtract(best, other)
    mean = float(differences.mean())
    count = len(differences)
    if count < 2:
        return Difference(method, mean, None)
    apart = differences - mean
    variance = float(apart @ apart)
    correlation = max(0.0, float(apart[1:] @ apart[:-1]) / variance) if variance else 0.0
    independent = math.sqrt(variance / (count - 1) / count)
    return Difference(method, mean, independent * math.sqrt((1 + correlation) / (1 - correlation)))


def _say(verdict: Verdict) -> list[str]:
    """Return the sentences of a verdict."""
    seconds = verdict.cpu_seconds
    doing = "Doubling" if verdict.factor == 2 else f"Making {verdict.factor} of each of"
    priced = [name for name in dict.fromkeys([verdict.best, verdict.cheapest]) if not math.isnan(seconds[name])]
    prices = [f"{name} {format_duration(seconds[name])}" for name in priced]
    price = [f"{doing} these {verdict.clip_frames} frames takes {listed(prices)} of CPU time."] if prices else []
    reached = f"{verdict.best} reaches {verdict.psnr:.1f} dB over {counted(verdict.frames, 'frame')}"
    if not verdict.ahead:
        return [f"{reached}.", *price]
    advice = _advise(verdict.best, verdict.ahead, verdict.cheapest, seconds)
    return [advice, f"{reached}, {_leads(verdict.ahead)}.", *price]


def _advise(
    best: str, ahead: Sequence[Difference], cheapest: str, seconds: Mapping[str, float], where: str = "here"
) -> str:
    """Return the recommendation and its reasons in one sentence."""
    is_one_frame = ahead[0].standard_error is None
    level = [] if is_one_frame else [each for each in ahead if each.is_level]
    near = level or ahead[:1]
    place = "on one frame" if is_one_frame else where
    advice = f"Take {best}: best picture {place}, {_span(near)} ahead of {listed([each.method for each in near])}"
    if level:
        advice += f", which {'is' if len(level) == 1 else 'are'} level"
    price = seconds[best]
    others = [seconds[each.method] for each in ahead]
    if cheapest == best and not math.isnan(price):
        is_cheapest = all(each >= price for each in others)
        advice += f"; nothing {'is cheaper' if is_cheapest else f'cheaper comes within {NEGLIGIBLE_DIFFERENCE} dB'}"
    elif cheapest != best:
        behind = next(each for each in ahead if each.method == cheapest)
        time = "the least known time" if math.isnan(price) else _share(seconds[cheapest] / price)
        advice += f"; {cheapest} {'takes' if behind in near else f'is {_span([behind])} behind at'} {time}"
    return f"{advice}."


def _span(differences: Sequence[Difference]) -> str:
    """Return the range of some differences as text, dB."""
    low, high = (f"{pick(each.mean for each in differences):.1f}" for pick in (min, max))
    if high == "0.0":
        return "less than 0.1 dB"
    return f"{high} dB" if low == high else f"{f'{low} to' if low != '0.0' else 'up to'} {high} dB"


def _share(share: float) -> str:
    """Return a share of the time as text."""
    if share >= 0.95:
        return "about the same time"
    names = {2: "half", 3: "a third of", 4: "a quarter of", 5: "a fifth of", 10: "a tenth of"}
    near = [name for part, name in names.items() if 0.9 < share * part < 1.1]
    return f"{near[0] if near else f'{max(1, round(100 * share))} % of'} the time"


def _leads(ahead: Sequence[Difference]) -> str:
    """Return the lead over every other method with its standard error, as text."""
    errors = ["" if each.standard_error is None else f" ± {each.standard_error:.2f}" for each in ahead]
    leads = [f"{each.mean:.2f}{error} dB ahead of {each.method}" for each, error in zip(ahead, errors, strict=True)]
    note = " (mean and standard error; up to two of these count as level)"
    return ", ".join(leads) + (note if all(errors) else "; one frame is no evidence for others")


def listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence.

    Examples
    --------
    >>> listed(["nlm", "dis", "blend"])
    'nlm, dis and blend'
    """
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def psnr_of_clips(comparisons: Sequence[Comparison]) -> dict[str, list[float]]:
    """Return the mean PSNR of every method on each clip, dB, by the names of the methods in their order."""
    return {
        method.name: [comparison.means(comparison.methods[place])["psnr"] for comparison in comparisons]
        for place, method in enumerate(comparisons[0].methods)
    }


def judge_all(comparisons: Sequence[Comparison]) -> list[str]:
    """Return recommendation and reasons for several clips, in sentences like those of `judge`."""
    psnr = psnr_of_clips(comparisons)
    best, *others = sorted(psnr, key=lambda name: -mean(psnr[name]))
    clips = f"the mean of {len(comparisons)} clips"
    reached = f"{best} reaches {mean(psnr[best]):.2f} dB in {clips}"
    if not others:
        return [f"{reached}."]
    leads = {name: np.subtract(psnr[best], psnr[name]) for name in others}
    ahead = [
        Difference(name, float(lead.mean()), float(lead.std(ddof=1)) / math.sqrt(len(lead)))
        for name, lead in leads.items()
    ]
    each_seconds = [_cpu_seconds(comparison) for comparison in comparisons]
    seconds = {name: sum(of_clip[name] for of_clip in each_seconds) for name in psnr}
    advice = _advise(best, ahead, _cheapest(best, ahead, seconds), seconds, f"in {clips}")
    wins = int((np.argmax([psnr[name] for name in (best, *others)], axis=0) == 0).sum())
    on = "all" if wins == len(comparisons) else str(wins)
    return [advice, f"{reached}, {_leads(ahead)}; it is best on {on} of them."]
