"""Fit the weights of the default method's candidates to drawn scenes: ``python samples/fit_fusion.py CLIPS ...``.

CLIPS are folders that ``construct_clips.py`` has made, of other seeds than those that are judged by. Every second frame
is hidden; of each, patches of 8 by 8 pixels are drawn, more of them where the plain weights err. A table like that of
`fpsboost.synthesis.fusion_table` is what makes the error of the mixture in these patches least, relative to that of the
plain weights, with an additional price on every patch that becomes worse. The error is the mean of squares; with
``--edge-weight``, edges that vanish or are added cost more. It is found by Adam (Kingma and Ba 2015, arXiv:1412.6980),
from plain weights and hinges of random directions, or from the table of the package. ``--mean`` prints the mean of
tables that were fitted in different ways.

Needs numpy and OpenCV.
"""

from __future__ import annotations

import argparse
import itertools
import math
import runpy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Interpolator
from fpsboost.kernels.constants import BLOCKS_2X2, BLOCKS_2X2_PER_ROW, FEATURES, WINDOW
from fpsboost.kernels.multi_hypothesis import extract_features, window_shape
from fpsboost.method_table import find_method
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.fusion_table import OUTPUTS, TABLE, mirrored
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis

SIDE = 4
"""Squares of two by two pixels, for each of which candidates are weighted, along each axis of a patch."""

LUMA = np.array([0.114, 0.587, 0.299], np.float32)
"""Shares of blue, green and red."""

KEPT = 8
"""Candidates of a node that are kept, those with the largest plain weights."""

FLOOR = 0.3
"""Added to mean squared errors, levels squared, so that what is nearly right does not count for much."""

EXCESS = 1.5
"""Price of what patches become worse than with plain weights, beside that of all errors."""

DECIBELS = 10 / math.log(10)

MIN_DEVIATION = 0.05
"""Least standard deviation of a feature that is assumed."""

HINGES = 8

CONSTANT, VOTES = 19, 20
"""Numbers of the feature that is always 1, and of the prior weight of a candidate."""

BATCH = 8
"""Frames whose gradients make a step."""

RATES = {"random": 0.03, "current": 0.005}
"""Largest length of a step along each number, by the start."""

MAX_GRADIENT, MOMENTUM = 5.0, (0.9, 0.999)
"""Largest norm of a gradient; decay of its means and of its squares."""


@dataclass
class Patches:
    """Patches of a hidden frame: their squares, row by row, with the candidates of the four nodes around each."""

    features: NDArray[np.float32]
    """(squares, 4, KEPT, FEATURES)."""
    priors: NDArray[np.float32]
    """By the votes, (squares, 4, KEPT); 0 where there is no candidate."""
    gains: NDArray[np.float32]
    """Factors on the weights of both frames together where a candidate shows what is in front, likewise."""
    mixed: NDArray[np.float32]
    """Samples of both frames, mixed, levels of 255, (squares, 4, KEPT, 12): three channels of four pixels."""
    change: NDArray[np.float32]
    """Samples of frame 1 minus those of frame 0, likewise."""
    shape: NDArray[np.float32]
    """Share of each window, (squares, 4)."""
    truth: NDArray[np.float32]
    """(squares, 12)."""
    importance: NDArray[np.float32]
    """How many times as likely each patch would be if all were equally likely, (patches,)."""


