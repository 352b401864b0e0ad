"""The report's section 4 as a tool: search radius, patch radius with window, and v by trial on a few frames.

One after the other, each with the best of those before: the search radius, around the one that is chosen without
being told; the size of the patch with and without the Gaussian (the report's Figure 7); then v. The radius comes first
because a wrong one hides what the others do: too small, and the motion is not among the candidates; too large, and
wrong matches decide. The frames are chosen for their motion. What a method refuses is not tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.analysis.scene_cuts import CutDetector
from fpsboost.errors import InputError, OptionError, OutputError
from fpsboost.evaluation.compare import Observer
from fpsboost.evaluation.contestants import InterpolatorContestant
from fpsboost.evaluation.hidden_frames import Hiding, Sample, read_samples
from fpsboost.evaluation.results import mean, score
from fpsboost.interpolator import Interpolator
from fpsboost.io.new_output import write_whole
from fpsboost.method_table import configure, find_method, methods
from fpsboost.motion.exhaustive import choose_search_radius, expected_motion

DEFAULT = "nlm"
"""Method that every other one is measured by."""

RADII = (1, 2, 3, 5, 7, 10, 14)
WINDOWS = ("box", "gaussian")
WIDTHS = (0.05, 0.09, 0.15, 0.25, 0.4)
STEP = math.sqrt(2)
"""Factor from one search radius to the next, which doubles the cost."""

IN_VAIN = 2  # number of search radii in a row, none better than those before, after which no farther one is tried

AS_GOOD = 1.005
"""Ratio of an error to the least up to which it is as good; the smaller value, which costs less, is then taken."""


CURVE_COLOURS = {"box": "#0072b2", "gaussian": "#e69f00", "": "#0072b2"}
CURVE_LABELS = {"box": "box", "gaussian": "Gaussian", "": ""}
FORMATS = (".svg", ".png", ".pdf")


@dataclass(frozen=True)
class Trial:
    """Result of one setting."""

    options: dict[str, Any]
    mse: float
    """Mean squared error over the frames, levels of 255 squared."""
    cpu_seconds: float


@dataclass(frozen=True)
class Tuning:
    """Trials on some frames of a clip."""

    clip: str
    method: str
    frames: list[int]
    sweeps: dict[str, list[Trial]]
    """Trials by the option that was swept: ``search_radius``, where the method has one; ``patch_radius``, with each
    window where it has several; ``v``."""
    best: Trial
    default: Trial
    """Trial of the default method, untuned, on the same frames."""


def tune(path: str, method: str, hiding: Hiding, count: int, observer: Observer) -> Tuning:
    """Sweep the parameters of a method, whose estimator has a patch radius, on `count` frames of a clip."""
    if count < 1:
        raise OptionError(f"`frames` must be at least 1, not {count}.")
    interpolator = find_method(method)
    known = {field.name for field in fields(interpolator.estimator)}  # type: ignore[arg-type]
    if "patch_radius" not in known:
        raise OptionError(f"The method {method!r} has no patch to tune; take nlm or nlm-exhaustive.")
    observer.begin("reading", None)
    samples = choose_frames(path, hiding, count, observer)
    tuner = _Tuner(interpolator, method, samples, observer)
    best: dict[str, Any] = {}
    sweeps: dict[str, list[Trial]] = {}
    if "search_radius" in known:
        usual = max(choose_search_radius(*sample.interval.prepared()) for sample in samples)
        observer.begin("search radius", None)
        sweeps["search_radius"] = sweep_around(usual, lambda radius: tuner.attempt({"search_radius": radius}))
        best = _best(sweeps["search_radius"]).options
    for name, settings in (("patch_radius", patches(known)), ("v", [{"v": width} for width in WIDTHS])):
        accepted = tuner.accepted([{**best, **each} for each in settings])
        observer.begin(name.replace("_", " "), len(accepted) * len(samples))
        sweeps[name] = [trial for trial in map(tuner.attempt, accepted) if trial is not None]
        best = _best(sweeps[name]).options
    observer.begin(DEFAULT, len(samples))
    default = _Tuner(methods[DEFAULT], DEFAULT, samples, observer).attempt({})
    assert default is not None
    return Tuning(path, method, [each.hidden.number for each in samples], sweeps, _best(sweeps["v"]), default)


def choose_frames(path: str, hiding: Hiding, count: int, observer: Observer) -> list[Sample]:
    """Return hidden frames whose motion is spread evenly from the middle of the clip's to its largest.

    Frames across a scene cut are left out, as long as there are others, and so are those that do not count.
    """
    motions: list[tuple[float, int]] = []
    match_scores: list[float] = []
    known: list[bool] = []
    for interval in hiding.intervals(path):
        image0, image1 = interval.prepared()
        motion = expected_motion(image0, image1)
        middle = interval.hidden[len(interval.hidden) // 2].number
        motions.append((motion, middle))
        known.append(interval.is_known)
        match_scores.append(methods["nlm"].pair(image0, image1).match_score)
        observer.advance()
    cuts = CutDetector().find_cuts(match_scores)
    fair = [(each, cut) for each, cut, is_known in zip(motions, cuts, known, strict=True) if is_known]
    if not fair:
        raise InputError(
            f"{path} has no hidden frame to tune on that is no repeat and beside none; choose another part of it, or "
            "take repeats for truth with `duplicates='keep'`."
        )
    usable = [each for each, cut in fair if not cut] or [each for each, _ in fair]
    ranked = [number for _, number in sorted(usable)]
    places = np.linspace(len(ranked) - 1, (len(ranked) - 1) // 2, min(count, len(ranked)))
    return read_samples(path, hiding, sorted({ranked[round(place)] for place in places.tolist()}))


def patches(known: Container[str]) -> list[dict[str, Any]]:
    """Return every patch radius, with every window if the method has one, the cheap ones first."""
    windows: Sequence[Mapping[str, Any]] = [{"window": name} for name in WINDOWS] if "window" in known else [{}]
    return [{"patch_radius": radius, **window} for window in windows for radius in RADII]


def sweep_around(usual: int, attempt: Callable[[int], Trial | None]) -> list[Trial]:
    """Try search radii below and above one, in either direction as far as it pays, and return the trials in order."""
    trials: dict[int, Trial] = {}

    def tries(radius: int) -> bool:
        trial = attempt(radius) if radius >= 1 else None
        if trial is not None:
            trials[radius] = trial
        return trial is not None

    tries(usual)
    for choose, one_step, factor in ((min, -1, 1 / STEP), (max, 1, STEP)):
        radius, in_vain = usual, 0
        while in_vain < IN_VAIN and tries(radius := choose(radius + one_step, round(radius * factor))):
            is_best = _best([trials[each] for each in sorted(trials)]) is trials[radius]
            in_vain = 0 if is_best else in_vain + 1
    return [trials[each] for each in sorted(trials)]


@dataclass(frozen=True)
class _Tuner:
    """A method and the frames that it is tried on."""

    interpolator: Interpolator
    method: str
    samples: Sequence[Sample]
    observer: Observer

    def accepted(self, settings: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the settings that the method does not refuse: its own checks know its bounds."""
        return [each for each in settings if self._configured(each) is not None]

    def attempt(self, options: dict[str, Any]) -> Trial | None:
        """Interpolate all frames with some options; return None if the method refuses them."""
        interpolator = self._configured(options)
        if interpolator is None:
            return None
        interpolator.compile_for(self.samples[0].hidden.truth)
        errors, cpu_seconds = [], []
        for sample in self.samples:
            (frame,) = InterpolatorContestant(interpolator).interpolate(sample.window, {sample.hidden.number})
            errors.append(score(sample.hidden.truth, frame.image).mse)
            cpu_seconds.append(frame.cpu_seconds)
            self.observer.advance()
        return Trial(options, mean(errors), mean(cpu_seconds))

    def _configured(self, options: dict[str, Any]) -> Interpolator | None:
        try:
            return configure(self.interpolator, self.method, options)
        except OptionError:
            return None


