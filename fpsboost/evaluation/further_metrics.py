"""Metrics beside PSNR, SSIM, MAE and MSE: a table by name, to which a metric is added as one more entry."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import as_shown
from fpsboost.errors import OptionError
from fpsboost.evaluation.filter_metrics import VmafMeter, XpsnrMeter, missing_filter
from fpsboost.evaluation.hidden_frames import Hidden, Interval
from fpsboost.image import Image

ALWAYS = ("psnr", "psnr_p5", "ssim", "mae", "mse")
"""Metrics that every comparison has; naming one changes nothing."""


class Meter(Protocol):
    """Contract: measures the frames of one method, in the order of the output."""

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame and the true one; those that methods are shown, which are equal, do not count."""

    def values(self) -> list[float]:
        """Return the metric of every frame that counts; called once, at the end."""


@dataclass(frozen=True)
class Metric:
    """A metric, of which a method has the mean over its frames."""

    title: str
    unit: str
    digits: int
    """Decimals in tables."""
    high_is_good: bool
    start: Callable[[Fraction], Meter]
    """Function that returns a meter for a method, given the clip's frames per second."""
    meaning: str
    """Sentence for a reader of the tables."""
    missing: Callable[[], str | None]
    """Function that returns what must be installed to measure it, or None."""


class FlipMeter:
    """Meter of LDR-FLIP, mean over the pixels: 0 is equal, 1 black beside white.

    Andersson et al. 2020 (doi:10.1145/3406183), by NVIDIA's package ``flip-evaluator`` (``fpsboost[flip]``), at its
    default of 67 pixels a degree: a 4K screen of 0.7 m from 0.7 m away.
    """

    def __init__(self) -> None:
        self._values: list[float] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        if counts:
            from flip_evaluator import evaluate  # noqa: PLC0415 (an extra, which may be missing)

            _, mean, _ = evaluate(_as_rgb(truth), _as_rgb(image), "LDR", applyMagma=False)
            self._values.append(float(mean))

    def values(self) -> list[float]:
        return self._values

    @staticmethod
    def missing() -> str | None:
        if find_spec("flip_evaluator"):
            return None
        return "the package flip-evaluator; install it with pip install 'fpsboost[flip]'"


def _as_rgb(image: Image) -> NDArray[Any]:
    """Return sRGB, (H, W, 3) float32 with 1.0 for white."""
    return np.ascontiguousarray(as_shown(image)[..., ::-1]).astype(np.float32) / np.float32(255)


metrics: dict[str, Metric] = {
    "flip": Metric(
        *("FLIP", "", 4, False),
        lambda rate: FlipMeter(),
        "FLIP is NVIDIA's LDR-FLIP (Andersson et al. 2020), mean over pixels at 67 pixels a degree, 0 is equal.",
        FlipMeter.missing,
    ),
    "xpsnr": Metric(
        *("XPSNR", "dB", 2, True),
        XpsnrMeter,
        "XPSNR is that of luma by FFmpeg's filter (Helmrich et al. 2020), mean of decibels over frames, higher is "
        "better; equal frames count as 120 dB.",
        lambda: missing_filter("xpsnr"),
    ),
    "vmaf": Metric(
        *("VMAF", "", 2, True),
        VmafMeter,
        "VMAF is Netflix's, 0 to 100 for equal, by FFmpeg's filter libvmaf, mean over the made frames; it was trained "
        "on coded videos and not on frames between others.",
        lambda: missing_filter("libvmaf"),
    ),
}
"""Metrics by name."""


def choose_metrics(texts: Sequence[str]) -> tuple[str, ...]:
    """Read names of metrics with commas between them; return those of `metrics`, each once."""
    names = [name.strip() for text in texts for name in text.split(",")]
    for name in names:
        if name not in metrics and name not in ALWAYS:
            raise OptionError(f"There is no metric {name!r}; choose from {', '.join([*ALWAYS, *metrics])}.")
        reason = metrics[name].missing() if name in metrics else None
        if reason is not None:
            raise OptionError(f"`metrics={name}` needs {reason}.")
    return tuple(dict.fromkeys(name for name in names if name in metrics))


class Meters:
    """Meters of one method by the names of its metrics, fed with the output in its order."""

    def __init__(self, names: Sequence[str], rate: Fraction) -> None:
        self._meters = {name: metrics[name].start(rate) for name in names}

    def passing(self, intervals: Iterator[Interval]) -> Iterator[Hidden]:
        """Yield the hidden frames of a clip in order; each must be passed to `add` before the next one is taken."""
        last: Interval | None = None
        for last in intervals:
            self.add(last.shown0.array, last.shown0.array, counts=False)
            yield from last.hidden
        if last is not None:
            self.add(last.shown1.array, last.shown1.array, counts=False)

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        for meter in self._meters.values():
            meter.add(truth, image, counts=counts)

    def values(self, frames: int) -> list[dict[str, float]]:
        """Return the metrics of each of so many interpolated frames by name."""
        columns = {name: meter.values() for name, meter in self._meters.items()}
        return [{name: column[place] for name, column in columns.items()} for place in range(frames)]
