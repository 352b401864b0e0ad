"""Fit the weights of the default method's candidates to drawn scenes: ``python samples/fit_fusion.py CLIPS ...``.

CLIPS are folders that ``construct_clips.py`` has made, of other seeds than those that are judged by. Every second frame
is hidden; of each, squares of two by two pixels are drawn, more of them where the plain weights err. The table of
`fpsboost.synthesis.fusion_table` is what makes the mean squared error of the mixture at these squares least, relative
to that of the plain weights, with an additional price on every square that becomes worse.

Needs numpy, numba, SciPy and OpenCV.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import minimize

from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.fusion_features import (
    CELL_FEATURES,
    FEATURES,
    SCALAR_FEATURES,
    SQUARE_FEATURES,
    SQUARES_PER_WINDOW,
    describe_candidate,
    spread_cells,
)
from fpsboost.kernels.multi_hypothesis import Window, window_shape
from fpsboost.kernels.pixel_weights import make_sums, make_work, pool_pixels, start_node, weigh_features
from fpsboost.kernels.window_rows import SQUARES_PER_ROW
from fpsboost.kernels.window_samples import WINDOW, locate_window, make_layer, sample_layer
from fpsboost.method_table import configure, methods
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.fusion_table import PAIRED, SINGLE, Coefficients, as_table
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis, _full_samples

KEPT = 8
"""Candidates of a node that are kept, those with the largest plain weights."""

FLOOR = 0.3
"""Added to mean squared errors, levels squared, so that what is nearly right does not count for much."""

DECIBELS = 10 / math.log(10)

MIN_DEVIATION = 0.02
"""Least standard deviation of a feature that is assumed."""

STIFFNESS = 2e-3
"""Price of the distance from the start, in standard deviations of the features, squared."""

PLAIN: Coefficients = {"similarity": (18, 18), "constant": (-18, -78)}
"""Plain weights; those of either frame alone are next to nothing."""

START: Coefficients = {**PLAIN, "constant": (-18, -22)}
"""Where the fit begins: either frame alone has a small weight, without which there is no gradient."""


@dataclass
class Squares:
    """Squares of hidden frames with the candidates of the four nodes around each."""

    features: NDArray[np.float32]
    """(squares, 4, KEPT, FEATURES)."""
    priors: NDArray[np.float32]
    """(squares, 4, KEPT); 0 where there is no candidate."""
    mixed: NDArray[np.float32]
    """Samples of both frames, mixed, levels of 255, (squares, 4, KEPT, 12)."""
    change: NDArray[np.float32]
    """Samples of frame 1 minus those of frame 0, likewise."""
    shape: NDArray[np.float32]
    """Share of each window, (squares, 4)."""
    truth: NDArray[np.float32]
    """(squares, 12)."""
    importance: NDArray[np.float32]
    """(squares,)."""


@njit
def describe_node(layer, window, t, motions, priors, support, weighting, around, work, sums, features, mixed, change):
    """Write the features and samples of the candidates of a node that the method compares; return their number."""
    start_node(sums)
    spread = np.empty(SQUARES_PER_WINDOW, np.float32)
    least, alike, count = np.float32(0), np.float32(0), 0
    for k in range(priors.size):
        if priors[k] <= 0:
            continue
        if priors[k] < weighting.min_vote_share * least or alike >= weighting.sufficient_similarity:
            break
        place = locate_window(window.top, window.left, motions[k], t, window.height, window.width, work.room.marks)
        sample_layer(layer, place, motions[k], work.room)
        pool_pixels(layer.distance, work.squared)
        room = work.features
        describe_candidate(work.squared, weighting.scale, window, motions[k], priors[k], support[k], t, around, room)
        features[count, :SQUARE_FEATURES] = room.squares.reshape(SQUARE_FEATURES, SQUARES_PER_WINDOW)
        for n in range(CELL_FEATURES):
            spread_cells(room.cells[n], room.between, spread, 0)
            features[count, SQUARE_FEATURES + n] = spread
        for n in range(SCALAR_FEATURES):
            features[count, SQUARE_FEATURES + CELL_FEATURES + n] = room.scalars[n]
        mixed[count], change[count] = layer.mixed, layer.change
        least, alike = weigh_features(priors[k], t, weighting, work, sums)
        count += 1
    return count


def draw_squares(pair: FramePair, synthesizer: MultiHypothesis, truth: NDArray[Any], count: int, seed: int) -> Squares:
    """Draw squares of the frame in the middle of a pair, more of them where the plain weights err."""
    (listed,) = synthesizer._listed(pair, [0.5])
    (image,) = synthesizer.synthesize(pair, [0.5])
    height, width = (size // 2 * 2 for size in truth.shape[:2])
    rows, columns = height // 2, width // 2
    error = ((image.astype(np.float32) - truth) ** 2).mean(2)[:height, :width].reshape(rows, 2, columns, 2).mean((1, 3))
    error = cv2.blur(error, (3, 3)).ravel().astype(np.float64)
    odds = 0.4 / error.size + 0.6 * error / max(error.sum(), 1e-9)
    odds /= odds.sum()
    drawn = np.random.default_rng(seed).choice(error.size, count, p=odds)
    y, x = drawn // columns, drawn % columns
    blocks = truth[:height, :width].reshape(rows, 2, columns, 2, 3).transpose(0, 2, 4, 1, 3).reshape(-1, 12)
    shape = count, 4, KEPT
    out = Squares(
        np.zeros((*shape, FEATURES), np.float32),
        np.zeros(shape, np.float32),
        np.zeros((*shape, 12), np.float32),
        np.zeros((*shape, 12), np.float32),
        np.zeros((count, 4), np.float32),
        blocks[drawn].astype(np.float32),
        (1 / (odds[drawn] * error.size)).astype(np.float32),
    )
    wanted: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    nodes, share = listed.candidates.listed.shape, window_shape(16)
    for i in range(count):
        for slot in range(4):
            row, column = (2 * y[i] + 8) // 16 - 1 + slot // 2, (2 * x[i] + 8) // 16 - 1 + slot % 2
            if 0 <= row < nodes[0] and 0 <= column < nodes[1]:
                square = (y[i] - 8 * row + 4) * SQUARES_PER_ROW + x[i] - 8 * column + 4
                out.shape[i, slot] = share[square]
                wanted.setdefault((row, column), []).append((i, slot, square))
    layer = make_layer(*_full_samples(pair), (1, 1), 0, 0)
    weighting, work, sums = synthesizer._weighting(pair.image0.pixels), make_work(), make_sums()
    room = listed.candidates.weights.shape[2]
    features = np.zeros((room, FEATURES, SQUARES_PER_WINDOW), np.float32)
    mixed, change = (np.zeros((room, 3, WINDOW * WINDOW), np.float32) for _ in range(2))
    for (row, column), squares in wanted.items():
        window = Window(row * 16 - 8, column * 16 - 8, *truth.shape[:2])
        number = listed.candidates.listed[row, column]
        priors = listed.candidates.weights[row, column, :number]
        motions, around = listed.candidates.motions[row, column, :number], listed.surroundings
        support, half = around.support[row, column], np.float32(0.5)
        found = describe_node(
            layer, window, half, motions, priors, support, weighting, around, work, sums, features, mixed, change
        )
        priors = priors[priors > 0][:found]
        for i, slot, square in squares:
            order = np.argsort(-priors * np.exp(18 * features[:found, 0, square]), kind="stable")[:KEPT]
            n = order.size
            out.features[i, slot, :n] = features[order, :, square]
            out.priors[i, slot, :n] = priors[order]
            first = square // SQUARES_PER_ROW * 2 * WINDOW + square % SQUARES_PER_ROW * 2
            places = [first, first + 1, first + WINDOW, first + WINDOW + 1]
            out.mixed[i, slot, :n] = (255 * mixed[order][:, :, places]).reshape(n, 12)
            out.change[i, slot, :n] = (255 * change[order][:, :, places]).reshape(n, 12)
    return out


def draw_clip(folder: Path, count: int, seed: int) -> list[Squares]:
    """Draw squares of every hidden frame of a clip."""
    frames = [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))]
    method = configure(methods["nlm"], "nlm", {"fusion": "learnt"})
    images = [FrameCache(frame) for frame in frames[::2]]
    pairs = [method.pair(first, second) for first, second in itertools.pairwise(images)]
    drawn = []
    for n, pair in enumerate(pairs):
        before, after = pairs[n - 1] if n else None, pairs[n + 1] if n + 1 < len(pairs) else None
        framed = method.frame_pair(pair, before, after)
        drawn.append(draw_squares(framed, method.synthesizer, frames[2 * n + 1], count, seed + n))
    return drawn


@njit(nogil=True, fastmath=True)
def mix_square(table, features, priors, mixed, change, shape, weights, sums, mean):
    """Write the mixture at a square, and the weights of all options of all candidates and their sums by node."""
    total = 0.0
    mean[:] = 0
    for n in range(4):
        if shape[n] <= 0:
            continue
        W = 1e-30
        for k in range(priors.shape[1]):
            if priors[n, k] <= 0:
                weights[n, k] = 0
                continue
            for o in range(3):
                logit = 0.0
                for f in range(table.shape[1]):
                    logit += table[o, f] * features[n, k, f]
                weights[n, k, o] = priors[n, k] * np.exp(min(max(logit, -40.0), 20.0))
                W += weights[n, k, o]
        sums[n] = W
        a = shape[n] / np.sqrt(W)
        total += a * W
        for k in range(priors.shape[1]):
            both = weights[n, k, 0] + weights[n, k, 1] + weights[n, k, 2]
            lean = 0.5 * (weights[n, k, 2] - weights[n, k, 1])
            if both > 0:
                for p in range(12):
                    mean[p] += a * (both * mixed[n, k, p] + lean * change[n, k, p])
    for p in range(12):
        mean[p] /= total
    return total


@njit(nogil=True, fastmath=True)
def measure(table, features, priors, mixed, change, shape, truth, errors):
    """Write the mean squared error of each square."""
    weights, sums, mean = np.zeros((4, priors.shape[2], 3)), np.ones(4), np.zeros(12)
    for i in range(truth.shape[0]):
        mix_square(table, features[i], priors[i], mixed[i], change[i], shape[i], weights, sums, mean)
        error = 0.0
        for p in range(12):
            off = min(max(mean[p], 0.0), 255.0) - truth[i, p]
            error += off * off
        errors[i] = error / 12


@njit(nogil=True, fastmath=True)
def average_node(priors, mixed, change, weights, total, mean):
    """Write the mean of a node's samples by the weights of its options."""
    mean[:] = 0
    for k in range(priors.size):
        both, lean = weights[k].sum() / total, 0.5 * (weights[k, 2] - weights[k, 1]) / total
        for p in range(12):
            mean[p] += both * mixed[k, p] + lean * change[k, p]


