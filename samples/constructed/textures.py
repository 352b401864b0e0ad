"""Textures drawn from noise with a fixed seed: leaves, grain, letters, cut-outs and patterns that repeat.

`scenery` follows the dead-leaves model (Lee, Mumford and Huang, "Occlusion models for natural images", IJCV 2001):
shapes that hide each other, with radii of a density that falls with the third power, have the 1/f spectrum and the
edges of photographs. Every texture draws its random numbers in the same order whatever its density.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from .raster import Array, Texture, count, find_places, index_matrix

Random = np.random.Generator
Extent = tuple[float, float]  # width and height in units

EARTH = ["2b2a26", "5b5546", "8a7f66", "b7a98a", "d8cfb8", "7c5a3c", "4d5a3a"]
STREET = ["23272e", "4a525c", "7c858c", "a9aca8", "cfc8ba", "93604a", "5a6f86"]
GARDEN = ["1d2a18", "38502a", "5f7a3c", "93a35e", "c9c89a", "6b4a30", "b0856a"]
EVENING = ["141628", "2d2f52", "5a4a78", "95637f", "d08f76", "f0c48f", "3a4d66"]
INDOORS = ["3a322c", "6e5f52", "a08d79", "c9b9a4", "e6dccb", "8a4b3c", "4f6a6a"]


# ------------------------------------------------------------------------------------------------------- noise, colours


def noise(
    random: Random, extent: Extent, density: float, *, coarse: float = 64, fine: float = 1.5, fall: float = 0.75
) -> Array:
    """Make noise of mean 0 and deviation 1, (H, W): octaves of cells from `coarse` to `fine` units, each weaker."""
    child = random.spawn(1)[0]
    rows, columns = count(extent[1], density), count(extent[0], density)
    total, cell, weight = np.zeros((rows, columns), np.float32), coarse, 1.0
    while cell >= fine:
        grid_size = (math.ceil(extent[1] / cell) + 4, math.ceil(extent[0] / cell) + 4)
        grid = child.standard_normal(grid_size, dtype=np.float32)
        into = index_matrix(total.shape, density) @ np.linalg.inv(index_matrix(grid.shape, 1 / cell))
        total += weight * cv2.warpPerspective(grid, into, (columns, rows), flags=cv2.INTER_CUBIC)
        cell, weight = cell / 2, weight * fall
    return (total - total.mean()) / max(float(total.std()), 1e-6)


def read_colour(text: str) -> Array:
    """Turn ``rrggbb`` into colours from 0 to 1."""
    return np.array([int(text[i : i + 2], 16) / 255 for i in (0, 2, 4)], np.float32)


def colour(values: Array, palette: Sequence[str]) -> Array:
    """Turn values from 0 to 1 into colours, evenly spread over a palette of ``rrggbb``."""
    stops = np.stack([read_colour(entry) for entry in palette])
    places = np.linspace(0, 1, len(palette))
    return np.stack([np.interp(values, places, stops[:, i]) for i in range(3)], axis=-1).astype(np.float32)


def rise(values: Array, low: float, high: float) -> Array:
    """Rise smoothly from 0 where values are below `low` to 1 where they are above `high`."""
    t = np.clip((values - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def cover(distance: Array, density: float) -> Array:
    """Tell the share of a sample that a shape covers whose edge is `distance` units away, positive inside."""
    return np.clip(distance * density + 0.5, 0, 1).astype(np.float32)


def with_alpha(colours: Array, alpha: Array) -> Array:
    """Put colours and alpha together, (H, W, 4)."""
    return np.dstack([colours * alpha[..., None], alpha]).astype(np.float32)


# ------------------------------------------------------------------------------------------------- scenes and cut-outs


def make_outline(random: Random, radius: float) -> Array:
    """Make the corners of a leaf, a box or a round blob, (n, 2)."""
    kind = random.integers(3)
    if kind == 0:  # corners anywhere round the middle
        angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(3, 8)))
        lengths = radius * random.uniform(0.5, 1.3, len(angles))
    elif kind == 1:  # a box
        half = math.atan(random.uniform(0.25, 1))
        angles = np.array([half, np.pi - half, np.pi + half, -half]) + random.choice([0, 0, random.uniform(0, np.pi)])
        lengths = np.full(4, radius)
    else:
        angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        lengths = radius * (1 + 0.3 * np.sin(random.integers(2, 4) * angles + random.uniform(0, 6)))
    return np.stack([lengths * np.cos(angles), lengths * np.sin(angles)], axis=1)


def scenery(
    random: Random,
    extent: Extent,
    density: float,
    palette: Sequence[str] = EARTH,
    *,
    leaves: float = 6,
    grain: float = 0.12,
) -> Texture:
    """Draw something like a photograph: shapes in front of each other, with grain on some and others nearly flat.

    `leaves` is their number per thousand square units, fewer of the small ones in some parts than in others; `grain` is
    the deviation of brightness where it is strongest.
    """
    base = noise(random, extent, density, coarse=150, fine=9, fall=0.6)
    picture = colour(0.5 + 0.18 * base, palette)
    strength = np.full(base.shape, 0.5, np.float32)
    busy = rise(noise(random, extent, density, coarse=130, fine=40), -0.8, 0.6)
    number = int(leaves * extent[0] * extent[1] / 1000)
    smallest, largest = 3.0, 100.0
    chances = random.random(number)
    radii = 1 / np.sqrt(chances / smallest**2 + (1 - chances) / largest**2)  # density falls with the third power
    stops = [read_colour(entry) for entry in palette]
    middle = index_matrix(picture.shape, density)[:2, 2]
    for radius in radii:
        place = (random.random(2) - 0.5) * extent
        outline = [np.rint(((make_outline(random, radius) + place) * density + middle) * 16).astype(np.int32)]
        column, row = np.clip((place * density + middle).astype(int), 0, (base.shape[1] - 1, base.shape[0] - 1))
        first, second, mix, near, rough = random.random(5)
        if radius < 12 and first > busy[row, column] + 0.05:
            continue
        tone = (0.5 + 0.18 * float(base[row, column]) + 0.9 * (mix - 0.5)) * (len(stops) - 1)
        below = int(np.clip(tone, 0, len(stops) - 2))
        plain = stops[below] + np.clip(tone - below, 0, 1) * (stops[below + 1] - stops[below])
        around = picture[row, column]  # some differ little from what they lie on
        paint = around + (0.15 + 0.85 * near) * (plain + 0.06 * (second - 0.5) - around)
        cv2.fillPoly(picture, outline, [float(part) for part in paint], shift=4)
        cv2.fillPoly(strength, outline, float(rough**3 * 1.4 + 0.04), shift=4)
    fine = noise(random, extent, density, coarse=20, fall=0.85)
    shade = noise(random, extent, density, coarse=200, fine=40)
    picture *= (1 + grain * strength * fine + 0.08 * shade)[..., None]
    return Texture(np.clip(picture, 0, 1), density)


def make_surface(random: Random, extent: Extent, density: float, palette: Sequence[str], grain: float = 0.1) -> Array:
    """Draw blotches of a few colours with grain, (H, W, 3)."""
    coarse = max(extent) / 4
    blotches = noise(random, extent, density, coarse=coarse, fall=0.6)
    fine = noise(random, extent, density, coarse=min(12, coarse), fall=0.9)
    return np.clip(colour(0.5 + 0.25 * blotches, palette) * (1 + grain * fine[..., None]), 0, 1)


def cutout(random: Random, size: float, density: float, palette: Sequence[str], corners: int = 0) -> Texture:
    """Cut a polygon (or, without corners, an ellipse) of `size` units across out of a printed surface."""
    extent = (size * 1.1, size * 1.1)
    x, y = find_places(extent, density)
    inner = scenery(random, extent, density, palette, leaves=9, grain=0.08).pixels
    if corners:
        distance = np.full_like(x, np.inf)
        for i in range(corners):
            angle = 2 * np.pi * (i + 0.3 * random.random()) / corners
            distance = np.minimum(distance, size * 0.42 - x * math.cos(angle) - y * math.sin(angle))
        limit = size / 2 - np.hypot(x, y)
        distance = np.minimum(distance, limit)
    else:
        distance = (1 - np.hypot(x / 0.5, y / 0.36) / size) * size * 0.4
    inner = inner * (1 - 0.5 * rise(-distance, -3, -1.5))[..., None]  # a darker rim
    return Texture(with_alpha(inner, cover(distance, density)), density)


def make_ball(density: float, size: float, paint: str, shade: float = 0.25) -> Texture:
    """Draw a ball without any texture, only a little darker towards the lower right."""
    x, y = find_places((size + 2, size + 2), density)
    light = 1 - shade * rise((x + y) / size, -0.4, 0.8)
    return Texture(
        with_alpha(read_colour(paint) * light[..., None], cover(size / 2 - np.hypot(x, y), density)), density
    )


def write_letters(
    random: Random, density: float, number: int, size: float, paint: str, weight: float = 0.12
) -> Texture:
    """Write a line of made-up letters, each some strokes between points of a grid, a space here and there."""
    extent = (number * size * 0.8, size * 1.5)
    rows, columns = count(extent[1], density), count(extent[0], density)
    ink = np.zeros((rows, columns), np.uint8)
    for i in range(number):
        path = random.integers([0, 0], [3, 4], size=(random.integers(3, 6), 2))
        if random.random() < 0.14:
            continue
        left, top = (i + 0.15) * size * 0.8, size * 0.25
        points = (path * (size * 0.25, size / 3) + (left, top)) * density
        wide = max(1, round(weight * size * density))
        cv2.polylines(ink, [np.rint(points * 16).astype(np.int32)], False, 255, wide, cv2.LINE_AA, shift=4)
    return Texture(with_alpha(read_colour(paint), ink.astype(np.float32) / 255), density)


# -------------------------------------------------------------------------------------------------- what repeats itself


def wrap(values: Array, period: float) -> Array:
    """Tell how far each value is from the nearest multiple of a period."""
    return values - period * np.round(values / period)


def look_up_cells(table: Array, column: Array, row: Array) -> Array:
    """Look up each cell's number in a table that is repeated periodically."""
    return table[row.astype(int) % table.shape[0], column.astype(int) % table.shape[1]]


