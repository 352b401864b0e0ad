"""Textures drawn from noise with a fixed seed and simple shapes: (size, size, 3) RGB uint8."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float32]  # (size, size) from 0 to 1, or RGB as a third axis
Texture = NDArray[np.uint8]

SIZE = 512


def noise(random: np.random.Generator, cells: int, octaves: int = 5, size: int = SIZE) -> Values:
    """Make smooth noise from 0 to 1, `cells` coarse blobs across, each octave half as large and half as strong."""
    total = np.zeros((size, size), np.float32)
    for octave in range(octaves):
        count = min(cells * 2**octave + 3, size)
        grid = random.random((count, count), dtype=np.float32)
        total += 0.5**octave * cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
    low, high = np.percentile(total, [0.5, 99.5])
    return np.clip((total - low) / (high - low), 0, 1).astype(np.float32)


def colour(values: Values, palette: str) -> Values:
    """Turn values from 0 to 1 into colours, evenly spread over a palette of ``rrggbb rrggbb ...``."""
    stops = np.array([[int(entry[i : i + 2], 16) / 255 for i in (0, 2, 4)] for entry in palette.split()])
    places = np.linspace(0, 1, len(stops))
    return np.stack([np.interp(values, places, stops[:, i]) for i in range(3)], axis=-1).astype(np.float32)


def finish(picture: Values) -> Texture:
    """Round a picture to 8 bits."""
    return np.clip(picture * 255 + 0.5, 0, 255).astype(np.uint8)


def grid(size: int = SIZE) -> tuple[Values, Values]:
    """Give x and y of the pixels, from -1 to 1."""
    y, x = (np.mgrid[0:size, 0:size].astype(np.float32) + 0.5) / size * 2 - 1
    return x, y


def frame(picture: Values, shade: str, width: float = 0.07) -> Values:
    """Draw a border, so that the edges of a cube are seen."""
    x, y = grid(len(picture))
    outside = np.maximum(np.abs(x), np.abs(y)) > 1 - width
    return np.where(outside[..., None], colour(np.zeros(1, np.float32), shade), picture).astype(np.float32)


def draw_map(random: np.random.Generator) -> Values:
    """Draw heights in colour, with lines where they are equal."""
    heights = cv2.GaussianBlur(noise(random, 4), (0, 0), 2)
    steps = np.abs(heights * 14 % 1 - 0.5) > 0.42
    return colour(heights, "1f5a66 3f8c85 8fbf9a ead9a4 e2a766 b9663f") * np.where(steps, 0.45, 1)[..., None]


def draw_rings(random: np.random.Generator) -> Values:
    """Draw rings round a star."""
    x, y = grid()
    radius = np.hypot(x, y) * (1 + 0.18 * np.cos(8 * np.arctan2(y, x))) + 0.06 * noise(random, 6)
    return colour(0.5 + 0.5 * np.tanh(3 * np.sin(17 * radius)), "12394b 1d7080 f0ead2 f7f3e3")


def draw_mosaic(random: np.random.Generator) -> Values:
    """Draw the cells nearest to scattered points, each its own colour, with dark joints."""
    x, y = grid()
    points = random.uniform(-1, 1, (90, 2))
    distances = np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1])
    nearest = np.sort(distances, axis=-1)[..., :2]
    shades = colour(random.random(90).astype(np.float32), "3a0f2b a2304e e8703a f4c77b fff0cf 3d8b8b")
    joint = nearest[..., 1] - nearest[..., 0] < 0.022
    return np.where(joint[..., None], 0.09, shades[np.argmin(distances, axis=-1)]).astype(np.float32)


def draw_weave(random: np.random.Generator) -> Values:
    """Draw a checked cloth with visible threads."""
    x, y = grid()
    across, down = (np.interp(v, np.linspace(-1, 1, 24), random.random(24)) for v in (x, y))
    thread = 0.82 + 0.18 * np.sin(x * 150) * np.sin(y * 150)
    return colour(0.5 * (np.round(across * 4) + np.round(down * 4)) / 4, "20264d 5a66b5 e9e4d4 c4513a 6b1f2a") * thread[
        ..., None
    ].astype(np.float32)


def draw_discs(random: np.random.Generator) -> Values:
    """Draw many overlapping discs, the large ones first."""
    picture = np.full((SIZE, SIZE, 3), (0.93, 0.89, 0.78), np.float32)
    for radius in np.geomspace(90, 8, 130):
        shade = colour(random.random(1).astype(np.float32), "e63946 f4a261 e9c46a 2a9d8f 264653 7b4b94")[0]
        middle = random.integers(0, SIZE, 2)
        cv2.circle(picture, middle.tolist(), round(radius), shade.tolist(), -1, cv2.LINE_AA)
        cv2.circle(picture, middle.tolist(), round(radius * 0.6), (shade * 0.6).tolist(), 3, cv2.LINE_AA)
    return picture


def draw_arcs(random: np.random.Generator) -> Values:
    """Draw tiles of two quarter circles each, turned at random, that join into winding ways."""
    tiles, extent = 8, SIZE // 8
    picture = colour(noise(random, 3), "0f3d3e 1f8a70 2f9f86")
    pale = colour(noise(random, 3), "fdf6d8 bedb92")
    y, x = np.mgrid[0:SIZE, 0:SIZE] % extent / extent
    turned = np.kron(random.integers(0, 2, (tiles, tiles)), np.ones((extent, extent))) > 0
    x = np.where(turned, 1 - x, x)
    on_way = np.minimum(np.abs(np.hypot(x, y) - 0.5), np.abs(np.hypot(1 - x, 1 - y) - 0.5)) < 0.13
    return np.where(on_way[..., None], pale, picture).astype(np.float32)


def make_sides(seed: int) -> Texture:
    """Make six different sides of a cube, three in a row."""
    random = np.random.default_rng(seed)
    drawings = [draw_map, draw_discs, draw_rings, draw_weave, draw_mosaic, draw_arcs]
    shades = ["2b2118", "20264d", "f7f3e3", "e9e4d4", "f4c77b", "0b2626"]
    sides = [finish(frame(draw(random), shade)) for draw, shade in zip(drawings, shades, strict=True)]
    return np.vstack([np.hstack(sides[3:]), np.hstack(sides[:3])])  # v goes up from the bottom row


def make_tiles(seed: int, count: int, palette: str, joint: str) -> Texture:
    """Make a floor of square tiles, each a little different in colour and figure."""
    random = np.random.default_rng(seed)
    size = 2048
    x, y = ((axis + 1) / 2 * count for axis in grid(size))
    shade = random.random((count, count), dtype=np.float32)[y.astype(int), x.astype(int)]
    veins = noise(random, 24, 5, size)
    picture = colour(np.clip(0.75 * shade + 0.25 * veins, 0, 1), palette)
    picture *= np.where(np.abs(veins - 0.5) < 0.02, 0.7, 1)[..., None]
    edge = np.maximum(np.abs(x % 1 - 0.5), np.abs(y % 1 - 0.5)) > 0.47
    line = colour(np.zeros(1, np.float32), joint)
    return finish(np.where(edge[..., None], line, picture).astype(np.float32))


def make_plaster(seed: int, palette: str) -> Texture:
    """Make a wall with soft clouds of colour and fine cracks."""
    random = np.random.default_rng(seed)
    size = 2048
    clouds = noise(random, 10, 4, size)
    picture = colour(clouds, palette)
    cracks = np.abs(noise(random, 14, 4, size) - 0.5) < 0.012
    return finish(picture * np.where(cracks, 0.72, 1)[..., None].astype(np.float32))


def make_checker(seed: int, count: int, palette: str) -> Texture:
    """Make a checker of cream and many colours; small discs sit on the cream fields."""
    random = np.random.default_rng(seed)
    size = 2048
    x, y = ((axis + 1) / 2 * count for axis in grid(size))
    column, row = x.astype(int), y.astype(int)
    shades = colour(random.random((count, count), dtype=np.float32), palette)
    is_cream = (column + row) % 2 == 0
    picture = np.where(is_cream[..., None], np.float32([0.94, 0.9, 0.8]), shades[row, column])
    is_disc = is_cream & (np.hypot(x % 1 - 0.5, y % 1 - 0.5) < 0.2)
    picture = np.where(is_disc[..., None], 0.8 * shades[row, (column + 1) % count], picture)
    return finish(picture.astype(np.float32))


def make_sky(seed: int) -> Values:
    """Make the light from all around, (64, 128, 3) float32: bright above, warm at the horizon, dark below."""
    random = np.random.default_rng(seed)
    down = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[:, None], 128, axis=1)
    clouds = cv2.resize(noise(random, 4, 3, 128), (128, 64))
    clouds = cv2.GaussianBlur(np.hstack([clouds, clouds[:, ::-1]]), (0, 0), 2)[:, ::2]  # the ends meet
    sky = colour(down, "6f9be0 8fb4ea bcd0ec f6dcb8 5c4a40 3a3030")
    return (sky * (0.5 + 1.0 * clouds * (down < 0.55))[..., None]).astype(np.float32)