@njit(nogil=True, fastmath=True)
def differentiate(table, features, priors, mixed, change, shape, truth, price, gradient):
    """Add the gradient of the errors, each times its price, with respect to the table."""
    kept = priors.shape[2]
    weights, sums, mean = np.zeros((4, kept, 3)), np.ones(4), np.zeros(12)
    slope, here = np.zeros(12), np.zeros(12)
    for i in range(truth.shape[0]):
        total = mix_square(table, features[i], priors[i], mixed[i], change[i], shape[i], weights, sums, mean)
        for p in range(12):
            inside = 0 <= mean[p] <= 255
            slope[p] = price[i] * 2 * (mean[p] - truth[i, p]) / 12 if inside else 0.0
        for n in range(4):
            if shape[i, n] <= 0:
                continue
            average_node(priors[i, n], mixed[i, n], change[i, n], weights[n], sums[n], here)
            share = shape[i, n] / np.sqrt(sums[n]) / total
            for k in range(kept):
                level, across = 0.0, 0.0
                for p in range(12):
                    level += slope[p] * (mixed[i, n, k, p] - 0.5 * here[p] - 0.5 * mean[p])
                    across += slope[p] * 0.5 * change[i, n, k, p]
                for o in range(3):
                    pull = weights[n, k, o] * share * (level + (o == 2) * across - (o == 1) * across)
                    for f in range(table.shape[1]):
                        gradient[o, f] += pull * features[i, n, k, f]


