"""Metrics beside PSNR, SSIM and MAE: a table by name, to which a metric is added as one more entry.

Those of `STANDARD` belong to every comparison, and the others are measured where they are asked for. A program of the
user's measures one too (`command_metric`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from importlib.util import find_spec
from typing import Protocol

import numpy as np

from fpsboost.colour import as_shown
from fpsboost.errors import OptionError, choose_one
from fpsboost.evaluation import steadiness
from fpsboost.evaluation.commands import PLACEHOLDERS, PicturesMeter, measure_by_command, split_command
from fpsboost.evaluation.hidden_frames import HeldOutFrame, Interval
from fpsboost.evaluation.results import LEVELS, Column, absolute_error, score
from fpsboost.evaluation.steadiness import FrameMeter
from fpsboost.evaluation.video_metrics import LibvmafMeter, XpsnrMeter, missing_filter, missing_libvmaf
from fpsboost.image import Image

ALWAYS = ("psnr", "psnr_p5", "ssim", "mae")
"""Metrics that every comparison has; naming one has no effect."""

RESERVED = ("name", "clip", "method", "frame", "t", "counted", "seconds", "cpu_seconds", "search_radius")
"""Other columns of the data, after which no metric can be named."""

STANDARD = ("spurious", "missing")
"""Those of `metrics` that every comparison has too: they are visible, and PSNR barely registers them."""


class Meter(Protocol):
    """Contract: measures the frames of one method, in the order of the output."""

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame and the true one; shown frames, which are equal, do not count."""

    def values(self) -> list[float]:
        """Return the metric of every frame that counts; called once, at the end."""


@dataclass(frozen=True)
class Metric(Column):
    """Metric, whose mean over its frames is the figure of a method."""

    start: Callable[[Fraction], Meter]
    """Function that returns a meter for a method, given the clip's frames per second."""
    missing: Callable[[], str | None] = lambda: None
    """Function that returns a description of what must be installed to measure it, or None."""


def flip(truth: Image, image: Image) -> float:
    """Return LDR-FLIP, mean over the pixels: 0 is equal, 1 black beside white.

    Andersson et al. 2020 (doi:10.1145/3406183), by NVIDIA's package ``flip-evaluator`` (``fpsboost[flip]``), at its
    default of 67 pixels a degree: a 4K screen of 0.7 m from 0.7 m away.
    """
    from flip_evaluator import evaluate  # noqa: PLC0415 (an extra, which may be missing)

    return float(evaluate(_as_rgb(truth), _as_rgb(image), "LDR", applyMagma=False)[1])


def missing_flip() -> str | None:
    """Return a description of the package that FLIP needs, for a message; None if it is installed."""
    needed = "the package flip-evaluator; install it with pip install 'fpsboost[flip]'"
    return None if find_spec("flip_evaluator") else needed


def _as_rgb(image: Image) -> np.ndarray:
    """Return sRGB, (H, W, 3) float32 in the order RGB, with 1.0 for white."""
    return np.ascontiguousarray(as_shown(image)[..., ::-1]).astype(np.float32) / np.float32(255)


