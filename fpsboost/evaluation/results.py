"""Results of a comparison as data, and the usual metrics of an interpolated frame against the true one.

All kinds of images are compared with 1.0 for white, so that a clip scores alike with 8 bits, 16 bits or as float. MSE
and MAE are given in levels of 255, as tables of 8-bit images have them; colours are weighted by their alpha.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

import numpy as np

from fpsboost.colour import composite_on_black
from fpsboost.errors import InputError
from fpsboost.evaluation.compared_methods import ComparedMethod
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.regions import AREAS
from fpsboost.image import Image

LEVELS = 255
"""Levels of white in which errors are given."""
MIN_MSE = 1e-12
"""Smallest MSE, for white = 1: equal images have a PSNR of 120 dB, as infinity would have no mean."""

SSIM_WINDOW = 7
"""Side of the window of scikit-image's SSIM, pixels."""

LOW_PERCENT = 5
"""Percentile of PSNR over frames that is reported: the worst frames characterize a clip better than the mean."""


@dataclass(frozen=True)
class Scores:
    """Scores of an interpolated frame against the true one."""

    mse: float
    """Mean squared error, levels of 255 squared."""
    psnr: float
    """Peak signal-to-noise ratio, dB; at most 120."""
    ssim: float
    """Structural similarity (Wang et al. 2004, doi:10.1109/TIP.2003.819861) as scikit-image has it by default, mean
    over the channels."""
    mae: float
    """Mean absolute error, levels of 255: what papers call interpolation error."""


def score(truth: Image, image: Image) -> Scores:
    """Compare an interpolated frame with the true one.

    Parameters
    ----------
    truth, image : (H, W, C)
        Two images of one size and type, at least 7 pixels each way.

    Raises
    ------
    InputError
        The images are smaller.

    Examples
    --------
    >>> truth = np.full((8, 8, 3), 100, np.uint8)
    >>> scores = score(truth, truth + np.uint8(5))
    >>> round(scores.mae, 3), round(scores.mse, 3), round(scores.psnr, 2)
    (5.0, 25.0, 34.15)
    """
    if min(truth.shape[:2]) < SSIM_WINDOW:
        raise InputError(
            f"Frames of {truth.shape[1]}x{truth.shape[0]} are too small to be compared; take at least "
            f"{SSIM_WINDOW} pixels each way."
        )
    from skimage.metrics import structural_similarity  # noqa: PLC0415 (it takes a second to import)

    reference, values = (composite_on_black(each).astype(np.float64) for each in (truth, image))
    error = max(float(np.square(reference - values).mean()), MIN_MSE)
    return Scores(
        mse=error * LEVELS**2,
        psnr=float(-10 * np.log10(error)),
        ssim=float(structural_similarity(reference, values, channel_axis=2, data_range=1)),
        mae=float(np.abs(reference - values).mean() * LEVELS),
    )


def absolute_error(truth: Image, image: Image) -> np.ndarray:
    """Return the mean over the channels of the absolute difference, levels of 255, (H, W) float32."""
    return np.asarray(np.abs(composite_on_black(truth) - composite_on_black(image)).mean(axis=2) * np.float32(LEVELS))


def mean(values: Sequence[float]) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def low_percentile(values: Sequence[float]) -> float:
    """Return the 5th percentile, interpolated linearly; of fewer than 20 values it is between the two lowest."""
    return float(np.percentile(values, LOW_PERCENT))


