"""What stands still in front of a moving picture: titles, logos, the car that a camera follows."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from fpsboost.kernels.jit import JIT

STAYS, STANDS_OUT = 1, 2


@njit(parallel=True, cache=True, **JIT)
def mark_overlay(image0, image1, before, after, motion, spacing, shortest, same, different, marks):
    """Find the pixels that stay as they are although what surrounds them moves.

    Parameters
    ----------
    image0, image1 : (H, W) uint8
    before, after : (H, W) uint8
        Further frames in which the pixel must be the same.
    motion : (rows, columns, 2) float32
        How the surroundings of each block of `spacing` pixels move from frame 0 to frame 1.
    spacing : int
    shortest : float32
        Motion below which surroundings count as still, pixels.
    same, different : int
        Levels: what differs by at most `same` stays, by more than `different` changes.
    marks : (H, W) uint8 out
        STAYS where a pixel stays the same; STANDS_OUT where, besides, it would not if it moved; else 0.
    """
    height, width = marks.shape
    for row in prange(height):
        y = np.int64(row)
        largest, smallest = np.empty(spacing, np.int16), np.empty(spacing, np.int16)
        for column in range(motion.shape[1]):
            left, right = column * spacing, min((column + 1) * spacing, width)
            marks[y, left:right] = 0
            dx, dy = motion[y // spacing, column]
            if max(abs(dx), abs(dy)) < shortest:
                continue
            here = image0[y, left:right]
            size = here.shape[0]
            largest[:] = 0
            for frame in (image1, before, after):
                there = frame[y, left:right]
                for i in range(size):
                    largest[i] = max(largest[i], abs(np.int16(there[i]) - np.int16(here[i])))
            # had it moved with its surroundings, its colour would be on this side or that in one of the frames
            smallest[:] = 255
            for sign in (-1, 1):
                v, u = y + sign * int(np.rint(dy)), left + sign * int(np.rint(dx))
                first, last = min(max(-u, 0), size), max(min(width - u, size), 0)
                if v < 0 or v >= height or first >= last:
                    smallest[:] = 0
                    continue
                smallest[:first] = 0
                smallest[last:] = 0
                for frame in (image0, image1, before, after):
                    there, same_columns, least = frame[v, u + first : u + last], here[first:last], smallest[first:last]
                    for i in range(last - first):
                        least[i] = min(least[i], abs(np.int16(there[i]) - np.int16(same_columns[i])))
            for i in range(size):
                if largest[i] <= same:
                    marks[y, left + i] = STANDS_OUT if smallest[i] > different else STAYS
