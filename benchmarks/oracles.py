"""What the default method could reach with the truth at hand: the best of its own candidates at every node or patch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image
from fpsboost.kernels.candidates import VALUES_PER_MOTION, Candidates
from fpsboost.kernels.jit import FINITE_JIT, njit
from fpsboost.kernels.multi_hypothesis import (
    AREA,
    WINDOW,
    Plane,
    fetch_window,
    locate_window,
    mix_inside,
    upsample_squares,
    window_shape,
)
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.multi_hypothesis import _samples

PATCH = 2
"""r of the patches that choose for themselves, pixels."""

INFINITE = np.float32(1e30)
"""More than any squared error."""

SHIFTS = (0.0, -0.5, 0.5, -1.0, 1.0)
"""Along x and y each, pixels."""


@njit(**FINITE_JIT)
def sum_around(values, radius, sums):
    """Sum values over the patch around each pixel of a window, cut off at the window's border."""
    for y in range(WINDOW):
        for x in range(WINDOW):
            total = np.float32(0)
            for j in range(max(y - radius, 0), min(y + radius, WINDOW - 1) + 1):
                for i in range(max(x - radius, 0), min(x + radius, WINDOW - 1) + 1):
                    total += values[j * WINDOW + i]
            sums[y * WINDOW + x] = total


@njit(**FINITE_JIT)
def sample_candidate(samples0, samples1, size, top, left, motion, t, rows, marks, images):
    """Sample a window along a candidate like `fpsboost.kernels.multi_hypothesis`: both frames mixed, and each alone.

    Parameters
    ----------
    samples0, samples1 : SampledImage
        See `fpsboost.kernels.multi_hypothesis`.
    size : (int, int)
        Height and width of the frame.
    top, left : int
        First pixel of the window.
    motion : (VALUES_PER_MOTION,) float32
        See `fpsboost.kernels.candidates`.
    t : float32
    rows : ((WINDOW + 3) * WINDOW,) float32
        Room.
    marks : (4, WINDOW) float32
        Room.
    images : (3, C, AREA) float32 out
    """
    unit, (_, height, width) = samples0.full.unit, samples0.full.planes.shape
    _, plane_rows, stride = samples0.full.coefficients.shape
    values0, coefficients0 = samples0.full.planes.ravel(), samples0.full.coefficients.ravel()
    values1, coefficients1 = samples1.full.planes.ravel(), samples1.full.coefficients.ravel()
    place = locate_window(top, left, motion, t, *size, marks)
    for c in range(images.shape[1]):
        first, second, mixed = images[1, c], images[2, c], images[0, c]
        plane0 = Plane(values0, coefficients0, unit, c, height, width, plane_rows, stride)
        fetch_window(plane0, place.y0, place.x0, -t, motion, WINDOW, WINDOW, rows, first)
        plane1 = Plane(values1, coefficients1, unit, c, height, width, plane_rows, stride)
        fetch_window(plane1, place.y1, place.x1, np.float32(1) - t, motion, WINDOW, WINDOW, rows, second)
        for i in range(AREA):
            mixed[i] = first[i] + t * (second[i] - first[i])
        if not place.within:
            mix_inside(t, marks, 1, 1, first, second, mixed)


@njit(**FINITE_JIT)
def measure_window(image, truth, top, left, error):
    """Measure the squared error of each pixel of a window, summed over the planes; 0 outside of the frame."""
    channels, height, width = truth.shape
    error[:] = 0
    for j in range(max(-top, 0), min(height - top, WINDOW)):
        for i in range(max(-left, 0), min(width - left, WINDOW)):
            for c in range(channels):
                difference = image[c, j * WINDOW + i] - truth[c, top + j, left + i]
                error[j * WINDOW + i] += difference * difference


@njit(**FINITE_JIT)
def add_window(best, shape, top, left, mean, weight):
    """Add the part of a window that lies inside of the frame."""
    channels, height, width = mean.shape
    for j in range(max(-top, 0), min(height - top, WINDOW)):
        for i in range(max(-left, 0), min(width - left, WINDOW)):
            place = j * WINDOW + i
            weight[top + j, left + i] += shape[place]
            for c in range(channels):
                mean[c, top + j, left + i] += shape[place] * best[c, place]


