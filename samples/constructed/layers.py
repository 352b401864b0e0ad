"""Textures that move in front of each other, which is what most clips are; what `catalogue` takes for a clip."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .raster import Array, Raster, Texture, shift
from .textures import EARTH, Random, scenery

Motion = Callable[[float], Array]  # a time in, the matrix of a texture out
Show = Callable[[float], Array]  # a time in, a picture of (rows, columns, 3) out
Maker = Callable[[Random, Raster], Show]


@dataclass(frozen=True)
class Clip:
    """How a clip is made.

    Attributes
    ----------
    make : callable
        Prepares the textures; what it returns draws the clip at any time. Time counts pairs: frame k is at k / 2, so
        speeds are per two frames, which is how far apart frames are when every second one is hidden.
    moves : str
        What is seen, and how fast.
    noise : float
        Deviation of the sensor's noise, levels of 255.
    blur : float
        Deviation of the lens's blur, pixels of the frame.
    subframes : int
        Pictures averaged over half the time from frame to frame, for motion blur.
    supersampling : int
        Samples a pixel each way.
    """

    make: Maker
    moves: str
    noise: float = 0
    blur: float = 0
    subframes: int = 1
    supersampling: int = 3


def pan(x: float, y: float = 0) -> Motion:
    """Move by (x, y) units a pair, in the middle at time 2."""
    return lambda time: shift(x * (time - 2), y * (time - 2))


def still(x: float = 0, y: float = 0) -> Motion:
    """Stay at a place."""
    return lambda _: shift(x, y)


def wave(time: float, period: float, phase: float = 0) -> float:
    """Give a sine of time, with a period in pairs and a phase in turns."""
    return math.sin(2 * math.pi * (time / period + phase))


def stack(raster: Raster, layers: Sequence[tuple[Texture, Motion]]) -> Show:
    """Show textures in front of each other, the first behind and larger than the frame."""

    def show(time: float) -> Array:
        canvas = raster.fill(layers[0][0], layers[0][1](time))
        for texture, motion in layers[1:]:
            raster.draw(canvas, texture, motion(time))
        return canvas

    return show


def backdrop(
    random: Random,
    raster: Raster,
    palette: Sequence[str] = EARTH,
    *,
    more: tuple[float, float] = (120, 90),
    **how: float,
) -> Texture:
    """Draw scenery that is larger than the frame by `more` units each way."""
    return scenery(random, (raster.extent[0] + more[0], raster.extent[1] + more[1]), raster.density, palette, **how)