metrics: dict[str, Metric] = {
    "flip": Metric(
        "FLIP",
        "",
        4,
        False,
        "FLIP is NVIDIA's LDR-FLIP (Andersson et al. 2020), mean over pixels at 67 pixels a degree, 0 is equal.",
        lambda rate: FrameMeter(flip),
        missing_flip,
    ),
    "xpsnr": Metric(
        "XPSNR",
        "dB",
        2,
        True,
        "XPSNR is that of luma by FFmpeg's filter (Helmrich et al. 2020), mean of decibels over frames, higher is "
        "better; equal frames count as 120 dB.",
        XpsnrMeter,
        lambda: missing_filter("xpsnr"),
    ),
    "vmaf": Metric(
        "VMAF",
        "",
        2,
        True,
        "VMAF is Netflix's, 0 to 100 for equal, by libvmaf, mean over the made frames; it was made to judge how videos "
        "are coded, not frames between others.",
        lambda rate: LibvmafMeter("vmaf"),
        missing_libvmaf,
    ),
    "psnr_hvs": Metric(
        "PSNR-HVS",
        "dB",
        2,
        True,
        "PSNR-HVS is PSNR of what eyes see in blocks of 8x8 (Egiazarian et al. 2006), by libvmaf, mean of decibels "
        "over the made frames; it was made to judge how pictures are coded, not frames between others.",
        lambda rate: LibvmafMeter("psnr_hvs"),
        missing_libvmaf,
    ),
    "mse": Metric(
        "MSE",
        "levels²",
        1,
        False,
        "MSE is the mean squared error over pixels and colours, in levels of 255 squared.",
        lambda rate: FrameMeter(lambda truth, image: score(truth, image).mse),
    ),
    "motion_smoothness": Metric(
        "Motion smoothness",
        "",
        4,
        True,
        "Motion smoothness is 1 less the mean absolute error as a share of white, as VBench computes it from AMT's "
        "frames: 1 is motion that the method predicts exactly, or none.",
        lambda rate: FrameMeter(
            lambda truth, image: 1 - float(absolute_error(truth, image).mean(dtype=float)) / LEVELS
        ),
    ),
    "wrong": Metric(
        "Wrong",
        "per mille",
        2,
        False,
        "Wrong is the area, per mille, that is off by more than 24 levels at a quarter of the size: what is "
        "seen from afar.",
        lambda rate: FrameMeter(steadiness.wrong_area),
    ),
    "spurious": Metric(
        "Spurious",
        "levels/100",
        2,
        False,
        "Spurious is the strength of edges that the true frame has nowhere near, levels/100: torn shapes and ghosts.",
        lambda rate: FrameMeter(steadiness.spurious_edges),
    ),
    "missing": Metric(
        "Missing",
        "levels/100",
        2,
        False,
        "Missing is the same of true edges that the interpolated frame lacks: what was smeared or lost.",
        lambda rate: FrameMeter(steadiness.missing_edges),
    ),
    "flicker": Metric(
        "Flicker",
        "levels",
        2,
        False,
        "Flicker is by how much interpolated frames differ from originals in brightness, noise and sharpness, all "
        "frames in the same way, levels: what pulses.",
        lambda rate: steadiness.FlickerMeter(),
    ),
    "steps": Metric(
        "Uneven steps",
        "%",
        1,
        False,
        "Uneven steps are changes of the motion from frame to frame beyond the true ones, percent of the path: 0 is as "
        "even as the truth, 100 a frame that repeats another.",
        lambda rate: steadiness.StepMeter(),
    ),
    "psnr_div": Metric(
        "PSNR_DIV",
        "dB",
        2,
        True,
        "PSNR_DIV is PSNR of the luma where the motion of the output diverges (Daly et al. 2025), mean of decibels "
        "over frames: errors of torn and doubled shapes, and not of the rest.",
        lambda rate: steadiness.DivergenceMeter(),
    ),
}
"""Metrics by name."""


def choose_metrics(texts: Sequence[str]) -> dict[str, Metric]:
    """Parse names of metrics separated by commas; return those of `metrics` by name, each once.

    Raises `OptionError` for an unknown metric, or one that cannot be measured here.
    """
    names = [name.strip() for text in texts for name in text.split(",")]
    for name in names:
        if name not in metrics and name not in ALWAYS:
            raise OptionError(f"There is no metric {name!r}; {choose_one(name, [*ALWAYS, *metrics])}")
        missing = metrics[name].missing() if name in metrics else None
        if missing is not None:
            raise OptionError(f"`metrics={name}` needs {missing}.")
    return {name: metrics[name] for name in names if name in metrics}


def command_metric(name: str, command: str, *, high_is_good: bool) -> Metric:
    """Return a metric that a program of the user's measures.

    Parameters
    ----------
    name : str
        Name of the metric in tables and data: a word that none of their columns has.
    command : str
        Command with ``{truth}`` and ``{made}`` for two folders of pictures, which prints a number for each, or one in
        all; see `docs/comparison.md`.
    high_is_good : bool
        Whether larger numbers are better.

    Raises
    ------
    OptionError
        The name cannot be that of a metric, or the command cannot be parsed.

    Examples
    --------
    >>> command_metric("lpips", "python lpips.py {truth} {made}", high_is_good=False).meaning
    'lpips is what `python lpips.py {truth} {made}` prints, lower is better.'
    """
    if name in {*ALWAYS, *metrics, *RESERVED} or not name.isidentifier():
        raise OptionError(f"`metric` {name!r} is taken, or no word; choose a different name.")
    words = split_command("metric", name, command, PLACEHOLDERS)
    meaning = f"{name} is what `{command}` prints, {'higher' if high_is_good else 'lower'} is better."
    measure = partial(measure_by_command, name, words)
    return Metric(name, "", 4, high_is_good, meaning, lambda rate: PicturesMeter(measure))


class Meters:
    """Meters of one method by the names of its metrics, fed with the output in its order."""

    def __init__(self, chosen: Mapping[str, Metric], rate: Fraction) -> None:
        self._meters = {name: metric.start(rate) for name, metric in chosen.items()}

    def passing(self, intervals: Iterator[Interval]) -> Iterator[HeldOutFrame]:
        """Yield the hidden frames of a clip in order; each must be passed to `add` before the next one is taken."""
        last: Interval | None = None
        for last in intervals:
            self.add(last.shown0.frame.array, last.shown0.frame.array, counts=False)
            yield from last.hidden
        if last is not None:
            self.add(last.shown1.frame.array, last.shown1.frame.array, counts=False)

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame to all meters."""
        for meter in self._meters.values():
            meter.add(truth, image, counts=counts)

    def values(self, frames: int) -> list[dict[str, float]]:
        """Return the metrics of each of the interpolated frames, `frames` in number, by name."""
        columns = {name: meter.values() for name, meter in self._meters.items()}
        return [{name: column[place] for name, column in columns.items()} for place in range(frames)]
