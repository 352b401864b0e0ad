"""Metrics beside PSNR, SSIM and MAE: a table by name, to which a metric is added as one more entry.

Those of `STANDARD` belong to every comparison, and the others are measured where they are asked for.

XPSNR and VMAF are filters of two videos, in the FFmpeg libraries of PyAV. Both use frames before and after, so they get
the whole output and the whole original, including shown frames; values of those, which are equal, are left out.
Pictures are YCbCr of 4:4:4, limited range and 8 bits, by the usual matrix for their size.
"""

import gc
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import av.filter
import numpy as np

from fpsboost.colour import as_shown, composite_on_black, has_alpha
from fpsboost.errors import InputError, OptionError, choose_one
from fpsboost.evaluation import steadiness
from fpsboost.evaluation.hidden_frames import HeldOutFrame, Interval
from fpsboost.evaluation.results import LEVELS, absolute_error, score
from fpsboost.evaluation.steadiness import FrameMeter
from fpsboost.image import Image
from fpsboost.io.video.ycc import from_bgr
from fpsboost.media import assumed_color_space, pulled

HIGHEST = 120.0
"""XPSNR of equal frames, dB, the same as their PSNR; infinity would have no mean."""

PIXEL_FORMAT = "yuv444p"
"""Pixel format of both videos; deeper ones are misread by ``xpsnr`` (FFmpeg 8.1), which takes rows to be unpadded."""

MULTIPLE = 4
"""Side of the blocks of ``xpsnr``, pixels; a lone last row or column has far too much weight, and may lie behind it."""

MIN_PIXELS = 2025
"""Number of pixels of a frame below which ``xpsnr`` chooses blocks of no size, and divides by it."""

MIN_SIDE = 32
"""Side of a frame below which ``xpsnr`` may see no error, pixels: in a lone column of blocks it sees none."""


def missing_filter(name: str) -> str | None:
    """Return a description of a filter that FFmpeg lacks, for a message; None if it is there."""
    lacking = f"the filter {name}, which the FFmpeg of this PyAV ({av.__version__}) was built without"
    return None if name in av.filter.filters_available else lacking


class _FilterMeter:
    """Meter by a filter of FFmpeg that compares two videos; values of interpolated frames count.

    It gets every frame. The graph is built for the size of the first one.
    """

    def __init__(self, rate: Fraction, filter_name: str, options: dict[str, str]) -> None:
        self._clock = Fraction(1, max(1, round(rate)))
        self._filter_name = filter_name
        self._options = options
        self._graph = av.filter.Graph()
        self._entries: list[av.filter.FilterContext] = []
        self._counts: list[bool] = []

    def _push(self, first: Image, second: Image, *, counts: bool) -> list[av.VideoFrame]:
        """Add two frames of one time, and return the pictures that the filter outputs."""
        height, width = first.shape[:2]
        if not self._entries:
            self._build(width, height)
        for entry, image in zip(self._entries, (first, second), strict=True):
            if has_alpha(image):  # colours count as far as they are seen, as in the other scores
                image = composite_on_black(image)[..., :-1]  # noqa: PLW2901
            picture = from_bgr(image, PIXEL_FORMAT, assumed_color_space(height), full_range=False)
            picture.pts = len(self._counts)
            picture.time_base = self._clock
            entry.push(picture)
        self._counts.append(counts)
        return list(pulled(self._graph))

    def _build(self, width: int, height: int) -> None:
        """Build the graph for frames of a size."""
        picture = {
            "video_size": f"{width}x{height}",
            "pix_fmt": PIXEL_FORMAT,
            "time_base": str(self._clock),
            "frame_rate": str(1 / self._clock),
            "pixel_aspect": "1/1",
        }
        comparing = self._graph.add(self._filter_name, **self._options)
        self._entries = [self._graph.add("buffer", **picture) for _ in range(2)]
        for place, entry in enumerate(self._entries):
            entry.link_to(comparing, 0, place)
        comparing.link_to(self._graph.add("buffersink"))
        self._graph.configure()

    def _end(self) -> list[av.VideoFrame]:
        """End both videos, free the graph, and return the last pictures."""
        for entry in self._entries:
            entry.push(None)
        pictures = list(pulled(self._graph)) if self._entries else []
        self._graph = av.filter.Graph()
        self._entries = []
        return pictures

    def _counted(self, values: list[float]) -> list[float]:
        """Return the values of the frames that count."""
        return [value for value, counts in zip(values, self._counts, strict=True) if counts]


