"""Passages of a clip that the page plays: the true frames, and those of each method, in step."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from fpsboost.colour import as_shown
from fpsboost.evaluation.contestants import Contestant
from fpsboost.evaluation.hidden_frames import Interval
from fpsboost.evaluation.report.pictures import find_loss
from fpsboost.evaluation.report.self_contained import LOSSLESS, MAX_WIDTH, PlayerData, as_webp, data_uri, not_too_wide
from fpsboost.evaluation.results import Comparison
from fpsboost.image import Image

MAX_PIXELS = 24_000_000
"""Number of pixels in all pictures that a page plays; those of large frames are reduced before."""

MAX_EXACT_PIXELS = 5_000_000
"""Number of pixels in all pictures that are kept without loss; each takes about seven times the room of another."""

MIN_HIDDEN = 6
"""Number of hidden frames that are played in any case."""

QUALITY = 72
"""WebP quality; most frames are seen for a moment only."""


def choose_passages(comparison: Comparison, count: int, also: Sequence[int] = ()) -> list[list[int]]:
    """Choose hidden frames that are worth playing: where methods differ most, and where the first one errs most.

    The two passages have `count` frames together; frames of `also` that lie in none become passages of their own.
    """
    hidden = comparison.hidden
    if count >= len(hidden):
        return [list(hidden)]
    left_out = {*comparison.cuts, *comparison.doubtful}
    errors = [[frame.scores.mae for frame in method.frames] for method in comparison.methods]
    counts = [number not in left_out for number in hidden]
    differences = [
        (median(each) - min(each)) * is_one for each, is_one in zip(zip(*errors, strict=True), counts, strict=True)
    ]
    length = max(1, count // 2)
    first = _largest(differences, length, [])
    second = _largest([error * is_one for error, is_one in zip(errors[0], counts, strict=True)], length, [first])
    passages = [hidden[begin : begin + length] for begin in sorted({first, second})]
    passages += [[number] for number in also if not any(number in passage for passage in passages)]
    return sorted(passages)


def _largest(values: Sequence[float], length: int, taken: Sequence[int]) -> int:
    """Return where the window with the largest sum begins that does not overlap the taken ones, if there is room."""
    begins = range(len(values) - length + 1)
    free = [begin for begin in begins if all(abs(begin - each) >= length for each in taken)]
    return max(free or begins, key=lambda begin: sum(values[begin : begin + length]))


def _size_of(comparison: Comparison) -> tuple[int, int]:
    width, height = comparison.kind.partition(",")[0].split("x")
    return int(width), int(height)


def count_for(comparison: Comparison, max_pixels: int) -> int:
    """Return how many hidden frames can be played within a number of pixels."""
    width, height = _size_of(comparison)
    scale = min(1.0, MAX_WIDTH / width)
    pictures = len(comparison.methods) + 1 + 1 / comparison.hiding.skip
    return max(MIN_HIDDEN, int(max_pixels / (pictures * width * height * scale**2)))


def choose_exact(comparison: Comparison, numbers: Sequence[int], max_pixels: int) -> list[int]:
    """Return the first of some hidden frames, as many as can be kept without loss; none if frames must be reduced."""
    width, height = _size_of(comparison)
    pixels = (len(comparison.methods) + 1) * width * height
    return [] if width > MAX_WIDTH else list(numbers)[: max_pixels // pixels]


def view_passages(
    comparison: Comparison,
    contestants: Mapping[str, Contestant],
    passages: Sequence[Sequence[int]],
    exact: Collection[int] = (),
) -> PlayerData:
    """Interpolate the hidden frames of passages once more and encode them, those of `exact` without loss."""
    passage_of = {number: place for place, passage in enumerate(passages) for number in passage}
    last = max(passage_of)
    data = PlayerData(["truth", *(method.name for method in comparison.methods)], *_size_of(comparison), 0.0)
    frames: dict[tuple[int, int], dict[str, Any]] = {}

    def add(number: int, passage: int, image: Image, note: str) -> None:
        displayed = not_too_wide(as_shown(image))
        picture = as_webp(displayed, LOSSLESS if number in exact else QUALITY)
        loss = round(find_loss(displayed, picture), 1) if (passage, number) not in frames else None
        frame = {"number": number, "passage": passage, "note": note, "images": [], "loss": loss}
        frames.setdefault((passage, number), frame)["images"].append(data.add_picture(data_uri(picture, "webp")))

    def intervals() -> Iterator[Interval]:
        return comparison.hiding.intervals(comparison.clip)

    for interval in _until(intervals(), last, 0):
        for hidden in interval.hidden:
            if hidden.number not in passage_of:
                continue
            passage = passage_of[hidden.number]
            for number, frame in ((interval.number, interval.shown0), (interval.last, interval.shown1)):
                if (passage, number) not in frames:
                    add(number, passage, frame.array, "shown")
            add(hidden.number, passage, hidden.truth, "hidden")
            data.fps = float((len(interval.hidden) + 1) / (interval.shown1.time - interval.shown0.time))
    for method in comparison.methods:
        contestant = contestants[method.name]
        # one interval more, whose motion has a say; a method that looks far gets all
        read = intervals() if contestant.looks_far else _until(intervals(), last, 1)
        for interpolated in contestant.interpolate(read, passage_of):
            add(interpolated.number, passage_of[interpolated.number], interpolated.image, "hidden")
    data.frames = [frames[key] for key in sorted(frames)]
    return data


def _until(intervals: Iterable[Interval], last: int, more: int) -> Iterator[Interval]:
    """Yield intervals up to the one with the last hidden frame, and some more."""
    for interval in intervals:
        yield interval
        if interval.last > last:
            if not more:
                return
            more -= 1