def fade_edge(random: Random, x: Array, y: Array, shape: str, half: Extent) -> Array:
    """Tell how far inside of a bounded pattern places are, in units; a blob's outline is wavy."""
    if shape == "box":
        return np.minimum(half[0] - np.abs(x), half[1] - np.abs(y))
    angle, phase = np.arctan2(y / half[1], x / half[0]), random.uniform(0, 6)
    radius = np.hypot(x / half[0], y / half[1])
    return (1 + 0.08 * np.sin(3 * angle + phase) - radius) * min(half)


Splat = Callable[[Random, Array, Array, Extent, float], tuple[Array, Array]]


def paint_slats(period: float, duty: float, paint: Sequence[str], rails: float = 0) -> Splat:
    """Paint upright slats with gaps, on rails this far apart."""

    def make(random: Random, x: Array, y: Array, extent: Extent, density: float) -> tuple[Array, Array]:
        alpha = cover(duty * period / 2 - np.abs(wrap(x, period)), density)
        if rails:
            alpha = np.maximum(alpha, cover(2.5 - np.abs(wrap(y, rails)), density))
        wood = noise(random, extent, density, coarse=24)
        round_ = 1 - 0.35 * np.abs(wrap(x, period)) / (duty * period / 2)
        return colour(0.5 + 0.1 * wood, paint) * round_[..., None], alpha

    return make


