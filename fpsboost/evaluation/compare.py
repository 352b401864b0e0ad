"""Every second frame hidden, made again by each method, and scored: the report's section 5 for anybody's material.

The clip is read once for the areas and the cuts and once a method, so that memory does not grow with its length.
"""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from importlib.metadata import version
from itertools import pairwise
from typing import IO, Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.analysis.cut_list import CutList
from fpsboost.analysis.scene_cuts import CutDetector, CutPolicy
from fpsboost.errors import InputError, OptionError, OutputError, explained
from fpsboost.evaluation.further_metrics import Meters, summarise
from fpsboost.evaluation.hiding import Hidden, Hiding, Interval
from fpsboost.evaluation.making import Made, Maker
from fpsboost.evaluation.metrics import Scores, absolute_error, low_percentile, mean, mean_scores, score
from fpsboost.evaluation.regions import NAMES, OUTSIDES, Regions, find_regions
from fpsboost.evaluation.verdict import judge
from fpsboost.frame import Image, describe
from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Pair, with_neighbours
from fpsboost.io.vector_folder import VectorFolder
from fpsboost.method_table import methods
from fpsboost.version import __version__

MIN_SHARE = 0.02
"""An area that takes less of the picture is not shown: its few pixels say more about chance than about a method."""


DATA_VERSION = 1
"""Of `Comparison.as_json`: higher where a name has gone or means something else, the same where names were added."""

MAX_NAMED = 8
"""Frames that a note names; the data have all of them."""


@dataclass(frozen=True)
class FrameResult:
    """One frame that a method made.

    Attributes
    ----------
    number : int
        In the clip, counted from 0.
    scores : Scores
    seconds, cpu_seconds : float
        That it took.
    inside, outside : dict of str to float
        Mean absolute error in and out of each area of `fpsboost.evaluation.regions.NAMES`, levels of 255; no number
        where an area is empty.
    search_radius : int or None
        That the motion was searched in, pixels; None where the method has none.
    metrics : dict of str to float
        What was measured beside, by name; see `fpsboost.evaluation.further_metrics`.
    """

    number: int
    scores: Scores
    seconds: float
    cpu_seconds: float
    inside: dict[str, float]
    outside: dict[str, float]
    search_radius: int | None = None
    metrics: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class MethodResult:
    """What one method made of all hidden frames.

    Attributes
    ----------
    name, options : str
    frames : list of FrameResult
        In order, those that do not count among them.
    """

    name: str
    options: str
    frames: list[FrameResult]


