"""Motion fields: the vectors of a frame's pixels with their similarity, and curved trajectories from pair to pair.

Direction: ``field01`` leads from frame 0 to frame 1, so that ``image1[y + dy, x + dx]`` looks like ``image0[y, x]``. A
field of the default method has a vector for every eighth pixel along x and y (a *point*); `MotionField.flow` repeats it
for the pixels that share it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.image_checks import check_pair
from fpsboost.kernels.points import (
    FieldLayout,
    RoundTrip,
    find_accelerations,
    find_gradients,
    measure_forward_backward_errors,
)


@dataclass(frozen=True)
class MotionField:
    """Motion of every pixel of one frame to another frame.

    Parameters
    ----------
    vectors : (rows, columns, 2) array
        ``(dx, dy)`` in pixels, in one direction: ``image1[y + dy, x + dx]`` looks like ``image0[y, x]``.
    similarities : (rows, columns) array, optional
        Similarity of both ends of each vector, in [0, 1], by the estimator's own measure; 1 if it is left out.
    search_radius : int, optional
        Search range, pixels in x and in y, if the estimator chose it for these frames.
    spacing : int
        Pixels along x and y that share a vector.
    size : (int, int), optional
        Height and width of the frame; needed unless every pixel has a vector of its own.

    Raises
    ------
    OptionError
        The shapes of the arrays do not go with each other or with the size.

    Examples
    --------
    >>> vectors = np.array([[[3, 0], [0, 0]]], np.float32)  # two points, 8 pixels apart
    >>> field = MotionField(vectors, np.ones((1, 2), np.float32), spacing=8, size=(6, 14))
    >>> field.shape, field.flow[5, 7].tolist(), field.flow[5, 8].tolist()
    ((6, 14), [3.0, 0.0], [0.0, 0.0])
    >>> MotionField(np.zeros((6, 14, 2))).similarity.min().tolist()
    1.0
    """

    vectors: np.ndarray
    """(rows, columns, 2) float32; the direction is in the variable's name (``field01``, ``field10``)."""
    similarities: np.ndarray = field(default_factory=lambda: np.ones((1, 1), np.float32))
    """(rows, columns) float32. In the default method, that of the whole-pixel vector before refinement."""
    search_radius: int | None = None
    spacing: int = 1
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Bring the arrays, which may be views, into the form that kernels take."""
        vectors = np.ascontiguousarray(self.vectors, np.float32)
        similarities = np.asarray(self.similarities)
        height, width = self.size or vectors.shape[:2]
        if self.spacing < 1:
            raise OptionError(f"`spacing` is {self.spacing}, and vectors are at least a pixel apart; give 1 or more.")
        points = -(-height // self.spacing), -(-width // self.spacing)
        if vectors.shape != (*points, 2) or similarities.shape not in {points, (1, 1)}:
            raise OptionError(
                f"`vectors` for {width}x{height} pixels with a `spacing` of {self.spacing} have the shape "
                f"{(*points, 2)} and `similarities` {points}, not {vectors.shape} and {similarities.shape}."
            )
        object.__setattr__(self, "vectors", vectors)
        object.__setattr__(self, "similarities", np.full(points, similarities, np.float32))

    @property
    def shape(self) -> tuple[int, int]:
        """Size of the frame, ``(H, W)``."""
        height, width = self.size or self.similarities.shape
        return height, width

    @cached_property
    def flow(self) -> np.ndarray:
        """Vector of every pixel, (H, W, 2) float32, ``(dx, dy)`` in pixels."""
        return self._at_pixels(self.vectors)

    @cached_property
    def similarity(self) -> np.ndarray:
        """Similarity of the point whose vector each pixel shares, not of its own patch, (H, W) float32."""
        return self._at_pixels(self.similarities)

    def at_points(self, spacing: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the vectors, (rows, columns, 2), and similarities, (rows, columns), at points `spacing` apart.

        The points are those of `point_places`. The arrays may be those of the field, and must not be written to.
        """
        layout = self.shape, self.spacing, spacing
        return resample_points(self.vectors, *layout), resample_points(self.similarities, *layout)

    def errors_at_points(self, spacing: int, back: MotionField) -> np.ndarray:
        """Return the forward-backward errors of the vectors of `at_points`, (rows, columns) float32, pixels.

        `back` is the motion of the other frame.
        """
        vectors, _ = self.at_points(spacing)
        return forward_backward_error(vectors, *point_places(self.shape, spacing), back)

    def _at_pixels(self, values: np.ndarray) -> np.ndarray:
        """Return the value of each point for all pixels that share it."""
        return values if self.spacing == 1 else spread_points(values, self.shape, self.spacing)


