"""Comparison: every second frame is hidden, interpolated by each method, and scored, as in section 5 of the report.

The clip is read once for the areas and the cuts and once per method, so that memory does not grow with its length.
"""

from __future__ import annotations

import math
import os
import platform
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise
from typing import IO, Protocol

import cv2
import numpy as np

from fpsboost import __version__
from fpsboost.analysis.scene_cuts import CutDetector, CutList, CutPolicy
from fpsboost.errors import InputError, OptionError, OutputError, explained
from fpsboost.evaluation.compared_methods import ComparedMethod, InterpolatedFrame
from fpsboost.evaluation.further_metrics import STANDARD, Meters, Metric, choose_metrics
from fpsboost.evaluation.hidden_frames import HoldOut, Interval
from fpsboost.evaluation.regions import AREAS, find_regions
from fpsboost.evaluation.results import Comparison, FrameResult, MethodResult, absolute_error, score
from fpsboost.frame_cache import FrameCache
from fpsboost.image import view
from fpsboost.kernels.binding import processor_level
from fpsboost.method_table import methods
from fpsboost.pair import Pair, items_with_neighbours
from fpsboost.render.folder import VectorFolder


class ComparisonObserver(Protocol):
    """Contract: shows the progress of a comparison."""

    def begin(self, name: str, frames: int | None) -> None:
        """Begin a method, or reading; `frames` is None if their number is not known yet."""

    def advance(self) -> None:
        """Count one more frame."""