class XpsnrMeter(_FilterMeter):
    """Meter of XPSNR of luma, dB: PSNR with errors weighted by their visibility.

    Helmrich et al. 2020 (doi:10.1109/ICASSP40776.2020.9054089), in FFmpeg's filter ``xpsnr``: blocks are weighted by
    the activity of the true video in space and time, in time by second differences from 32 frames per second on. Up to
    three rows at the bottom and columns at the right are left out, so that the sides are multiples of 4.
    """

    def __init__(self, rate: Fraction) -> None:
        super().__init__(rate, "xpsnr", {})
        self._values: list[float] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame; raises `InputError` if it is too small for the filter."""
        height, width = (side - side % MULTIPLE for side in truth.shape[:2])
        if min(height, width) < MIN_SIDE or height * width < MIN_PIXELS:
            raise InputError(
                f"Frames of {truth.shape[1]}x{truth.shape[0]} are too small for XPSNR, which needs {MIN_SIDE} "
                f"pixels each way and {MIN_PIXELS} in all; leave xpsnr out of `metrics`."
            )
        truth, image = (np.ascontiguousarray(each[:height, :width]) for each in (truth, image))
        self._keep(self._push(truth, image, counts=counts))

    def _keep(self, pictures: list[av.VideoFrame]) -> None:
        """Store the values of pictures that the filter has output, limited to `HIGHEST`."""
        self._values += [min(float(each.metadata["lavfi.xpsnr.xpsnr.y"]), HIGHEST) for each in pictures]

    def values(self) -> list[float]:
        """Return the XPSNR of each frame that counts, dB."""
        self._keep(self._end())
        return self._counted(self._values)


class VmafMeter(_FilterMeter):
    """Meter of VMAF, 0 to 100, by Netflix's model ``vmaf_v0.6.1`` in FFmpeg's filter ``libvmaf``.

    It was trained on ratings of compressed videos on a 1080p screen at three times its height.
    """

    def __init__(self, rate: Fraction) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="fpsboost-")
        self._log = Path(self._scratch.name, "vmaf.json")
        super().__init__(rate, "libvmaf", {"log_path": str(self._log), "log_fmt": "json"})

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame."""
        self._push(image, truth, counts=counts)  # unlike xpsnr, it takes the reference second

    def values(self) -> list[float]:
        """Return the VMAF of each frame that counts."""
        self._end()
        gc.collect()  # libvmaf writes its log when it is freed; PyAV's filters and their graph hold each other
        values = read_vmaf(self._log.read_text(encoding="utf-8"))
        self._scratch.cleanup()
        return self._counted(values)


def read_vmaf(log: str) -> list[float]:
    """Return the VMAF of every frame, in order, from libvmaf's log in JSON."""
    frames = sorted(json.loads(log)["frames"], key=lambda frame: int(frame["frameNum"]))
    return [float(frame["metrics"]["vmaf"]) for frame in frames]


ALWAYS = ("psnr", "psnr_p5", "ssim", "mae")
"""Metrics that every comparison has; naming one has no effect."""

STANDARD = ("spurious", "missing")
"""Those of `metrics` that every comparison has too: they are visible, and PSNR barely registers them."""


class Meter(Protocol):
    """Contract: measures the frames of one method, in the order of the output."""

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame and the true one; shown frames, which are equal, do not count."""

    def values(self) -> list[float]:
        """Return the metric of every frame that counts; called once, at the end."""


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
        "VMAF is Netflix's, 0 to 100 for equal, by FFmpeg's filter libvmaf, mean over the made frames; it was trained "
        "on coded videos and not on frames between others.",
        VmafMeter,
        lambda: missing_filter("libvmaf"),
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


def choose_metrics(texts: Sequence[str]) -> tuple[str, ...]:
    """Parse names of metrics separated by commas; return those of `metrics`, each once.

    Raises `OptionError` for an unknown metric, or one that cannot be measured here.
    """
    names = [name.strip() for text in texts for name in text.split(",")]
    for name in names:
        if name not in metrics and name not in ALWAYS:
            raise OptionError(f"There is no metric {name!r}; {choose_one(name, [*ALWAYS, *metrics])}")
        missing = metrics[name].missing() if name in metrics else None
        if missing is not None:
            raise OptionError(f"`metrics={name}` needs {missing}.")
    return tuple(dict.fromkeys(name for name in names if name in metrics))


class Meters:
    """Meters of one method by the names of its metrics, fed with the output in its order."""

    def __init__(self, names: Sequence[str], rate: Fraction) -> None:
        self._meters = {name: metrics[name].start(rate) for name in names}

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