def paint_grille(period: float, bar: float, paint: Sequence[str]) -> Splat:
    """Paint crossed bars with holes between."""

    def make(random: Random, x: Array, y: Array, extent: Extent, density: float) -> tuple[Array, Array]:
        nearest = np.minimum(np.abs(wrap(x, period)), np.abs(wrap(y, period)))
        worn = noise(random, extent, density, coarse=40)
        light = 1 - 0.5 * nearest / bar
        return colour(0.5 + 0.12 * worn, paint) * light[..., None], cover(bar / 2 - nearest, density)

    return make


def paint_cells(
    period: Extent,
    gap: float,
    paint: Sequence[str],
    mortar: str,
    *,
    differ: float = 0.03,
    grain: float = 0.03,
    bond: float = 0,
    corner: float = 0,
) -> Splat:
    """Paint tiles, bricks (`bond`: how far every other row is moved, in periods) or keys, with almost equal tones."""

    def make(random: Random, x: Array, y: Array, extent: Extent, density: float) -> tuple[Array, Array]:
        row = np.round(y / period[1])
        along = x - bond * period[0] * (row % 2)
        column = np.round(along / period[0])
        dx = period[0] / 2 - gap / 2 - np.abs(wrap(along, period[0]))
        dy = period[1] / 2 - gap / 2 - np.abs(wrap(y, period[1]))
        distance = np.minimum(dx, dy)
        if corner:
            distance = np.minimum(distance, corner - np.hypot(np.maximum(corner - dx, 0), np.maximum(corner - dy, 0)))
        tone = look_up_cells(random.standard_normal((64, 64)).astype(np.float32), column, row)
        fine = noise(random, extent, density, coarse=16, fall=0.9)
        stain = noise(random, extent, density, coarse=90, fine=30)
        face = colour(0.5 + differ * tone, paint) * (1 + grain * fine + 0.03 * stain)[..., None]
        face = face * (1 - 0.15 * rise(-distance, -1.5, 0))[..., None]
        ground = read_colour(mortar) * (1 + grain * fine)[..., None]
        inside = cover(distance, density)[..., None]
        return ground + inside * (face - ground), np.ones_like(x)

    return make