def compare(
    path: str,
    compared_methods: Mapping[str, ComparedMethod],
    hold_out: HoldOut,
    observer: ComparisonObserver,
    *,
    skipped: Mapping[str, str] | None = None,
    vectors: VectorFolder | None = None,
    cuts: CutPolicy | None = CutDetector(),
    metrics: Mapping[str, Metric] | None = None,
) -> Comparison:
    """Score methods, by name, on the hidden frames of a clip.

    Parameters
    ----------
    path : str
        Video, or folder or pattern of images.
    compared_methods : mapping of str to ComparedMethod
        Methods by name; the first one decides which frames a page shows.
    hold_out : HoldOut
        Choice of the frames that are hidden.
    observer : ComparisonObserver
        Informed about the progress.
    skipped : mapping of str to str, optional
        Methods that cannot be run, with the reason.
    vectors : VectorFolder, optional
        A renderer's vectors, which give the areas; repeated frames are then not looked for.
    cuts : CutPolicy or None
        Finds the scene cuts between the true frames; None takes everything for one scene.
    metrics : mapping of str to Metric, optional
        Further metrics by name, see `fpsboost.evaluation.choose_metrics`; those of `STANDARD` are always measured.

    Raises
    ------
    InputError
        The clip cannot be read, or no hidden frame can be compared.
    OptionError
        There is no method.
    OutputError
        The folder for temporary files is full.
    """
    if not compared_methods:
        reasons = "".join(f"; {name} was skipped, {reason}" for name, reason in (skipped or {}).items())
        raise OptionError(f"There is no method to compare{reasons}; name others with `methods`.")
    if vectors is not None:  # which give the motion, as in conversions
        hold_out = replace(hold_out, duplicates="keep", counts_frames=True)
    if isinstance(cuts, CutList) and cuts.counts_frames:
        hold_out = replace(hold_out, counts_frames=True)
    metrics = {**choose_metrics(STANDARD), **(metrics or {})}
    advice = "free some space there, or name another folder with TMPDIR"
    with explained(OutputError, "write to", tempfile.gettempdir(), advice), tempfile.TemporaryFile() as file:
        observer.begin("reading", None)
        facts = _Facts()
        pairs = _true_pairs(facts.passing(hold_out.intervals(path), file, observer, vectors), cuts)
        across_cuts, doubtful = _not_counted(path, facts, pairs)
        rate = facts.pictures / facts.seconds
        results = []
        for name, compared_method in compared_methods.items():
            observer.begin(name, len(facts.hidden))
            # the true frames are read beside: a method may read far ahead
            truths = hold_out.intervals(path)
            interpolated = compared_method.interpolate(hold_out.intervals(path))
            frames = list(_scored(interpolated, truths, file, observer, meters := Meters(metrics, rate)))
            measured = meters.values(len(frames))
            frames = [replace(frame, metrics=row) for frame, row in zip(frames, measured, strict=True)]
            results.append(MethodResult(name, compared_method.describe(), frames))
    left_out = {*across_cuts, *doubtful}
    shares = [row for number, row in zip(facts.hidden, facts.shares, strict=True) if number not in left_out]
    return Comparison(
        path,
        facts.kind,
        hold_out,
        facts.hidden,
        across_cuts,
        shares=dict(zip(AREAS, np.mean(shares, axis=0).tolist(), strict=True)),
        methods=results,
        skipped=dict(skipped or {}),
        made_with={  # versions of what affects frames, scores or speed
            "fpsboost": __version__,
            "Python": platform.python_version(),
            "NumPy": np.__version__,
            "OpenCV": cv2.__version__,
            "kernels": processor_level(),
            "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        },
        times=facts.times,
        repeats=facts.repeats,
        doubtful=doubtful,
        clip_frames=facts.clip_frames,
        metrics=metrics,
    )


def _not_counted(path: str, facts: _Facts, pairs: Iterator[tuple[list[int], Pair]]) -> tuple[list[int], list[int]]:
    """Return the hidden frames across cuts, and those whose true pictures are unknown.

    Raises `InputError` if no other hidden frames are left. `facts` are complete once all pairs were taken.
    """
    across_cuts = {
        number for numbers, pair in items_with_neighbours(pairs) if pair.is_discontinuous for number in numbers
    }
    cuts = [number for number in facts.hidden if number in across_cuts]
    doubtful = [number for number in facts.unknown if number not in across_cuts]
    if len(facts.hidden) > len(cuts) + len(doubtful):
        return cuts, doubtful
    reasons = [f"{len(cuts)} across a scene cut (`no_cuts` takes everything for one scene)"] if cuts else []
    if doubtful:
        advice = "`duplicates='keep'` takes repeats too"
        reasons.append(f"{len(doubtful)} beside repeated frames, in stills or pauses ({advice})")
    raise InputError(
        f"None of the {len(facts.hidden)} frames of {path} that would be hidden can be compared: "
        f"{' and '.join(reasons)}; choose another part of the clip."
    )


@dataclass
class _Facts:
    """Facts about the intervals of a clip, collected while they are read."""

    hidden: list[int] = field(default_factory=list)
    """Numbers of the hidden frames."""
    times: list[float] = field(default_factory=list)
    """Position of each hidden frame in time between the shown ones, 0 to 1."""
    shares: list[list[float]] = field(default_factory=list)
    """Share of the picture that each area has, by hidden frame."""
    unknown: list[int] = field(default_factory=list)
    """Hidden frames of intervals whose true pictures are unknown."""
    repeats: list[int] = field(default_factory=list)
    """Numbers of the frames that repeat the one before."""
    kind: str = ""
    """Size and type of the frames."""
    clip_frames: int = 1
    """Number of frames from the first shown one to the last."""
    pictures: int = 0
    """Number of frames that are not repeats, except the last one."""
    seconds: Fraction = Fraction(0)
    """Duration of these frames, seconds."""

    def passing(
        self, intervals: Iterable[Interval], file: IO[bytes], observer: ComparisonObserver, vectors: VectorFolder | None
    ) -> Iterator[Interval]:
        """Yield the intervals, store their facts, and append the areas of each hidden frame to a file.

        These are as many arrays one after the other, with one bit per pixel and area; see `_scored`.
        """
        for interval in intervals:
            for hidden, regions in zip(interval.hidden, find_regions(interval, vectors), strict=True):
                np.save(file, np.packbits(regions))
                self.hidden.append(hidden.number)
                self.times.append(float(hidden.t))
                self.shares.append([float(region.mean()) for region in regions])
                observer.advance()
            if not interval.is_known:
                self.unknown += [hidden.number for hidden in interval.hidden]
            self.repeats += interval.repeats
            self.kind = view(interval.shown0.frame.array).describe()
            self.clip_frames += interval.shown1.position.number - interval.shown0.position.number
            self.pictures += len(interval.hidden) + 1
            self.seconds += interval.shown1.time - interval.shown0.time
            yield interval


def _true_pairs(intervals: Iterable[Interval], policy: CutPolicy | None) -> Iterator[tuple[list[int], Pair]]:
    """Yield every two consecutive true frames, with the numbers of the hidden frames of their interval.

    Cuts are detected between these and not between the shown ones: fast motion between shown frames is not a cut.
    """
    interpolator = replace(methods["nlm"], cuts=policy)
    last: FrameCache | None = None
    for interval in intervals:
        first, end = interval.prepared()
        row = [last or first, *interval.prepared_truths(), end]
        for pair in pairwise(row):
            yield [each.number for each in interval.hidden], interpolator.pair(*pair)
        last = end


def _scored(
    interpolated: Iterator[InterpolatedFrame],
    truths: Iterator[Interval],
    file: IO[bytes],
    observer: ComparisonObserver,
    meters: Meters,
) -> Iterator[FrameResult]:
    """Yield the scores of a method's frames, in order; `file` has the areas of `_Facts.passing`."""
    file.seek(0)
    for frame, truth in zip(interpolated, meters.passing(truths), strict=True):
        meters.add(truth.truth, frame.image)
        error = absolute_error(truth.truth, frame.image)
        shape = len(AREAS), *error.shape
        areas = np.unpackbits(np.load(file), count=math.prod(shape)).reshape(shape) > 0
        of_frame = dict(zip(AREAS, areas, strict=True))
        yield FrameResult(
            frame.number,
            score(truth.truth, frame.image),
            frame.seconds,
            frame.cpu_seconds,
            {name: _mean_where(error, area) for name, area in of_frame.items()},
            {name: _mean_where(error, ~area) for name, area in of_frame.items()},
            frame.search_radius,
        )
        observer.advance()


def _mean_where(error: np.ndarray, area: np.ndarray) -> float:
    """Return the mean error in an area; NaN if it is empty."""
    return float(error[area].mean()) if area.any() else float("nan")
