"""How well do methods go through light that changes in one place? ``python benchmarks/light_spots.py CLIPS``.

A Gaussian spot of light comes up between two frames, in proportion to time, so that the frame between them is known:
the hidden frame of a clip under half of it. On resting ground, the hidden frame stands for all three.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scoring import find_clips, one_thread, read_frames, wide_console

from fpsboost.evaluation.results import score
from fpsboost.image import Image
from fpsboost.method_table import methods

RADII, GAINS = (0.05, 0.15, 0.3, 0.5), (1.3, 2.0, 3.0)


def spot(height: int, width: int, radius: float) -> NDArray[np.float64]:
    """Return a spot in the middle, with a standard deviation of `radius` heights, (height, width, 1) in [0, 1]."""
    y, x = np.mgrid[:height, :width]
    squared = (y - height / 2) ** 2 + (x - width / 2) ** 2
    return np.exp(-squared / (2 * (radius * height) ** 2))[..., np.newaxis]


def light_up(images: Sequence[Image], radius: float, gain: float) -> list[Image]:
    """Return images over which the light in the spot rises evenly from 1 to `gain`."""
    light = (gain - 1) * spot(*images[0].shape[:2], radius)
    times = np.linspace(0, 1, len(images))
    return [
        np.rint((image * (1 + light * t)).clip(0, 255)).astype(np.uint8) for image, t in zip(images, times, strict=True)
    ]


def main() -> None:
    """Print a table for every clip."""
    parser = argparse.ArgumentParser(description="How well do methods go through light that changes in one place?")
    parser.add_argument("clips", nargs="+", help="clips of 8 bits, of which the first three frames are taken")
    parser.add_argument("--methods", default="nlm,dis,blend", help="(default: %(default)s)")
    parser.add_argument("--json", type=Path, help="file for all figures")
    options = parser.parse_args()
    one_thread()
    names, rows = options.methods.split(","), []
    for clip, path in find_clips(options.clips).items():
        frames = read_frames(path, 3)
        table = Table("ground", "radius, heights", "gain", *names, title=f"{clip}: PSNR, dB")
        for (ground, images), radius, gain in product(
            {"moving": frames, "resting": [frames[1]] * 3}.items(), RADII, GAINS
        ):
            first, truth, last = light_up(images, radius, gain)
            figures = {name: score(truth, methods[name].interpolate(first, last, [0.5])[0]).psnr for name in names}
            rows.append({"clip": clip, "ground": ground, "radius": radius, "gain": gain, **figures})
            table.add_row(ground, str(radius), str(gain), *(f"{figures[name]:.2f}" for name in names))
        wide_console().print(table)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