def paint_dots(period: float, radius: float, paint: str, cloth: str, dirt: float = 0.03) -> Splat:
    """Paint dots on a cloth, every other row moved by half a period."""

    def make(random: Random, x: Array, y: Array, extent: Extent, density: float) -> tuple[Array, Array]:
        across = x - period / 2 * (np.round(y / period) % 2)
        inside = cover(radius - np.hypot(wrap(across, period), wrap(y, period)), density)[..., None]
        picture = read_colour(cloth) + inside * (read_colour(paint) - read_colour(cloth))
        return picture * (1 + dirt * noise(random, extent, density, coarse=70))[..., None], np.ones_like(x)

    return make


def pattern(
    random: Random, extent: Extent, density: float, paint: Splat, shape: str = "", half: Extent = (0, 0)
) -> Texture:
    """Draw a pattern, all over (no `shape`) or bounded by a ``box`` or a ``blob`` of half a width and a height."""
    x, y = find_places(extent, density)
    picture, alpha = paint(random, x, y, extent, density)
    if shape:
        alpha = alpha * cover(fade_edge(random, x, y, shape, half), density)
    elif alpha.min() == 1:
        return Texture(np.clip(picture, 0, 1).astype(np.float32), density)
    return Texture(with_alpha(np.clip(picture, 0, 1), alpha), density)


def add_glyphs(random: Random, keys: Texture, period: Extent, half: Extent, paint: str) -> Texture:
    """Print a small sign of its own on each key."""
    pixels = keys.pixels.copy()
    middle = index_matrix(pixels.shape, keys.density)[:2, 2]
    ink = np.zeros(pixels.shape[:2], np.uint8)
    columns, rows = int(half[0] / period[0]), int(half[1] / period[1])
    for row in range(-rows, rows + 1):
        for column in range(-columns, columns + 1):
            path = random.integers(-1, 2, size=(4, 2)) * (period[0] * 0.11, period[1] * 0.13)
            points = (path + np.array([column * period[0], row * period[1]])) * keys.density + middle
            wide = max(1, round(keys.density * 0.8))
            cv2.polylines(ink, [np.rint(points * 16).astype(np.int32)], False, 255, wide, cv2.LINE_AA, shift=4)
    printed = ink[..., None].astype(np.float32) / 255 * (pixels[..., 3:] if keys.has_alpha else 1)
    pixels[..., :3] += printed * (read_colour(paint) - pixels[..., :3])
    return Texture(pixels, keys.density)
