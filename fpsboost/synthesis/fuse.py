"""The default: every pixel a mean over the motions that may hold there, weighed by patch similarity at time t."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.frame import Image, has_alpha
from fpsboost.kernels.candidates import CELL, collect_candidates
from fpsboost.kernels.fuse import ROW, SPARE, fuse_candidates, write_pixels
from fpsboost.kernels.memory import aligned_empty
from fpsboost.kernels.spline import MARGIN, fill_planes, filter_response, find_coefficients
from fpsboost.motion.colour import normalised
from fpsboost.motion.field import MotionField, at_points, point_places, round_trip
from fpsboost.synthesis import Transition
from fpsboost.synthesis.rounding import colour_unseen, rounding_offset, value_range

CAPACITY = 48
"""Candidates of one cell, at most."""

ASTRAY = 16
"""A motion whose way there and back ends so far from where it began has half a vote, pixels."""


class Fused(NamedTuple):
    """An in-between frame and how far it can be trusted."""

    image: Image
    """(H, W, C)."""
    confidence: NDArray[Any]
    """(H, W) float32 in [0, 1]."""


@dataclass(frozen=True)
class Fuse:
    """Collect the motions of both frames that lead through each cell at time t, and weigh what they bring together.

    Parameters
    ----------
    step : int
        One pixel in so many of each frame, along x and y, has its motion tried.
    around : float
        A motion is tried this far around the place where it leads to, and counts the less the farther, pixels.
    tolerance : float
        Motions that differ by less are tried once, pixels.
    width : float
        v of the similarity at time t, for colours in [0, 1].
    sharpness : float
        How clearly the most similar motion wins: its weight is ``exp(sharpness * similarity)``.
    enough : float
        Similarity at which a cell needs no further candidates.
    """

    step: int = 8
    around: float = 12
    tolerance: float = 0.5
    width: float = 0.3
    sharpness: float = 25
    enough: float = 0.99

    def __post_init__(self) -> None:
        if self.step < 1:
            raise OptionError(f"step must be at least 1 pixel, not {self.step}.")
        if not self.tolerance >= 0:
            raise OptionError(f"tolerance must be at least 0 pixels, not {self.tolerance}.")
        if not self.width > 0:
            raise OptionError(f"width must be above 0, not {self.width}.")
        if self.around <= CELL / 2:
            raise OptionError(f"around must be more than {CELL // 2} pixels, or motions are lost, not {self.around}.")

    def synthesize(self, transition: Transition, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`."""
        for fused in self.fuse(transition, times):
            yield fused.image

    def fuse(self, transition: Transition, times: Sequence[float]) -> Iterator[Fused]:
        """Like `synthesize`, with the confidence of every pixel."""
        samples0, samples1 = (image.once(_samples) for image in (transition.image0, transition.image1))
        height, width, channels = transition.image0.pixels.shape
        cells = -(-height // CELL), -(-width // CELL)
        scale = np.float32(0.5 / self.width**2 * max(1, 3 / channels))
        acceleration = transition.acceleration
        if acceleration is None:
            acceleration = np.zeros((*cells, 2), np.float32)
        votes01 = self._voters(transition.field01, transition.field10)
        votes10 = self._voters(transition.field10, transition.field01)
        for t in times:
            count = np.zeros(cells, np.int32)
            votes, sums = np.zeros((*cells, CAPACITY), np.float32), np.zeros((*cells, CAPACITY, 2), np.float32)
            corners = np.zeros((*cells, CAPACITY, 2, 2), np.float32)
            landings = [(*voters, 1, t) for voters in votes01] + [(*voters, -1, 1 - t) for voters in votes10]
            for flow, trust, sign, time in landings:
                collect_candidates(
                    flow,
                    trust,
                    np.float32(sign),
                    np.float32(time),
                    self.step,
                    np.float32(self.around),
                    np.float32(self.tolerance),
                    count,
                    votes,
                    corners,
                    sums,
                )
            mean = np.empty((channels, height, width), np.float32)
            confidence = np.empty((height, width), np.float32)
            bend = acceleration * np.float32(t * (1 - t) / 2)
            fuse_candidates(
                *samples0,
                *samples1,
                height,
                width,
                np.float32(t),
                count,
                votes,
                corners,
                sums,
                bend,
                scale,
                np.float32(self.sharpness),
                np.float32(self.enough),
                CELL,
                ROW,
                mean,
                confidence,
            )
            yield Fused(_as_image(mean, transition, t), confidence)

    def _voters(self, field: MotionField, other: MotionField) -> list[tuple[NDArray[Any], NDArray[Any]]]:
        """Every motion of a frame with what the vote of each of its points counts.

        As much as its patches are alike, where that is known, and the less the farther from its beginning the way there
        and back ends: what is hidden in the other frame is found again by chance only, and somewhere else.
        """
        y, x = point_places(field.flow.shape, self.step)
        flows, returns = (field.flow, *field.alternatives), (other.flow, *other.alternatives)
        voters = []
        for flow, back in zip(flows, returns, strict=True):
            astray = round_trip(at_points(flow, self.step), y, x, back) / np.float32(ASTRAY)
            voters.append((flow, 1 / (1 + astray * astray)))
        flow, trust = voters[0]
        return [(flow, trust * at_points(field.similarity, self.step)), *voters[1:]]


def _samples(image: Image) -> NDArray[Any]:
    """Planes of an image and their spline coefficients, (2, C, H, W); colours with straight alpha are multiplied by it.

    One array, because fresh memory is dear: each of its pages costs more than the filter's work on it.
    """
    height, width, channels = image.shape
    is_float = image.dtype == np.float32
    if is_float:  # what is no number would spread to its surroundings
        image = normalised(image)
    samples = aligned_empty((2, channels, height + 2 * MARGIN, width + 2 * MARGIN + SPARE), np.float32)
    planes, coefficients = samples
    scale = 1 if is_float else 1 / np.iinfo(image.dtype).max
    precision = 1 / 2**11 if image.dtype == np.uint8 else 1 / 2**19
    fill_planes(image, np.float32(scale), has_alpha(image) and not is_float, planes)
    find_coefficients(planes, filter_response(precision), coefficients)
    return samples


def _extremes(image: Image) -> tuple[np.float32, np.float32]:
    """The lowest and the highest number of a float image."""
    numbers = normalised(image)
    return numbers.min(), numbers.max()


def _as_image(mean: NDArray[Any], transition: Transition, t: float) -> Image:
    image0, image1 = transition.image0.pixels, transition.image1.pixels
    image = np.empty_like(image0)
    is_float = image0.dtype == np.float32
    if is_float:  # sharp samples overshoot: nothing may be darker or brighter than all there is
        (lowest0, highest0), (lowest1, highest1) = (
            each.once(_extremes) for each in (transition.image0, transition.image1)
        )
        lowest, highest = min(lowest0, lowest1), max(highest0, highest1)
    else:
        lowest, highest = value_range(image0)
    scale = np.float32(1) if is_float else highest
    straight_alpha = has_alpha(image0) and not is_float
    write_pixels(mean, scale, rounding_offset(image0), lowest, highest, straight_alpha, image)
    if straight_alpha:
        colour_unseen(image, image0, image1, t)
    return image