def resample_points(values: np.ndarray, size: tuple[int, ...], spacing: int, step: int) -> np.ndarray:
    """Return the values of points `spacing` apart for those `step` apart; see `point_places`. Not always a copy.

    Each point takes the value of the point whose block of pixels it lies in; nothing is interpolated.
    """
    if step == spacing:
        return values
    y, x = (places // spacing for places in point_places(size, step))
    return values.take(y, axis=0).take(x, axis=1)


def spread_points(values: np.ndarray, size: tuple[int, ...], spacing: int) -> np.ndarray:
    """Repeat the value of each point for every pixel of a frame, or for the finer points of `size`, (rows, columns)."""
    height, width = size[:2]
    # along rows first: the second repeat then copies whole rows
    return values.repeat(spacing, axis=1)[:, :width].repeat(spacing, axis=0)[:height]


@lru_cache(maxsize=64)  # the same for every frame of a clip
def point_places(size: tuple[int, ...], spacing: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows and columns of points `spacing` apart, from spacing / 2 to within the frame; read-only.

    A point is the middle of a block of spacing x spacing pixels; at the right and at the bottom edge, where blocks are
    cut off, it may be the last pixel.
    """
    height, width = size[:2]
    y, x = (np.minimum(np.arange(0, length, spacing) + spacing // 2, length - 1) for length in (height, width))
    for places in (y, x):
        places.setflags(write=False)
    return y, x


def forward_backward_error(vectors: np.ndarray, y: np.ndarray, x: np.ndarray, back: MotionField) -> np.ndarray:
    """Return the distance between the start of each vector and the end of the way there and back, pixels.

    It is 0 where both fields agree, and large where a pixel is occluded in the other frame or matched by chance.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
        Motion of the pixels in rows `y` and columns `x`.
    y, x : (rows,) and (columns,) int
        Places of the vectors.
    back : MotionField
        Motion of the other frame, whose edges are repeated.

    Returns
    -------
    (rows, columns) float32
    """
    vectors = np.ascontiguousarray(vectors, np.float32)
    distance = np.empty(vectors.shape[:2], np.float32)
    measure_forward_backward_errors(vectors, y, x, back.vectors, back.spacing, *back.shape, distance)
    return distance


def ends_inside(motion: np.ndarray) -> np.ndarray:
    """Return whether the motion from each pixel, (H, W, 2), ends inside of the frame, (H, W) bool."""
    height, width = motion.shape[:2]
    y = np.arange(height, dtype=np.float32)[:, np.newaxis] + motion[..., 1]
    x = np.arange(width, dtype=np.float32) + motion[..., 0]
    return np.asarray((x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5))


def motion_gradients(vectors: np.ndarray, spacing: int) -> np.ndarray:
    """Return the motion gradients around points: those of zoom, rotation and perspective, not of object boundaries.

    A gradient is the smaller of the differences from the neighbours on both sides if they have the same sign, else 0
    (minmod limiter; Roe 1986, doi:10.1146/annurev.fl.18.010186.002005): at the edge of an object, one of them is large.

    Parameters
    ----------
    vectors : (rows, columns, 2) float32
        Motion of points, pixels.
    spacing : int
        Distance between the points, pixels.

    Returns
    -------
    (rows, columns, 2, 2) float32
        Change of (dx, dy) along x, then along y, pixels per pixel.
    """
    gradients = np.empty((*vectors.shape, 2), np.float32)
    find_gradients(vectors, spacing, gradients)
    return gradients


@dataclass(frozen=True)
class ZeroMotion:
    """Zero motion of every pixel, as used by `blend` and `nearest`, which need no estimate."""

    takes_planes: ClassVar[bool] = True

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Return zero motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`."""
        check_pair(image0.pixels, image1.pixels)
        height, width = image0.pixels.shape[:2]
        still = MotionField(np.zeros((1, 1, 2)), spacing=max(height, width), size=(height, width))
        return still, still


CONSISTENT = 1.5
"""Maximum forward-backward error of a valid vector, pixels."""

ONE_SIDED_WEIGHT = 0.8
"""Weight of the acceleration if it is estimated from one neighbouring pair only."""

TWO_SIDED_WEIGHT = 1.5
"""Weight of the acceleration if it is estimated from both neighbouring pairs. A Catmull-Rom spline has 1, which is
exact for slowly changing motion; the ideal interpolation of motion that may change from pair to pair, a sinc, has 4 if
truncated after two frames on each side."""

COMPARABLE = 2.0
"""Maximum ratio of the durations of two pairs up to which acceleration is not limited: beyond it, motion may well have
stopped or begun within the longer one."""

LEAST_RATIO = 0.125
"""Ratio of durations below which acceleration is reduced: it has the errors of vectors times 2 over the ratio."""


def accelerations_at_points(
    onward: tuple[MotionField, MotionField], away: tuple[MotionField, MotionField] | None, ratio: float, spacing: int
) -> np.ndarray:
    """Estimate the acceleration at the frame that two neighbouring pairs share, at points `spacing` apart.

    If the durations differ by more than a factor of 2, it is limited so that the path of a point, with either weight,
    stays between its ends along x and along y, as that of a monotone spline does.

    Parameters
    ----------
    onward : (MotionField, MotionField)
        Motion from the shared frame to the other frame of the pair, and back.
    away : (MotionField, MotionField) or None
        The same for the neighbouring pair; None if there is none.
    ratio : float
        Duration of the neighbouring pair divided by that of the pair.
    spacing : int
        Distance between the points, pixels.

    Returns
    -------
    (rows, columns, 3) float32
        1 where the vectors in both directions are valid, and the acceleration (x, y) in pixels per interval squared;
        else 0.
    """
    y, x = point_places(onward[0].shape, spacing)
    changes = np.zeros((y.size, x.size, 3), np.float32)
    if away is not None:
        fields = *onward, *away
        if len({field.spacing for field in fields}) == 1:
            vectors = [field.vectors for field in fields]
            shared = onward[0].spacing
        else:
            vectors = [field.flow for field in fields]
            shared = 1
        trips = RoundTrip(*vectors[:2]), RoundTrip(*vectors[2:])
        layout = FieldLayout(shared, *onward[0].shape)
        find_accelerations(*trips, layout, y, x, ratio, CONSISTENT, changes)
        if not 1 / COMPARABLE <= ratio <= COMPARABLE:
            limit = np.abs(onward[0].at_points(spacing)[0]) * np.float32(2 / TWO_SIDED_WEIGHT)
            belief = np.float32(min(1, ratio / LEAST_RATIO) ** 2)
            changes[..., 1:] = (changes[..., 1:] * belief).clip(-limit, limit)
    return changes
