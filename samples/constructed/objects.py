"""Things that move by themselves: balls, cut-outs that turn or grow, cans that spin, people, birds."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from .layers import Motion, Show, backdrop, pan, stack, wave
from .raster import Array, Raster, Texture, enlarge, lay_over, shift, turn
from .textures import (
    EARTH,
    EVENING,
    GARDEN,
    INDOORS,
    STREET,
    Random,
    cover,
    cutout,
    find_places,
    make_ball,
    make_surface,
    noise,
    read_colour,
    with_alpha,
    write_letters,
)

# ---------------------------------------------------------------------------------------------------------------- balls


def make_balls(random: Random, raster: Raster) -> Show:
    """Throw balls of several sizes in front of a still background, at 1 to 4 diameters a pair."""
    # size, diameters a pair, colour, height
    balls = [
        (8, 4, "f2f2ec", -90),
        (12, 3, "d9482b", -45),
        (18, 2, "e8c33a", 20),
        (26, 1, "3b6fb0", 75),
        (7, 2, "20242a", 110),
    ]
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, GARDEN), lambda _: shift(0, 0))]
    for i, (size, jump, paint, height) in enumerate(balls):
        speed = size * jump * (-1 if i % 2 else 1)

        def move(time: float, speed: float = speed, height: float = height) -> Array:
            return shift(speed * (time - 2), height + 6 * (time - 2) ** 2 - 14)

        layers.append((make_ball(raster.density, size, paint), move))
    return stack(raster, layers)


def make_balls_pan(random: Random, raster: Raster) -> Show:
    """Throw balls on curved paths in front of what pans."""
    # size, radius of the path, pairs for one round, phase in turns
    balls = [(10, 90, 20, 0.1), (14, 70, 12, 0.45), (20, 60, 12, 0.8), (32, 80, 17, 0.3), (9, 110, 26, 0.6)]
    paints = ["e9e4d8", "b8402f", "2f6d5c", "d7a13a", "f4f4f4"]
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, STREET), pan(-9, 2))]
    for (size, radius, period, phase), paint in zip(balls, paints, strict=True):

        def move(time: float, radius: float = radius, period: float = period, phase: float = phase) -> Array:
            x = 300 * (phase - 0.45) + 1.3 * radius * wave(time, period, phase)
            return shift(x, radius * wave(time, period, phase + 0.2))

        layers.append((make_ball(raster.density, size, paint, 0.12), move))
    return stack(raster, layers)


# ------------------------------------------------------------------------------------------------------------ turntable


def make_turning(random: Random, raster: Raster) -> Show:
    """Turn cut-outs by 10 to 20 degrees a pair, in front of what hardly moves."""
    # size, corners, degrees a pair, place
    shapes = [
        (120, 5, 10, -150, -50),
        (90, 0, -15, -20, 60),
        (70, 3, 20, 70, -70),
        (130, 6, -12, 160, 30),
        (60, 4, 18, -170, 85),
    ]
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, INDOORS), pan(0.6))]
    for size, corners, speed, x, y in shapes:

        def move(time: float, speed: float = speed, x: float = x, y: float = y) -> Array:
            return shift(x, y + 4 * wave(time, 6, x)) @ turn(speed * time)

        layers.append((cutout(random, size, raster.density, EARTH, corners), move))
    return stack(raster, layers)


def make_growing(random: Random, raster: Raster) -> Show:
    """Let cut-outs grow or shrink by 10 to 20 % a pair."""
    # size, corners, growth a pair, place
    shapes = [
        (70, 5, 1.2, -140, -30),
        (150, 0, 0.85, 30, 55),
        (60, 4, 1.15, 120, -60),
        (110, 6, 0.9, -10, -70),
        (50, 3, 1.1, 190, 60),
    ]
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, EVENING), pan(-2, 1))]
    for size, corners, factor, x, y in shapes:
        largest = size * max(factor**4.5, 1)  # drawn as large as it is ever shown

        def move(
            time: float, ratio: float = size / largest, factor: float = factor, x: float = x, y: float = y
        ) -> Array:
            return shift(x, y) @ enlarge(ratio * factor**time) @ turn(3 * time)

        layers.append((cutout(random, largest, raster.density, STREET, corners), move))
    return stack(raster, layers)


def spin_can(
    raster: Raster, label: Texture, radius: float, height: float, distance: float
) -> Callable[[float], Texture]:
    """Prepare an upright can round which a label is printed; called with degrees, it draws it, (H, W, 4).

    Each sample's ray from a camera at `distance` from the axis meets the cylinder where a quadratic equation says.
    """
    x, y = find_places((radius * 2.4, height * 1.3), raster.density)
    # the ray (x s, y s, distance (s - 1)): on the cylinder, x^2 s^2 + distance^2 (s - 1)^2 = radius^2
    a, b, c = x * x + distance**2, -2 * distance**2, distance**2 - radius**2
    root = b * b - 4 * a * c
    s = (-b - np.sqrt(np.maximum(root, 0))) / (2 * a)
    angle, along = np.arctan2(x * s, distance * (1 - s)), y * s
    edge = radius / math.sqrt(1 - (radius / distance) ** 2)  # where rays just touch it
    alpha = np.minimum(cover(edge - np.abs(x), raster.density), cover(height / 2 - np.abs(along), raster.density))
    light = (0.35 + 0.75 * np.maximum(np.cos(angle + 0.5), 0)) * alpha
    texels = (along * label.density + (label.pixels.shape[0] - 1) / 2).astype(np.float32)
    around = label.pixels.shape[1]

    def show(degrees: float) -> Texture:
        places = ((angle - math.radians(degrees)) / (2 * np.pi) % 1 * around).astype(np.float32)
        # the label closes: its first columns are repeated
        closed = np.concatenate([label.pixels[:, -2:], label.pixels, label.pixels[:, :3]], axis=1)
        seen = cv2.remap(closed, places + 2, texels, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return Texture(np.dstack([seen * light[..., None], alpha]).astype(np.float32), raster.density)

    return show


def make_label(random: Random, raster: Raster, radius: float, height: float, palette: list[str], ink: str) -> Texture:
    """Print a label with blotches, bands and letters, as long as the can is round."""
    extent = (2 * np.pi * radius, height)
    surface = make_surface(random, extent, raster.density, palette, 0.04)
    _, y = find_places(extent, raster.density)
    band = np.maximum(
        cover(3 - np.abs(y - height * 0.36), raster.density), cover(2 - np.abs(y + height * 0.4), raster.density)
    )
    surface = surface + band[..., None] * (read_colour(ink) - surface)
    for line, size in enumerate((height * 0.2, height * 0.09, height * 0.09)):
        letters = write_letters(random, raster.density, int(extent[0] / size / 0.8) - 2, size, ink).pixels
        top, left = int((0.2 + 0.25 * line) * surface.shape[0]), int(size * raster.density)
        part = surface[top : top + letters.shape[0], left : left + letters.shape[1]]
        lay_over(part, letters[: part.shape[0], : part.shape[1]])
    return Texture(np.ascontiguousarray(surface, np.float32), raster.density)


def make_cans(random: Random, raster: Raster) -> Show:
    """Spin printed cans of three sizes by 8 to 20 degrees a pair."""
    room = backdrop(random, raster, INDOORS, leaves=4, grain=0.06)
    cans = []
    for radius, height, speed, x, palette, ink in (
        (72, 170, 8, -130, ["a8312d", "c4463a"], "f3ead7"),
        (46, 130, -14, 40, ["e9e0c8", "f2ead6"], "2c4a6b"),
        (30, 80, 20, 155, ["2f5d43", "47805a", "3d6f50"], "f0d774"),
    ):
        label = make_label(random, raster, radius, height, palette, ink)
        cans.append((spin_can(raster, label, radius, height, 400), speed, x, 85 - height / 2 * 0.97))

    def show(time: float) -> Array:
        canvas = raster.fill(room, shift(0, 0))
        for can, speed, x, y in cans:
            raster.draw(canvas, can(speed * time + x), shift(x, y))
        return canvas

    return show


# --------------------------------------------------------------------------------------------------------------- crowds


def make_person(random: Random, density: float, tall: float) -> tuple[Texture, Texture]:
    """Draw a body with a head, and a limb."""
    x, y = find_places((tall * 0.5, tall), density)
    shirt, skin, hair = (read_colour(random.choice(choice)) for choice in PEOPLE)
    body = cover((1 - np.hypot(x / 0.17, (y + tall * 0.09) / 0.24) / tall) * tall * 0.17, density)
    head = cover(tall * 0.085 - np.hypot(x, y + tall * 0.38), density)
    fine = 1 + 0.12 * noise(random, (tall * 0.5, tall), density, coarse=tall / 4)
    stripes = 1 + 0.25 * np.sign(np.sin(y * 2 * np.pi / 4)) * (random.random() < 0.4)
    colours = shirt * (fine * stripes)[..., None]
    face = skin + rise_above(y, -tall * 0.4)[..., None] * (hair - skin)
    colours = colours + head[..., None] * (face - colours)
    both = Texture(with_alpha(np.clip(colours, 0, 1), np.maximum(body, head)), density)
    x, y = find_places((tall * 0.2, tall * 0.5), density)
    length = cover(tall * 0.05 - np.abs(x), density) * cover(tall * 0.22 - np.abs(y), density)
    trousers = read_colour(random.choice(["2b2f3a", "4a4038", "39424f", "6b6458"]))
    return both, Texture(with_alpha(np.broadcast_to(trousers, (*x.shape, 3)), length), density)


PEOPLE = (
    ["a33b32", "2f5f8a", "d8d2c4", "3d3d42", "c79a3b", "5a7a4a", "7a4a6a", "8a8f96"],
    ["e0b090", "c48f6a", "8a5a3c", "f0c8a8"],
    ["2a1d14", "5a3a20", "111111", "9a7a4a"],
)


def rise_above(y: Array, level: float) -> Array:
    """Give 1 above a level (y points down), else 0."""
    return (y < level).astype(np.float32)


def make_crowd(random: Random, raster: Raster) -> Show:
    """Let 46 people walk in both directions, with swinging limbs, over a square."""
    square = backdrop(random, raster, STREET, leaves=4, grain=0.06)
    people = []
    for depth in np.sort(random.random(46)):
        tall = 26 + 26 * depth
        walk = {
            "x": random.uniform(-270, 270),
            "y": -75 + 165 * depth,
            "speed": random.choice([-1, 1]) * random.uniform(0.12, 0.3) * tall,
            "phase": random.random(),
            "period": random.uniform(4.5, 8),
        }
        people.append((tall, make_person(random, raster.density, tall), walk))

    def show(time: float) -> Array:
        canvas = raster.fill(square, shift(0.8 * (time - 2), 0))
        for tall, (body, limb), walk in people:
            swing = wave(time, walk["period"], walk["phase"])
            x = walk["x"] + walk["speed"] * (time - 2) + 0.04 * tall * swing
            y = walk["y"] - 0.05 * tall * abs(swing)
            place = shift(x, y) @ turn(4 * swing)
            for side in (-1, 1):
                leg = place @ shift(side * tall * 0.05, tall * 0.12) @ turn(28 * side * swing) @ shift(0, tall * 0.2)
                raster.draw(canvas, limb, leg)
            raster.draw(canvas, body, place)
            for side in (-1, 1):
                arm = place @ shift(side * tall * 0.15, -tall * 0.22) @ turn(-34 * side * swing) @ shift(0, tall * 0.12)
                raster.draw(canvas, limb, arm @ enlarge(0.7))
        return canvas

    return show


def make_bird(random: Random, density: float, size: float) -> tuple[Texture, Texture]:
    """Draw a bird's body as seen from below, and one of its wings."""
    tone = read_colour(random.choice(["2a2c30", "4a4640", "8a8478", "d8d4ca", "6a5a4c"]))
    x, y = find_places((size, size * 1.2), density)
    shade = 1 + 0.1 * noise(random, (size, size * 1.2), density, coarse=size / 3)
    body = cover((1 - np.hypot(x / 0.16, y / 0.5) / size) * size * 0.16, density)
    colours = np.clip(tone * shade[..., None], 0, 1)
    wing = cover(np.minimum(size * 0.14 - np.abs(y - 0.2 * np.abs(x)), size * 0.46 - np.abs(x)), density)
    return Texture(with_alpha(colours, body), density), Texture(with_alpha(colours * 0.85, wing), density)