@dataclass(frozen=True)
class Comparison:
    """Everything that a report says, and nothing else.

    Attributes
    ----------
    clip : str
        The path as the user gave it.
    kind : str
        What its frames are: ``640x360, 3 channels, 8-bit``.
    hiding : Hiding
    hidden : list of int
        Numbers of the hidden frames.
    cuts : list of int
        Those of them that lie across a scene cut, which no method can know: no mean counts them.
    shares : dict of str to float
        Mean share of the frame that each area takes.
    methods : list of MethodResult
    skipped : dict of str to str
        Methods that could not be run, and why.
    made_with : dict of str to str
        Versions and machine.
    rendered : tuple of str
        The options that named a renderer's vectors, as words of the command line.
    others : tuple of str
        Those that named other tools' frames.
    cut_options : tuple of str
        Those that said where scenes end.
    times : list of float
        Where between the two shown frames each of `hidden` lies, 0 to 1.
    repeats : list of int
        Numbers of frames that show what the one before shows: neither shown nor a truth, unless in a still.
    doubtful : list of int
        Those of `hidden` at whose times nobody knows what should be seen, most often beside repeats; see
        `fpsboost.evaluation.hiding.Hiding`. No mean counts them.
    clip_frames : int
        Frames from the first shown one to the last, all counted.
    metrics : tuple of str
        What was measured beside the scores: names of `fpsboost.evaluation.further_metrics.metrics`.
    """

    clip: str
    kind: str
    hiding: Hiding
    hidden: list[int]
    cuts: list[int]
    shares: dict[str, float]
    methods: list[MethodResult]
    skipped: dict[str, str]
    made_with: dict[str, str] = field(default_factory=dict)
    rendered: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    cut_options: tuple[str, ...] = ()
    times: list[float] = field(default_factory=list)
    repeats: list[int] = field(default_factory=list)
    doubtful: list[int] = field(default_factory=list)
    clip_frames: int = 0
    metrics: tuple[str, ...] = ()

    @property
    def areas(self) -> list[tuple[str, str]]:
        """The areas that are worth showing, each with what lies outside: both take a share that matters."""
        known = zip(NAMES, OUTSIDES, strict=True)
        return [pair for pair in known if MIN_SHARE <= self.shares[pair[0]] <= 1 - MIN_SHARE]

    @property
    def uneven(self) -> list[int]:
        """Hidden frames that lie off their even places between the shown ones."""
        steps = self.hiding.skip + 1
        even = [(place % self.hiding.skip + 1) / steps for place in range(len(self.hidden))]
        return [number for number, t, usual in zip(self.hidden, self.times, even, strict=False) if t != usual]

    def notes(self, makers: Mapping[str, Maker]) -> list[str]:
        """Return what must be known of duplicates and times to understand the figures, as sentences.

        Parameters
        ----------
        makers : mapping of str to Maker
            The methods.
        """
        notes = []
        if self.repeats:
            notes.append(f"These frames show what the one before shows, and are no truths: {_some(self.repeats)}.")
        if self.doubtful:
            notes.append(
                "These hidden frames do not count, since beside repeats, in stills and across pauses nobody knows what "
                f"should be seen: {_some(self.doubtful)}."
            )
        uneven = [number for number in self.uneven if number not in {*self.cuts, *self.doubtful}]
        if uneven:
            rigid = [name for name, maker in makers.items() if not maker.any_time]
            but = f" (even ones with {', '.join(rigid)})" if rigid else ""
            notes.append(
                f"These hidden frames do not divide the time between the shown ones evenly, and were made at their own "
                f"times{but}: {_some(uneven)}."
            )
        return notes

    def counted(self, method: MethodResult) -> list[FrameResult]:
        """Return the frames of a method that count."""
        left_out = {*self.cuts, *self.doubtful}
        return [frame for frame in method.frames if frame.number not in left_out]

    def means(self, method: MethodResult) -> Scores:
        """Mean scores of a method."""
        return mean_scores([frame.scores for frame in self.counted(method)])

    def low_psnr(self, method: MethodResult) -> float:
        """Return the 5th percentile of a method's PSNR over the frames that count, dB."""
        return low_percentile([frame.scores.psnr for frame in self.counted(method)])

    def further(self, method: MethodResult) -> dict[str, float]:
        """Return the figures of a method in the further metrics, by name, over the frames that count."""
        return summarise(self.metrics, [frame.metrics for frame in self.counted(method)])

    def mean_seconds(self, method: MethodResult) -> tuple[float, float]:
        """Seconds and CPU seconds a frame of a method."""
        frames = self.counted(method)
        return mean([frame.seconds for frame in frames]), mean([frame.cpu_seconds for frame in frames])

    def mean_error(self, method: MethodResult, area: str, inside: bool = True) -> float:
        """Mean absolute error of a method in an area or outside of it, levels of 255."""
        frames = self.counted(method)
        return mean([(frame.inside if inside else frame.outside)[area] for frame in frames])

    def as_json(self) -> dict[str, Any]:
        """Plain data for machines: the frames of every method, and their means."""
        plain = {
            "version": DATA_VERSION,
            **asdict(self),
            "hiding": self.hiding.as_json(),
            "verdict": asdict(judge(self)),
        }
        for row, method in zip(plain["methods"], self.methods, strict=True):
            seconds, cpu_seconds = self.mean_seconds(method)
            row["mean"] = {
                **asdict(self.means(method)),
                "psnr_p5": self.low_psnr(method),
                "metrics": self.further(method),
                "seconds": seconds,
                "cpu_seconds": cpu_seconds,
                "inside": {area: self.mean_error(method, area) for area in NAMES},
                "outside": {area: self.mean_error(method, area, inside=False) for area in NAMES},
            }
        finite: dict[str, Any] = _without_nan(plain)
        return finite


class Observer(Protocol):
    """Contract: is told how a comparison goes."""

    def begun(self, name: str, frames: int | None) -> None:
        """Take note that a method begins, or reading; `frames` will be made, None if that is not known yet."""
        ...

    def made(self) -> None:
        """One more frame is done."""
        ...


