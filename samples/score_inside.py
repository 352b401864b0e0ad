"""Score the report's methods inside of what a scene shows: ``python samples/score_inside.py FOLDER --scene glass``.

Every second frame of ``FOLDER/SCENE``, as `render_scenes.py` writes it, is hidden and made again. What counts is the
mean squared error, in levels of 255, where the ray through the pixel's centre meets a solid of the scene first:
floor and wall, which move as their surfaces do, would drown the difference.
"""

from __future__ import annotations

import argparse
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from stage.geometry import trace
from stage.scenes import Scene, scenes

from fpsboost.frame_cache import FrameCache
from fpsboost.method_table import find_method, vector_methods
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.render.folder import VectorFolder

METHODS = ("reproject-scene", "reproject-image", "nlm-exhaustive", "nlm-brute-force", "nlm", "dis", "blend")
ROOM = 2
"""Number of actors, at the end of a scene's list, that are floor and wall."""


def find_solids(scene: Scene, number: float, width: int, height: int) -> np.ndarray:
    """Find the pixels whose ray meets a solid before floor and wall, (H, W) bool."""
    _, body = trace(scene.camera(number), scene.bodies(number), (width, height))
    return ((body >= 0) & (body < len(scene.actors) - ROOM)).reshape(height, width)


def main() -> None:
    """Print a line for each method."""
    parser = argparse.ArgumentParser(description="Score the report's methods inside of what a scene shows.")
    parser.add_argument("folder", type=Path, help="what render_scenes.py wrote to")
    parser.add_argument("--scene", choices=list(scenes), default="glass")
    parser.add_argument("--step", type=Fraction, default=Fraction(1), help="the same as for render_scenes.py")
    options = parser.parse_args()
    folder, scene = options.folder / options.scene, scenes[options.scene]()
    images = [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))]
    vectors = VectorFolder(folder / "vectors", folder / "depth")
    for name in METHODS:
        takes_vectors = name in vector_methods or isinstance(find_method(name).estimator, ExhaustiveSearch)
        method = find_method(name, vectors if takes_vectors else None)
        errors = []
        for number in range(1, len(images) - 1, 2):
            image0, image1 = (FrameCache(images[each], Fraction(each)) for each in (number - 1, number + 1))
            ((made, _),) = method.images(method.pair(image0, image1), [Fraction(1, 2)])
            height, width = made.shape[:2]
            inside = find_solids(scene, float(number * options.step), width, height)
            errors.append(((made[inside].astype(float) - images[number][inside]) ** 2).mean())
        print(f"{name:16} {np.mean(errors):6.1f}", flush=True)


if __name__ == "__main__":
    main()
