"""Pictures of a comparison's page: crops at the worst spots, motion and confidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeGuard

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import as_shown
from fpsboost.evaluation.contestants import Contestant, InterpolatorContestant
from fpsboost.evaluation.hidden_frames import Sample
from fpsboost.evaluation.metrics import absolute_error
from fpsboost.evaluation.report.self_contained import LOSSLESS, as_heat, encode, not_too_wide
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator
from fpsboost.motion.field import ZeroMotion, point_places
from fpsboost.pair import Pair
from fpsboost.synthesis import FramePair, FusesHypotheses

MIN_CROP = 48
"""Smallest side of a crop, pixels; a tenth of the frame's width if that is more."""

WHEEL = 160
"""Side of the colour wheel, pixels."""

ARROWS = 30
"""Number of arrows along the longer side of a frame."""

MAX_DRAWN_ERROR = 64
"""Error at the bright end of the colours, levels of 255; larger ones are drawn alike."""


@dataclass(frozen=True)
class Picture:
    """One encoded picture."""

    name: str
    method: int | None
    """Place among the methods; None for the truth."""
    uri: str
    mae: float | None = None


class Spot(NamedTuple):
    """A square of a frame that is worth a closer look."""

    x: int
    y: int
    size: int
    reason: str


@dataclass(frozen=True)
class Strip:
    """One spot, in the truth and as every method has it."""

    letter: str
    spot: Spot
    crops: list[Picture]


@dataclass(frozen=True)
class MotionPicture:
    """Motion from one shown frame to the next, as one method estimates it."""

    picture: Picture
    """Direction as hue, length as saturation."""
    arrows: str
    tips: str
    """SVG paths, in pixels of the frame: shafts, and where they point to."""
    longest: float


@dataclass(frozen=True)
class MotionView:
    """Motion between two shown frames as the methods estimate it, and their doubts."""

    number: int
    between: tuple[int, int]
    """Numbers of the shown frames."""
    width: int
    height: int
    shown: str
    wheel: str
    """The earlier shown frame, and the legend of colours, encoded."""
    edge: float
    """Motion at the wheel's edge, pixels."""
    stretch: float
    """Length of an arrow as a multiple of the motion."""
    fields: list[MotionPicture]
    doubts: list[tuple[Picture, Picture]]
    """Doubt and true error of each method that knows its doubt."""


def view_frame(sample: Sample, frames: Mapping[str, Image]) -> list[Strip]:
    """Find the spots of a frame that are worth a closer look, and encode them as every method, by name, has them."""
    truth = sample.hidden.truth
    images = [("truth", None, truth), *((name, index, image) for index, (name, image) in enumerate(frames.items()))]
    errors = [absolute_error(truth, image) for image in frames.values()]
    strips = []
    for letter, spot in zip("AB", find_spots(errors), strict=False):
        window = np.s_[spot.y : spot.y + spot.size, spot.x : spot.x + spot.size]
        crops = []
        for name, index, image in images:
            mae = None if index is None else float(errors[index][window].mean())
            crops.append(Picture(name, index, encode(as_shown(image[window]), LOSSLESS), mae))
        strips.append(Strip(letter, spot, crops))
    return strips


