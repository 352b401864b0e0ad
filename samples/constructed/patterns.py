"""Patterns that repeat: bars, tiles, bricks, fences, a grille, keys, dots and windows."""

from __future__ import annotations

from .layers import Show, backdrop, pan, stack, wave
from .raster import Raster, enlarge, shift, tilt, turn
from .textures import (
    EVENING,
    GARDEN,
    INDOORS,
    STREET,
    Random,
    add_glyphs,
    paint_cells,
    paint_dots,
    paint_grille,
    paint_slats,
    pattern,
)


def make_bars(random: Random, raster: Raster) -> Show:
    """Fill the frame with thin upright bars, a little worn."""
    paint = paint_cells((6, 400), 2.5, ["8f9399", "b9bec2"], "34383c", differ=0.02, grain=0.025)
    return stack(raster, [(pattern(random, (560, 360), raster.density, paint), pan(4.2, 0.7))])


def make_tiles(random: Random, raster: Raster) -> Show:
    """Fill the frame with tiles that turn."""
    paint = paint_cells((40, 40), 3, ["6f8f9a", "9db8bd", "c9d6d2"], "4a4744", differ=0.08, grain=0.035)
    tiles = pattern(random, (620, 620), raster.density, paint)
    return stack(raster, [(tiles, lambda time: shift(20, -12) @ turn(10 * (time - 2)))])


def make_bricks(random: Random, raster: Raster) -> Show:
    """Move past a brick wall that is seen at a slant."""
    paint = paint_cells((40, 12), 2, ["6d3b2c", "8f5440", "a86a50"], "a39a8c", differ=0.12, grain=0.06, bond=0.5)
    wall = pattern(random, (1100, 560), raster.density, paint)
    return stack(raster, [(wall, lambda time: tilt(24 + 3 * (time - 2), 4) @ shift(17 * (time - 2), 2 * (time - 2)))])


def make_windows(random: Random, raster: Raster) -> Show:
    """Move past a facade of equal windows that is seen at a slant."""
    paint = paint_cells((40, 20), 9, ["20303c", "3d5160", "7b8d97"], "b1a696", differ=0.12, grain=0.03)
    front = pattern(random, (900, 520), raster.density, paint)
    return stack(raster, [(front, lambda time: tilt(-12, 3) @ shift(26 * (time - 2), 4 * wave(time, 5)))])


def make_fence(random: Random, raster: Raster) -> Show:
    """Put a long fence in front of a garden that moves the other way."""
    slats = paint_slats(20, 0.5, ["8a7a66", "cdbfa8", "efe6d6"], rails=60)
    fence = pattern(random, (860, 190), raster.density, slats, "box", (430, 80))
    return stack(raster, [(backdrop(random, raster, GARDEN), pan(-4)), (fence, lambda t: shift(7 * (t - 2), 20))])


def make_railing(random: Random, raster: Raster) -> Show:
    """Put a short railing in front of a street, faster than its own period."""
    slats = paint_slats(12, 0.45, ["2a2d30", "4a4f54"], rails=54)
    railing = pattern(random, (230, 130), raster.density, slats, "box", (105, 56))
    street = backdrop(random, raster, STREET)
    return stack(raster, [(street, pan(3, 1)), (railing, lambda t: shift(15 * (t - 2), 5 * wave(t, 4)) @ turn(2 * t))])


def make_grille(random: Random, raster: Raster) -> Show:
    """Zoom towards a grille, and more slowly to what is behind."""
    bars = paint_grille(20, 6, ["3b3a38", "6b6a66", "a09d96"])
    grille = pattern(random, (420, 260), raster.density, bars, "box", (187, 107))
    room = backdrop(random, raster, INDOORS)
    near, far = (lambda t: shift(10, 4) @ enlarge(1.08**t)), (lambda t: shift(2 * t, 0) @ enlarge(1.02**t))
    return stack(raster, [(room, far), (grille, near)])


def make_keyboard(random: Random, raster: Raster) -> Show:
    """Slide along a keyboard in perspective: equal keys but for small signs."""
    half = (150.0, 50.0)
    paint = paint_cells((20, 20), 4, ["2c2e31", "34363a"], "15161a", differ=0.1, grain=0.02, corner=3)
    keys = pattern(random, (320, 120), raster.density, paint, "box", half)
    keys = add_glyphs(random, keys, (20, 20), half, "d8dade")
    desk = backdrop(random, raster, INDOORS, leaves=3, grain=0.05)
    return stack(
        raster, [(desk, pan(3, 1)), (keys, lambda t: tilt(8, 38) @ shift(13 * (t - 2), 6) @ turn(3 * (t - 2)))]
    )


def make_dots(random: Random, raster: Raster) -> Show:
    """Wave a dotted cloth with a wavy outline in front of what moves the other way."""
    paint = paint_dots(6, 1.6, "f0e7d8", "8c2f39", dirt=0.08)
    cloth = pattern(random, (190, 220), raster.density, paint, "blob", (80, 95))
    behind = backdrop(random, raster, EVENING)
    return stack(raster, [(behind, pan(-6)), (cloth, lambda t: shift(12 * wave(t, 9), 2.5 * t) @ turn(4 * (t - 2)))])
