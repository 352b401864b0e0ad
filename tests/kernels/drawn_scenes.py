"""Small scenes of every kind of image, converted by every method that has kernels.

``python tests/kernels/drawn_scenes.py COUNT`` converts so many of random sizes, and prints digests of what it made.
"""

import hashlib
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np

from fpsboost import Coding, FrameCache, InterpolatedImage, Layer, LayeredImage, find_method
from fpsboost.image import YCbCrImage, view
from fpsboost.motion.rendered import FrameVectors

Size = tuple[int, int]


def ball(size: Size) -> np.ndarray:
    """Where the ball is in the first frame."""
    y, x = np.mgrid[: size[0], : size[1]]
    return (3 * y - size[0]) ** 2 + (2 * x - size[1]) ** 2 < min(size) ** 2 / 4


def scene(k: int, size: Size, channels: int = 3) -> np.ndarray:
    """Frame k, 0 to 255: a texture moves to the left, a ball before it downwards, and a letter stands still."""
    texture = np.kron(np.random.default_rng(3).integers(0, 256, (32, 32, channels)), np.ones((3, 3, 1), int))
    image = np.roll(texture, -3 * k, 1)[: size[0], : size[1]]
    moved = np.roll(ball(size), 2 * k, 0)[..., np.newaxis]
    image = np.where(moved, np.roll(texture[::-1], 2 * k, 0)[: size[0], : size[1]], image)
    image[8:16, 10:12] = 250
    return image


def in_planes(k: int, size: Size, bits: int, down: int) -> YCbCrImage:
    """The scene as if its channels were luma and chroma, the latter of half the width."""
    codes = (scene(k, size) << bits - 8).astype(np.uint8 if bits == 8 else np.uint16)
    planes = codes[..., 0], codes[::down, ::2, 1], codes[::down, ::2, 2]
    coding = Coding(bits, 1, full_range=False, chroma_location="left", pixel_format="yuv420p")
    if down == 1 or bits > 8:
        coding = replace(coding, pixel_format=f"yuv42{0 if down == 2 else 2}p" + "10le" * (bits > 8))
    return YCbCrImage(tuple(map(np.ascontiguousarray, planes)), coding)


def in_layers(k: int, size: Size) -> LayeredImage:
    """The scene with light and depth beside it."""
    image = (scene(k, size) / 64).astype(np.float32)
    light = Layer("Light", "linear", {name: image[..., c] * 3 for c, name in enumerate("BGR")})
    return LayeredImage(image, (light, Layer("Depth", "depth", {"Depth.Z": image[..., 0]})))


def in_floats(k: int, size: Size) -> np.ndarray:
    return (scene(k, size) / 255).astype(np.float32)


KINDS: dict[str, Callable[[int, Size], Any]] = {
    "uint8": lambda k, size: scene(k, size).astype(np.uint8),
    "uint16": lambda k, size: (scene(k, size) * 257).astype(np.uint16),
    "float32": in_floats,
    "vectors": in_floats,
    "gray": lambda k, size: scene(k, size, 1).astype(np.uint8),
    "alpha": lambda k, size: scene(k, size, 4).astype(np.uint16),
    "layers": in_layers,
    "4:2:0": lambda k, size: in_planes(k, size, 8, 2),
    "4:2:2": lambda k, size: in_planes(k, size, 8, 1),
    "4:2:0, 10 bits": lambda k, size: in_planes(k, size, 10, 2),
}
OF_KINDS = {
    "nlm": ("uint8", "float32", "layers", "alpha", "4:2:0", "vectors"),
    "nlm:fusion=plain": ("uint16", "4:2:2", "4:2:0, 10 bits"),
    "nlm-fast": ("float32", "gray", "4:2:0", "4:2:0, 10 bits"),
    "dis": ("float32",),
    "nlm-exhaustive:search-radius=5,patch-radius=2": ("uint16",),
    "nlm-brute-force:window=gaussian,search-radius=5,patch-radius=3": ("float32",),
    "nlm-exhaustive": ("uint8",),
    "block": ("uint8", "float32"),
    "block:pattern=diamond": ("uint16",),
    "reproject-image": ("vectors",),
    "reproject-scene": ("vectors",),
}
CONVERSIONS = [(method, kind) for method, kinds in OF_KINDS.items() for kind in kinds]


def converted(method: str, kind: str, size: Size) -> list[InterpolatedImage]:
    """The image half-way between the second and the third of four frames, with its confidence."""
    flow = np.zeros((*size, 2), np.float32)
    flow[..., 0] = -1
    flow[ball(size)] = 0.25, 1
    vectors = SimpleNamespace(step=2, remarks=[], has=lambda number: True)
    vectors.for_image = lambda number, image: FrameVectors(-flow, flow, 10 - ball(size).astype(np.float32))
    interpolator = find_method(method, vectors if kind == "vectors" else None)
    frames = [FrameCache(KINDS[kind](k, size), output_position=Fraction(2 * k)) for k in range(4)]
    pairs = [interpolator.pair(*frames[k : k + 2]) for k in range(3)]
    return list(interpolator.images(pairs[1].between(pairs[0], pairs[2]), [0.5], with_confidence=True))


def digests(made: InterpolatedImage) -> list[str]:
    """Of the arrays of an image, and of its confidence."""
    arrays = [made.confidence, *view(made.image).arrays()]
    return [hashlib.sha256(np.ascontiguousarray(each)).hexdigest()[:12] for each in arrays]


if __name__ == "__main__":
    random = np.random.default_rng(1)
    for number in range(int(sys.argv[1])):
        conversion, size = CONVERSIONS[number % len(CONVERSIONS)], tuple(random.integers(1, 41, 2).tolist())
        print(*conversion, size, end=" ", flush=True)
        print(*digests(*converted(*conversion, size)))
