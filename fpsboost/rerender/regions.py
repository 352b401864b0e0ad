"""Tiles of a frame, and the choice of the tiles of interpolated frames to render within a budget.

Tiles are chosen by their expected squared error, the largest first, as many as fit. The chosen tiles are then cleaned
up: holes in time and in space are filled, single tiles dropped, and tiles joined to few rectangles. As that changes the
number of pixels, the number of tiles is found by bisection.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

WHOLE_SHARE = 0.8
"""Share of a frame from which on all of it is rendered: one plain render without seams."""
SMALLEST_GRID = 16  # number of tiles of a frame below which single tiles are kept

LARGER = (1.25, 1.5)
"""Multiples of the number of tiles that fits, of which some frames are taken where there is room left."""

MAX_ADDED_SHARE = 0.25
"""Maximum share of a rectangle that does not belong to the two that it replaces."""


class Rectangle(NamedTuple):
    """A rectangle, of tiles or of pixels; y points down.

    Examples
    --------
    >>> left, right = Rectangle(0, 0, 16, 16), Rectangle(32, 8, 16, 16)
    >>> left.area, left.around(right)
    (256, Rectangle(x=0, y=0, width=48, height=24))
    """

    x: int
    """Column of the left edge."""
    y: int
    """Row of the upper edge."""
    width: int
    """Number of columns."""
    height: int
    """Number of rows."""

    @property
    def area(self) -> int:
        """Number of tiles or pixels."""
        return self.width * self.height

    @property
    def part(self) -> tuple[slice, slice]:
        """Slices of the rows and columns, to index an array."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def around(self, other: Rectangle) -> Rectangle:
        """Return the smallest rectangle that contains both."""
        x = min(self.x, other.x)
        y = min(self.y, other.y)
        right = max(self.x + self.width, other.x + other.width)
        bottom = max(self.y + self.height, other.y + other.height)
        return Rectangle(x, y, right - x, bottom - y)


@dataclass(frozen=True)
class TileGrid:
    """Tiles of frames of one size, from the upper left; those at the right and at the bottom edge may be smaller."""

    height: int
    """Height of a frame, pixels."""
    width: int
    """Width of a frame, pixels."""
    tile: int
    """Side of a tile, pixels."""

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns of tiles."""
        return -(-self.height // self.tile), -(-self.width // self.tile)

    @cached_property
    def areas(self) -> np.ndarray:
        """Pixels of each tile, (rows, columns) float64."""
        rows, columns = (
            np.diff(np.minimum(np.arange(count + 1) * self.tile, length))
            for count, length in zip(self.shape, (self.height, self.width), strict=True)
        )
        return np.outer(rows, columns).astype(np.float64)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of every tile, (rows, columns) float64, of values of (height, width)."""
        sums = values.astype(np.float64)
        for axis, length in enumerate((self.height, self.width)):
            sums = np.add.reduceat(sums, np.arange(0, length, self.tile), axis=axis)
        return np.asarray(sums / self.areas)

    def in_pixels(self, tiles: Rectangle) -> Rectangle:
        """Return a rectangle of tiles in pixels, cut off at the edges of the frame."""
        x = tiles.x * self.tile
        y = tiles.y * self.tile
        right = (tiles.x + tiles.width) * self.tile
        bottom = (tiles.y + tiles.height) * self.tile
        return Rectangle(x, y, min(right, self.width) - x, min(bottom, self.height) - y)


def partition(mask: np.ndarray) -> list[Rectangle]:
    """Divide a mask into rectangles that do not overlap, along rows or along columns, whichever gives fewer.

    Examples
    --------
    >>> partition(np.array([[1, 1, 0], [1, 1, 1]], bool))
    [Rectangle(x=0, y=0, width=2, height=1), Rectangle(x=0, y=1, width=3, height=1)]
    """
    along_rows = list(_runs_joined(mask))
    along_columns = [Rectangle(each.y, each.x, each.height, each.width) for each in _runs_joined(mask.T)]
    fewer = along_columns if len(along_columns) < len(along_rows) else along_rows
    return sorted(fewer, key=lambda each: (each.y, each.x))


