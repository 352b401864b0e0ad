"""How good: hide every second frame, make it again, compare: ``python benchmarks/quality.py [CLIP ...]``.

A clip is a video, a folder or a pattern of images; the sample clip by default. Pairs across a scene cut are left out,
since no method can know what lies there. Figures are means over the hidden frames: PSNR of the mean squared error and
SSIM as scikit-image has them, MAE in levels of 255 (what the Middlebury tables call interpolation error), and CPU
milliseconds a frame.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from skimage.metrics import mean_squared_error, structural_similarity

from fpsboost.frame import Image
from fpsboost.interpolator import Interpolator, methods
from fpsboost.media.opening import open_source
from fpsboost.motion.colour import normalised
from fpsboost.scenes import CutDetector

SAMPLE = Path(__file__).parent.parent / "samples" / "orbit.mp4"


def triplets(clip: str, largest: int) -> Iterator[tuple[Image, Image, Image]]:
    """Every even frame, the hidden one after it, and the next even one."""
    with open_source(clip) as source:
        frames = iter(source)
        first = next(frames).image
        for _ in range(largest):
            pair = list(islice(frames, 2))
            if len(pair) < 2:
                return
            hidden, last = (frame.image for frame in pair)
            yield first, hidden, last
            first = last


def score(truth: Image, made: Image) -> dict[str, float]:
    """PSNR in dB, SSIM, MAE in levels of 255."""
    reference, guess = (normalised(image).astype(np.float64) for image in (truth, made))
    error = max(float(mean_squared_error(reference, guess)), 1e-12)
    return {
        "psnr": float(-10 * np.log10(error)),
        "ssim": float(structural_similarity(reference, guess, channel_axis=2, data_range=1)),
        "mae": float(np.abs(reference - guess).mean() * 255),
    }


def measure(clip: str, chosen: dict[str, Interpolator], largest: int) -> dict[str, dict[str, float]]:
    """Mean scores of every method over one clip."""
    scores: dict[str, list[dict[str, float]]] = {name: [] for name in chosen}
    for first, hidden, last in triplets(clip, largest):
        if CutDetector().is_cut(first, last):
            continue
        for name, interpolator in chosen.items():
            begin = time.process_time()
            made: NDArray[Any] = interpolator.interpolate(first, last, [0.5])[0]
            spent = (time.process_time() - begin) * 1e3
            scores[name].append({**score(hidden, made), "cpu_ms": spent})
    return {name: means(rows) for name, rows in scores.items() if rows}


def means(rows: list[dict[str, float]]) -> dict[str, float]:
    """The mean of every figure."""
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def main() -> None:
    """Print a table for each clip, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="*", default=[str(SAMPLE)])
    parser.add_argument("--methods", default=",".join(methods), help="names, separated by commas")
    parser.add_argument("--frames", type=int, default=40, help="hidden frames at most, per clip")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    chosen = {name: methods[name] for name in arguments.methods.split(",")}
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    for interpolator in chosen.values():
        interpolator.compile_for(noise)
    figures = {}
    for clip in arguments.clip:
        figures[clip] = measure(clip, chosen, arguments.frames)
        table = Table("method", "PSNR, dB", "SSIM", "MAE", "CPU, ms", title=clip)
        for name, row in figures[clip].items():
            table.add_row(name, f"{row['psnr']:.2f}", f"{row['ssim']:.4f}", f"{row['mae']:.3f}", f"{row['cpu_ms']:.0f}")
        Console().print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