def draw_patches(pair: FramePair, synthesizer: MultiHypothesis, truth: NDArray[Any], count: int, seed: int) -> Patches:
    """Draw patches of the frame in the middle of a pair, more of them where the plain weights err."""
    (inputs,) = synthesizer._blend_inputs(pair, [0.5])
    (image,) = synthesizer.synthesize(pair, [0.5])
    height, width = (size // 2 * 2 for size in truth.shape[:2])
    rows, columns = height // 2, width // 2
    error = ((image.astype(np.float32) - truth) ** 2).mean(2)[:height, :width].reshape(rows, 2, columns, 2).mean((1, 3))
    error = cv2.boxFilter(cv2.blur(error, (3, 3)), -1, (SIDE, SIDE), anchor=(0, 0))
    error = error[: rows - SIDE + 1, : columns - SIDE + 1].astype(np.float64)
    odds = 0.4 / error.size + 0.6 * error.ravel() / max(error.sum(), 1e-9)
    odds /= odds.sum()
    drawn = np.random.default_rng(seed).choice(error.size, count, p=odds)
    top, left = (place[:, None, None] for place in np.unravel_index(drawn, error.shape))
    down, right = np.indices((SIDE, SIDE))
    y, x = (top + down).ravel(), (left + right).ravel()
    blocks = truth[:height, :width].reshape(rows, 2, columns, 2, 3).transpose(0, 2, 4, 1, 3).reshape(rows, columns, 12)
    shape = y.size, 4, KEPT
    out = Patches(
        np.zeros((*shape, FEATURES), np.float32),
        np.zeros(shape, np.float32),
        np.ones(shape, np.float32),
        np.zeros((*shape, 12), np.float32),
        np.zeros((*shape, 12), np.float32),
        np.zeros((y.size, 4), np.float32),
        blocks[y, x].astype(np.float32),
        (1 / (odds[drawn] * error.size)).astype(np.float32),
    )
    wanted: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    nodes, share = inputs.candidates.listed.shape, window_shape(16)
    for i in range(y.size):
        for slot in range(4):
            row, column = (2 * y[i] + 8) // 16 - 1 + slot // 2, (2 * x[i] + 8) // 16 - 1 + slot % 2
            if 0 <= row < nodes[0] and 0 <= column < nodes[1]:
                square = (y[i] - 8 * row + 4) * BLOCKS_2X2_PER_ROW + x[i] - 8 * column + 4
                out.shape[i, slot] = share[square]
                wanted.setdefault((row, column), []).append((i, slot, square))
    half = np.float32(0.5)
    room, found = inputs.candidates.weights.shape[2], np.empty(1, np.int64)
    features, gains = (np.zeros((room, *size, BLOCKS_2X2), np.float32) for size in ((FEATURES,), ()))
    mixed, change = (np.zeros((room, 3, WINDOW * WINDOW), np.float32) for _ in range(2))
    for (row, column), squares in wanted.items():
        node = inputs.full, row, column, half, inputs.candidates, inputs.weighting, inputs.context
        extract_features(*node, features, gains, mixed, change, found)
        priors = features[: found[0], VOTES, 0]
        for i, slot, square in squares:
            order = np.argsort(-priors * np.exp(18 * features[: found[0], 0, square]), kind="stable")[:KEPT]
            n = order.size
            out.features[i, slot, :n] = features[order, :, square]
            out.priors[i, slot, :n], out.gains[i, slot, :n] = priors[order], gains[order, square]
            first = square // BLOCKS_2X2_PER_ROW * 2 * WINDOW + square % BLOCKS_2X2_PER_ROW * 2
            places = [first, first + 1, first + WINDOW, first + WINDOW + 1]
            out.mixed[i, slot, :n] = (255 * mixed[order][:, :, places]).reshape(n, 12)
            out.change[i, slot, :n] = (255 * change[order][:, :, places]).reshape(n, 12)
    return out


def draw_clip(folder: Path, method: Interpolator, count: int, seed: int) -> list[Patches]:
    """Draw patches of every hidden frame of a clip."""
    frames = [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))]
    images = [FrameCache(frame) for frame in frames[::2]]
    pairs = [method.pair(first, second) for first, second in itertools.pairwise(images)]
    drawn = []
    for n, pair in enumerate(pairs):
        before, after = pairs[n - 1] if n else None, pairs[n + 1] if n + 1 < len(pairs) else None
        framed = pair.between(before, after).curved_frame_pair
        drawn.append(draw_patches(framed, method.synthesizer, frames[2 * n + 1], count, seed + n))
    return drawn


class Numbers(NamedTuple):
    """What is fitted: the rows of a table, (2 + HINGES, FEATURES), and the outputs of the hinges, (HINGES, 2)."""

    rows: NDArray[np.float64]
    outputs: NDArray[np.float64]


class Mixture(NamedTuple):
    """The mixture at every square, and what its gradient needs again."""

    mean: NDArray[np.floating]
    """(squares, 12)."""
    hinges: NDArray[np.floating]
    """Hinges of frame 0 and of frame 1, (squares, 4, KEPT, 2, HINGES)."""
    weights: NDArray[np.floating]
    """Of both frames, of frame 0 and of frame 1, of every candidate, (squares, 4, KEPT, 3)."""
    means: NDArray[np.floating]
    """Mixtures of the nodes by themselves, (squares, 4, 12)."""
    shares: NDArray[np.floating]
    """Factors of the weights of a node in the mixture, (squares, 4)."""


