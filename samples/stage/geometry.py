"""Solids, cameras, and what a renderer's depth and vector passes hold, exactly.

Everything on stage is a convex solid that a 4x4 matrix places, so that the hit of a ray, and where the hit point was
one frame ago and will be one frame on, are a few formulas. The world is right-handed with y up; lengths have no unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FAR = 1e6  # where a ray ends that hits nothing: so distant that it moves only as the camera turns


# ------------------------------------------------------------------------------------------------------------- matrices


def move(x: float, y: float, z: float) -> Array:
    """Make the matrix of a translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def scale(factor: float) -> Array:
    """Make the matrix of a scaling."""
    return np.diag([factor, factor, factor, 1.0])


def turn(axis: Sequence[float], degrees: float) -> Array:
    """Make the matrix of a rotation round an axis through the origin, by the formula of Rodrigues."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix


def apply(matrix: Array, points: Array) -> Array:
    """Move points, (..., 3), by a matrix."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


# --------------------------------------------------------------------------------------------------------------- solids


@dataclass(frozen=True)
class Solid:
    """A convex solid around the origin.

    Attributes
    ----------
    corners : (n, 3)
    faces : sequence of sequences of int
        The corners of each face, counter-clockwise as seen from outside.
    columns, rows : int
        How the cells of its texture lie; each face shows a cell, one after the other.
    """

    corners: Array
    faces: Sequence[Sequence[int]]
    columns: int = 1
    rows: int = 1

    @property
    def planes(self) -> tuple[Array, Array]:
        """Outward normals, (n, 3), and distances from the origin, (n,), of the faces."""
        first, second, third = (self.corners[[face[i] for face in self.faces]] for i in range(3))
        normals = np.cross(second - first, third - second)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.sum(normals * first, axis=1)

    def hit(self, origin: Array, directions: Array) -> Array:
        """Tell how far along each ray, in lengths of its direction, it enters the solid; infinity if it does not."""
        normals, distances = self.planes
        speed = directions @ normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = (distances - normals @ origin) / speed
        enter = np.where(speed < 0, crossing, -np.inf).max(axis=1)
        leave = np.where(speed > 0, crossing, np.inf).min(axis=1)
        return np.where((enter < leave) & (enter > 0), enter, np.inf)

    def write(self, path: Path) -> None:
        """Write the solid as a Wavefront OBJ with texture coordinates, no corner shared between faces."""
        lines, count = [], 0
        for place, face in enumerate(self.faces):
            column, row = place % self.columns, place // self.columns % self.rows
            for i, corner in enumerate(face):
                # three corners or four: on a square, a hair inside its cell
                u, v = ((0.004, 0.004), (0.996, 0.004), (0.996, 0.996), (0.004, 0.996))[i]
                lines.append("v {} {} {}".format(*self.corners[corner]))
                lines.append(f"vt {(column + u) / self.columns} {(row + v) / self.rows}")
            numbers = [f"{count + i + 1}/{count + i + 1}" for i in range(len(face))]
            lines += [" ".join(["f", numbers[0], *numbers[i : i + 2]]) for i in range(1, len(face) - 1)]
            count += len(face)
        path.write_text("\n".join(lines) + "\n", encoding="ascii")


def make_box(x: float, y: float, z: float, *, columns: int = 1, rows: int = 1) -> Solid:
    """Make a box from its half sizes; the faces are right, left, top, bottom, front and back."""
    corners = np.array([(i, j, k) for k in (-z, z) for j in (-y, y) for i in (-x, x)], float)
    faces = [(5, 1, 3, 7), (0, 4, 6, 2), (6, 7, 3, 2), (0, 1, 5, 4), (4, 5, 7, 6), (1, 0, 2, 3)]
    return Solid(corners, faces, columns, rows)


def make_icosahedron(radius: float) -> Solid:
    """Make a solid of twenty triangles."""
    golden = (1 + math.sqrt(5)) / 2
    signs = [(i, j) for i in (-1, 1) for j in (-golden, golden)]
    corners = np.array([np.roll((0, i, j), shift) for shift in range(3) for i, j in signs])
    faces = []
    for three in combinations(range(12), 3):
        a, b, c = corners[list(three)]
        if np.allclose([np.linalg.norm(a - b), np.linalg.norm(b - c), np.linalg.norm(c - a)], 2):
            faces.append(three if np.linalg.det([a, b, c]) > 0 else three[::-1])
    return Solid(corners * radius / np.linalg.norm(corners[0]), faces)


