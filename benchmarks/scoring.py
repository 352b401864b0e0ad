"""Clips, frames interpolated as a sequence, and scores, for all benchmarks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from itertools import islice, pairwise, starmap
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from rich.console import Console

from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.analysis.scene_cuts import CutDetector
from fpsboost.errors import InputError
from fpsboost.evaluation.compared_methods import ComparedMethod
from fpsboost.evaluation.further_metrics import Meters, Metric
from fpsboost.evaluation.further_metrics import metrics as further_metrics
from fpsboost.evaluation.hidden_frames import HeldOutFrame, HoldOut, Interval
from fpsboost.evaluation.results import low_percentile, mean, means, score
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator
from fpsboost.io.images.files import IMAGE_SUFFIXES
from fpsboost.io.opening import open_source
from fpsboost.pair import with_neighbours

Figures = dict[str, float]

SAMPLE = Path(__file__).parent.parent / "samples" / "orbit.mp4"
VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".y4m", ".mpg", ".ts")
"""Which files of a folder are clips; a file that is named itself may be anything that can be read."""


@dataclass(frozen=True)
class Clip:
    """A clip with every second frame hidden."""

    name: str
    intervals: list[Interval]
    scored: list[int]
    """Indices of the hidden frames that count: no method can know what lies across a scene cut."""
    rate: Fraction

    @property
    def shown(self) -> list[Image]:
        """The even frames."""
        return [*(each.shown0.frame.array for each in self.intervals), self.intervals[-1].shown1.frame.array]

    @property
    def hidden(self) -> list[Image]:
        """The odd ones: one between every two that are shown."""
        return [hidden.truth for each in self.intervals for hidden in each.hidden]


class Made(NamedTuple):
    """Frames that one method has interpolated of one clip."""

    images: list[Image]
    cpu_ms: float
    """A frame."""


def wide_console(*, stderr: bool = False) -> Console:
    """Return a console for tables that need more than 80 columns, also where the output goes into a file."""
    return Console(stderr=stderr, width=max(Console().width, 120))


def one_thread() -> None:
    """Keep OpenCV to one thread: those that wait for each other on a busy machine spin, and are billed for it."""
    cv2.setNumThreads(1)


def find_clips(paths: Iterable[str]) -> dict[str, str]:
    """Return clips by name: each path is a video, a pattern or a folder of images, or a folder of such folders."""
    found = []
    for path in paths:
        if Path(path).is_dir() and not _holds_images(Path(path)):
            children = sorted(Path(path).iterdir())
            inside = [str(each) for each in children if _holds_images(each) or each.suffix.lower() in VIDEOS]
            if not inside:
                raise InputError(f"{path} holds neither images nor clips; name a folder that does.")
            found += inside
        else:
            found.append(path)
    names = [Path(path).resolve().stem if Path(path).is_file() else Path(path).resolve().name for path in found]
    return {path if names.count(name) > 1 else name: path for name, path in zip(names, found, strict=True)}


def _holds_images(folder: Path) -> bool:
    return folder.is_dir() and any(each.suffix.lower() in IMAGE_SUFFIXES for each in folder.iterdir())


def read_frames(path: str, largest: int) -> list[Image]:
    """Read the first frames of a clip as three colours, so that every tool gets the same."""
    with open_source(path) as source:
        return [three_colours(frame.image) for frame in islice(source, largest)]


def three_colours(image: Image) -> Image:
    """Without alpha, and gray thrice."""
    if image.shape[2] == 1:
        return np.repeat(image, 3, axis=2)
    return np.ascontiguousarray(image[..., :3])


def read_clip(name: str, path: str, largest: int) -> Clip:
    """Hide every second frame, at most `largest`."""
    hold_out = HoldOut(last=2 * largest + 1, duplicates="keep")
    intervals = [_in_three_colours(each) for each in hold_out.intervals(path)]
    rate = 2 * len(intervals) / (intervals[-1].shown1.time - intervals[0].shown0.time)
    shown = [intervals[0].prepared()[0], *(each.prepared()[1] for each in intervals)]
    scores = [CutDetector().match_score(*pair) for pair in pairwise(shown)]
    around = [[*scores[max(k - 1, 0) : k], *scores[k + 1 : k + 2]] for k in range(len(scores))]
    kept = [k for k, score in enumerate(scores) if not CutDetector().is_cut(score, *around[k])]
    return Clip(name, intervals, kept, rate)


def _in_three_colours(interval: Interval) -> Interval:
    """Return an interval whose frames have neither alpha nor one colour alone."""

    def changed(source: SourceFrame) -> SourceFrame:
        frame = replace(source.frame, image=three_colours(source.frame.array))
        return SourceFrame(frame, source.time, source.output_position, source.position)

    # tools that double frames know no other time than the middle
    hidden = tuple(HeldOutFrame(changed(each.source), Fraction(1, 2)) for each in interval.hidden)
    return interval._replace(shown0=changed(interval.shown0), shown1=changed(interval.shown1), hidden=hidden)


def make_between(interpolator: Interpolator, frames: Sequence[Image]) -> Iterator[Image]:
    """Yield the frame in the middle of every two."""
    prepared = pairwise(map(FrameCache, frames))  # one of each frame, for both of its pairs
    for pair in with_neighbours(starmap(interpolator.pair, prepared)):
        yield next(interpolator.images(pair, [0.5])).image
        pair.release_caches()


def make_hidden(method: ComparedMethod, clip: Clip) -> Made:
    """Make the hidden frames of a clip."""
    made = list(method.interpolate(clip.intervals))
    return Made([each.image for each in made], mean([each.cpu_seconds for each in made]) * 1e3)


def score_clip(clip: Clip, made: Made, metrics: Mapping[str, Metric]) -> Figures:
    """Mean scores over the frames that count, further metrics, and CPU milliseconds a frame."""
    rows = [asdict(score(clip.hidden[index], made.images[index])) for index in clip.scored]
    return {
        **means(rows),
        "psnr_p5": low_percentile([row["psnr"] for row in rows]),
        **measure_further(clip, made, metrics),
        "cpu_ms": made.cpu_ms,
    }


def measure_further(clip: Clip, made: Made, metrics: Mapping[str, Metric]) -> Figures:
    """Return figures of further metrics over the frames that count, by name."""
    meters = Meters(metrics, clip.rate)
    for hidden, image in zip(meters.passing(iter(clip.intervals)), made.images, strict=True):
        meters.add(hidden.truth, image)
    measured = meters.values(len(clip.hidden))
    return means([measured[index] for index in clip.scored])


def cells(row: Mapping[str, float], metrics: Sequence[str] = ()) -> list[str]:
    """PSNR, SSIM, MAE, CPU milliseconds and further metrics as a table shows them."""
    further = [f"{row[name]:.{further_metrics[name].digits}f}" for name in metrics]
    return [f"{row['psnr']:.2f}", f"{row['ssim']:.4f}", f"{row['mae']:.3f}", f"{row['cpu_ms']:.0f}", *further]
