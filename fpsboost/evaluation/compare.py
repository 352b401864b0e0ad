"""Every second frame hidden, interpolated by each method, and scored: the report's section 5 for anybody's material.

The clip is read once for the areas and the cuts and once a method, so that memory does not grow with its length.
"""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from importlib.metadata import version
from itertools import pairwise
from typing import IO, Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.analysis.scene_cuts import CutDetector, CutPolicy, counts_frames
from fpsboost.errors import InputError, OptionError, OutputError, explained
from fpsboost.evaluation.contestants import Contestant, InterpolatedFrame
from fpsboost.evaluation.further_metrics import Meters
from fpsboost.evaluation.hidden_frames import Hiding, Interval
from fpsboost.evaluation.metrics import absolute_error, score
from fpsboost.evaluation.regions import AREAS, Regions, find_regions
from fpsboost.evaluation.results import Comparison, FrameResult, MethodResult
from fpsboost.frame_cache import FrameCache
from fpsboost.image import view
from fpsboost.interpolator import with_neighbours
from fpsboost.io.vectors.folder import VectorFolder
from fpsboost.method_table import methods
from fpsboost.pair import Pair
from fpsboost.version import __version__


class Observer(Protocol):
    """Contract: shows the progress of a comparison."""

    def begin(self, name: str, frames: int | None) -> None:
        """Begin a method, or reading; `frames` is None if their number is not known yet."""
        ...

    def advance(self) -> None:
        """Count one more frame."""
        ...


