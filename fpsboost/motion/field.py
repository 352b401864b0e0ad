"""A motion field: the vectors of a frame's pixels, and how alike their ends were found to be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.points import find_gradients, measure_forward_backward_errors


@dataclass(frozen=True)
class MotionField:
    """Motion of every pixel of one frame towards another.

    Attributes
    ----------
    vectors : (rows, columns, 2) float32
        ``(dx, dy)`` in pixels; the direction is in the variable's name (``field01``, ``field10``).
    similarities : (rows, columns) float32
        How alike the patches or blocks at both ends were found to be, in [0, 1], each estimator by its own measure; 1
        everywhere where it has none. The default's belong to the whole pixels that its vectors were refined from.
    search_radius : int or None
        Largest motion that was searched for, pixels in x and in y, where an estimator chose it for these frames.
    spacing : int
        Pixels along x and y that share a vector.
    size : (H, W) or None
        Of the frame; None where every pixel has a vector of its own.
    """

    vectors: NDArray[Any]
    similarities: NDArray[Any]
    search_radius: int | None = None
    spacing: int = 1
    size: tuple[int, int] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """``(H, W)`` of the frame."""
        height, width = self.size or self.similarities.shape
        return height, width

    @cached_property
    def flow(self) -> NDArray[Any]:
        """(H, W, 2) float32, the vector of every pixel."""
        return self._at_pixels(self.vectors)

    @cached_property
    def similarity(self) -> NDArray[Any]:
        """(H, W) float32, for every pixel the similarity of the point whose vector it shares, not of its own patch."""
        return self._at_pixels(self.similarities)

    def at_points(self, spacing: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Vectors and similarities of the pixels at points `spacing` apart; see `point_places`.

        Returns
        -------
        (rows, columns, 2), (rows, columns) float32
        """
        y, x = (places // self.spacing for places in point_places(self.shape, spacing))
        vectors, similarities = (each.take(y, axis=0).take(x, axis=1) for each in (self.vectors, self.similarities))
        return vectors, similarities

    def _at_pixels(self, values: NDArray[Any]) -> NDArray[Any]:
        return values if self.spacing == 1 else spread_points(values, self.shape, self.spacing)


def spread_points(values: NDArray[Any], size: tuple[int, ...], spacing: int) -> NDArray[Any]:
    """Give every pixel of a frame, or the finer points of `size`, what its point has."""
    height, width = size[:2]
    # rows last, which are copied as a whole
    return values.repeat(spacing, axis=1)[:, :width].repeat(spacing, axis=0)[:height]


def point_places(size: tuple[int, ...], spacing: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows and columns of points `spacing` apart, the first at spacing / 2 and the last within the frame."""
    height, width = size[:2]
    y, x = (np.minimum(np.arange(0, length, spacing) + spacing // 2, length - 1) for length in (height, width))
    return y, x


def forward_backward_error(vectors: NDArray[Any], y: NDArray[Any], x: NDArray[Any], back: MotionField) -> NDArray[Any]:
    """How far from where they began vectors end, there and back.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
        Motion of the pixels in rows `y` and columns `x`.
    y : (rows,) int
    x : (columns,) int
    back : MotionField
        Of the other frame; beyond its edges as at them.

    Returns
    -------
    (rows, columns) float32
        Pixels.
    """
    distance = np.empty(vectors.shape[:2], np.float32)
    measure_forward_backward_errors(vectors, y, x, back.vectors, back.spacing, *back.shape, distance)
    return distance


def motion_gradients(vectors: NDArray[Any], spacing: int) -> NDArray[Any]:
    """How motion changes from pixel to pixel around points: by zoom, rotation and perspective, not from thing to thing.

    Of the differences from the neighbours on both sides the smaller one where they have one sign, else none (the minmod
    limiter; Roe 1986, doi:10.1146/annurev.fl.18.010186.002005): at the edge of an object one of them is large.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
    spacing : int
        Distance of the points, pixels.

    Returns
    -------
    (rows, columns, 2, 2) float32
        Along x, of dx and dy, then along y; pixels per pixel.
    """
    gradients = np.empty((*vectors.shape, 2), np.float32)
    find_gradients(vectors, np.float32(spacing), gradients)
    return gradients