def mix(numbers: Numbers, patches: Patches) -> Mixture:
    """Return the mixture at each square, by numbers for features as they are."""
    rows, outputs = numbers
    both_orders = np.concatenate([rows, mirrored(rows)]).astype(np.float32)
    sums = (patches.features @ both_orders.T).reshape(*patches.priors.shape, 2, len(rows))
    hinges = np.maximum(sums[..., 2:], 0)
    logits = np.empty((*patches.priors.shape, 3))
    logits[..., 0] = 0.5 * (sums[..., 0] + hinges @ outputs[:, 0]).sum(-1)
    logits[..., 1:] = sums[..., 1] + hinges @ outputs[:, 1]
    weights = patches.priors[..., None] * np.exp(logits.clip(-40, 20))
    weights[..., 0] *= patches.gains
    totals = weights.sum((2, 3)) + 1e-30
    both, lean = weights.sum(-1) / totals[..., None], 0.5 * (weights[..., 2] - weights[..., 1]) / totals[..., None]
    means = (both[:, :, None] @ patches.mixed + lean[:, :, None] @ patches.change)[:, :, 0]
    parts = patches.shape * np.sqrt(totals)
    parts /= parts.sum(1, keepdims=True)
    return Mixture((parts[:, None] @ means)[:, 0], hinges, weights, means, parts / totals)


def differentiate(numbers: Numbers, patches: Patches, mixture: Mixture, slopes: NDArray[np.floating]) -> Numbers:
    """Return the gradient with respect to numbers, given that with respect to the mixture, (squares, 12)."""
    _, outputs = numbers
    mean, hinges, weights, means, shares = mixture
    along = slopes[:, None, :, None]
    level = (patches.mixed @ along)[..., 0] - 0.5 * (means + mean[:, None]) @ slopes[..., None]
    across = 0.5 * (patches.change @ along)[..., 0]
    pull = weights * shares[..., None, None] * np.stack([level, level - across, level + across], axis=-1)
    half, alone = 0.5 * pull[..., :1], pull[..., 1:]  # of frame 0 and of frame 1
    onto_sums = np.empty((*alone.shape, 2 + len(outputs)), np.float32)
    onto_sums[..., 0], onto_sums[..., 1] = half, alone
    onto_sums[..., 2:] = (hinges > 0) * (half[..., None] * outputs[:, 0] + alone[..., None] * outputs[:, 1])
    features = patches.features.reshape(-1, FEATURES)
    own, exchanged = np.moveaxis(onto_sums.reshape(len(features), 2, -1), 1, 0)
    row_slopes = own.T @ features + mirrored(exchanged.T @ features)
    every = hinges.reshape(-1, len(outputs))
    half = np.broadcast_to(half, alone.shape)
    return Numbers(row_slopes, np.stack([half.ravel() @ every, alone.ravel() @ every], axis=1))


