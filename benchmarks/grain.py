"""How grainy: noise of made frames against rendered ones, without and with ``match_grain``.

``python benchmarks/grain.py`` adds noise to the frames of ``samples/scenes``, hides every second frame and makes it
again: Gaussian noise of a standard deviation in levels of 255, white or blurred with a radius in pixels. The noise of a
frame is its difference from the frame made of the scene without noise: its standard deviation in blocks of 16 pixels,
the median of them; that of a hidden frame is what was added. ``pulse`` is the standard deviation of the noise of
rendered and made frames in turn, as a share of its mean. PSNR is against the hidden frame, with its noise.

``python benchmarks/grain.py FOLDER ...`` takes frames as they are, such as path-traced ones. Their noise is Immerkaer's
(1996) in blocks of 16 pixels, the quantile of 10 % of them, where the picture is flattest.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import methods
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.interpolator import Interpolator
from fpsboost.pair import with_neighbours

Array = NDArray[Any]
SCENES = Path(__file__).parents[1] / "samples" / "scenes"
NOISE = ((0, 0.0), (4, 0.0), (8, 0.0), (16, 0.0), (8, 0.7), (8, 1.0), (8, 2.0))
"""Standard deviations in levels and radii of the blur in pixels."""
BLOCK = 16
LAPLACIAN = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6


def read(folder: Path, count: int) -> list[Array]:
    """Read the first frames of a folder, 8-bit BGR."""
    return [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))[:count]]


def noisy(frames: list[Array], deviation: float, radius: float) -> list[Array]:
    """Add noise to frames."""
    random, made = np.random.default_rng(0), []
    for frame in frames:
        noise = random.normal(0, 1, frame.shape)
        if radius:
            noise = cv2.GaussianBlur(noise, (0, 0), radius)
        made.append(np.clip(np.rint(frame + noise * (deviation / noise.std())), 0, 255).astype(np.uint8))
    return made


def hidden(interpolator: Interpolator, frames: list[Array]) -> list[Array]:
    """Make every second frame again."""
    caches = [FrameCache(frame, None, SourcePosition(k, Fraction(k))) for k, frame in enumerate(frames[::2])]
    pairs = [interpolator.pair(*each) for each in pairwise(caches)]
    return [np.asarray(image) for pair in with_neighbours(pairs) for image, _ in interpolator.images(pair, [0.5])]


def blocks(values: Array) -> Array:
    """Return the mean of each block of a plane."""
    rows, columns = (length // BLOCK for length in values.shape[:2])
    cut = values[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK, -1)
    return np.asarray(cut.mean(axis=(1, 3, 4)))


def flattest(frame: Array) -> float:
    """Return the noise where a frame is flattest, levels."""
    return float(np.sqrt(np.quantile(blocks(np.square(cv2.filter2D(frame.astype(np.float32), -1, LAPLACIAN))), 0.1)))


def difference(frame: Array, clean: Array) -> float:
    """Return the noise of a frame, levels, whose clean frame is known."""
    noise = frame.astype(float) - clean
    return float(np.sqrt(np.median(blocks(np.square(noise)))))


def psnr(made: list[Array], truths: list[Array]) -> float:
    """Return the mean PSNR, dB."""
    errors = [np.square(one.astype(float) - other).mean() for one, other in zip(made, truths, strict=True)]
    return float(np.mean(10 * np.log10(255**2 / np.array(errors))))


def row(frames: list[Array], method: Interpolator, measure: Callable[[list[Array], bool], list[float]]) -> str:
    """Return the ratio, pulse and PSNR without and with matched grain as a table's cells."""
    truths, cells = frames[1::2], []
    kept = measure(frames, True)
    for match_grain in (False, True):
        made = hidden(replace(method, match_grain=match_grain), frames)
        noise = measure(made, False)
        turns = [level for pair in zip(kept[::2], noise, strict=False) for level in pair]
        is_clean = max(kept) == 0  # so that there is nothing to compare with
        ratio = "none" if is_clean else f"{np.mean(noise) / np.mean(kept[1::2]):.2f}"
        pulse = "none" if is_clean else f"{np.std(turns) / np.mean(turns):.2f}"
        cells.append((ratio, pulse, f"{psnr(made, truths[: len(made)]):.2f}"))
    return " | ".join(f"{without}, {matched}" for without, matched in zip(*cells, strict=True))


def rows(folders: list[Path], count: int, method: Interpolator) -> Iterator[str]:
    """Yield the rows of the table."""
    if folders:
        for folder in folders:
            yield f"| {folder.name} | {row(read(folder, count), method, lambda each, _: list(map(flattest, each)))} |"
        return
    for scene in ("texture", "glass", "reflective"):
        clean = read(SCENES / scene, count)
        made_clean = hidden(method, clean)
        for deviation, radius in NOISE:

            def measure(frames: list[Array], are_rendered: bool) -> list[float]:
                references = clean if are_rendered else made_clean  # noqa: B023
                return [difference(*each) for each in zip(frames, references, strict=True)]

            cells = row(noisy(clean, deviation, radius), method, measure)
            yield f"| {scene}, {deviation} levels{f', radius {radius:g}' if radius else ''} | {cells} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--frames", type=int, default=9, help="how many of each, an odd number (default: %(default)s)")
    parser.add_argument("--method", default="nlm", help="which method (default: %(default)s)")
    options = parser.parse_args()
    print("| | noise of made to rendered: without, with | pulse | PSNR, dB |\n|---|---|---|---|")
    for each in rows(options.folders, options.frames, methods[options.method]):
        print(each, flush=True)


if __name__ == "__main__":
    main()
