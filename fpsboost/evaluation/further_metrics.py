"""What can be measured beside PSNR, SSIM, MAE and MSE: a table by name, each with what it is and what it is not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, Protocol

from fpsboost.errors import OptionError
from fpsboost.evaluation import flip_metric
from fpsboost.evaluation.filter_metrics import VmafMeter, XpsnrMeter, missing_filter
from fpsboost.evaluation.grid_metric import PERIODS, GridMeter, grid_ratios
from fpsboost.evaluation.hiding import Hidden, Interval
from fpsboost.evaluation.metrics import means
from fpsboost.evaluation.temporal_metrics import DifferenceMeter, FlowMeter
from fpsboost.frame import Image

ALWAYS = ("psnr", "psnr_p5", "ssim", "mae", "mse")
"""What every comparison measures; naming it changes nothing."""


class Meter(Protocol):
    """Contract: measures what one method made, frame by frame, in the order of the output."""

    def shown(self, image: Image) -> None:
        """Add a frame that methods get to see to the output; the first and the last are such."""
        ...

    def made(self, truth: Image, made: Image) -> None:
        """Add a made frame to the output, with the true one."""
        ...

    def values(self) -> list[dict[str, float]]:
        """Asked once, at the end: what was measured of each made frame, by name."""
        ...


class Figure(NamedTuple):
    """A number that tables show of each method."""

    name: str
    title: str
    unit: str
    digits: int
    high_is_good: bool


@dataclass(frozen=True)
class Metric:
    """Something that can be measured.

    Attributes
    ----------
    figures : tuple of Figure
        What a method gets.
    start : callable
        Makes a meter for a method, given the clip's frames per second.
    meaning : str
        What the figures are, in sentences for a reader of the tables.
    summarise : callable
        Makes the figures of what was measured frame by frame.
    missing : callable
        What there must be to measure it and is not, or None.
    """

    figures: tuple[Figure, ...]
    start: Callable[[Fraction], Meter]
    meaning: str
    summarise: Callable[[Sequence[Mapping[str, float]]], dict[str, float]] = means
    missing: Callable[[], str | None] = lambda: None

    @property
    def of_frames(self) -> tuple[Figure, ...]:
        """The figures that single frames have as well."""
        return self.figures if self.summarise is means else ()


metrics: dict[str, Metric] = {
    "dtssd": Metric(
        (Figure("dtssd", "dtSSD", "levels", 2, False),),
        lambda rate: DifferenceMeter(),
        "dtSSD is the root mean square error of the change from the output's frame before, in levels of 255 (after "
        "Erofeev et al. 2015); with one frame hidden between two it is the root of each frame's MSE and tells nothing "
        "new.",
    ),
    "tof": Metric(
        (Figure("tof", "tOF", "pixels", 3, False),),
        lambda rate: FlowMeter(),
        "tOF is the mean distance in pixels of the optical flow (Farnebäck) from the output's frame before to the "
        "made one, from that between the true two (Chu et al. 2020); it sees wrong places and hardly blur.",
    ),
    "flip": Metric(
        (Figure("flip", "FLIP", "", 4, False),),
        lambda rate: flip_metric.FlipMeter(),
        "FLIP is NVIDIA's LDR-FLIP (Andersson et al. 2020), mean over pixels at 67 pixels a degree, 0 is equal.",
        missing=flip_metric.missing,
    ),
    "xpsnr": Metric(
        (Figure("xpsnr", "XPSNR", "dB", 2, True),),
        XpsnrMeter,
        "XPSNR is that of luma by FFmpeg's filter (Helmrich et al. 2020), mean of decibels over frames, higher is "
        "better; equal frames count as 120 dB.",
        missing=lambda: missing_filter("xpsnr"),
    ),
    "vmaf": Metric(
        (Figure("vmaf", "VMAF", "", 2, True),),
        VmafMeter,
        "VMAF is Netflix's, 0 to 100 for equal, by FFmpeg's filter libvmaf, mean over the made frames; it was trained "
        "on coded videos and not on frames between others.",
        missing=lambda: missing_filter("libvmaf"),
    ),
    "grid": Metric(
        tuple(Figure(f"grid{period}", f"Grid {period}", "ratio", 2, False) for period in PERIODS),
        lambda rate: GridMeter(),
        f"Grid {', '.join(map(str, PERIODS[:-1]))} and {PERIODS[-1]} are edges of blocks: steps, where a frame is "
        "wrong, on the lines of a grid of that period over those half-way between; 1 or less is no grid, and few steps "
        "are chance.",
        summarise=grid_ratios,
    ),
}
"""Metrics by name."""


def choose_metrics(texts: Sequence[str]) -> tuple[str, ...]:
    """Read the names of metrics, with commas between them.

    Parameters
    ----------
    texts : sequence of str
        One for each time that the option was given.

    Returns
    -------
    tuple of str
        Names of `metrics`, each once; those that are always measured are left out.

    Raises
    ------
    OptionError
        There is no such metric, or it cannot be measured here, and the message says what is missing.

    Examples
    --------
    >>> choose_metrics(["psnr,tof", "grid,tof"])
    ('tof', 'grid')
    """
    names = [name.strip() for text in texts for name in text.split(",")]
    for name in names:
        if name not in metrics and name not in ALWAYS:
            raise OptionError(f"There is no metric {name!r}; choose from {', '.join([*ALWAYS, *metrics])}.")
        reason = metrics[name].missing() if name in metrics else None
        if reason is not None:
            raise OptionError(f"`metrics={name}` needs {reason}.")
    return tuple(dict.fromkeys(name for name in names if name in metrics))


class Meters:
    """The meters of one method, fed with the output in its order.

    Parameters
    ----------
    names : sequence of str
        Of `metrics`.
    rate : Fraction
        The clip's frames per second.
    """

    def __init__(self, names: Sequence[str], rate: Fraction) -> None:
        self._meters = [metrics[name].start(rate) for name in names]

    def passing(self, intervals: Iterator[Interval]) -> Iterator[Hidden]:
        """Yield the hidden frames of a clip in order; each must have been `made` before the next one is taken."""
        last: Interval | None = None
        for last in intervals:
            self.shown(last.shown0.array)
            yield from last.hidden
        if last is not None:
            self.shown(last.shown1.array)

    def shown(self, image: Image) -> None:
        """See `Meter.shown`."""
        for meter in self._meters:
            meter.shown(image)

    def made(self, truth: Image, made: Image) -> None:
        """See `Meter.made`."""
        for meter in self._meters:
            meter.made(truth, made)

    def values(self, frames: int) -> list[dict[str, float]]:
        """Return what all of them measured of each of so many made frames, by name."""
        rows: list[dict[str, float]] = [{} for _ in range(frames)]
        for meter in self._meters:
            for row, values in zip(rows, meter.values(), strict=True):
                row.update(values)
        return rows


def summarise(names: Sequence[str], rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the figures of a method.

    Parameters
    ----------
    names : sequence of str
        Of `metrics`.
    rows : sequence of mapping
        What was measured of each frame that counts, by all of them.
    """
    return {
        figure.name: summary[figure.name]
        for name in names
        for summary in (metrics[name].summarise(rows),)
        for figure in metrics[name].figures
    }


def figures_of(names: Sequence[str]) -> list[Figure]:
    """Return the figures of these metrics that tables show."""
    return [figure for name in names for figure in metrics[name].figures]
