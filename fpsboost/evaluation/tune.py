"""The report's section 4 as a tool: patch radius, window, v and search radius by trial on a few frames.

One after the other, each with the best of those before: the size of the patch with and without the Gaussian (the
report's Figure 7), then v, then the search radius. The frames are chosen for their motion.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any

import numpy as np

from fpsboost.errors import InputError, OptionError
from fpsboost.evaluation.compare import Observer, Picked, pick
from fpsboost.evaluation.hiding import Hiding
from fpsboost.evaluation.making import InterpolatorMaker
from fpsboost.evaluation.metrics import mean, score
from fpsboost.interpolator import Interpolator
from fpsboost.method_table import configure, find_method, methods
from fpsboost.motion.search_radius import choose_search_radius, expected_motion
from fpsboost.scenes import CutDetector

RADII = (1, 2, 3, 5, 7, 10, 14)
WINDOWS = ("box", "gaussian")
WIDTHS = (0.05, 0.09, 0.15, 0.25, 0.4)
SHARES = (0.25, 0.5, 0.75, 1.0, 1.5)
"""Of the search radius that the report's heuristic gives."""

AS_GOOD = 1.005
"""An error at most so many times the least is as good, and then the smaller value, which costs less, is taken."""


@dataclass(frozen=True)
class Trial:
    """What one setting gives.

    Attributes
    ----------
    options : dict of str to value
    mse : float
        Mean over the frames, levels of 255 squared.
    seconds : float
        A frame.
    """

    options: dict[str, Any]
    mse: float
    seconds: float


@dataclass(frozen=True)
class Tuning:
    """The trials of a clip.

    Attributes
    ----------
    clip, method : str
    frames : list of int
        Numbers of the frames that were made, counted from 0.
    sweeps : dict of str to list of Trial
        By what was swept: ``patch_radius`` (with each window, where the method has one), ``v``, ``search_radius``.
    best : dict of str to value
        The options to use.
    """

    clip: str
    method: str
    frames: list[int]
    sweeps: dict[str, list[Trial]]
    best: dict[str, Any]


def tune(
    path: str,
    method: str,
    hiding: Hiding,
    count: int,
    observer: Observer,
    input_fps: Fraction | None = None,
) -> Tuning:
    """Sweep the parameters of a method on a few frames of a clip.

    Parameters
    ----------
    path : str
        A video, a folder or a pattern of images.
    method : str
        Whose estimator has a patch radius.
    hiding : Hiding
        Which frames may be hidden.
    count : int
        How many frames to try on.
    observer : Observer
    input_fps : Fraction, optional
        Frames per second of images.

    Returns
    -------
    Tuning

    Raises
    ------
    InputError
        The clip cannot be read, or is too short.
    OptionError
        The method has no patch radius, or `count` is below 1.
    """
    if count < 1:
        raise OptionError(f"--frames must be at least 1, not {count}.")
    interpolator = find_method(method)
    known = {field.name for field in fields(interpolator.estimator)}  # type: ignore[arg-type]
    if "patch_radius" not in known:
        raise OptionError(f"The method {method!r} has no patch to tune; take nlm or nlm-exhaustive.")
    observer.begun("reading", None)
    picked = choose_frames(path, hiding, count, observer, input_fps)
    best: dict[str, Any] = {}
    sweeps: dict[str, list[Trial]] = {}
    for name, settings in _sweeps(known, picked):
        observer.begun(name.replace("_", " "), len(settings) * len(picked))
        trials = [_try(interpolator, method, {**best, **each}, picked, observer) for each in settings]
        sweeps[name] = trials
        best = _best(trials)
    return Tuning(path, method, [each.hidden.number for each in picked], sweeps, best)


def choose_frames(
    path: str, hiding: Hiding, count: int, observer: Observer, input_fps: Fraction | None = None
) -> list[Picked]:
    """Hidden frames whose motion is spread evenly from the middle of the clip's to its largest.

    Frames across a scene cut are left out, as long as there are others, and so are those that are no truth (see
    `fpsboost.evaluation.hiding.Hiding`).
    """
    motions: list[tuple[float, int]] = []
    likenesses: list[float] = []
    known: list[bool] = []
    for interval in hiding.intervals(path, input_fps):
        image0, image1 = interval.prepared()
        motion = expected_motion(image0, image1)
        middle = interval.hidden[len(interval.hidden) // 2].number
        motions.append((motion, middle))
        known.append(interval.is_known)
        likenesses.append(methods["nlm"].pair(image0, image1).likeness)
        observer.made()
    cuts = CutDetector().find_cuts(likenesses)
    fair = [(each, cut) for each, cut, is_known in zip(motions, cuts, known, strict=True) if is_known]
    if not fair:
        raise InputError(
            f"{path} has no hidden frame to tune on that is no repeat and beside none; choose another part of it, or "
            "take repeats for truth with --duplicates keep."
        )
    usable = [each for each, cut in fair if not cut] or [each for each, _ in fair]
    ranked = [number for _, number in sorted(usable)]
    places = np.linspace(len(ranked) - 1, (len(ranked) - 1) // 2, min(count, len(ranked)))
    return pick(path, hiding, sorted({ranked[round(place)] for place in places.tolist()}), input_fps)


def _sweeps(known: set[str], picked: Sequence[Picked]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """What is swept, and every setting of it, for a method with these options."""
    windows: Sequence[Mapping[str, Any]] = [{"window": name} for name in WINDOWS] if "window" in known else [{}]
    yield "patch_radius", [{"patch_radius": radius, **window} for window in windows for radius in RADII]
    yield "v", [{"v": width} for width in WIDTHS]
    if "search_radius" in known:
        usual = max(_usual_search_radius(each) for each in picked)
        radii = sorted({max(1, round(share * usual)) for share in SHARES})
        yield "search_radius", [{"search_radius": radius} for radius in radii]


def _usual_search_radius(picked: Picked) -> int:
    interval = next(each for each in picked.window if picked.hidden in each.hidden)
    return choose_search_radius(*interval.prepared())


def _try(
    interpolator: Interpolator, method: str, options: dict[str, Any], picked: Sequence[Picked], observer: Observer
) -> Trial:
    maker = InterpolatorMaker(configure(interpolator, method, options))
    maker.interpolator.compile_for(picked[0].hidden.truth)
    errors = []
    begin = time.perf_counter()
    for each in picked:
        errors.append(score(each.hidden.truth, each.make(maker)).mse)
        observer.made()
    return Trial(options, mean(errors), (time.perf_counter() - begin) / len(picked))


def _best(trials: Sequence[Trial]) -> dict[str, Any]:
    """The first of those that are about as good as the best: sweeps go from what is cheap to what is dear."""
    least = min(trial.mse for trial in trials)
    return next(trial.options for trial in trials if trial.mse <= least * AS_GOOD)