def means(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the `mean` of every figure."""
    return {key: mean([row[key] for row in rows]) for key in rows[0]}


MIN_SHARE = 0.02
"""Smallest share of the picture of an area that is shown: few pixels are dominated by chance."""

TIMES = {"cpu_seconds": "CPU time", "seconds": "Wall time"}
"""Names of the times of a frame, by their names in the data; verdicts use the first."""

MAX_NAMED = 8
"""Maximum number of frames that a note lists; the data have all of them."""


@dataclass(frozen=True)
class Column:
    """Column of a table with a figure for every method."""

    title: str
    """Heading."""
    unit: str
    """Unit of the numbers; empty if they have none."""
    digits: int
    """Decimals of the numbers."""
    high_is_good: bool
    """Whether larger numbers are better."""
    meaning: str
    """Sentence for a reader of the tables."""


@dataclass(frozen=True)
class FrameResult:
    """Scores of one frame of a method."""

    number: int
    """Number of the frame in the clip."""
    scores: Scores
    """PSNR, SSIM, MAE and MSE."""
    seconds: float
    """Elapsed time, seconds; NaN if unknown."""
    cpu_seconds: float
    """CPU time, seconds; NaN if unknown."""
    inside: dict[str, float]
    """Mean absolute error inside of each area of `fpsboost.evaluation.regions.AREAS`, levels of 255; NaN for an empty
    one."""
    outside: dict[str, float]
    """The same outside of each area."""
    search_radius: int | None = None
    """Search radius of the motion, pixels; None if the method has none."""
    metrics: dict[str, float] = field(default_factory=dict)
    """Further metrics by name."""


@dataclass(frozen=True)
class MethodResult:
    """Scores of one method on all hidden frames, in order, including those that do not count."""

    name: str
    options: str
    """Description of the method by `ComparedMethod.describe`."""
    frames: list[FrameResult]
    """Scores of the frames."""


@dataclass(frozen=True)
class Comparison:
    """Everything that a report contains."""

    clip: str
    """Path of the clip."""
    kind: str
    """Size and type of the frames: ``640x360, 3 channels, 8-bit``."""
    hold_out: HoldOut
    """Choice of the hidden frames."""
    hidden: list[int]
    """Numbers of the hidden frames."""
    cuts: list[int]
    """Hidden frames across a scene cut, which no method can reconstruct: means leave them out."""
    shares: dict[str, float]
    """Mean share of the picture of each area."""
    methods: list[MethodResult]
    """Results of the methods, in the order in which they were given."""
    skipped: dict[str, str]
    """Methods that could not be run, with the reason."""
    made_with: dict[str, str] = field(default_factory=dict)
    """Versions and machine."""
    rendered: tuple[str, ...] = ()
    """Options for a renderer's vectors, as words of the command line."""
    others: tuple[str, ...] = ()
    """Options for other tools' frames, as words of the command line."""
    cut_options: tuple[str, ...] = ()
    """Options for scene cuts, as words of the command line."""
    times: list[float] = field(default_factory=list)
    """Position in time of each hidden frame between the two shown ones, 0 to 1."""
    repeats: list[int] = field(default_factory=list)
    """Numbers of frames that repeat the one before: neither shown nor a truth, unless in a still."""
    doubtful: list[int] = field(default_factory=list)
    """Hidden frames whose true pictures are unknown, most often beside repeats; see
    `fpsboost.evaluation.hidden_frames.HoldOut`. Means leave them out."""
    clip_frames: int = 0
    """Number of frames from the first shown one to the last."""
    metrics: Mapping[str, Column] = field(default_factory=dict)
    """Further metrics by name, in the order of the tables."""

    @property
    def areas(self) -> list[tuple[str, str]]:
        """Areas that are large enough to be shown, each with its complement, which is large enough too."""
        return [pair for pair in AREAS.items() if MIN_SHARE <= self.shares[pair[0]] <= 1 - MIN_SHARE]

    @property
    def uneven(self) -> list[int]:
        """Hidden frames that do not divide the time between the shown ones evenly."""
        skip = self.hold_out.skip
        timed = enumerate(zip(self.hidden, self.times, strict=False))
        return [number for place, (number, t) in timed if t != (place % skip + 1) / (skip + 1)]

    def counted(self, method: MethodResult) -> list[FrameResult]:
        """Return the frames of a method that count."""
        left_out = {*self.cuts, *self.doubtful}
        return [frame for frame in method.frames if frame.number not in left_out]

    def means(self, method: MethodResult) -> dict[str, float]:
        """Return the mean scores and seconds of a method by name, and the 5th percentile of its PSNR, ``psnr_p5``.

        PSNR is the mean of decibels, as benchmarks have it; unknown seconds are NaN.
        """
        frames = self.counted(method)
        scores = means([asdict(frame.scores) for frame in frames])
        low_psnr = low_percentile([frame.scores.psnr for frame in frames])
        seconds = means([{name: getattr(frame, name) for name in TIMES} for frame in frames])
        return {**scores, "psnr_p5": low_psnr, **seconds}

    def further(self, method: MethodResult) -> dict[str, float]:
        """Return the further metrics of a method by name, means over the frames that count."""
        return means([frame.metrics for frame in self.counted(method)])

    @property
    def known_times(self) -> dict[str, str]:
        """Entries of `TIMES` that are known for at least one method."""
        of_methods = [self.means(method) for method in self.methods]
        return {name: title for name, title in TIMES.items() if any(np.isfinite(each[name]) for each in of_methods)}

    def mean_error(self, method: MethodResult, area: str, inside: bool = True) -> float:
        """Return the mean absolute error of a method in an area or outside of it, levels of 255."""
        frames = self.counted(method)
        return mean([(frame.inside if inside else frame.outside)[area] for frame in frames])


class ComparedClip(NamedTuple):
    """A comparison, and its methods by name, which can interpolate some frames again."""

    comparison: Comparison
    compared_methods: Mapping[str, ComparedMethod]
    """Methods by name, in the order of the comparison."""

    def notes(self) -> list[str]:
        """Return sentences about duplicates and times without which the figures would be misunderstood."""
        repeats = self.comparison.repeats
        doubtful = self.comparison.doubtful
        uneven = [number for number in self.comparison.uneven if number not in {*self.comparison.cuts, *doubtful}]
        notes = list[str]()
        if repeats:
            notes.append(f"These frames repeat the one before, and are not compared: {_some(repeats)}.")
        if doubtful:
            notes.append(
                "These hidden frames do not count, since beside repeats, in stills and across pauses the true picture "
                f"is unknown: {_some(doubtful)}."
            )
        if uneven:
            rigid = [name for name, compared_method in self.compared_methods.items() if not compared_method.any_time]
            but = f" (even ones with {', '.join(rigid)})" if rigid else ""
            notes.append(
                "These hidden frames do not divide the time between the shown ones evenly, and were interpolated at "
                f"their own times{but}: {_some(uneven)}."
            )
        return notes


def _some(numbers: Sequence[int]) -> str:
    """Return the first of many numbers as text, and how many more there are."""
    named = ", ".join(map(str, numbers[:MAX_NAMED]))
    more = len(numbers) - MAX_NAMED
    return f"{named} and {more} more" if more > 0 else named