def measure_edges(samples: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return the mean strength of edges in luma at half the size, by patch, and its gradient.

    Parameters
    ----------
    samples : (squares, 12)
        Levels of 255; a square is one pixel at half the size.

    Returns
    -------
    strength : (patches,)
        Mean of sqrt(dx**2 + dy**2 + 1), for forward differences in levels.
    slopes : (squares, 12)
        Gradient of the strength of its patch.
    """
    luma = (samples.reshape(-1, 3, 4).mean(2) @ LUMA).reshape(-1, SIDE, SIDE)
    corner = luma[:, :-1, :-1]
    across, down = luma[:, :-1, 1:] - corner, luma[:, 1:, :-1] - corner
    length = np.sqrt(across**2 + down**2 + 1)
    across, down = across / length, down / length
    slopes = np.zeros_like(luma)
    slopes[:, :-1, :-1] -= across + down
    slopes[:, :-1, 1:] += across
    slopes[:, 1:, :-1] += down
    return length.mean((1, 2)), slopes.reshape(-1, 1) / (SIDE - 1) ** 2 * np.repeat(LUMA / 4, 4)


def measure(mixture: NDArray[Any], truth: NDArray[Any], edge_weight: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the error of each patch, levels squared, and its gradient with respect to the mixture, (squares, 12).

    It is the mean squared error plus `edge_weight` times the squared difference of the mean strengths of edges.
    """
    shown = mixture.clip(0, 255)
    off, area = shown - truth, SIDE**2
    (strength, edge_slopes), (wanted, _) = measure_edges(shown), measure_edges(truth)
    errors = (off**2).reshape(len(strength), -1).mean(1) + edge_weight * (strength - wanted) ** 2
    slopes = 2 * off / (12 * area) + 2 * edge_weight * np.repeat(strength - wanted, area)[:, None] * edge_slopes
    return errors, np.where(mixture == shown, slopes, 0)


class Objective:
    """What is minimised: the error relative to that of plain weights, dB, with a price on patches that become worse.

    Numbers are those of features with a mean of 0 and a deviation of 1, whose steps are alike.
    """

    def __init__(self, frames: Sequence[Patches], edge_weight: float = 0) -> None:
        every = np.concatenate([frame.features[frame.priors > 0][::16] for frame in frames])
        every = np.concatenate([every, mirrored(every)])
        self._means, self._deviations = every.mean(0), np.maximum(every.std(0), MIN_DEVIATION)
        self._means[CONSTANT], self._deviations[CONSTANT] = 0, 1
        self._frames, self._edge_weight = frames, edge_weight
        plain = self.raw(self.plain(-78))
        self._plain = [measure(mix(plain, frame).mean, frame.truth, edge_weight)[0] for frame in frames]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    def plain(self, alone: float) -> Numbers:
        """Return plain weights; those of either frame alone begin with this constant."""
        rows = np.zeros((2 + HINGES, FEATURES))
        rows[:2, 0], rows[:2, CONSTANT] = 18, (-18, alone)
        return self.standardised(Numbers(rows, np.zeros((HINGES, 2))))

    def standardised(self, numbers: Numbers) -> Numbers:
        """Return numbers for features as they are as those that are fitted."""
        rows = numbers.rows * self._deviations
        rows[:, CONSTANT] += numbers.rows @ self._means
        return Numbers(rows, numbers.outputs)

    def raw(self, numbers: Numbers) -> Numbers:
        """Return the numbers that are fitted as those for features as they are."""
        rows = numbers.rows / self._deviations
        rows[:, CONSTANT] -= rows @ self._means
        return Numbers(rows, numbers.outputs)

    def __call__(self, numbers: Numbers, chosen: Sequence[int]) -> tuple[float, Numbers]:
        """Return the mean loss of the chosen frames and its gradient."""
        loss, total, raw = 0.0, Numbers(*map(np.zeros_like, numbers)), self.raw(numbers)
        for number in chosen:
            frame, plain = self._frames[number], self._plain[number]
            mixture = mix(raw, frame)
            errors, slopes = measure(mixture.mean, frame.truth, self._edge_weight)
            weight = frame.importance / len(plain)
            before, now = weight @ plain + FLOOR, weight @ errors + FLOOR
            worse = errors > plain + FLOOR
            excess = (weight * worse) @ (errors - plain - FLOOR)
            loss += 10 * np.log10(now / before) + EXCESS * DECIBELS * excess / before
            price = DECIBELS * weight * (1 / now + EXCESS * worse / before) / len(chosen)
            slopes *= np.repeat(price, SIDE**2)[:, None]
            total = Numbers(*map(np.add, total, differentiate(raw, frame, mixture, slopes)))
        rows, outputs = total
        rows = (rows - rows[:, [CONSTANT]] * self._means) / self._deviations
        return loss / len(chosen), Numbers(rows, outputs)

    def gain(self, numbers: Numbers) -> NDArray[np.float64]:
        """Return how many dB better than plain weights each frame is."""
        raw, gains = self.raw(numbers), []
        for frame, plain in zip(self._frames, self._plain, strict=True):
            errors, _ = measure(mix(raw, frame).mean, frame.truth, self._edge_weight)
            gains.append(10 * np.log10((frame.importance @ plain) / (frame.importance @ errors)))
        return np.array(gains)


def as_numbers(table: Iterable[Sequence[float]], outputs: Sequence[Sequence[float]]) -> Numbers:
    """Return the columns of a table, and the outputs of its hinges, as numbers for features as they are."""
    return Numbers(np.array(list(table), float).T, np.array(outputs, float).T)


def find_start(objective: Objective, kind: str) -> Numbers:
    """Return where a fit begins: at the "current" table, or at plain weights and "random" hinges.

    From plain weights, either frame alone has a small weight, without which there is no gradient.
    """
    if kind == "current":
        return objective.standardised(as_numbers(TABLE.values(), OUTPUTS))
    random, plain = np.random.default_rng(1), objective.plain(-22)
    limit = FEATURES**-0.5
    plain.rows[2:] = random.uniform(-limit, limit, (HINGES, FEATURES))
    plain.outputs[:] = random.uniform(-0.1, 0.1, (HINGES, 2)) * HINGES**-0.5
    return plain


def fit(objective: Objective, start: Numbers, rate: float, epochs: int) -> Iterator[Numbers]:
    """Yield the numbers after each epoch; the steps grow up to `rate`, then shrink until the last epoch."""
    random, numbers, count = np.random.default_rng(2), start, len(objective)
    batches, step = count // BATCH or 1, 0
    means, squares = (Numbers(*map(np.zeros_like, numbers)) for _ in range(2))
    for _ in range(epochs):
        for chosen in np.array_split(random.permutation(count), batches):
            _, slopes = objective(numbers, chosen)
            step += 1
            length = rate * math.sin(math.pi * (step / (epochs * batches)) ** 0.6) ** 2
            limit = min(1, MAX_GRADIENT / math.sqrt(sum((slope**2).sum() for slope in slopes)))
            stepped = []
            for number, slope, mean, square in zip(numbers, slopes, means, squares, strict=True):
                mean[:] = MOMENTUM[0] * mean + (1 - MOMENTUM[0]) * limit * slope
                square[:] = MOMENTUM[1] * square + (1 - MOMENTUM[1]) * (limit * slope) ** 2
                unbiased = mean / (1 - MOMENTUM[0] ** step), square / (1 - MOMENTUM[1] ** step)
                stepped.append(number - length * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8))
            numbers = Numbers(*stepped)
        yield numbers


