"""The three scenes: who is on stage, how it moves from frame to frame, and what lights it.

Materials and lights are dictionaries as Mitsuba takes them, with plain arrays for matrices and, for images, functions
that make them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from stage import textures
from stage.geometry import Array, Camera, Solid, follow_spline, make_box, make_icosahedron, move, scale, turn

FRAMES_A_LEG = 12  # frames the camera takes from one point of its spline to the next

MakeTexture = Callable[[], textures.Texture]


@dataclass(frozen=True)
class Actor:
    """A solid, what it is made of, and the matrix that places it at a frame's number."""

    solid: Solid
    material: dict[str, Any]
    pose: Callable[[float], Array]


@dataclass(frozen=True)
class Scene:
    """Description of a scene.

    Attributes
    ----------
    actors : list of Actor
    lights : list of dict
    positions, targets : (n, 3)
        Closed Catmull-Rom splines of where the camera stands and what it looks at.
    depth : int
        How many segments a path of light may have.
    """

    actors: list[Actor]
    lights: list[dict[str, Any]]
    positions: Array
    targets: Array
    depth: int

    def camera(self, number: float) -> Camera:
        """Give the camera of a frame."""
        place = number / FRAMES_A_LEG
        return Camera(follow_spline(self.positions, place), follow_spline(self.targets, place), 45)

    def bodies(self, number: float) -> list[tuple[Solid, Array]]:
        """Give the solids of a frame, each with the matrix that places it."""
        return [(actor.solid, actor.pose(number)) for actor in self.actors]


def paint(make_texture: MakeTexture) -> dict[str, Any]:
    """Make a matt material whose texture is drawn only on request, because motion vectors do not need it."""
    return {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": cache(make_texture)}}


def make_panel(middle: tuple[float, float, float], width: float, height: float, light: float) -> dict[str, Any]:
    """Make a rectangle that shines towards the middle of the stage."""
    away = np.subtract(middle, (0.0, 1.0, 0.0))
    away /= np.linalg.norm(away)
    side = np.cross([0.0, 1.0, 0.01], away)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3] = np.stack([side * width, np.cross(away, side) * height, -away, middle], axis=1)
    radiance = {"type": "rgb", "value": [light, 0.94 * light, 0.84 * light]}
    return {"type": "rectangle", "to_world": matrix, "emitter": {"type": "area", "radiance": radiance}}


def make_room(floor: MakeTexture, wall: MakeTexture, distance: float) -> list[Actor]:
    """Make a floor and, behind the stage, a wall."""
    return [
        Actor(make_box(14, 0.1, 14), paint(floor), lambda _: move(0, -0.1, 0)),
        Actor(make_box(14, 14, 0.1), paint(wall), lambda _: move(0, 12, -distance)),
    ]


def make_reflective() -> Scene:
    """Make a scene of two metals of different roughness that turn above a tiled floor and reflect bright panels."""
    floor = partial(textures.make_tiles, 3, 34, "5a2422 a8573a d8b070 e8dcc0 3f7c80 1d4358", "1c1816")
    wall = partial(textures.make_plaster, 4, "16283a 2c4a5e 4a6f80 8a9a86 9a6a4a")
    steel = {"type": "roughconductor", "material": "Al", "alpha": 0.03, "distribution": "ggx"}
    copper = {"type": "roughconductor", "material": "Cu", "alpha": 0.14, "distribution": "ggx"}
    actors = [
        Actor(make_box(0.8, 0.8, 0.8), steel, lambda n: move(-1.3, 1.4, 0) @ turn((0.35, 1, 0.2), 18 + 4.2 * n)),
        Actor(
            make_icosahedron(1.0),
            copper,
            lambda n: move(1.35, 1.3, 0.35) @ turn((-0.3, 1, 0.45), 40 - 4.6 * n),
        ),
    ]
    lights = [
        {"type": "envmap", "bitmap": cache(partial(textures.make_sky, 7))},
        make_panel((-3.5, 6, 5), 1.3, 1.3, 7),
        make_panel((6, 3.5, 4), 0.7, 1.6, 6),
    ]
    positions = np.array([(-1.2, 2.7, 7.0), (0.2, 3.0, 6.8), (1.5, 2.6, 7.0), (0.4, 2.2, 7.3)])
    targets = np.array([(-0.1, 1.15, 0), (0.1, 1.1, 0), (0.15, 1.2, 0), (-0.1, 1.2, 0)])
    return Scene([*actors, *make_room(floor, wall, 4)], lights, positions, targets, 9)


def make_texture() -> Scene:
    """Make a scene of a cube with six detailed sides that turns, grows and shrinks."""
    floor = partial(textures.make_tiles, 13, 40, "3c4a3e 6f8a66 a9b88c d9d3b0 8a7a5c", "26302a")
    wall = partial(textures.make_plaster, 14, "e0c9a6 d9a679 b9806a 8c6272 5a5478")

    def pose(number: float) -> Array:
        size = 1.0 + 0.2 * math.sin(2 * math.pi * number / 36)
        return move(0.1, 1.65, 0) @ turn((0.45, 1, 0.25), 25 + 3.6 * number) @ scale(size)

    cube = Actor(make_box(0.85, 0.85, 0.85, columns=3, rows=2), paint(partial(textures.make_sides, 12)), pose)
    lights = [{"type": "constant", "radiance": {"type": "rgb", "value": [0.42, 0.46, 0.55]}}]
    lights += [make_panel((-4, 7, 5), 1.6, 1.6, 11)]
    positions = np.array([(1.3, 2.4, 7.0), (0.2, 2.8, 6.8), (-1.2, 2.5, 6.7), (-0.1, 2.1, 7.2)])
    targets = np.array([(0.2, 1.6, 0), (0.1, 1.55, 0), (-0.1, 1.65, 0), (0, 1.65, 0)])
    return Scene([cube, *make_room(floor, wall, 3.5)], lights, positions, targets, 8)


def make_glass() -> Scene:
    """Make a scene of a glass cube that turns in front of a coloured checker."""
    floor = partial(textures.make_tiles, 23, 36, "3a3f4a 6a7588 a0aab0 d8d8d0", "22252c")
    wall = partial(textures.make_checker, 24, 44, "e63946 f4a261 e9c46a 2a9d8f 1d5c8f 6a3d8f")
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    cube = Actor(make_box(0.88, 0.88, 0.88), glass, lambda n: move(0, 1.65, 0.4) @ turn((0.3, 1, -0.35), 12 + 3.8 * n))
    lights = [
        {"type": "constant", "radiance": {"type": "rgb", "value": [0.75, 0.8, 0.9]}},
        make_panel((4.5, 7, 5), 2.2, 2.2, 5),
    ]
    positions = np.array([(-1.1, 2.2, 6.9), (0.3, 2.5, 6.7), (1.3, 2.2, 6.8), (0.1, 1.9, 7.1)])
    targets = np.array([(-0.1, 1.6, 0), (0.1, 1.6, 0), (0.1, 1.65, 0), (-0.1, 1.6, 0)])
    return Scene([cube, *make_room(floor, wall, 3)], lights, positions, targets, 16)


scenes: dict[str, Callable[[], Scene]] = {"reflective": make_reflective, "texture": make_texture, "glass": make_glass}