class _Areas:
    """Areas of all hidden frames, on disk: one bit a pixel, in order."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._shape: tuple[int, ...] = ()

    def add(self, regions: Regions) -> None:
        """Keep the areas of one more frame."""
        self._shape = (len(regions), *regions[0].shape)
        self._file.write(np.packbits(np.stack(regions)).tobytes())

    def of(self, index: int) -> NDArray[Any]:
        """Return the areas of the hidden frame with this index, (areas, H, W) bool."""
        size = -(-int(np.prod(self._shape)) // 8)
        self._file.seek(index * size)
        packed = np.frombuffer(self._file.read(size), np.uint8)
        bits: NDArray[Any] = np.unpackbits(packed, count=int(np.prod(self._shape))).reshape(self._shape) > 0
        return bits


def compare(
    path: str,
    contestants: Mapping[str, Contestant],
    hiding: Hiding,
    observer: Observer,
    *,
    skipped: Mapping[str, str] | None = None,
    input_fps: Fraction | None = None,
    rendered: tuple[str, ...] = (),
    others: tuple[str, ...] = (),
    vectors: VectorFolder | None = None,
    cuts: CutPolicy | None = CutDetector(),
    cut_options: tuple[str, ...] = (),
    metrics: Sequence[str] = (),
) -> Comparison:
    """Score methods on the hidden frames of a clip.

    Parameters
    ----------
    path : str
        A video, a folder or a pattern of images.
    contestants : mapping of str to Contestant
        Methods by name.
    hiding : Hiding
    observer : Observer
    skipped : mapping of str to str, optional
        Methods that cannot be run, with the reason.
    input_fps : Fraction, optional
        Frames per second of images.
    rendered, others : tuple of str
        See `fpsboost.evaluation.results.Comparison`.
    vectors : VectorFolder, optional
        A renderer's motion vectors, from which the areas come; repeats are then not looked for.
    cuts : CutPolicy or None
        Finds or knows the scene cuts between the true frames; None takes everything for one scene.
    cut_options : tuple of str
        See `fpsboost.evaluation.results.Comparison`.
    metrics : sequence of str
        Names of further metrics; see `fpsboost.evaluation.further_metrics.choose_metrics`.

    Raises
    ------
    OptionError
        There is no method to compare.
    InputError
        The clip cannot be read, is too short, or holds what cannot be compared, or no hidden frame counts.
    OutputError
        There is no space for temporary files.
    """
    if not contestants:
        reasons = "".join(f"; {name} was skipped, {reason}" for name, reason in (skipped or {}).items())
        raise OptionError(f"There is no method to compare{reasons}; name others with `methods`.")
    if vectors is not None:  # which say what moves, as in conversions
        hiding = replace(hiding, duplicates="keep", counts_frames=True)
    if counts_frames(cuts):
        hiding = replace(hiding, counts_frames=True)
    advice = "free some space there, or name another folder with TMPDIR"
    with explained(OutputError, "write to", tempfile.gettempdir(), advice), tempfile.TemporaryFile() as file:
        observer.begin("reading", None)
        areas = _Areas(file)
        overview, rate = _look(path, hiding, input_fps, areas, observer, vectors, cuts)
        results = []
        for name, contestant in contestants.items():
            observer.begin(name, len(overview.hidden))
            # the true frames are read beside: a method may read far ahead
            truths = hiding.intervals(path, input_fps)
            interpolated = contestant.interpolate(hiding.intervals(path, input_fps))
            frames = list(_scored(interpolated, truths, areas, observer, meters := Meters(metrics, rate)))
            measured = meters.values(len(frames))
            frames = [replace(frame, metrics=row) for frame, row in zip(frames, measured, strict=True)]
            results.append(MethodResult(name, contestant.describe(), frames))
    return replace(
        overview,
        methods=results,
        skipped=dict(skipped or {}),
        made_with=_made_with(),
        rendered=rendered,
        others=others,
        cut_options=cut_options,
        metrics=tuple(metrics),
    )


def _made_with() -> dict[str, str]:
    """Return the versions of what affects frames, scores or speed, and the machine."""
    outside = {
        name: version(package)
        for name, package in (("NumPy", "numpy"), ("Numba", "numba"), ("scikit-image", "scikit-image"))
    }
    return {
        "fpsboost": __version__,
        "Python": platform.python_version(),
        **outside,
        "OpenCV": cv2.__version__,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
    }


def _look(
    path: str,
    hiding: Hiding,
    input_fps: Fraction | None,
    areas: _Areas,
    observer: Observer,
    vectors: VectorFolder | None,
    policy: CutPolicy | None,
) -> tuple[Comparison, Fraction]:
    """Return a comparison without methods, and the frames per second; raise InputError if no hidden frame counts."""
    passed: list[_Passed] = []
    pairs = _true_pairs(_passing(hiding.intervals(path, input_fps), areas, observer, vectors, passed), policy)
    across_cuts = {
        number
        for before, (numbers, pair), after in with_neighbours(pairs)
        if pair.is_discontinuous(*(each and each[1] for each in (before, after)))
        for number in numbers
    }
    hidden = [number for each in passed for number in each.hidden]
    cuts = [number for number in hidden if number in across_cuts]
    doubtful = [number for each in passed if not each.is_known for number in each.hidden if number not in across_cuts]
    _check_some_count(path, len(hidden), len(cuts), len(doubtful))
    left_out = {*cuts, *doubtful}
    shares = [
        share
        for each in passed
        for number, share in zip(each.hidden, each.shares, strict=True)
        if number not in left_out
    ]
    comparison = Comparison(
        path,
        passed[-1].kind,
        hiding,
        hidden,
        cuts,
        shares=dict(zip(AREAS, np.mean(shares, axis=0).tolist(), strict=True)),
        methods=[],
        skipped={},
        times=[float(t) for each in passed for t in each.times],
        repeats=[number for each in passed for number in each.repeats],
        doubtful=doubtful,
        clip_frames=passed[-1].last - passed[0].first + 1,
    )
    return comparison, sum(len(each.hidden) + 1 for each in passed) / sum(
        (each.seconds for each in passed), Fraction(0)
    )


class _Passed(NamedTuple):
    """Facts about an interval that has been read."""

    kind: str
    first: int
    last: int
    hidden: list[int]
    times: list[Fraction]
    repeats: tuple[int, ...]
    is_known: bool
    shares: list[list[float]]
    seconds: Fraction


def _passing(
    intervals: Iterable[Interval],
    areas: _Areas,
    observer: Observer,
    vectors: VectorFolder | None,
    passed: list[_Passed],
) -> Iterator[Interval]:
    """Yield the intervals, append each to `passed`, and keep their areas."""
    for interval in intervals:
        shares = []
        for regions in find_regions(interval, vectors):
            areas.add(regions)
            shares.append([float(each.mean()) for each in regions])
            observer.advance()
        passed.append(
            _Passed(
                view(interval.shown0.array).describe(),
                interval.number,
                interval.last,
                [each.number for each in interval.hidden],
                [each.t for each in interval.hidden],
                interval.repeats,
                interval.is_known,
                shares,
                interval.shown1.time - interval.shown0.time,
            )
        )
        yield interval


def _true_pairs(intervals: Iterable[Interval], policy: CutPolicy | None) -> Iterator[tuple[list[int], Pair]]:
    """Yield every two true frames that follow each other, with the numbers of the hidden frames of their interval.

    A cut is looked for between these and not between the shown ones: what is fast motion to a method is no cut.
    """
    interpolator = replace(methods["nlm"], cuts=policy)
    last: FrameCache | None = None
    for interval in intervals:
        first, end = interval.prepared()
        row = [last or first, *interval.prepared_truths(), end]
        for pair in pairwise(row):
            yield [each.number for each in interval.hidden], interpolator.pair(*pair)
        last = end


def _check_some_count(path: str, hidden: int, cuts: int, doubtful: int) -> None:
    """Raise `InputError` unless a hidden frame is left that counts."""
    if hidden > cuts + doubtful:
        return
    reasons = []
    if cuts:
        reasons.append(f"{cuts} across a scene cut (`no_cuts` takes everything for one scene)")
    if doubtful:
        reasons.append(
            f"{doubtful} beside repeated frames, in stills or pauses (`duplicates='keep'` takes repeats too)"
        )
    raise InputError(
        f"None of the {hidden} frames of {path} that would be hidden can be compared: {' and '.join(reasons)}; "
        "choose another part of the clip."
    )


def _scored(
    interpolated: Iterator[InterpolatedFrame],
    truths: Iterator[Interval],
    areas: _Areas,
    observer: Observer,
    meters: Meters,
) -> Iterator[FrameResult]:
    for index, (frame, truth) in enumerate(zip(interpolated, meters.passing(truths), strict=True)):
        meters.add(truth.truth, frame.image)
        error = absolute_error(truth.truth, frame.image)
        of_frame = dict(zip(AREAS, areas.of(index), strict=True))
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


def _mean_where(error: NDArray[Any], area: NDArray[Any]) -> float:
    return float(error[area].mean()) if area.any() else float("nan")