@dataclass(frozen=True)
class _Overview:
    """What the first reading of a clip found."""

    kind: str
    hidden: list[int]
    times: list[float]
    cuts: list[int]
    repeats: list[int]
    doubtful: list[int]
    clip_frames: int
    shares: dict[str, float]
    areas: _Areas
    rate: Fraction
    """Frames per second, over all intervals."""


class _Areas:
    """The areas of all hidden frames, on disk: one bit a pixel, in order."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._shape: tuple[int, ...] = ()

    def add(self, regions: Regions) -> None:
        """Keep those of one more frame."""
        self._shape = (len(regions), *regions[0].shape)
        self._file.write(np.packbits(np.stack(regions)).tobytes())

    def of(self, index: int) -> NDArray[Any]:
        """Those of the frame with this place among the hidden ones, (areas, H, W) bool."""
        size = -(-int(np.prod(self._shape)) // 8)
        self._file.seek(index * size)
        packed = np.frombuffer(self._file.read(size), np.uint8)
        bits: NDArray[Any] = np.unpackbits(packed, count=int(np.prod(self._shape))).reshape(self._shape) > 0
        return bits


def compare(
    path: str,
    makers: Mapping[str, Maker],
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
    makers : mapping of str to Maker
        The methods by name.
    hiding : Hiding
        Which frames are hidden.
    observer : Observer
    skipped : mapping of str to str, optional
        Methods that were asked for and cannot be run, and why.
    input_fps : Fraction, optional
        Frames per second of images.
    rendered, others, cut_options : tuple of str
        See `Comparison`.
    vectors : VectorFolder, optional
        A renderer's: the areas come from them, and repeats are not looked for.
    cuts : CutPolicy or None
        Finds the scene cuts between the true frames, or knows them; None takes everything for one scene.
    metrics : sequence of str
        What to measure beside the scores: of `fpsboost.evaluation.further_metrics.choose_metrics`.

    Returns
    -------
    Comparison

    Raises
    ------
    OptionError
        There is no method to compare.
    InputError
        The clip cannot be read, is too short, or holds what cannot be compared, or no hidden frame counts.
    OutputError
        There is no space for what is kept meanwhile.
    """
    if not makers:
        reasons = "".join(f"; {name} was skipped, {reason}" for name, reason in (skipped or {}).items())
        raise OptionError(f"There is no method to compare{reasons}; name others with --methods.")
    if vectors is not None:  # which say what moves, as in conversions
        hiding = replace(hiding, duplicates="keep", counts_frames=True)
    if isinstance(cuts, CutList) and cuts.counts_frames:
        hiding = replace(hiding, counts_frames=True)
    advice = "free some space there, or name another folder with TMPDIR"
    with explained(OutputError, "write to", tempfile.gettempdir(), advice), tempfile.TemporaryFile() as file:
        observer.begun("reading", None)
        overview = _look(path, hiding.intervals(path, input_fps), _Areas(file), observer, vectors, cuts)
        results = []
        for name, maker in makers.items():
            observer.begun(name, len(overview.hidden))
            # the true frames are read beside: a method may read far ahead
            truths = hiding.intervals(path, input_fps)
            made = maker.make(hiding.intervals(path, input_fps))
            frames = list(_scored(made, truths, overview, observer, meters := Meters(metrics, overview.rate)))
            measured = meters.values(len(frames))
            frames = [replace(frame, metrics=row) for frame, row in zip(frames, measured, strict=True)]
            results.append(MethodResult(name, maker.describe(), frames))
    return Comparison(
        path,
        overview.kind,
        hiding,
        overview.hidden,
        overview.cuts,
        overview.shares,
        results,
        dict(skipped or {}),
        _made_with(),
        rendered,
        others,
        cut_options,
        overview.times,
        overview.repeats,
        overview.doubtful,
        overview.clip_frames,
        tuple(metrics),
    )


def _made_with() -> dict[str, str]:
    """Versions of what has a say in frames, scores or speed, and the machine."""
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
    intervals: Iterable[Interval],
    areas: _Areas,
    observer: Observer,
    vectors: VectorFolder | None,
    policy: CutPolicy | None,
) -> _Overview:
    """Find the areas, and which hidden frames count.

    Raises
    ------
    InputError
        None does.
    """
    passed: list[_Passed] = []
    pairs = _true_pairs(_passing(intervals, areas, observer, vectors, passed), policy)
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
    return _Overview(
        passed[-1].kind,
        hidden,
        [float(t) for each in passed for t in each.times],
        cuts,
        [number for each in passed for number in each.repeats],
        doubtful,
        passed[-1].last - passed[0].first + 1,
        dict(zip(NAMES, np.mean(shares, axis=0).tolist(), strict=True)),
        areas,
        sum(len(each.hidden) + 1 for each in passed) / sum((each.seconds for each in passed), Fraction(0)),
    )