# --------------------------------------------------------------------------------------------------------------- camera


def follow_spline(points: Array, place: float) -> Array:
    """Follow the closed Catmull-Rom spline through points, (n, 3); it is at ``points[i]`` at place i."""
    start = math.floor(place)
    before, first, second, after = (points[(start + i) % len(points)] for i in (-1, 0, 1, 2))
    t = place - start
    linear, square, cubic = (
        second - before,
        2 * before - 5 * first + 4 * second - after,
        3 * (first - second) + after - before,
    )
    return first + 0.5 * t * (linear + t * (square + t * cubic))


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: where it stands, what it looks at, and how wide it sees (degrees)."""

    position: Array
    target: Array
    width: float

    @property
    def axes(self) -> Array:
        """The directions to the right, up and forward, as rows."""
        forward = (self.target - self.position) / np.linalg.norm(self.target - self.position)
        right = np.cross(forward, [0, 1, 0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def look(self, width: int, height: int) -> Array:
        """Give the rays through the centres of all pixels, (H * W, 3), each one long along the viewing axis."""
        y, x = np.mgrid[0:height, 0:width] + 0.5
        focal = width / 2 / math.tan(math.radians(self.width) / 2)
        rays = np.stack([(x - width / 2) / focal, (height / 2 - y) / focal, np.ones_like(x)], axis=-1)
        return rays.reshape(-1, 3) @ self.axes

    def project(self, points: Array, width: int, height: int) -> Array:
        """Tell where points, (n, 3), are in the image, (n, 2): pixels, x to the right and y down."""
        right, up, forward = ((points - self.position) @ self.axes.T).T
        focal = width / 2 / math.tan(math.radians(self.width) / 2)
        return np.stack([width / 2 + focal * right / forward, height / 2 - focal * up / forward], axis=-1)


# --------------------------------------------------------------------------------------------------------------- passes


def trace(
    camera: Camera, bodies: Sequence[tuple[Solid, Array]], size: tuple[int, int]
) -> tuple[Array, NDArray[np.intp]]:
    """Find what the ray through each pixel's centre hits first.

    Parameters
    ----------
    bodies : sequence of (Solid, matrix)
    size : (width, height)

    Returns
    -------
    depth : (H * W,)
        Distance along the camera's viewing axis; `FAR` where there is nothing.
    body : (H * W,) int
        Which body was hit; -1 where there is nothing.
    """
    rays = camera.look(*size)
    hits = [np.full(len(rays), FAR)]
    for solid, matrix in bodies:
        inverse = np.linalg.inv(matrix)
        hits.append(solid.hit(apply(inverse, camera.position), rays @ inverse[:3, :3].T))
    return np.min(hits, axis=0), np.argmin(hits, axis=0) - 1


def find_vectors(
    cameras: Sequence[Camera], bodies: Sequence[Sequence[tuple[Solid, Array]]], size: tuple[int, int]
) -> tuple[Array, Array]:
    """Compute the depth of a frame and its motion to the frame before and after.

    Parameters
    ----------
    cameras, bodies : three each
        The previous frame, this one and the next.
    size : (width, height)

    Returns
    -------
    depth : (H, W)
        Distance along the camera's viewing axis; infinity where there is nothing.
    vectors : (H, W, 4)
        As in Blender's Vector pass: x and y of "where the point was in the previous frame" minus "where it is", and of
        "where it is" minus "where it will be in the next frame"; in pixels, x to the right and y *up*.
    """
    width, height = size
    depth, hit = trace(cameras[1], bodies[1], size)
    points = cameras[1].position + depth[:, None] * cameras[1].look(width, height)
    here = cameras[1].project(points, width, height)
    there = []
    for time in (0, 2):
        moved = points.copy()
        for index in range(len(bodies[1])):
            of_body = hit == index
            motion = bodies[time][index][1] @ np.linalg.inv(bodies[1][index][1])
            moved[of_body] = apply(motion, points[of_body])
        there.append(cameras[time].project(moved, width, height))
    up = np.array([1, -1])
    vectors = np.hstack([(there[0] - here) * up, (here - there[1]) * up])
    return np.where(hit < 0, np.inf, depth).reshape(height, width), vectors.reshape(height, width, 4)
