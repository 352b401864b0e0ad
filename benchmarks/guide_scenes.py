"""Scenes whose guides no program can make of their frames, for `guides.py`: drawn ones, and path-traced ones.

Drawn: textures at different depths, seen by two cameras of which the second one is a guide; and motion blur in the
guides or in the frames alone. Path-traced: the scenes of ``samples/scenes``, whose guides Mitsuba renders with fewer
samples or smaller; its denoiser needs a GPU of NVIDIA, so there are no denoised ones.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from guide_kinds import Material, reduced, to_bytes
from numpy.typing import NDArray
from scoring import read_frames

from fpsboost.errors import InputError
from fpsboost.image import Image

SAMPLES = Path(__file__).parents[1] / "samples"
sys.path.insert(0, str(SAMPLES))
from constructed.layers import Motion, backdrop, wave  # noqa: E402 (the path is set before)
from constructed.raster import Raster, Texture, shift, turn  # noqa: E402
from constructed.textures import EARTH, GARDEN, STREET, Random, cutout  # noqa: E402

SIZE = (640, 360)
LENGTH = 9
"""Frames of a drawn scene."""
APART = 0.02 * 480
"""How far the two cameras see the nearest things apart, units: 2 % of the width."""
SUBFRAMES = 7
"""Pictures of an exposure of half of the time from frame to frame."""
PALETTES = {"earth": EARTH, "garden": GARDEN, "street": STREET}
FULL_SAMPLES = 64
"""Samples a pixel of the frames of ``samples/scenes``."""
OTHER_SEED = 7
"""Guides have noise of their own."""


class Layer(NamedTuple):
    """A texture at a depth."""

    texture: Texture
    motion: Motion
    nearness: float
    """Reciprocal of its depth; 1 is the nearest one."""


@dataclass(frozen=True)
class DrawnScene:
    """A background, and nine things at six depths in front of it."""

    name: str
    """One of `PALETTES`."""

    raster: ClassVar[Raster] = Raster(*SIZE, supersampling=2)

    @cached_property
    def layers(self) -> list[Layer]:
        """The farthest first."""
        random = np.random.default_rng([65, *self.name.encode()])
        behind = backdrop(random, self.raster, PALETTES[self.name])
        layers = [Layer(behind, lambda time: shift(5 * (time - 2), 2 * wave(time, 6)), 0.15)]
        others = [palette for name, palette in PALETTES.items() if name != self.name]
        for number, nearness in enumerate((0.25, 0.25, 0.35, 0.35, 0.5, 0.5, 0.7, 0.85, 1.0)):
            layers.append(make_thing(random, self.raster, others[number % 2], nearness))
        return layers

    def draw(self, number: float, *, eye: float = 0) -> NDArray[Any]:
        """Draw a frame as a camera at a place of its rail sees it, RGB from 0 to 1."""
        behind, *others = [
            (layer.texture, shift(-eye * layer.nearness, 0) @ layer.motion(number / 2)) for layer in self.layers
        ]
        canvas = self.raster.fill(*behind)
        for texture, matrix in others:
            self.raster.draw(canvas, texture, matrix)
        size = self.raster.width, self.raster.height
        return cv2.resize(np.clip(canvas, 0, 1), size, interpolation=cv2.INTER_AREA)

    def sharp(self, number: int, *, eye: float = 0) -> Image:
        """Return a frame of a short exposure."""
        return as_image(self.draw(number, eye=eye))

    def exposed(self, number: int) -> Image:
        """Return a frame of an exposure of half of the time to the next one, 180 degrees."""
        times = number + 0.5 * ((np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - 0.5)
        return as_image(np.mean([self.draw(float(each)) for each in times], axis=0))


def as_image(picture: NDArray[Any]) -> Image:
    """Turn RGB from 0 to 1 into BGR with 8 bits."""
    return np.ascontiguousarray(to_bytes(picture * 255)[..., ::-1])


def make_thing(random: Random, raster: Raster, palette: list[str], nearness: float) -> Layer:
    """Make a thing that passes, the faster the nearer it is, turns and bobs."""
    x, y = random.uniform(-200, 200), random.uniform(-90, 90)
    size = random.uniform(60, 90) * (0.5 + nearness)
    speed, spin, period = random.normal(0, 8) + 24 * nearness, random.normal(0, 6), random.uniform(5, 9)

    def motion(time: float) -> NDArray[Any]:
        return shift(x + speed * (time - 2), y + 6 * wave(time, period)) @ turn(spin * (time - 2))

    corners = random.choice([0, 3, 6])
    return Layer(cutout(random, size, raster.density, palette, int(corners)), motion, nearness)


def drawn(name: str, *, is_exposed: bool) -> Material:
    """Return a drawn scene with the guides that it has."""
    scene = DrawnScene(name)
    picture = scene.exposed if is_exposed else scene.sharp

    def guides(of: Callable[[int], Image], smaller: int, *_: object) -> Callable[..., dict[int, Image]]:
        return lambda frames, seeds: {number: reduced(of(number), smaller) for number in seeds}

    second = partial(scene.sharp, eye=APART)
    kinds = {"shutter-frames2": guides(scene.sharp, 2)}
    if not is_exposed:
        kinds = {
            "cameras2": guides(second, 2),
            "cameras4": guides(second, 4),
            "shutter-guides2": guides(scene.exposed, 2),
        }
    name = f"drawn-{name}{'-exposed' if is_exposed else ''}"
    return Material(name, lambda largest: [picture(number) for number in range(min(largest, LENGTH))], kinds)


DRAWN_KINDS = ("cameras2", "cameras4", "shutter-guides2")
"""The second camera, at a half and a quarter of the width; guides of a long exposure of sharp frames, at a half."""
EXPOSED_KINDS = ("shutter-frames2",)
"""Sharp guides, at a half of the width, of frames of a long exposure."""
RENDERED_KINDS = ("path1", "path4", "path64-4")
"""Path-traced guides with 1 and 4 samples a pixel, and with 64 at a quarter of the width."""


def drawn_scenes(*, are_exposed: bool) -> Iterator[Material]:
    """Yield the drawn scenes."""
    return (drawn(name, is_exposed=are_exposed) for name in PALETTES)


def rendered_scenes() -> Iterator[Material]:
    """Yield the scenes of ``samples/scenes``; raises `InputError` without Mitsuba."""
    try:
        import mitsuba  # noqa: PLC0415 (an extra, which may be missing)
    except ImportError as error:
        raise InputError("--renders needs Mitsuba; install it with pip install '.[samples]'.") from error
    from render_scenes import encode, render  # noqa: PLC0415
    from stage.scenes import scenes  # noqa: PLC0415

    mitsuba.set_variant("scalar_rgb")

    def traced(name: str, samples: int, smaller: int) -> Callable[..., dict[int, Image]]:
        def make(frames: Mapping[int, Image], seeds: Mapping[int, int]) -> dict[int, Image]:
            scene = scenes[name]()
            made = {}
            for number in seeds:
                height, width = frames[number].shape[:2]
                size = width // smaller, height // smaller
                made[number] = as_image(encode(render(scene, number, size, samples, OTHER_SEED * 100_000 + number)))
            return made

        return make

    for name in scenes:
        kinds = {"path1": traced(name, 1, 1), "path4": traced(name, 4, 1), "path64-4": traced(name, FULL_SAMPLES, 4)}
        yield Material(name, partial(read_frames, str(SAMPLES / "scenes" / name)), kinds)