def _best(trials: Sequence[Trial]) -> Trial:
    """Return the first trial that is about as good as the best: sweeps go from cheap to dear."""
    least = min(trial.mse for trial in trials)
    return next(trial for trial in trials if trial.mse <= least * AS_GOOD)


def draw_tuning(tuning: Tuning, path: Path) -> None:
    """Draw all sweeps side by side into a new file; the report's Figure 7."""
    # takes half a second, and only this needs it
    from matplotlib.figure import Figure  # noqa: PLC0415
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415

    check_drawable(path)
    figure = Figure(figsize=(4 * len(tuning.sweeps), 3.4), layout="constrained")
    for axes, (name, trials) in zip(
        figure.subplots(1, len(tuning.sweeps), squeeze=False)[0], tuning.sweeps.items(), strict=True
    ):
        for window, curve in _curves(name, trials).items():
            x, y = zip(*curve, strict=True)
            axes.plot(x, y, "o-", color=CURVE_COLOURS[window], label=CURVE_LABELS[window], markersize=4)
        chosen = tuning.best.options[name]
        axes.axvline(chosen, color="0.6", linewidth=0.8, linestyle="--")
        axes.set_xlabel(f"{name.replace('_', ' ')}{'' if name == 'v' else ', pixels'}")
        axes.set_ylim(0, 1.08 * max(trial.mse for trial in trials))
        axes.spines[["top", "right"]].set_visible(False)
        if name != "v":
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if len(_curves(name, trials)) > 1:
            axes.legend(frameon=False)
    figure.axes[0].set_ylabel("mean squared error, levels of 255")
    drawing = BytesIO()
    figure.savefig(drawing, format=path.suffix[1:], dpi=150)
    write_whole(path, drawing.getvalue())


def check_drawable(path: Path) -> None:
    """Raise OutputError if the file's ending is none that can be drawn."""
    if path.suffix.lower() not in FORMATS:
        raise OutputError(f"{path} cannot be drawn; choose a name that ends in {', '.join(FORMATS)}.")


def _curves(name: str, trials: list[Trial]) -> dict[str, list[tuple[float, float]]]:
    """Return error against the swept value; where the windows are swept too, one curve each."""
    curves: dict[str, list[tuple[float, float]]] = {}
    for trial in trials:
        window = trial.options.get("window", "") if name == "patch_radius" else ""
        curves.setdefault(window, []).append((trial.options[name], trial.mse))
    return curves
