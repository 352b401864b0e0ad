"""Where pictures are drawn: a frame of 480 units across, sampled several times as densely as its pixels, and matrices.

Lengths are in units, of which a frame is 480 wide whatever its size: at 480x270, a unit is a pixel. Places are counted
from the middle of a frame or of a texture, x to the right and y down. A matrix, 3x3, takes places of a texture to
places of the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
UNITS = 480  # the width of a frame


# ------------------------------------------------------------------------------------------------------------- matrices


def shift(x: float, y: float) -> Array:
    """Make the matrix of a translation."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1]], float)


def turn(degrees: float) -> Array:
    """Make the matrix of a rotation round the middle, clockwise as seen."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], float)


def enlarge(factor: float, factor_y: float | None = None) -> Array:
    """Make the matrix of a scaling round the middle."""
    return np.diag([factor, factor if factor_y is None else factor_y, 1.0])


def tilt(yaw: float, pitch: float, distance: float = 500) -> Array:
    """Make the matrix of a plane turned in space (degrees; round the vertical, then the horizontal axis).

    A pinhole camera looks at its middle from a distance in units, where a length of the plane is as long in the frame.
    """
    a, b = math.radians(yaw), math.radians(pitch)
    round_y = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    round_x = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    across, down = (round_x @ round_y)[:, :2].T  # where the plane's axes point
    matrix = np.stack([across, down, [0, 0, 1]], axis=1)
    matrix[2] = across[2] / distance, down[2] / distance, 1
    return matrix


# -------------------------------------------------------------------------------------------------------------- drawing


@dataclass(frozen=True)
class Texture:
    """A picture that can be placed.

    Attributes
    ----------
    pixels : (H, W, 3 or 4) float32
        RGB from 0 to 1; with a fourth channel, alpha, by which the colours are multiplied already.
    density : float
        Texels per unit.
    """

    pixels: Array
    density: float

    @property
    def has_alpha(self) -> bool:
        """Whether something behind it is seen."""
        return bool(self.pixels.shape[2] == 4)


def count(length: float, density: float) -> int:
    """Tell how many texels a length in units takes."""
    return max(1, round(length * density))


def find_places(extent: tuple[float, float], density: float) -> tuple[Array, Array]:
    """Give x and y of the centres of all texels, (H, W) float32 each, in units."""
    columns, rows = count(extent[0], density), count(extent[1], density)
    x = (np.arange(columns, dtype=np.float32) - (columns - 1) / 2) / np.float32(density)
    y = (np.arange(rows, dtype=np.float32) - (rows - 1) / 2) / np.float32(density)
    across, down = np.meshgrid(x, y)
    return across, down


def index_matrix(shape: tuple[int, ...], density: float) -> Array:
    """Make the matrix from places in units to indices of texels."""
    rows, columns = shape[:2]
    return shift((columns - 1) / 2, (rows - 1) / 2) @ enlarge(density)


@dataclass(frozen=True)
class Raster:
    """Frames of a size, drawn with `supersampling` samples a pixel each way."""

    width: int
    height: int
    supersampling: int = 3

    @property
    def density(self) -> float:
        """Samples per unit."""
        return self.supersampling * self.width / UNITS

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height of a frame in units."""
        return UNITS, UNITS * self.height / self.width

    @property
    def places(self) -> tuple[Array, Array]:
        """X and y of all samples in units."""
        return find_places(self.extent, self.density)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of samples."""
        return self.supersampling * self.height, self.supersampling * self.width

    def fill(self, texture: Texture, matrix: Array) -> Array:
        """Draw a texture that is larger than the frame, (rows, columns, channels)."""
        into = index_matrix(self.shape, self.density) @ matrix
        into = into @ np.linalg.inv(index_matrix(texture.pixels.shape, texture.density))
        # mirrored beyond its edges: no clip is meant to show them
        mode = cv2.INTER_CUBIC
        border = cv2.BORDER_REFLECT_101
        return cv2.warpPerspective(texture.pixels, into, self.shape[::-1], flags=mode, borderMode=border)

    def draw(self, canvas: Array, texture: Texture, matrix: Array, opacity: float = 1) -> None:
        """Lay a texture with alpha over a canvas."""
        into = index_matrix(self.shape, self.density) @ matrix
        into = into @ np.linalg.inv(index_matrix(texture.pixels.shape, texture.density))
        rows, columns = texture.pixels.shape[:2]
        corners = into @ np.array([[-1, columns, columns, -1], [-1, -1, rows, rows], [1, 1, 1, 1]], float)
        x, y = corners[:2] / corners[2]
        left, top = max(0, math.floor(x.min())), max(0, math.floor(y.min()))
        right, bottom = min(self.shape[1], math.ceil(x.max()) + 1), min(self.shape[0], math.ceil(y.max()) + 1)
        if left >= right or top >= bottom:
            return
        area = (right - left, bottom - top)
        placed = cv2.warpPerspective(texture.pixels, shift(-left, -top) @ into, area, flags=cv2.INTER_CUBIC)
        lay_over(canvas[top:bottom, left:right], np.clip(placed, 0, 1, out=placed), opacity)

    def look_up(self, texture: Texture, x: Array, y: Array) -> Array:
        """Draw a texture where each sample shows a place of it; x and y in units, as many as there are samples."""
        matrix = index_matrix(texture.pixels.shape, texture.density)
        columns = (x * texture.density + matrix[0, 2]).astype(np.float32)
        rows = (y * texture.density + matrix[1, 2]).astype(np.float32)
        return cv2.remap(texture.pixels, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)

    def stroke(self, canvas: Array, lines: list[Array], colours: list[Any], thickness: float) -> None:
        """Draw lines, (n, 2) in units each, of a thickness in units; the canvas is rounded to 8 bits on the way."""
        if canvas.dtype != np.uint8:
            msg = f"lines are drawn on 8 bits, not on {canvas.dtype}"
            raise TypeError(msg)
        matrix = index_matrix(self.shape, self.density)
        wide = max(1, round(thickness * self.density))
        for line, colour in zip(lines, colours, strict=True):
            points = np.rint((line * self.density + matrix[:2, 2]) * 16).astype(np.int32)
            inked = tuple(float(round(255 * part)) for part in colour)
            cv2.polylines(canvas, [points], False, inked, wide, cv2.LINE_AA, shift=4)


def lay_over(canvas: Array, layer: Array, opacity: float = 1) -> None:
    """Lay a picture with alpha, colours multiplied by it, over a canvas of the same size."""
    canvas *= 1 - opacity * layer[..., 3:]
    canvas += layer[..., :3] if opacity == 1 else opacity * layer[..., :3]


def to_bytes(canvas: Array) -> Array:
    """Round colours from 0 to 1 to 8 bits."""
    return np.rint(np.clip(canvas, 0, 1) * 255).astype(np.uint8)


def to_floats(canvas: Array) -> Array:
    """Turn 8 bits into colours from 0 to 1."""
    return canvas.astype(np.float32) / np.float32(255)
