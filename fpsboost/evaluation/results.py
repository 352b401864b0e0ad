"""Results of a comparison as data, and the distance of an interpolated frame from the true one in the usual figures.

All kinds of images are compared with 1.0 for white, so that a clip scores alike with 8 bits, 16 bits or as float. MSE
and MAE are given in levels of 255, as tables of 8-bit images have them; colours count as far as they are opaque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import mean_squared_error, structural_similarity

from fpsboost.colour import composite_on_black
from fpsboost.errors import InputError
from fpsboost.evaluation.contestants import Contestant
from fpsboost.evaluation.hidden_frames import Hiding
from fpsboost.evaluation.regions import AREAS, COMPLEMENTS
from fpsboost.image import Image

LEVELS = 255
MIN_MSE = 1e-12  # smallest MSE: equal images have a PSNR of 120 dB and not of infinity, which has no mean

SSIM_WINDOW = 7

LOW_PERCENT = 5  # percentile of PSNR over frames that is reported: the worst frames say more about a clip than the mean


@dataclass(frozen=True)
class Scores:
    """Scores of an interpolated frame against the true one."""

    mse: float
    """Mean squared error, levels of 255 squared."""
    psnr: float
    """Peak signal-to-noise ratio, dB; at most 120."""
    ssim: float
    """Structural similarity (Wang et al. 2004, doi:10.1109/TIP.2003.819861), mean over the channels."""
    mae: float
    """Mean absolute error, levels of 255: what the Middlebury tables call interpolation error."""


def score(truth: Image, image: Image) -> Scores:
    """Compare an interpolated frame with the true one, both (H, W, C), of one size and type, 7 pixels at least."""
    if min(truth.shape[:2]) < SSIM_WINDOW:
        raise InputError(
            f"Frames of {truth.shape[1]}x{truth.shape[0]} are too small to be compared; take at least "
            f"{SSIM_WINDOW} pixels each way."
        )
    reference, values = (composite_on_black(each).astype(np.float64) for each in (truth, image))
    error = max(float(mean_squared_error(reference, values)), MIN_MSE)
    ssim: Any = structural_similarity
    return Scores(
        mse=error * LEVELS**2,
        psnr=float(-10 * np.log10(error)),
        ssim=float(ssim(reference, values, win_size=SSIM_WINDOW, channel_axis=2, data_range=1)),
        mae=float(np.abs(reference - values).mean() * LEVELS),
    )


def absolute_error(truth: Image, image: Image) -> NDArray[Any]:
    """Return the mean over the channels of the absolute difference, levels of 255, (H, W) float32."""
    return np.asarray(np.abs(composite_on_black(truth) - composite_on_black(image)).mean(axis=2) * np.float32(LEVELS))


def mean(values: Sequence[float]) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def low_percentile(values: Sequence[float]) -> float:
    """Return the 5th percentile, interpolated linearly; of fewer than 20 values it lies between the two lowest."""
    return float(np.percentile(values, LOW_PERCENT))


def means(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the `mean` of every figure."""
    return {key: mean([row[key] for row in rows]) for key in rows[0]}


MIN_SHARE = 0.02
"""Smallest share of the picture of an area that is shown: a few pixels say more about chance than about a method."""

TIMES = {"cpu_seconds": "CPU time", "seconds": "Wall time"}
"""Times of a frame by their names in the data; verdicts go by the first."""

MAX_NAMED = 8  # maximum number of frames that a note names; the data have all of them


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
            notes.append(f"These frames repeat the one before, and are not compared: {_some(self.repeats)}.")
        if self.doubtful:
            notes.append(
                "These hidden frames do not count, since beside repeats, in stills and across pauses the true picture "
                f"is unknown: {_some(self.doubtful)}."
            )
        uneven = [number for number in self.uneven if number not in {*self.cuts, *self.doubtful}]
        if uneven:
            rigid = [name for name, contestant in contestants.items() if not contestant.any_time]
            but = f" (even ones with {', '.join(rigid)})" if rigid else ""
            notes.append(
                f"These hidden frames do not divide the time between the shown ones evenly, and were interpolated at "
                f"their own times{but}: {_some(uneven)}."
            )
        return notes

    def counted(self, method: MethodResult) -> list[FrameResult]:
        """Return the frames of a method that count."""
        left_out = {*self.cuts, *self.doubtful}
        return [frame for frame in method.frames if frame.number not in left_out]

    def means(self, method: MethodResult) -> Scores:
        """Return the mean scores of a method; PSNR as the mean of decibels, as benchmarks have it."""
        return Scores(**means([asdict(frame.scores) for frame in self.counted(method)]))

    def low_psnr(self, method: MethodResult) -> float:
        """Return the 5th percentile of a method's PSNR over the frames that count, dB."""
        return low_percentile([frame.scores.psnr for frame in self.counted(method)])

    def further(self, method: MethodResult) -> dict[str, float]:
        """Return the further metrics of a method by name, means over the frames that count."""
        return means([frame.metrics for frame in self.counted(method)])

    def mean_seconds(self, method: MethodResult) -> dict[str, float]:
        """Return the mean ``seconds`` and ``cpu_seconds`` of a method per frame; NaN if unknown."""
        return means([{name: getattr(frame, name) for name in TIMES} for frame in self.counted(method)])

    @property
    def known_times(self) -> dict[str, str]:
        """Those of `TIMES` that are known of any method."""
        of_methods = [self.mean_seconds(method) for method in self.methods]
        return {name: title for name, title in TIMES.items() if any(np.isfinite(each[name]) for each in of_methods)}

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
