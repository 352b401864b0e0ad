"""The round trip of rendering on a scene of the report: ``python samples/round_trip.py OUT``.

Every second frame is rendered by Mitsuba, fpsboost makes those between and plans which regions of them are worth
rendering, Mitsuba renders these, and fpsboost puts them in. Prints the error of the frames between before and after.
Any other renderer goes the same way; see the functions `render_frames` and `render_regions`.

Needs fpsboost and Mitsuba 3: ``pip install '.[samples]'``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from render_scenes import Size, encode, read_size, render
from stage.geometry import find_vectors
from stage.scenes import Scene, scenes

STEP = 2
TRUTH_SAMPLES = 4
"""Factor of the paths of light of the true frames, so that their own noise counts for little."""


def main() -> None:
    """Make the round trip that the command line asks for."""
    parser = argparse.ArgumentParser(description="Render half, make the rest, render again what is doubtful.")
    parser.add_argument("out", type=Path, help="new folder for everything")
    parser.add_argument("--scene", choices=list(scenes), default="glass", help="(default: %(default)s)")
    parser.add_argument("--frames", type=int, default=9, help="how many in the end (default: %(default)s)")
    parser.add_argument("--size", type=read_size, default=(384, 216), help="WIDTHxHEIGHT (default: 384x216)")
    parser.add_argument("--samples", type=int, default=64, help="paths of light a pixel (default: %(default)s)")
    parser.add_argument("--budget", default="10%", help="part of the pixels rendered again (default: 10%%)")
    options = parser.parse_args()
    mi.set_variant("scalar_rgb")
    shot = Shot(scenes[options.scene](), options.size, options.samples)
    renders, made, plan, regions, merged = (
        options.out / name for name in ("renders", "made", "plan", "regions", "merged")
    )

    render_frames(shot, range(0, options.frames, STEP), renders)
    fpsboost(renders, made, "--factor", STEP, "--passes", "all", "--confidence", options.out / "confidence")
    fpsboost("plan", renders, plan, "--budget", options.budget)
    share = render_regions(shot, plan / "plan.json", regions)
    fpsboost("merge", made, regions, merged, "--plan", plan)

    between = range(1, options.frames - 1, STEP)
    shot.samples *= TRUTH_SAMPLES
    truth = [encode(shot.colours(number, seed=1)) for number in between]
    before, after = (
        [mean_squared_error(truth[i], folder / f"{number:04d}.exr") for i, number in enumerate(between)]
        for folder in (made, merged)
    )
    print("frame  made  merged   (mean squared error, levels of 255)")
    for number, *errors in zip(between, before, after, strict=True):
        print(f"{number:5d} {errors[0]:5.1f} {errors[1]:7.1f}")
    print(f"error {np.mean(before):.2f} -> {np.mean(after):.2f}, {share:.1%} of the pixels rendered again")


class Shot:
    """A scene, and how it is rendered."""

    def __init__(self, scene: Scene, size: Size, samples: int) -> None:
        self.scene, self.size, self.samples = scene, size, samples

    def colours(self, number: int, seed: int = 0, crop: tuple[int, int, int, int] | None = None) -> NDArray[np.float32]:
        """Render a frame, or a part of it: linear RGB. Each frame and each seed has noise of its own."""
        return render(self.scene, float(number), self.size, self.samples, seed * 100_000 + number, crop)

    def depth(self, number: int) -> NDArray[Any]:
        """Compute the distance of each pixel along the viewing axis."""
        around = (number - 1, number, number + 1)
        return find_vectors([self.scene.camera(n) for n in around], [self.scene.bodies(n) for n in around], self.size)[
            0
        ]


def render_frames(shot: Shot, numbers: range, folder: Path) -> None:
    """Render every N-th frame: ``FOLDER/0000.exr``, ``FOLDER/0002.exr``, ..."""
    for number in numbers:
        write_layers(folder / f"{number:04d}.exr", shot.colours(number), shot.depth(number))


def render_regions(shot: Shot, plan: Path, folder: Path) -> float:
    """Render the regions of a plan, and return which part of the made frames' pixels they are.

    A region becomes an image of its size: ``FOLDER/0001_1.exr`` is the first of frame 1.
    """
    planned = json.loads(plan.read_text(encoding="utf-8"))
    pixels = 0
    folder.mkdir(parents=True)
    for frame in planned["frames"]:
        depth = shot.depth(frame["number"])
        for place, (x, y, width, height) in enumerate(frame["regions"], start=1):
            colours = shot.colours(frame["number"], seed=1 + place, crop=(x, y, width, height))
            name = f"{frame['number']:04d}_{place}.exr"
            write_layers(folder / name, colours, depth[y : y + height, x : x + width])
            pixels += width * height
    return pixels / (len(planned["frames"]) * shot.size[0] * shot.size[1])


def write_layers(path: Path, colours: NDArray[np.float32], depth: NDArray[Any]) -> None:
    """Write linear colours in half floats, and depth as the layer Depth in full ones."""
    path.parent.mkdir(parents=True, exist_ok=True)
    channels = {name: np.ascontiguousarray(colours[..., i], np.float16) for i, name in enumerate("RGB")}
    channels["Depth.Z"] = np.ascontiguousarray(depth, np.float32)
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))


def fpsboost(*arguments: object) -> None:
    """Run a command of fpsboost; what it says is shown, and a failure ends everything."""
    subprocess.run([sys.executable, "-m", "fpsboost", *map(str, arguments)], check=True)


def mean_squared_error(truth: NDArray[np.float32], path: Path) -> float:
    """Return the error of an image against the truth, as sRGB in levels of 255."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        linear = np.dstack([file.channels()[name].pixels.astype(np.float32) for name in "RGB"])
    return float(np.mean((255 * (encode(linear) - truth)) ** 2))


if __name__ == "__main__":
    main()
