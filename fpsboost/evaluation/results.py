"""Results of a comparison as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from fpsboost.evaluation.contestants import Contestant
from fpsboost.evaluation.hidden_frames import Hiding
from fpsboost.evaluation.metrics import Scores, low_percentile, mean, mean_scores, means
from fpsboost.evaluation.regions import AREAS, COMPLEMENTS

MIN_SHARE = 0.02
"""Smallest share of the picture of an area that is shown: a few pixels say more about chance than about a method."""

MAX_NAMED = 8
"""Maximum number of frames that a note names; the data have all of them."""


@dataclass(frozen=True)
class FrameResult:
    """Scores of one frame of a method."""

    number: int
    scores: Scores
    seconds: float
    cpu_seconds: float
    inside: dict[str, float]
    outside: dict[str, float]
    """Mean absolute error in and out of each area of `fpsboost.evaluation.regions.AREAS`, levels of 255; NaN where an
    area is empty."""
    search_radius: int | None = None
    metrics: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class MethodResult:
    """Scores of one method on all hidden frames, in order, those that do not count among them."""

    name: str
    options: str
    frames: list[FrameResult]


@dataclass(frozen=True)
class Comparison:
    """Everything that a report says, and nothing else."""

    clip: str
    kind: str
    """Size and type of the frames: ``640x360, 3 channels, 8-bit``."""
    hiding: Hiding
    hidden: list[int]
    cuts: list[int]
    """Hidden frames across a scene cut, which no method can know: no mean counts them."""
    shares: dict[str, float]
    methods: list[MethodResult]
    skipped: dict[str, str]
    made_with: dict[str, str] = field(default_factory=dict)
    """Versions and machine."""
    rendered: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    cut_options: tuple[str, ...] = ()
    """Options for a renderer's vectors, other tools' frames and scene cuts, as words of the command line."""
    times: list[float] = field(default_factory=list)
    """Place in time of each hidden frame between the two shown ones, 0 to 1."""
    repeats: list[int] = field(default_factory=list)
    """Numbers of frames that repeat the one before: neither shown nor a truth, unless in a still."""
    doubtful: list[int] = field(default_factory=list)
    """Hidden frames whose true pictures nobody knows, most often beside repeats; see
    `fpsboost.evaluation.hidden_frames.Hiding`. No mean counts them."""
    clip_frames: int = 0
    """Number of frames from the first shown one to the last."""
    metrics: tuple[str, ...] = ()

    @property
    def areas(self) -> list[tuple[str, str]]:
        """Areas that are worth showing, each with its complement: both take a share that matters."""
        pairs = zip(AREAS, COMPLEMENTS, strict=True)
        return [pair for pair in pairs if MIN_SHARE <= self.shares[pair[0]] <= 1 - MIN_SHARE]

    @property
    def uneven(self) -> list[int]:
        """Hidden frames that lie off their even places between the shown ones."""
        steps = self.hiding.skip + 1
        even = [(place % self.hiding.skip + 1) / steps for place in range(len(self.hidden))]
        return [number for number, t, usual in zip(self.hidden, self.times, even, strict=False) if t != usual]

    def notes(self, contestants: Mapping[str, Contestant]) -> list[str]:
        """Return what must be known of duplicates and times to understand the figures, as sentences."""
        notes = []
        if self.repeats:
            notes.append(f"These frames show what the one before shows, and are no truths: {_some(self.repeats)}.")
        if self.doubtful:
            notes.append(
                "These hidden frames do not count, since beside repeats, in stills and across pauses nobody knows what "
                f"should be seen: {_some(self.doubtful)}."
            )
        uneven = [number for number in self.uneven if number not in {*self.cuts, *self.doubtful}]
        if uneven:
            rigid = [name for name, contestant in contestants.items() if not contestant.any_time]
            but = f" (even ones with {', '.join(rigid)})" if rigid else ""
            notes.append(
                f"These hidden frames do not divide the time between the shown ones evenly, and were made at their own "
                f"times{but}: {_some(uneven)}."
            )
        return notes

    def counted(self, method: MethodResult) -> list[FrameResult]:
        """Return the frames of a method that count."""
        left_out = {*self.cuts, *self.doubtful}
        return [frame for frame in method.frames if frame.number not in left_out]

    def means(self, method: MethodResult) -> Scores:
        """Return the mean scores of a method."""
        return mean_scores([frame.scores for frame in self.counted(method)])

    def low_psnr(self, method: MethodResult) -> float:
        """Return the 5th percentile of a method's PSNR over the frames that count, dB."""
        return low_percentile([frame.scores.psnr for frame in self.counted(method)])

    def further(self, method: MethodResult) -> dict[str, float]:
        """Return the further metrics of a method by name, means over the frames that count."""
        return means([frame.metrics for frame in self.counted(method)])

    def mean_seconds(self, method: MethodResult) -> tuple[float, float]:
        """Return the mean seconds and CPU seconds of a method per frame."""
        frames = self.counted(method)
        return mean([frame.seconds for frame in frames]), mean([frame.cpu_seconds for frame in frames])

    def mean_error(self, method: MethodResult, area: str, inside: bool = True) -> float:
        """Return the mean absolute error of a method in an area or outside of it, levels of 255."""
        frames = self.counted(method)
        return mean([(frame.inside if inside else frame.outside)[area] for frame in frames])


class ComparedClip(NamedTuple):
    """A comparison, and its methods by name, which can interpolate some frames again."""

    comparison: Comparison
    contestants: Mapping[str, Contestant]


def _some(numbers: Sequence[int]) -> str:
    """List the first of many numbers, and say how many more there are."""
    named = ", ".join(map(str, numbers[:MAX_NAMED]))
    more = len(numbers) - MAX_NAMED
    return f"{named} and {more} more" if more > 0 else named