def read_options() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description="Fit the weights of the default method to drawn scenes.")
    parser.add_argument("clips", type=Path, nargs="*", help="folders of clips, as construct_clips.py makes them")
    parser.add_argument("--method", default="nlm", help="whose candidates are weighted (default: %(default)s)")
    parser.add_argument("--patches", type=int, default=20, help="drawn of each hidden frame (default: %(default)s)")
    parser.add_argument(
        "--edge-weight", type=float, default=0, metavar="W", help="of lost or added edges (default: %(default)s)"
    )
    parser.add_argument(
        "--start", choices=list(RATES), default="random", help="where the fit begins (default: %(default)s)"
    )
    parser.add_argument("--epochs", type=int, default=45, help="of the minimisation (default: %(default)s)")
    parser.add_argument("--stop-after", type=int, metavar="N", help="end early, after N epochs")
    parser.add_argument("--mean", type=Path, nargs="+", metavar="TABLE", help="print the mean of printed tables")
    options = parser.parse_args()
    if bool(options.clips) == bool(options.mean):
        parser.error("name either folders of clips to fit to, or tables after --mean")
    return options


def main() -> None:
    """Fit a table to what the command line names, or take the mean of tables, and print it."""
    options = read_options()
    if options.mean:
        files = [runpy.run_path(str(path)) for path in options.mean]
        tables = [as_numbers(file["TABLE"].values(), file["OUTPUTS"]) for file in files]
        print_table(Numbers(*(np.mean(each, 0) for each in zip(*tables, strict=True))))
        return
    folders = [clip for folder in options.clips for clip in sorted(folder.iterdir()) if clip.is_dir()]
    method, frames = find_method(options.method), []
    for number, clip in enumerate(folders):
        frames += draw_clip(clip, method, options.patches, 100 * number)
    objective = Objective(frames, options.edge_weight)
    numbers = find_start(objective, options.start)
    fitted = fit(objective, numbers, RATES[options.start], options.epochs)
    for epoch, numbers in enumerate(itertools.islice(fitted, options.stop_after), 1):
        print(f"# epoch {epoch}: {objective.gain(numbers).mean():+.3f} dB", flush=True)
    print_table(objective.raw(numbers))


def print_table(numbers: Numbers) -> None:
    """Print the numbers as `fpsboost.synthesis.fusion_table` has them."""
    rows, (both, alone) = (each.T.tolist() for each in numbers)
    print("TABLE = {")
    for name, values in zip(TABLE, rows, strict=True):
        print(f'    "{name}": ({", ".join(f"{value:.3g}" for value in values)}),')
    print("}\nOUTPUTS = (")
    for values in (both, alone):
        print(f"    ({', '.join(f'{value:.3g}' for value in values)}),")
    print(")")


if __name__ == "__main__":
    main()
