"""Pictures of a comparison's page: crops at the worst spots, motion and confidence; and passages that it plays.

A passage is the true frames of a part of the clip, and those of each method, in step.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from fpsboost.colour import as_shown
from fpsboost.evaluation.compared_methods import ComparedInterpolator, ComparedMethod
from fpsboost.evaluation.hidden_frames import HeldOutFrame, Sample
from fpsboost.evaluation.results import ComparedClip, Comparison, absolute_error
from fpsboost.image import Image, view
from fpsboost.interpolator import Interpolator
from fpsboost.motion.field import ZeroMotion, point_places
from fpsboost.pages import (
    LOSSLESS,
    MAX_WIDTH,
    PlayerData,
    as_heat,
    as_webp,
    data_uri,
    encode,
    not_too_wide,
)
from fpsboost.pair import Pair
from fpsboost.synthesis import FusesHypotheses

MIN_CROP = 48
"""Smallest side of a crop, pixels; a tenth of the frame's width if that is more."""
ARROWS = 30
"""Number of arrows along the longer side of a frame."""

MAX_DRAWN_ERROR = 64
"""Error at the bright end of the colour scale, levels of 255; larger ones look alike."""


@dataclass(frozen=True)
class Picture:
    """One encoded picture of a method, of the truth, or of the guide."""

    name: str
    """Name of the method, ``truth`` or ``guide``."""
    method: int | None
    """Index of the method; None for the truth and the guide."""
    uri: str
    """Data URI."""
    mae: float | None = None
    """Mean absolute error, levels of 255; None if unknown."""


class Spot(NamedTuple):
    """A square of a frame that deserves a closer look."""

    x: int
    """Left column, pixels."""
    y: int
    """Upper row, pixels."""
    size: int
    """Side, pixels."""
    reason: str
    """Reason for showing it."""


@dataclass(frozen=True)
class Strip:
    """One spot in the truth, in the guide if there is one, and in the frame of every method."""

    spot: Spot
    crops: list[Picture]
    """The spot in each of these."""


@dataclass(frozen=True)
class MotionPicture:
    """Motion from one shown frame to the next, as one method estimates it."""

    picture: Picture
    """Direction as hue, length as saturation."""
    arrows: list[tuple[float, ...]]
    """Its arrows; see `arrows_of`."""
    longest: float
    """Longest motion, pixels."""


@dataclass(frozen=True)
class MotionView:
    """Motion between two shown frames as the methods estimate it, and their uncertainty."""

    number: int
    """Number of the hidden frame."""
    between: tuple[int, int]
    """Numbers of the shown frames."""
    width: int
    """Width of the frame, pixels."""
    height: int
    """Height of the frame, pixels."""
    shown: str
    """The earlier shown frame, encoded."""
    edge: float
    """Motion at the wheel's edge, pixels."""
    stretch: float
    """Length of an arrow as a multiple of the motion."""
    fields: list[MotionPicture]
    """Motion by each method that estimates it."""
    doubts: list[tuple[Picture, Picture]]
    """Uncertainty and true error, for each method that has a confidence of its own."""


def view_frame(sample: Sample, frames: Mapping[str, Image]) -> list[Strip]:
    """Find the spots of a frame that deserve a closer look, and encode them from the frame of every method."""
    truth = sample.hidden.truth
    unscored = {"truth": truth}
    if sample.hidden.source.guide is not None:
        unscored["guide"] = enlarged_guide(sample.hidden)
    errors = [absolute_error(truth, image) for image in frames.values()]
    strips = []
    for spot in find_spots(errors):
        window = np.s_[spot.y : spot.y + spot.size, spot.x : spot.x + spot.size]
        crops = [Picture(name, None, encode(as_shown(image[window]), LOSSLESS)) for name, image in unscored.items()]
        for index, (name, image) in enumerate(frames.items()):
            crops.append(
                Picture(name, index, encode(as_shown(image[window]), LOSSLESS), float(errors[index][window].mean()))
            )
        strips.append(Strip(spot, crops))
    return strips


def enlarged_guide(hidden: HeldOutFrame) -> Image:
    """Return the guide of a frame as a screen shows it, at the size of the frame; black if there is none."""
    if hidden.source.guide is None:
        return np.zeros_like(hidden.truth)
    return cv2.resize(as_shown(view(hidden.source.guide).array()), hidden.truth.shape[1::-1])


