"""Expected errors of interpolated frames, tile by tile, without their truth.

Each image that was rendered is hidden and interpolated from the images before and after it, at twice the distance:
there the error is known. This shows two things without any training: which squared error belongs to which confidence in
this clip, and where the clip is hard to predict. Images hidden at four times the distance show how far the first of
them, learned at one distance, is off at half of it.

Uncertainty is 1 minus the confidence; it is called doubt here.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import NamedTuple, Self

import numpy as np

from fpsboost import Frame, FrameCache, Interpolator, Pair, SourcePosition
from fpsboost.extension import compared_colours, composite_on_black, items_with_neighbours, view
from fpsboost.rerender.regions import TileGrid

MIN_ERROR = 1e-7
"""Value added to squared errors that are multiplied, for white = 1: a tenth of the error of rounding to 8 bits."""

BINS = 256  # number of bins of equally many tiles that a curve is fitted to

Tiles = np.ndarray
"""A number for every tile of a frame, (rows, columns) float64."""

InOrder = Callable[[Iterable[Callable[[], "Trial"]]], Iterator["Trial"]]
"""Runs functions in parallel and yields their results in order."""


class Trial(NamedTuple):
    """Uncertainty and errors of the frames interpolated between two images."""

    scene_cut: bool
    """Whether a scene ends between the images, so that nothing was interpolated."""
    doubts: list[Tiles]
    """1 - confidence of each frame; half the squared difference of the two images across a scene cut."""
    error: Tiles | None
    """Squared error of the only frame, where its truth was hidden and no scene ends."""


def isotonic_regression(values: Tiles, weights: Tiles) -> Tiles:
    """Return the nearest values that never fall, in weighted least squares; all (N,) float64, weights at least 1.

    Each is the largest, over all first places up to its own, of the least mean from there to its own or a later place
    (min-max formula of Barlow et al. 1972, Statistical inference under order restrictions).
    """
    sums, totals = (np.concatenate([[0], np.cumsum(each)]) for each in (values * weights, weights))
    means = (sums[1:] - sums[:-1, None]) / np.maximum(totals[1:] - totals[:-1, None], 1)  # from a row to a column
    least = np.minimum.accumulate(means[:, ::-1], axis=1)[:, ::-1]
    return np.maximum.accumulate(least, axis=0).diagonal()


@dataclass(frozen=True)
class ErrorCurve:
    """Squared error by uncertainty, which never falls as the uncertainty rises (isotonic regression)."""

    doubts: np.ndarray
    """Uncertainty at the points of the curve, increasing, (N,) float64."""
    errors: np.ndarray
    """Squared error at these points, (N,) float64; linear between them and constant beyond them."""

    @classmethod
    def fitted(cls, trials: Sequence[Trial]) -> Self:
        """Fit a curve to the tiles of frames whose error is known; at least one must be."""
        doubts, errors = _tiles_of(trials)
        order = np.argsort(doubts, kind="stable")
        bins = np.array_split(order, min(BINS, len(order)))
        mean_doubts, mean_errors = (np.array([tiles[each].mean() for each in bins]) for tiles in (doubts, errors))
        return cls(mean_doubts, isotonic_regression(mean_errors, np.array([len(each) for each in bins])))

    def at(self, doubts: np.ndarray) -> np.ndarray:
        """Return the expected squared error of tiles with these uncertainties."""
        return np.asarray(np.interp(doubts, self.doubts, self.errors))

    def bias(self, trials: Sequence[Trial]) -> float:
        """Return the ratio of the expected errors of frames to their true ones, by their means; 1 where one is zero."""
        doubts, errors = _tiles_of(trials)
        true = float(errors.mean())
        expected = float(self.at(doubts).mean())
        return expected / true if true > 0 and expected > 0 else 1.0


def expect_errors(
    frames: Iterable[Frame], interpolator: Interpolator, factor: int, grid: TileGrid, in_order: InOrder
) -> tuple[np.ndarray, list[int]]:
    """Predict the squared error of the frames of a conversion.

    Parameters
    ----------
    frames : iterable of Frame
        Rendered images, at least three, which are iterated several times.
    interpolator : Interpolator
        Method of the conversion.
    factor : int
        Output frames per image.
    grid : TileGrid
        Tiles in which errors are averaged.
    in_order : callable
        That of `fpsboost.threads.run_in_parallel`.

    Returns
    -------
    errors : (F, rows, columns) float64
        Mean squared error of each tile of all frames between the images, in order, for white = 1.
    scenes : list of int
        Number of the scene of each frame; one that is interpolated across a cut is a scene of its own.
    """

    def trials(distance: int, first: int) -> list[Trial]:
        trios = _trios(frames, interpolator, factor, distance, first)
        times = [Fraction(1, 2)] if distance > 1 else [Fraction(step, factor) for step in range(1, factor)]
        return list(in_order(partial(_try, interpolator, *each, times, grid) for each in items_with_neighbours(trios)))

    between = trials(1, 0)
    hidden: list[Trial | None] = [None] * (len(between) + 1)
    hidden[1:-1:2] = trials(2, 0)
    hidden[2:-1:2] = trials(2, 1)
    doubts = np.stack([doubt for trial in between for doubt in trial.doubts])
    nearby = np.stack(
        [
            _error_nearby(hidden[place : place + 2], step / factor, grid)
            for place in range(len(between))
            for step in range(1, factor)
        ]
    )
    cut = np.repeat([trial.scene_cut for trial in between], factor - 1)
    scenes = np.repeat(np.cumsum([trial.scene_cut for trial in between]) * 2, factor - 1) - cut
    measured = [trial for trial in hidden if trial is not None and trial.error is not None]
    if not measured:  # such as scenes of two images each, of which none can be hidden
        return np.where(cut[:, np.newaxis, np.newaxis], doubts, 0), scenes.tolist()
    expected = ErrorCurve.fitted(measured).at(doubts)
    farther = [trial for trial in trials(4, 0) if trial.error is not None]
    if farther:
        expected /= ErrorCurve.fitted(farther).bias(measured)
    follows = ~cut & np.isfinite(nearby).all(axis=(1, 2))
    # the geometric mean of both, scaled to the sum of the first, as if both had the same sum
    product = np.sqrt((expected[follows] + MIN_ERROR) * (nearby[follows] + MIN_ERROR))
    total = product.sum()
    expected[follows] = product * (expected[follows].sum() / total) if total > 0 else product
    expected[cut] = doubts[cut]
    return expected, scenes.tolist()


def comparable(image: np.ndarray) -> np.ndarray:
    """Return an image on the scale on which frames are compared; float images are tone-mapped from linear light."""
    return compared_colours(image) if image.dtype == np.float32 else image


def squared_error(image0: np.ndarray, image1: np.ndarray) -> np.ndarray:
    """Return the squared difference of `comparable` images, mean of the channels, (H, W) float32, for white = 1."""
    difference = composite_on_black(image0) - composite_on_black(image1)
    return np.asarray(np.einsum("yxc,yxc->yx", difference, difference) / np.float32(difference.shape[2]))


def _trios(
    frames: Iterable[Frame], interpolator: Interpolator, factor: int, distance: int, first: int
) -> Iterator[tuple[np.ndarray | None, Pair]]:
    """Yield pairs of images that are `distance` apart, from the image `first` on, each behind the one in its middle."""
    before: FrameCache | None = None
    truth: np.ndarray | None = None
    for index, frame in enumerate(islice(frames, first, None), first):
        place = (index - first) % distance
        if place == 0:
            image = FrameCache(comparable(frame.array), Fraction(index * factor), SourcePosition(index, frame.time))
            if before is not None:
                yield truth, interpolator.pair(before, image)
            before = image
        elif place == distance // 2:
            truth = comparable(frame.array)


def _try(
    interpolator: Interpolator, truth: np.ndarray | None, pair: Pair, times: Sequence[Fraction], grid: TileGrid
) -> Trial:
    """Interpolate between two images, and measure the uncertainty and, where the truth is known, the error."""
    if pair.is_discontinuous:  # the nearer frame is repeated, and the other one is right as often
        apart = grid.means(squared_error(pair.image0.array, pair.image1.array)) / 2
        return Trial(scene_cut=True, doubts=[apart] * len(times), error=None)
    interpolated = list(interpolator.images(pair, times, with_confidence=True))
    error = None if truth is None else grid.means(squared_error(view(interpolated[0].image).array(), truth))
    return Trial(pair.is_cut, [grid.means(1 - image.confidence) for image in interpolated], error)


def _tiles_of(trials: Sequence[Trial]) -> tuple[np.ndarray, np.ndarray]:
    """Return the uncertainty and the error of all tiles of frames whose error is known."""
    doubts = np.concatenate([trial.doubts[0].ravel() for trial in trials])
    return doubts, np.concatenate([trial.error.ravel() for trial in trials if trial.error is not None])


def _error_nearby(sides: Sequence[Trial | None], t: float, grid: TileGrid) -> Tiles:
    """Return the error expected at time t from those of the images on both sides; NaN where neither is known."""
    measured = [
        (weight, trial.error)
        for weight, trial in zip((1 - t, t), sides, strict=True)
        if trial is not None and trial.error is not None
    ]
    if not measured:
        return np.full(grid.shape, np.nan)
    return np.asarray(sum(weight * error for weight, error in measured) / sum(weight for weight, _ in measured))