def view_motion(
    sample: Sample, frames: Mapping[str, Image], contestants: Mapping[str, Contestant]
) -> MotionView | None:
    """Draw the motion of every method around a hidden frame, and the doubts; None if no method estimates motion."""
    interval = sample.interval
    places = {name: index for index, name in enumerate(frames)}
    moving = {name: each.interpolator for name, each in contestants.items() if name in places and _moves(each)}
    pairs = {name: each.pair(*interval.prepared(with_layers=each.takes_layers)) for name, each in moving.items()}
    if not pairs:
        return None
    flows = {name: pair.fields[0].flow for name, pair in pairs.items()}
    height, width = interval.shown0.array.shape[:2]
    edge = max(1.0, float(np.median([np.percentile(np.linalg.norm(flow, axis=-1), 98) for flow in flows.values()])))
    spacing = max(4, max(height, width) // ARROWS)
    stretch = _stretch(edge, spacing)
    fields = [
        MotionPicture(
            Picture(name, places[name], encode(not_too_wide(in_colour(flow, edge)))),
            *draw_arrows(flow, spacing, stretch),
            float(np.linalg.norm(flow, axis=-1).max()),
        )
        for name, flow in flows.items()
    ]
    return MotionView(
        number=sample.hidden.number,
        between=(interval.number, interval.last),
        width=width,
        height=height,
        shown=encode(not_too_wide(as_shown(interval.shown0.array))),
        wheel=encode(draw_wheel(WHEEL), LOSSLESS),
        edge=edge,
        stretch=stretch,
        fields=fields,
        doubts=list(_doubts(sample, frames, moving, pairs)),
    )


def _moves(contestant: Contestant) -> TypeGuard[InterpolatorContestant]:
    return isinstance(contestant, InterpolatorContestant) and not isinstance(
        contestant.interpolator.estimator, ZeroMotion
    )


def _doubts(
    sample: Sample, frames: Mapping[str, Image], interpolators: Mapping[str, Interpolator], pairs: Mapping[str, Pair]
) -> Iterator[tuple[Picture, Picture]]:
    for index, name in enumerate(frames):
        synthesizer = interpolators[name].synthesizer if name in pairs else None
        if isinstance(synthesizer, FusesHypotheses):
            frame_pair = FramePair(*pairs[name].compensated, *pairs[name].fields)
            confidence = next(synthesizer.fuse(frame_pair, [float(sample.hidden.t)])).confidence
            error = absolute_error(sample.hidden.truth, frames[name])
            doubt, wrong = (not_too_wide(as_heat(each)) for each in (1 - confidence, error / MAX_DRAWN_ERROR))
            yield Picture(name, index, encode(doubt)), Picture(name, index, encode(wrong), float(error.mean()))


def find_loss(image: NDArray[Any], picture: bytes) -> float:
    """Return the mean absolute error that encoding has left in a picture of an image, levels of 255."""
    decoded = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return float(cv2.absdiff(decoded, image).mean())


def find_spots(errors: Sequence[NDArray[Any]]) -> list[Spot]:
    """Return the square where all methods together err most, and one beside it where the best is farthest ahead."""
    height, width = errors[0].shape
    size = min(max(MIN_CROP, width // 10), height, width)
    means = np.stack([_window_means(error, size) for error in errors])
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


def _window_means(error: NDArray[Any], size: int) -> NDArray[Any]:
    """Return means over all squares that lie inside, by their upper left corner."""
    sums = cv2.integral(error.astype(np.float32), sdepth=cv2.CV_64F)
    return (sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]) / size**2


def in_colour(flow: NDArray[Any], edge: float) -> NDArray[Any]:
    """Return motion as colours, (H, W, 3) uint8: direction as hue, length as saturation, full from `edge` pixels on."""
    length, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
    colours = np.stack([angle, (length / edge).clip(0, 1), np.ones_like(angle)], axis=-1).astype(np.float32)
    return np.rint(cv2.cvtColor(colours, cv2.COLOR_HSV2BGR) * 255).astype(np.uint8)


def draw_wheel(size: int) -> NDArray[Any]:
    """Return the legend of `in_colour`, (size, size, 4) uint8: the colour of each vector where it points to."""
    radius = size / 2
    y, x = (np.mgrid[:size, :size].astype(np.float32) + 0.5 - radius) / radius
    inside = ((1 - np.hypot(x, y)) * radius + 0.5).clip(0, 1)  # a smooth rim
    return np.dstack([in_colour(np.dstack([x, y]), 1), np.rint(inside * 255).astype(np.uint8)])


def _stretch(edge: float, spacing: int) -> float:
    """Return the roundest factor that lets arrows be seen and hardly overlap."""
    return float(next((factor for factor in (20, 10, 5, 2) if factor * edge <= 1.5 * spacing), 1))


def draw_arrows(flow: NDArray[Any], spacing: int, stretch: float) -> tuple[str, str]:
    """Return motion of (H, W, 2) as SVG paths, in pixels: shafts from every `spacing` pixels on, and their tips."""
    shafts, tips = [], []
    for row, vectors in enumerate(flow[np.ix_(*point_places(flow.shape, spacing))]):
        for column, (dx, dy) in enumerate((vectors * stretch).tolist()):
            x, y = column * spacing + spacing // 2, row * spacing + spacing // 2
            if np.hypot(dx, dy) >= 1:
                shafts.append(f"M{x} {y}l{dx:.1f} {dy:.1f}")
                tips.append(f"M{x + dx:.1f} {y + dy:.1f}h0")
    return "".join(shafts), "".join(tips)