def make_flock(random: Random, raster: Raster) -> Show:
    """Let 70 birds wheel and flap in front of a sky with soft clouds."""
    sky = scenery_of_sky(random, raster)
    birds = []
    for _ in range(70):
        size = random.uniform(7, 20)
        orbit = random.uniform([-200, -100, 20, 12], [200, 100, 90, 40])  # middle, radius, period
        birds.append((make_bird(random, raster.density, size), size, orbit, random.random(2), random.choice([-1, 1])))

    def show(time: float) -> Array:
        canvas = raster.fill(sky, shift(1.5 * (time - 2), 0.5 * time))
        for (body, wing), size, (x, y, radius, period), (phase, beat), way in birds:
            angle = 2 * np.pi * (way * time / period + phase)
            place = shift(x + radius * math.cos(angle), y + 0.6 * radius * math.sin(angle))
            place = place @ turn(math.degrees(angle) + (180 if way > 0 else 0))
            flap = 0.65 + 0.35 * wave(time, 1.7 + size / 10, beat)
            raster.draw(canvas, wing, place @ shift(0, -0.08 * size) @ enlarge(2 * flap, 1))
            raster.draw(canvas, body, place)
        return canvas

    return show


def scenery_of_sky(random: Random, raster: Raster) -> Texture:
    """Draw a nearly flat sky."""
    extent = (raster.extent[0] + 60, raster.extent[1] + 60)
    clouds = noise(random, extent, raster.density, coarse=130, fall=0.5)
    _, y = find_places(extent, raster.density)
    tone = np.clip(0.55 + 0.0012 * y + 0.05 * clouds, 0, 1)[..., None]
    return Texture(np.clip(tone * np.array([0.95, 1.05, 1.2], np.float32), 0, 1).astype(np.float32), raster.density)