@njit(**FINITE_JIT)
def choose_candidates(samples0, samples1, truth, t, candidates, alone, radius, shape, mean, weight, choice):
    """Sum up windows of the candidates that come nearest to the truth.

    Parameters
    ----------
    samples0, samples1, t
        See `sample_candidate`.
    truth : (C, height, width) float32
    candidates : fpsboost.kernels.candidates.Candidates
        Their weights are not read.
    alone : bool
        Whether what either frame shows may be taken unmixed.
    radius : int
        r of the patches that choose, pixels; below 0 a window chooses as a whole.
    shape : (AREA,) float32
        `fpsboost.kernels.multi_hypothesis.window_shape`, spread over the pixels.
    mean : (C, height, width) float32
        Sum of the windows; in and out.
    weight : (height, width) float32
        Sum of their shapes; in and out.
    choice : (rows, columns) int32 out
        The candidate that each window would choose as a whole.
    """
    channels, height, width = truth.shape
    rows, marks = np.empty((WINDOW + 3) * WINDOW, np.float32), np.empty((4, WINDOW), np.float32)
    images, best = np.empty((3, channels, AREA), np.float32), np.empty((channels, AREA), np.float32)
    error, score, least = np.empty(AREA, np.float32), np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    count, motions, _, spacing = candidates
    before = (WINDOW - spacing) // 2
    for row in range(count.shape[0]):
        for column in range(count.shape[1]):
            top, left = row * spacing - before, column * spacing - before
            least[:] = INFINITE
            least_of_all = INFINITE
            for k in range(count[row, column]):
                sample_candidate(
                    samples0, samples1, (height, width), top, left, motions[row, column, k], t, rows, marks, images
                )
                for number in range(3 if alone else 1):
                    measure_window(images[number], truth, top, left, error)
                    whole = np.float32((error * shape).sum())
                    if whole < least_of_all:
                        least_of_all = whole
                        choice[row, column] = k
                    if radius < 0:
                        score[:] = whole
                    else:
                        sum_around(error, radius, score)
                    for i in range(AREA):
                        if score[i] < least[i]:
                            least[i] = score[i]
                            best[:, i] = images[number, :, i]
            add_window(best, shape, top, left, mean, weight)


def best_of(
    frame_pair: FramePair,
    truth: Image,
    t: float,
    candidates: Candidates,
    *,
    alone: bool = False,
    radius: int = -1,
) -> tuple[Image, NDArray[Any]]:
    """Return the frame at time t of the candidates that come nearest to the truth, and which those are.

    Parameters
    ----------
    frame_pair : FramePair
        Between two frames of 8 bits.
    truth : (H, W, C) uint8
    t : float
    candidates : Candidates
        Their weights are not read.
    alone : bool
        Whether what either frame shows may be taken unmixed.
    radius : int
        r of the patches that choose, pixels; below 0 a window chooses as a whole.

    Returns
    -------
    (H, W, C) uint8, and (rows, columns) int32
        The second is what each window would choose as a whole.
    """
    samples0, samples1 = (image.cached(_samples) for image in (frame_pair.image0, frame_pair.image1))
    wanted = np.ascontiguousarray(truth.transpose(2, 0, 1), np.float32) / np.float32(255)
    mean, weight, choice = (
        np.zeros_like(wanted),
        np.zeros(wanted.shape[1:], np.float32),
        np.zeros_like(candidates.listed),
    )
    shape = np.empty(AREA, np.float32)
    upsample_squares(window_shape(candidates.spacing), 1, 1, shape)
    choose_candidates(samples0, samples1, wanted, np.float32(t), candidates, alone, radius, shape, mean, weight, choice)
    mean /= weight
    return np.rint(mean.transpose(1, 2, 0).clip(0, 1) * 255).astype(np.uint8), choice


def shifted(motions: NDArray[Any], choice: NDArray[Any], t: float, *, paths: bool) -> NDArray[Any]:
    """Return each node's chosen candidate with its motion, or its position at time t, shifted by `SHIFTS` in x and y.

    Parameters
    ----------
    motions : (rows, columns, room, VALUES_PER_MOTION) float32
    choice : (rows, columns) int32
    t : float
    paths : bool
        Shift the place, at both frames alike, instead of the motion.

    Returns
    -------
    (rows, columns, len(SHIFTS)^2, VALUES_PER_MOTION) float32
    """
    chosen = np.take_along_axis(motions, choice[..., np.newaxis, np.newaxis], axis=2)
    shifts = np.zeros((len(SHIFTS) ** 2, VALUES_PER_MOTION), np.float32)
    both_axes = np.stack(np.meshgrid(SHIFTS, SHIFTS), axis=-1).reshape(-1, 2)
    if paths:  # the place at time t is that of the straight path less a t (1 - t) / 2
        shifts[:, 2:4] = both_axes / (t * (1 - t) / 2)
    else:
        shifts[:, :2] = both_axes
    moved: NDArray[Any] = np.ascontiguousarray(chosen + shifts, np.float32)
    return moved