def _runs_joined(mask: np.ndarray) -> Iterator[Rectangle]:
    """Yield the runs of consecutive tiles in each row, joined with equal runs in the rows below."""
    growing: dict[tuple[int, int], int] = {}
    for y, row in enumerate([*mask, np.zeros(mask.shape[1], bool)]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        runs = {(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)}
        for begin, end in growing.keys() - runs:
            top = growing.pop((begin, end))
            yield Rectangle(begin, top, end - begin, y - top)
        for run in runs:
            growing.setdefault(run, y)


def simplified(mask: np.ndarray) -> np.ndarray:
    """Return a mask of tiles with near rectangles joined while that adds no more than `MAX_ADDED_SHARE`."""
    result = mask.copy()
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    for label in range(1, count):
        for rectangle in _joined(partition(mask & (labels == label))):
            result[rectangle.part] = True
    return result


def _joined(rectangles: Iterable[Rectangle]) -> list[Rectangle]:
    """Join the two rectangles that add the smallest share to the one around both, until all would add too much."""
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


class _Choice(NamedTuple):
    """Masks of all frames, their pixels and their gains."""

    masks: np.ndarray  # tiles to render, (F, rows, columns) bool
    areas: np.ndarray  # pixels to render of each frame, (F,)
    gains: np.ndarray  # squared error that is taken away from each frame, (F,)


def choose_regions(errors: np.ndarray, grid: TileGrid, budget: float, scenes: Sequence[int]) -> np.ndarray:
    """Choose the tiles to render within a budget of pixels, by the error that they are expected to have.

    Parameters
    ----------
    errors : (F, rows, columns) float64
        Expected squared error of each tile of each frame.
    grid : TileGrid
        Tiles of a frame.
    budget : float
        Maximum number of pixels of all frames together.
    scenes : sequence of int
        Number of each frame's scene, between which nothing is smoothed.

    Returns
    -------
    (F, rows, columns) bool
    """
    belongs = np.asarray(scenes)
    steady = smooth_over_time(errors, belongs)
    order = np.argsort(-steady, axis=None, kind="stable")

    def choose(count: int) -> _Choice:
        masks = np.zeros(steady.size, bool)
        masks[order[:count]] = True
        masks = clean(masks.reshape(steady.shape), belongs)
        return _Choice(masks, (masks * grid.areas).sum(axis=(1, 2)), (masks * steady * grid.areas).sum(axis=(1, 2)))

    largest = int((steady > 0).sum())
    fits = 0
    too_many = largest + 1
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        if choose(middle).areas.sum() <= budget:
            fits = middle
        else:
            too_many = middle
    counts = {min(largest, int((fits + 1) * factor)) for factor in LARGER}
    return _filled_up(choose(fits), [choose(count) for count in sorted(counts)], budget)


def _filled_up(base: _Choice, options: Sequence[_Choice], budget: float) -> np.ndarray:
    """Replace frames by those of larger choices, the largest gain per pixel first, as long as they fit the budget."""
    masks, areas, gains = (each.copy() for each in base)
    for option in options:
        more_area = option.areas - areas
        more_gain = option.gains - gains
        useful = np.flatnonzero(more_gain > 0)
        ratios = more_gain[useful] / np.maximum(more_area[useful], 1e-12)
        for frame in useful[np.argsort(-ratios, kind="stable")]:
            if areas.sum() - areas[frame] + option.areas[frame] <= budget:
                masks[frame], areas[frame], gains[frame] = (each[frame] for each in option)
    return masks


def smooth_over_time(errors: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """Return errors averaged over each frame and its neighbours in a scene, with the weights 1, 2, 1.

    Errors are (F, rows, columns).
    """
    same = scenes[1:] == scenes[:-1]
    after = errors.copy()
    after[:-1][same] = errors[1:][same]
    before = errors.copy()
    before[1:][same] = errors[:-1][same]
    return np.asarray((2 * errors + after + before) / 4)


def clean(masks: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """Return masks, (F, rows, columns) bool, with fewer and simpler regions that do not flicker.

    A tile that is chosen in the frames before and after is chosen in the frame between, too.
    """
    same = (scenes[:-2] == scenes[2:])[:, np.newaxis, np.newaxis]
    closed = masks.copy()
    closed[1:-1] |= masks[:-2] & masks[2:] & same
    return np.stack([_clean_frame(mask) for mask in closed])


def _clean_frame(mask: np.ndarray) -> np.ndarray:
    """Fill holes, drop single tiles and join near rectangles; a frame that is nearly covered is taken as a whole."""
    kept = _without_holes(simplified(_without_crumbs(_without_holes(mask))))
    return np.ones_like(kept) if kept.mean() >= WHOLE_SHARE else kept


def _without_holes(mask: np.ndarray) -> np.ndarray:
    """Fill areas that the mask encloses; the edge of the frame encloses nothing."""
    padded = cv2.copyMakeBorder((~mask).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    _, labels = cv2.connectedComponents(padded, connectivity=4)
    return np.asarray((labels != labels[0, 0])[1:-1, 1:-1])


def _without_crumbs(mask: np.ndarray) -> np.ndarray:
    """Drop single tiles, unless the frame has only a few."""
    if mask.size < SMALLEST_GRID:
        return mask
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] > 1
    large[0] = False
    return np.asarray(large[labels])