class _Passed(NamedTuple):
    """What is kept of an interval that has been looked at."""

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
    """Yield the intervals, note each in `passed`, and keep their areas."""
    for interval in intervals:
        shares = []
        for regions in find_regions(interval, vectors):
            areas.add(regions)
            shares.append([float(each.mean()) for each in regions])
            observer.made()
        passed.append(
            _Passed(
                describe(interval.shown0.array),
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
    """Every two true frames that follow each other, with the numbers of the hidden frames of their interval.

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
        reasons.append(f"{cuts} across a scene cut (--no-cuts takes everything for one scene)")
    if doubtful:
        reasons.append(f"{doubtful} beside repeated frames, in stills or pauses (--duplicates keep takes repeats too)")
    raise InputError(
        f"None of the {hidden} frames of {path} that would be hidden can be compared: {' and '.join(reasons)}; "
        "choose another part of the clip."
    )


def _scored(
    made: Iterator[Made], truths: Iterator[Interval], overview: _Overview, observer: Observer, meters: Meters
) -> Iterator[FrameResult]:
    for index, (frame, truth) in enumerate(zip(made, meters.passing(truths), strict=True)):
        meters.made(truth.truth, frame.image)
        error = absolute_error(truth.truth, frame.image)
        areas = dict(zip(NAMES, overview.areas.of(index), strict=True))
        yield FrameResult(
            frame.number,
            score(truth.truth, frame.image),
            frame.seconds,
            frame.cpu_seconds,
            {name: _mean_where(error, area) for name, area in areas.items()},
            {name: _mean_where(error, ~area) for name, area in areas.items()},
            frame.search_radius,
        )
        observer.made()


def _mean_where(error: NDArray[Any], area: NDArray[Any]) -> float:
    return float(error[area].mean()) if area.any() else float("nan")


class Picked(NamedTuple):
    """A hidden frame with as much of the clip around it as methods look at."""

    hidden: Hidden
    window: list[Interval]
    """Its interval, the one before and the one after."""

    def make(self, maker: Maker) -> Image:
        """Make it once more, exactly as in a comparison unless the method looks farther than the window."""
        (made,) = maker.make(self.window, {self.hidden.number})
        return made.image


def pick(path: str, hiding: Hiding, numbers: Sequence[int], input_fps: Fraction | None = None) -> list[Picked]:
    """Read some of the hidden frames with their surroundings.

    Parameters
    ----------
    path, hiding, input_fps
        As for `compare`.
    numbers : sequence of int
        Of the frames, in any order.

    Returns
    -------
    list of Picked
        In the order of `numbers`.
    """
    found: dict[int, Picked] = {}
    before: Interval | None = None
    unfinished: list[Picked] = []
    for interval in hiding.intervals(path, input_fps):
        for picked in unfinished:
            picked.window.append(interval)
        around = [interval] if before is None else [before, interval]
        unfinished = [Picked(hidden, [*around]) for hidden in interval.hidden if hidden.number in numbers]
        found.update((picked.hidden.number, picked) for picked in unfinished)
        before = interval
    return [found[number] for number in numbers]


def make_some(
    path: str, hiding: Hiding, numbers: Sequence[int], maker: Maker, input_fps: Fraction | None = None
) -> dict[int, Image]:
    """Make some of the hidden frames once more, exactly as in a comparison, by running a method over the whole clip.

    `Picked.make` is quicker, and enough for a method that does not look far.

    Parameters
    ----------
    path, hiding, numbers, input_fps
        As for `pick`.
    maker : Maker

    Returns
    -------
    dict of int to image
        By number.
    """
    return {made.number: made.image for made in maker.make(hiding.intervals(path, input_fps), numbers)}


def _some(numbers: Sequence[int]) -> str:
    """List the first of many numbers, and say how many more there are."""
    named = ", ".join(map(str, numbers[:MAX_NAMED]))
    more = len(numbers) - MAX_NAMED
    return f"{named} and {more} more" if more > 0 else named


def _without_nan(value: Any) -> Any:
    """JSON has no word for what is no number."""
    if isinstance(value, dict):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
