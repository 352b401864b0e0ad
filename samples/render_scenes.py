"""Render the scenes of the report: ``python samples/render_scenes.py OUT``.

Two metals, a textured cube and a glass cube, with global illumination: colour as ``OUT/SCENE/0000.png`` and, linear, as
``OUT/SCENE/exr/0000.exr``; depth and exact motion vectors of every frame beside it. ``stage/`` holds the scenes; they
move the same whatever is rendered of them, and longer when there are more frames.

Needs numpy, OpenCV, OpenEXR and Mitsuba 3: ``pip install '.[samples]'``.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from stage.geometry import Array, Camera, find_vectors
from stage.scenes import Scene, scenes

Size = tuple[int, int]  # width, height
Crop = tuple[int, int, int, int]  # x, y, width, height
STEPS = 64  # vectors are rounded to this part of a pixel, so that they pack well


def for_mitsuba(entry: Any) -> Any:
    """Turn what a description holds into Mitsuba's bitmaps (functions that make images) and transforms (matrices)."""
    if isinstance(entry, dict):
        return {key: for_mitsuba(value) for key, value in entry.items()}
    if isinstance(entry, np.ndarray):
        return mi.ScalarTransform4f(entry)
    return mi.Bitmap(entry()) if callable(entry) else entry


def describe_camera(camera: Camera, size: Size, samples: int, crop: Crop | None) -> dict[str, Any]:
    """Describe a camera to Mitsuba, and the part of its image that is rendered."""
    view = mi.ScalarTransform4f().look_at(camera.position.tolist(), camera.target.tolist(), [0, 1, 0])
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "gaussian"}}
    if crop is not None:
        names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        # the filter of the pixels at its edges reaches beyond it
        film |= {**dict(zip(names, crop, strict=True)), "sample_border": True}
    sampler = {"type": "multijitter", "sample_count": samples}
    place = {"to_world": view, "fov": camera.width, "fov_axis": "x"}
    return {"type": "perspective", **place, "film": film, "sampler": sampler}


def load(scene: Scene, number: float, size: Size, samples: int, folder: Path, crop: Crop | None) -> Any:
    """Build a frame's scene in Mitsuba; the solids are written to `folder`, which is needed only meanwhile."""
    parts = {f"light{i}": light for i, light in enumerate(scene.lights)}
    for i, actor in enumerate(scene.actors):
        actor.solid.write(folder / f"{i}.obj")
        shape = {"type": "obj", "filename": str(folder / f"{i}.obj"), "face_normals": True}
        parts[f"actor{i}"] = {**shape, "to_world": actor.pose(number), "bsdf": actor.material}
    integrator = {"type": "path", "max_depth": scene.depth}
    sensor = describe_camera(scene.camera(number), size, samples, crop)
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **for_mitsuba(parts)})


def render(
    scene: Scene, number: float, size: Size, samples: int, seed: int, crop: Crop | None = None
) -> NDArray[np.float32]:
    """Render the linear colours of a frame, or of the part `crop` of it, (H, W, 3) RGB."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = load(scene, number, size, samples, Path(folder), crop)
    image = mi.render(loaded, seed=seed)
    return np.asarray(image, dtype=np.float32)[..., :3]


def encode(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turn linear colours into sRGB from 0 to 1."""
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055).astype(np.float32)


def denoise(colours: NDArray[np.float32], samples: int) -> NDArray[np.float32]:
    """Smooth differences between neighbours that are as small as the noise at this number of samples."""
    noise = 0.3 / math.sqrt(samples)  # measured with a second seed: about the best for all three scenes
    return cv2.bilateralFilter(colours, 5, noise, 1.2)


def write_exr(path: Path, channels: str, values: Array | NDArray[np.float32], *, is_full: bool = False) -> None:
    """Write an image, (H, W, channels), as OpenEXR in half floats, or in full ones."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kind = np.float32 if is_full else np.float16
    planes = {name: np.ascontiguousarray(values[..., i], kind) for i, name in enumerate(channels)}
    # PXR24 loses nothing of half floats and packs smooth ones best, but cuts full ones to 24 bits
    compression = OpenEXR.ZIP_COMPRESSION if is_full else OpenEXR.PXR24_COMPRESSION
    with OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))


def write_passes(folder: Path, scene: Scene, number: int, step: Fraction, size: Size, *, is_full: bool) -> None:
    """Write the depth and the motion vectors of a frame."""
    around = [float(each * step) for each in (number - 1, number, number + 1)]
    cameras, bodies = [scene.camera(n) for n in around], [scene.bodies(n) for n in around]
    depth, vectors = find_vectors(cameras, bodies, size)
    if not is_full:
        vectors = np.round(vectors * STEPS) / STEPS
    write_exr(folder / "depth" / f"{number:04d}.exr", "Z", depth[..., None], is_full=is_full)
    write_exr(folder / "vectors" / f"{number:04d}.exr", "XYZW", vectors, is_full=is_full)


def write_colour(folder: Path, number: int, linear: NDArray[np.float32], samples: int) -> None:
    """Write the colours of a frame: linear as they are, and 8-bit, denoised."""
    write_exr(folder / "exr" / f"{number:04d}.exr", "RGB", linear)
    halves = linear.astype(np.float16).astype(np.float32)  # so that one file follows from the other
    pixels = np.round(denoise(encode(halves), samples) * 255).astype(np.uint8)
    cv2.imwrite(str(folder / f"{number:04d}.png"), pixels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])


def read_size(text: str) -> Size:
    """Read ``384x216``."""
    width, height = (int(part) for part in text.split("x"))
    return width, height


def main() -> None:
    """Render what the command line asks for."""
    parser = argparse.ArgumentParser(description="Render the scenes of the report, with depth and motion vectors.")
    parser.add_argument("out", type=Path, help="folder that takes a folder for each scene")
    parser.add_argument("--scene", choices=list(scenes), action="append", help="only this one; may be repeated")
    parser.add_argument("--frames", type=int, default=25, help="how many (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="number of the first frame (default: %(default)s)")
    help_step = "how far the scenes move in a frame: 1/4 is a quarter as fast (default: %(default)s)"
    parser.add_argument("--step", type=Fraction, default=Fraction(1), help=help_step)
    parser.add_argument("--size", type=read_size, default=(384, 216), help="WIDTHxHEIGHT (default: 384x216)")
    help_samples = "paths of light a pixel, best a square number (default: %(default)s)"
    parser.add_argument("--samples", type=int, default=64, help=help_samples)
    parser.add_argument("--seed", type=int, default=0, help="another seed, other noise (default: %(default)s)")
    parser.add_argument("--full", action="store_true", help="depth and vectors as 32-bit floats, not rounded")
    options = parser.parse_args()
    mi.set_variant("scalar_rgb")
    for name in options.scene or scenes:
        scene = scenes[name]()
        for number in range(options.first, options.first + options.frames):
            # each frame has noise of its own: the same noise in all would stand still in front of what moves
            seed = options.seed * 100_000 + number
            write_passes(options.out / name, scene, number, options.step, options.size, is_full=options.full)
            linear = render(scene, float(number * options.step), options.size, options.samples, seed)
            write_colour(options.out / name, number, linear, options.samples)
            print(f"{name} {number}", flush=True)


if __name__ == "__main__":
    main()