def view_motion(
    sample: Sample, frames: Mapping[str, Image], compared_methods: Mapping[str, ComparedMethod]
) -> MotionView | None:
    """Draw the motion of every method around a hidden frame, and the uncertainty.

    Returns None if no method estimates motion.
    """
    interval = sample.interval
    moving = {
        name: each.interpolator
        for name, each in compared_methods.items()
        if isinstance(each, ComparedInterpolator) and not isinstance(each.interpolator.estimator, ZeroMotion)
    }
    pairs = {name: each.pair(*interval.prepared(with_layers=each.takes_layers)) for name, each in moving.items()}
    if not pairs:
        return None
    flows = {name: pair.fields[0].flow for name, pair in pairs.items()}
    height, width = interval.shown0.frame.array.shape[:2]
    edge = max(1.0, float(np.median([np.percentile(np.linalg.norm(flow, axis=-1), 98) for flow in flows.values()])))
    spacing = max(4, max(height, width) // ARROWS)
    # the roundest factor that lets arrows be seen and hardly overlap
    stretch = float(next((factor for factor in (20, 10, 5, 2) if factor * edge <= 1.5 * spacing), 1))
    fields = [
        MotionPicture(
            Picture(name, [*frames].index(name), encode(not_too_wide(in_colour(flow, edge)))),
            arrows_of(flow, spacing, stretch),
            float(np.linalg.norm(flow, axis=-1).max()),
        )
        for name, flow in flows.items()
    ]
    return MotionView(
        number=sample.hidden.number,
        between=(interval.shown0.position.number, interval.shown1.position.number),
        width=width,
        height=height,
        shown=encode(not_too_wide(as_shown(interval.shown0.frame.array))),
        edge=edge,
        stretch=stretch,
        fields=fields,
        doubts=list(_doubts(sample, frames, moving, pairs)),
    )


def _doubts(
    sample: Sample, frames: Mapping[str, Image], interpolators: Mapping[str, Interpolator], pairs: Mapping[str, Pair]
) -> Iterator[tuple[Picture, Picture]]:
    """Return the uncertainty and the true error of each method with a confidence of its own."""
    for index, name in enumerate(frames):
        synthesizer = interpolators[name].synthesizer if name in pairs else None
        if isinstance(synthesizer, FusesHypotheses):
            confidence = next(synthesizer.fuse(pairs[name].frame_pair, [float(sample.hidden.t)])).confidence
            error = absolute_error(sample.hidden.truth, frames[name])
            uncertainty, wrong = (not_too_wide(as_heat(each)) for each in (1 - confidence, error / MAX_DRAWN_ERROR))
            yield Picture(name, index, encode(uncertainty)), Picture(name, index, encode(wrong), float(error.mean()))


def find_spots(errors: Sequence[np.ndarray]) -> list[Spot]:
    """Return the square where all methods together err most, and one beside it.

    The second is where the lead of the best method is largest.
    """
    height, width = errors[0].shape
    size = min(max(MIN_CROP, width // 10), height, width)
    blurred = np.stack([cv2.blur(error.astype(np.float64), (size, size), anchor=(0, 0)) for error in errors])
    means = blurred[:, : height - size + 1, : width - size + 1]
    together = means.mean(axis=0)
    y, x = np.unravel_index(int(together.argmax()), together.shape)
    spots = [Spot(int(x), int(y), size, "largest error")]
    several = len(errors) > 1
    # not from the worst: a method that fails everywhere would draw all attention
    leads = np.median(means, axis=0) - means.min(axis=0) if several else together
    rows, columns = np.ogrid[: leads.shape[0], : leads.shape[1]]
    beside = (abs(rows - y) >= size) | (abs(columns - x) >= size)
    if beside.any():
        y, x = np.unravel_index(int(np.where(beside, leads, -1).argmax()), leads.shape)
        spots.append(Spot(int(x), int(y), size, "methods differ most" if several else "next largest error"))
    return spots


def in_colour(flow: np.ndarray, edge: float) -> np.ndarray:
    """Return motion as colours, (H, W, 3) uint8: direction as hue, length as saturation, full from `edge` pixels on."""
    length, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
    colours = np.stack([angle, (length / edge).clip(0, 1), np.ones_like(angle)], axis=-1).astype(np.float32)
    return np.rint(cv2.cvtColor(colours, cv2.COLOR_HSV2BGR) * 255).astype(np.uint8)


def arrows_of(flow: np.ndarray, spacing: int, stretch: float) -> list[tuple[float, ...]]:
    """Return arrows along motion of (H, W, 2) from every `spacing` pixels on: x, y, and how far they lead, pixels."""
    return [
        (column * spacing + spacing // 2, row * spacing + spacing // 2, *vector)
        for row, vectors in enumerate(flow[np.ix_(*point_places(flow.shape, spacing))])
        for column, vector in enumerate((vectors * stretch).tolist())
        if np.hypot(*vector) >= 1
    ]


MAX_PIXELS = 24_000_000
"""Number of pixels in all pictures that a page plays; those of large frames are reduced before."""

MAX_EXACT_PIXELS = 5_000_000
"""Number of pixels in all pictures that are kept without loss; each takes about seven times the room of another."""

MIN_HIDDEN = 6
"""Number of hidden frames that are played in any case."""

QUALITY = 72
"""WebP quality; most frames are visible for a moment only."""


def choose_passages(comparison: Comparison, count: int, also: Sequence[int] = ()) -> list[list[int]]:
    """Choose hidden frames to play: where methods differ most, and where the first one errs most.

    The two passages have `count` frames together; frames of `also` that lie in none become passages of their own.
    """
    hidden = comparison.hidden
    if count >= len(hidden):
        return [list(hidden)]
    errors = np.array([[frame.scores.mae for frame in method.frames] for method in comparison.methods])
    errors[:, np.isin(hidden, [*comparison.cuts, *comparison.doubtful])] = 0
    length = max(1, count // 2)
    first = _largest(np.median(errors, axis=0) - errors.min(axis=0), length, [])
    second = _largest(errors[0], length, [first])
    passages = [hidden[begin : begin + length] for begin in sorted({first, second})]
    passages += [[number] for number in also if not any(number in passage for passage in passages)]
    return sorted(passages)


def _largest(values: np.ndarray, length: int, taken: Sequence[int]) -> int:
    """Return the beginning of the window with the largest sum that does not overlap those taken.

    It has `length` values. If there is no room for it, the overlap is ignored.
    """
    begins = range(len(values) - length + 1)
    free = [begin for begin in begins if all(abs(begin - each) >= length for each in taken)]
    return max(free or begins, key=lambda begin: values[begin : begin + length].sum())


def _size_of(comparison: Comparison) -> tuple[int, int]:
    """Return width and height of the frames of a comparison, pixels."""
    width, height = comparison.kind.partition(",")[0].split("x")
    return int(width), int(height)


def count_for(comparison: Comparison, max_pixels: int) -> int:
    """Return how many hidden frames can be played within a number of pixels."""
    width, height = _size_of(comparison)
    scale = min(1.0, MAX_WIDTH / width)
    pictures = len(comparison.methods) + 1 + 1 / comparison.hold_out.skip
    return max(MIN_HIDDEN, int(max_pixels / (pictures * width * height * scale**2)))


def choose_exact(comparison: Comparison, numbers: Sequence[int], max_pixels: int) -> list[int]:
    """Return the first of some hidden frames, as many as can be kept without loss; none if frames must be reduced."""
    width, height = _size_of(comparison)
    pixels = (len(comparison.methods) + 1) * width * height
    return [] if width > MAX_WIDTH else list(numbers)[: max_pixels // pixels]


def view_passages(clip: ComparedClip, passages: Sequence[Sequence[int]], exact: Collection[int] = ()) -> PlayerData:
    """Interpolate the hidden frames of passages once more and encode them, those of `exact` without loss."""
    comparison = clip.comparison
    passage_of = {number: place for place, passage in enumerate(passages) for number in passage}
    data = PlayerData(["truth", *(method.name for method in comparison.methods)], *_size_of(comparison), 0.0)
    frames: dict[tuple[int, int], dict[str, Any]] = {}
    guides: dict[int, Image] = {}

    def add(number: int, passage: int, image: Image, note: str) -> None:
        displayed = not_too_wide(as_shown(image))
        picture = as_webp(displayed, LOSSLESS if number in exact else QUALITY)
        loss = None
        if (passage, number) not in frames:  # mean absolute error that encoding has left, levels of 255
            decoded = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
            assert decoded is not None
            loss = round(float(cv2.absdiff(decoded, displayed).mean()), 1)
        frame = {"number": number, "passage": passage, "note": note, "images": [], "loss": loss}
        frames.setdefault((passage, number), frame)["images"].append(data.add_picture(data_uri(picture, "webp")))

    intervals = partial(comparison.hold_out.intervals, comparison.clip)
    for interval in intervals():
        for hidden in interval.hidden:
            if hidden.number not in passage_of:
                continue
            passage = passage_of[hidden.number]
            for shown in (interval.shown0, interval.shown1):
                if (passage, shown.position.number) not in frames:
                    add(shown.position.number, passage, shown.frame.array, "shown")
            add(hidden.number, passage, hidden.truth, "hidden")
            guides[hidden.number] = enlarged_guide(hidden)
            data.fps = float((len(interval.hidden) + 1) / (interval.shown1.time - interval.shown0.time))
    for compared_method in clip.compared_methods.values():
        for interpolated in compared_method.interpolate(intervals(), passage_of):
            add(interpolated.number, passage_of[interpolated.number], interpolated.image, "hidden")
    if comparison.hold_out.decoding.guide is not None:
        data.names.append("guide")
        for number, guide in guides.items():
            add(number, passage_of[number], guide, "hidden")
    data.frames = [frames[key] for key in sorted(frames)]
    return data
