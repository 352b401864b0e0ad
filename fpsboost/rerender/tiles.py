"""Tiles of a frame, and rectangles of tiles or pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

MAX_ADDED_SHARE = 0.25
"""Maximum share of a rectangle that was not in the two that it replaces."""


class Rectangle(NamedTuple):
    """A rectangle, of tiles or of pixels; y points down."""

    x: int
    y: int
    width: int
    height: int

    @property
    def area(self) -> int:
        """Number of tiles or pixels."""
        return self.width * self.height

    @property
    def part(self) -> tuple[slice, slice]:
        """Its rows and columns, to index an array."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def around(self, other: Rectangle) -> Rectangle:
        """Return the smallest rectangle that holds both."""
        x, y = min(self.x, other.x), min(self.y, other.y)
        right, bottom = (
            max(self.x + self.width, other.x + other.width),
            max(self.y + self.height, other.y + other.height),
        )
        return Rectangle(x, y, right - x, bottom - y)


@dataclass(frozen=True)
class TileGrid:
    """Tiles of frames of one size, from the upper left; those at the right and at the bottom may be smaller.

    Attributes
    ----------
    height, width : int
        Of a frame, pixels.
    tile : int
        Side of a tile, pixels.
    """

    height: int
    width: int
    tile: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        return -(-self.height // self.tile), -(-self.width // self.tile)

    @cached_property
    def areas(self) -> NDArray[Any]:
        """Pixels of each tile, (rows, columns) float64."""
        rows, columns = (
            np.diff(np.minimum(np.arange(count + 1) * self.tile, length))
            for count, length in zip(self.shape, (self.height, self.width), strict=True)
        )
        return np.outer(rows, columns).astype(np.float64)

    def means(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the mean of every tile, (rows, columns) float64, of values of (height, width)."""
        sums = values.astype(np.float64)
        for axis, length in enumerate((self.height, self.width)):
            sums = np.add.reduceat(sums, np.arange(0, length, self.tile), axis=axis)
        return np.asarray(sums / self.areas)

    def in_pixels(self, tiles: Rectangle) -> Rectangle:
        """Return a rectangle of tiles in pixels, without what lies beyond the frame."""
        x, y = tiles.x * self.tile, tiles.y * self.tile
        right, bottom = (tiles.x + tiles.width) * self.tile, (tiles.y + tiles.height) * self.tile
        return Rectangle(x, y, min(right, self.width) - x, min(bottom, self.height) - y)


def partition(mask: NDArray[Any]) -> list[Rectangle]:
    """Divide a mask into rectangles that do not overlap, along rows or along columns, whichever takes fewer.

    Parameters
    ----------
    mask : (rows, columns) bool

    Returns
    -------
    list of Rectangle
        From top to bottom, then from left to right.

    Examples
    --------
    >>> import numpy as np
    >>> partition(np.array([[1, 1, 0], [1, 1, 1]], bool))
    [Rectangle(x=0, y=0, width=2, height=1), Rectangle(x=0, y=1, width=3, height=1)]
    """
    along_rows = list(_runs_joined(mask))
    along_columns = [Rectangle(each.y, each.x, each.height, each.width) for each in _runs_joined(mask.T)]
    fewer = along_columns if len(along_columns) < len(along_rows) else along_rows
    return sorted(fewer, key=lambda each: (each.y, each.x))


def _runs_joined(mask: NDArray[Any]) -> Iterator[Rectangle]:
    """Yield the runs of each row, as high as rows below have the same run."""
    growing: dict[tuple[int, int], int] = {}
    for y, row in enumerate([*mask, np.zeros(mask.shape[1], bool)]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        runs = {(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)}
        for begin, end in [run for run in growing if run not in runs]:
            top = growing.pop((begin, end))
            yield Rectangle(begin, top, end - begin, y - top)
        for run in runs:
            growing.setdefault(run, y)


def simplified(mask: NDArray[Any]) -> NDArray[Any]:
    """Return a mask that holds another one and consists of few rectangles.

    Rectangles of tiles that are near each other are joined while that adds no more than `MAX_ADDED_SHARE`.

    Parameters
    ----------
    mask : (rows, columns) bool

    Returns
    -------
    (rows, columns) bool
    """
    found = mask.copy()
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    for label in range(1, count):
        for rectangle in _joined(partition(mask & (labels == label))):
            found[rectangle.part] = True
    return found


def _joined(rectangles: Iterable[Rectangle]) -> list[Rectangle]:
    """Join the two rectangles that waste the smallest share of the one around both, again and again."""
    left = list(rectangles)
    while len(left) > 1:
        x, y, width, height = np.array(left, np.float64).T
        area = width * height
        across, down = (
            np.maximum.outer(start + length, start + length) - np.minimum.outer(start, start)
            for start, length in ((x, width), (y, height))
        )
        added = 1 - np.add.outer(area, area) / (across * down)
        np.fill_diagonal(added, np.inf)
        first, second = np.unravel_index(int(added.argmin()), added.shape)
        if added[first, second] > MAX_ADDED_SHARE:
            break
        joined = left[first].around(left[second])
        left = [each for index, each in enumerate(left) if index not in (first, second)] + [joined]
    return left