NUMBERS = [(name, place) for names, count in ((SINGLE, 2), (PAIRED, 4)) for name in names for place in range(count)]
"""Free numbers of the table: the name of a feature, and the place among its coefficients."""


def name_numbers(numbers: NDArray[Any]) -> Coefficients:
    """Return the free numbers by the names of their features."""
    found: dict[str, tuple[float, ...]] = {}
    for (name, _), number in zip(NUMBERS, numbers, strict=True):
        found[name] = (*found.get(name, ()), float(number))
    return found


BASIS = np.array([as_table(name_numbers(row)).astype(float) for row in np.eye(len(NUMBERS))])
"""What each free number adds to the table."""


class Objective:
    """What is minimised: how much smaller the mean squared error is than that of plain weights, dB, over all frames."""

    def __init__(self, frames: Sequence[Squares]) -> None:
        self._frames = [
            (frame, (frame.features, frame.priors, frame.mixed, frame.change, frame.shape)) for frame in frames
        ]
        self._plain = [self._errors(as_table(PLAIN), number) for number in range(len(frames))]
        every = np.concatenate([frame.features[frame.priors > 0] for frame in frames[:60]])
        uses = (BASIS != 0).any(axis=1)
        self.scales = 1 / np.maximum(uses @ every.std(0) / uses.sum(axis=1), MIN_DEVIATION)

    def _errors(self, table: NDArray[np.float32], number: int) -> NDArray[np.float64]:
        """Return the mean squared error of each square of a frame, levels squared."""
        frame, arrays = self._frames[number]
        errors = np.empty(frame.truth.shape[0])
        measure(table, *arrays, frame.truth, errors)
        return errors

    def __call__(self, numbers: NDArray[Any], start: NDArray[Any]) -> tuple[float, NDArray[Any]]:
        """Return the loss and its gradient; numbers are those of the table over `scales`, and stay near the start."""
        table = np.tensordot(numbers * self.scales, BASIS, 1).astype(np.float32)
        loss, gradient = 0.0, np.zeros((3, FEATURES))
        for number, ((frame, arrays), plain) in enumerate(zip(self._frames, self._plain, strict=True)):
            errors, weight = self._errors(table, number), frame.importance / frame.truth.shape[0]
            before, now = weight @ plain + FLOOR, weight @ errors + FLOOR
            worse = errors > plain + FLOOR
            excess = (weight * worse) @ (errors - plain - FLOOR)
            loss += 10 * np.log10(now / before) + DECIBELS * excess / before
            price = DECIBELS * weight * (1 / now + worse / before) / len(self._frames)
            differentiate(table, *arrays, frame.truth, price, gradient)
        apart = numbers - start
        free = (BASIS.reshape(len(BASIS), -1) @ gradient.ravel()) * self.scales
        return loss / len(self._frames) + 0.5 * STIFFNESS * apart @ apart, free + STIFFNESS * apart

    def gain(self, table: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return how many dB better than plain weights each frame is."""
        importance = [frame.importance for frame, _ in self._frames]
        return np.array(
            [
                10 * np.log10((weight @ plain) / (weight @ self._errors(table, number)))
                for number, (weight, plain) in enumerate(zip(importance, self._plain, strict=True))
            ]
        )


def start(objective: Objective) -> NDArray[np.float64]:
    """Return the numbers where a fit begins."""
    return np.array([START.get(name, (0, 0, 0, 0))[place] for name, place in NUMBERS]) / objective.scales


def fit(frames: Sequence[Squares], steps: int, tell: Callable[[int, Objective, Coefficients], None]) -> Coefficients:
    """Return the table that fits the squares best, after so many steps from plain weights."""
    objective, count = Objective(frames), itertools.count(1)
    found = minimize(
        objective,
        start(objective),
        args=(start(objective),),
        jac=True,
        method="L-BFGS-B",
        callback=lambda numbers: tell(next(count), objective, name_numbers(numbers * objective.scales)),
        options={"maxiter": steps},
    )
    return name_numbers(found.x * objective.scales)


def main() -> None:
    """Fit a table to what the command line names, and print it."""
    parser = argparse.ArgumentParser(description="Fit the weights of the default method to drawn scenes.")
    parser.add_argument("clips", type=Path, nargs="+", help="folders of clips, as construct_clips.py makes them")
    parser.add_argument("--squares", type=int, default=300, help="drawn of each hidden frame (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=90, help="of the minimisation (default: %(default)s)")
    options = parser.parse_args()
    folders = [clip for folder in options.clips for clip in sorted(folder.iterdir()) if clip.is_dir()]
    frames = [frame for number, clip in enumerate(folders) for frame in draw_clip(clip, options.squares, 100 * number)]

    def tell(step: int, objective: Objective, table: Coefficients) -> None:
        if step % 10 == 0:
            print(f"# step {step}: {objective.gain(as_table(table)).mean():+.3f} dB", flush=True)

    for name, values in fit(frames, options.steps, tell).items():
        print(f'    "{name}": ({", ".join(f"{value:.3g}" for value in values)}),')


if __name__ == "__main__":
    main()
