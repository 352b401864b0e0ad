"""Detection of static overlays on moving frames: titles, logos, the car that the camera follows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.jit import JIT, njit
from fpsboost.kernels.tiles import Index

STAYS, STANDS_OUT = 1, 2


class Frames(NamedTuple):
    """Frames in which a pixel of an overlay is the same, each (H, W) uint8."""

    image0: NDArray[Any]
    image1: NDArray[Any]
    before: NDArray[Any]
    """The frame before the pair."""
    after: NDArray[Any]
    """The frame after the pair."""


@njit(inline="always", **JIT)
def apart(one, other):
    """Return the absolute difference of two 8-bit levels as 8 bits: a vector holds four times as many as of 32 bits."""
    return np.uint8(max(one, other) - min(one, other))


@njit(cache=True, **JIT)
def mark_overlay(frames, motion, spacing, shortest, same, different, marks):
    """Find the pixels that stay the same although their surroundings move.

    Parameters
    ----------
    frames : Frames
    motion : (rows, columns, 2) float32
        Motion of the surroundings of each block of `spacing` pixels from frame 0 to frame 1, pixels.
    spacing : int
    shortest : float32
        Motion below which the surroundings count as static, pixels.
    same, different : int
        Difference in levels up to which a pixel is the same, and above which it is different.
    marks : (H, W) uint8 out
        STAYS where a pixel stays the same; STANDS_OUT where it would also be different if it had moved; else 0.
    """
    image0, image1, before, after = frames
    height, width = marks.shape
    for y in range(height):
        here, smallest = Index(y), np.empty(spacing, np.uint8)
        for column in range(motion.shape[1]):
            left, right = column * spacing, min((column + 1) * spacing, width)
            dx, dy = motion[y // spacing, column, 0], motion[y // spacing, column, 1]
            if max(abs(dx), abs(dy)) < shortest:
                marks[y, left:right] = 0
                continue
            begin, size = Index(left), right - left
            # had the pixel moved along, one of the frames would show its colour on one side or the other
            smallest[:] = 255
            for sign in (-1, 1):
                v, u = y + sign * int(np.rint(dy)), left + sign * int(np.rint(dx))
                first, last = min(max(-u, 0), size), max(min(width - u, size), 0)
                if v < 0 or v >= height or first >= last:
                    smallest[:] = 0
                    continue
                smallest[:first] = 0
                smallest[last:] = 0
                there, moved = Index(v), Index(u + first)
                for i in range(Index(last - first)):
                    place = Index(first) + i
                    colour = image0[here, begin + place]
                    smallest[place] = min(
                        smallest[place],
                        apart(image0[there, moved + i], colour),
                        apart(image1[there, moved + i], colour),
                        apart(before[there, moved + i], colour),
                        apart(after[there, moved + i], colour),
                    )
            for i in range(Index(size)):
                colour = image0[here, begin + i]
                largest = max(
                    apart(image1[here, begin + i], colour),
                    apart(before[here, begin + i], colour),
                    apart(after[here, begin + i], colour),
                )
                mark = STANDS_OUT if smallest[i] > different else STAYS
                marks[here, begin + i] = mark if largest <= same else 0
