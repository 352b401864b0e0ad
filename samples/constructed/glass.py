"""Glass and gloss, what is out of focus, boxes with vents, blades that whirl, and what enters or leaves the frame."""

from __future__ import annotations

import math

import cv2
import numpy as np

from .layers import Motion, Show, backdrop, pan, stack, wave
from .raster import Array, Raster, Texture, enlarge, find_places, shift, turn
from .textures import (
    EARTH,
    EVENING,
    GARDEN,
    INDOORS,
    STREET,
    Random,
    cover,
    cutout,
    make_ball,
    make_surface,
    paint_slats,
    pattern,
    read_colour,
    rise,
    with_alpha,
)

LAMPS = ["ffd9a0", "f2f0e6", "9fc4e8", "e87a5a"]


def drift(x: float, y: float, right: float, down: float = 0, spin: float = 0) -> Motion:
    """Move past a place at time 2, by so many units a pair, and turn by so many degrees."""
    return lambda time: shift(x + right * (time - 2), y + down * (time - 2)) @ turn(spin * (time - 2))


# ---------------------------------------------------------------------------------------------------- glass and gloss


def blend(canvas: Array, share: Array, paint: Array | float) -> None:
    """Paint over a canvas, in place, where `share` says how much."""
    canvas += share[..., None] * (paint - canvas)


def make_lenses(random: Random, raster: Raster) -> Show:
    """Move solid balls of glass: in each, what is behind stands on its head, with a still highlight and a dark rim."""
    behind, (x, y) = backdrop(random, raster, EARTH), raster.places
    balls = [(random.uniform(-200, 200), random.uniform(-90, 90), random.uniform(22, 55)) for _ in range(5)]
    paths = [(random.uniform(-14, 14), random.uniform(-6, 6), random.uniform(4, 9), random.random()) for _ in balls]

    def show(time: float) -> Array:
        gone_x, gone_y = 4 * (time - 2), -1.5 * (time - 2)
        canvas = raster.look_up(behind, x - gone_x, y - gone_y)
        for (left, top, radius), (right, down, period, phase) in zip(balls, paths, strict=True):
            dx = x - left - right * (time - 2) - 4 * wave(time, period, phase)
            dy = y - top - down * (time - 2)
            away = np.hypot(dx, dy) / radius
            bent = -0.9 - 1.6 * np.clip(away, 0, 1) ** 4
            inside = cover((1 - away) * radius, raster.density)
            seen = raster.look_up(behind, x - dx + bent * dx - gone_x, y - dy + bent * dy - gone_y)
            seen = seen * (1 - 0.7 * rise(away, 0.75, 1.0))[..., None] * np.array([0.9, 0.97, 0.94], np.float32)
            shine = cover((0.16 - np.hypot(dx / radius + 0.4, dy / radius + 0.45)) * radius, raster.density)
            blend(seen, 0.9 * shine, 1.0)
            blend(canvas, inside, seen)
        return canvas

    return show


def make_prism(random: Random, raster: Raster) -> Show:
    """Turn cut glass: each of its facets shows another part of what is behind, moving in a direction of its own."""
    behind, (x, y) = backdrop(random, raster, STREET), raster.places
    facets = 7
    tilts = random.uniform(-28, 28, (2, facets, 2))

    def show(time: float) -> Array:
        gone = 3 * (time - 2)
        canvas = raster.look_up(behind, x - gone, y)
        for side, (left, top, radius, speed) in enumerate(((-95, 10, 88, 9), (120, -15, 62, -15))):
            angle = math.radians(speed * time)
            dx, dy = x - left - (5 - 9 * side) * (time - 2), y - top - 2 * wave(time, 6)
            along = (np.arctan2(dy, dx) - angle) / (2 * np.pi) * facets % facets
            number = along.astype(int) % facets
            within = (along - number - 0.5) * 2 * np.pi / facets
            edge = radius * math.cos(math.pi / facets) - np.hypot(dx, dy) * np.cos(within)
            cos, sin = math.cos(angle), math.sin(angle)
            lean = tilts[side][number]
            lean_x, lean_y = lean[..., 0] * cos - lean[..., 1] * sin, lean[..., 0] * sin + lean[..., 1] * cos
            table = edge > 0.55 * radius
            zoom = np.where(table, 0.7, 0.85)
            seen = raster.look_up(
                behind,
                x - dx + zoom * dx + np.where(table, 0, lean_x) - gone,
                y - dy + zoom * dy + np.where(table, 0, lean_y),
            )
            lit = 0.85 + 0.25 * np.where(table, 0, np.sin(2 * np.pi * (number / facets) + angle + side))
            seen = np.clip(seen * lit[..., None], 0, 1)
            seams = cover(1.2 - np.abs(np.hypot(dx, dy) * np.sin(np.abs(within) - np.pi / facets)), raster.density)
            blend(seen, 0.5 * seams * ~table, 0.95)
            blend(seen, 0.6 * cover(1.0 - np.abs(edge - 0.55 * radius), raster.density), 0.95)
            blend(canvas, cover(edge, raster.density), seen)
        return canvas

    return show


def make_tumblers(random: Random, raster: Raster) -> Show:
    """Move drinking glasses in front of a table: clear walls, dark rims, a drink inside; one leaves, one enters."""
    behind, (x, y) = backdrop(random, raster, INDOORS, leaves=4, grain=0.06), raster.places
    glasses = [(-215, 5, 34, 62, -16), (-20, 20, 44, 74, 7), (150, 0, 30, 56, -9), (275, 15, 38, 66, -20)]
    drinks = [read_colour(text) for text in ("3a1206", "b0761c", "d8d6c8", "5a0c14")]

    def show(time: float) -> Array:
        gone = -2 * (time - 2)
        canvas = raster.look_up(behind, x - gone, y)
        for (left, top, half, tall, speed), drink in zip(glasses, drinks, strict=True):
            dx, dy = x - left - speed * (time - 2), y - top
            wide = half * (1 - 0.0022 * (dy + tall))
            edge = np.minimum(wide - np.abs(dx), tall - np.abs(dy))
            across = np.clip(dx / wide, -1, 1)
            shadow = np.exp(-((dx / (1.6 * half)) ** 2) - ((dy - tall) / 14) ** 2)
            canvas *= (1 - 0.45 * shadow)[..., None]
            seen = raster.look_up(behind, x - 0.55 * half * across**3 - gone, y)
            level = dy - tall * (-0.1 + 0.02 * wave(time, 3)) - 0.05 * dx * wave(time, 4, 0.2)
            drunk = cover(np.minimum(level, wide - 4 - np.abs(dx)), raster.density)
            blend(seen, 0.82 * drunk, drink * (1.1 - 0.5 * across**2)[..., None])
            blend(seen, 0.7 * rise(np.abs(across), 0.86, 0.99), 0.12)
            blend(seen, 0.75 * cover(2.2 - np.abs(dx + 0.6 * half), raster.density), 1.0)
            ring = np.abs(np.hypot(dx, (dy + tall) * half / 9) - half)
            blend(canvas, cover(edge, raster.density), seen)
            blend(canvas, 0.8 * cover(1.6 - ring * 9 / half, raster.density), 0.2)
        return canvas

    return show


def make_gloss(random: Random, raster: Raster) -> Show:
    """Spin glossy balls and roll a glossy floor: what they mirror stays behind while the print on them moves."""
    floor, mirrored = backdrop(random, raster, EARTH, leaves=3), backdrop(random, raster, EVENING, leaves=5)
    extent, (x, y) = (700.0, 300.0), raster.places
    prints = [
        Texture(make_surface(random, extent, raster.density, paint, 0.2), raster.density) for paint in (STREET, GARDEN)
    ]
    lamps = random.uniform([-0.5, -0.6], [0.5, 0.0], (4, 2))

    def show(time: float) -> Array:
        canvas = 0.75 * raster.look_up(floor, x - 6 * (time - 2), y)
        canvas += 0.3 * raster.look_up(mirrored, x - 1.5 * (time - 2), -y)
        for i, (left, top, radius, speed) in enumerate(((-120, -20, 75, 11), (110, 15, 95, -7))):
            dx, dy = x - left - (4 - 7 * i) * (time - 2), y - top
            across, down = np.clip(dx / radius, -1, 1), np.clip(dy / radius, -1, 1)
            up = np.sqrt(np.maximum(1 - across**2 - down**2, 0))
            seen = raster.look_up(
                prints[i], radius * np.arctan2(across, up + 0.05) - speed * (time - 2), radius * np.arcsin(down)
            )
            seen = seen * (0.35 + 0.55 * up)[..., None]
            grazing = 0.12 + 0.6 * (1 - up) ** 3
            seen += grazing[..., None] * raster.look_up(mirrored, 260 * across * up + left, 200 * down * up)
            for lamp in lamps:
                blend(seen, 0.9 * rise(-np.hypot(across - lamp[0], down - lamp[1]), -0.11, -0.06), 1.0)
            blend(canvas, cover(radius - np.hypot(dx, dy), raster.density), np.clip(seen, 0, 1))
        return np.asarray(canvas)

    return show


# -------------------------------------------------------------------------------------------------------- out of focus


def unfocused(texture: Texture, radius: float) -> Texture:
    """Spread each point of a texture over a disc of a radius in units, as a lens does that is focused elsewhere."""
    size = 2 * round(radius * texture.density) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)).astype(np.float32)
    grown = texture.pixels
    if texture.has_alpha:
        grown = cv2.copyMakeBorder(grown, size, size, size, size, cv2.BORDER_CONSTANT)
    return Texture(cv2.filter2D(grown, -1, disc / disc.sum(), borderType=cv2.BORDER_REFLECT_101), texture.density)


def make_defocus(random: Random, raster: Raster) -> Show:
    """Pass sharp things in front of what is out of focus, and behind large soft things that pass faster."""
    layers: list[tuple[Texture, Motion]] = [(unfocused(backdrop(random, raster, EVENING), 5), pan(-4, 1))]
    for _ in range(6):
        lamp = make_ball(raster.density, random.uniform(12, 30), random.choice(LAMPS), 0)
        dimmed = Texture(lamp.pixels * np.float32(0.6), lamp.density)
        x, y = random.uniform([-220, -110], [220, 20])
        layers.append((dimmed, drift(x, y, -5)))
    for _ in range(5):
        x, y, speed = random.uniform([-200, -80, -13], [200, 80, 13])
        size, corners = random.uniform(50, 110), int(random.integers(0, 7)) // 3 * 3
        layers.append((cutout(random, size, raster.density, INDOORS, corners), drift(x, y, speed, spin=0.4 * speed)))
    for _ in range(3):
        x, y, speed = random.uniform([-220, -110, 18], [220, 110, 42])
        leaf = unfocused(cutout(random, random.uniform(70, 130), raster.density, GARDEN, 3), random.uniform(4, 9))
        layers.append((leaf, drift(x, y, speed, -0.2 * speed)))
    return stack(raster, layers)


# --------------------------------------------------------------------------------------------- boxes, blades, borders


def face_in_space(middle: tuple[float, float, float], across: Array, down: Array, distance: float = 600) -> Array:
    """Make the matrix of a plane in space, by its middle and where its axes point, seen from a distance in units."""
    matrix = np.stack([across, down, np.asarray(middle, float)], axis=1)
    matrix[2] = matrix[2] / distance + (0, 0, 1)
    return matrix


def make_vents(random: Random, raster: Raster) -> Show:
    """Turn a box with equal slots on one side and a pane on another, in front of a still wall."""
    wall = backdrop(random, raster, INDOORS, leaves=0.6, grain=0.03)
    wide, tall, deep = 150.0, 190.0, 90.0
    density = raster.density
    x, y = find_places((wide, tall), density)
    pane = cutout(random, 3 * tall, density, STREET, 4).pixels
    rows, columns = x.shape
    top, left = (pane.shape[0] - rows) // 2, (pane.shape[1] - columns) // 2
    inner = pane[top : top + rows, left : left + columns, :3] * 0.8
    frame = rise(np.maximum(np.abs(x) / wide, np.abs(y) / tall), 0.42, 0.43)[..., None]
    front = Texture(with_alpha(inner + frame * (0.78 - inner), np.ones_like(x)), density)
    side_x, side_y = find_places((deep, tall), density)
    shell = make_surface(random, (deep, tall), density, ["b9b9b5", "c6c6c2", "d0d0cc"], 0.02)
    slots = cover(np.minimum(1.3 - np.abs((side_y + 0.35 * side_x) % 6 - 3), 26 - np.abs(side_x)), density)
    shell *= (1 - 0.85 * slots)[..., None]
    glow = rise(-np.abs(side_x - 30), -4, -1)[..., None] * np.array([0.5, 0.1, 0.7], np.float32)
    side = Texture(with_alpha(np.clip(shell + glow, 0, 1), np.ones_like(side_x)), density)

    def show(time: float) -> Array:
        canvas = raster.fill(wall, shift(0, 0))
        angle = math.radians(38 + 7 * (time - 2))
        ahead, aside = np.array([math.cos(angle), 0, math.sin(angle)]), np.array([-math.sin(angle), 0, math.cos(angle)])
        down, place = np.array([0.0, 1, 0]), np.array([10 * wave(time, 9), 5, 40.0])
        raster.draw(canvas, front, face_in_space(place - deep / 2 * aside, ahead, down))
        raster.draw(canvas, side, face_in_space(place + wide / 2 * ahead, aside, down))
        return canvas

    return show


def make_blades(random: Random, raster: Raster) -> Show:
    """Whirl blades by 20 to 50 degrees a pair, with motion blur, in front of what pans."""
    behind = backdrop(random, raster, EARTH, leaves=3)
    rotors = []
    for x, y, size, number, speed in ((-110, -10, 190, 3, 21), (115, 25, 130, 5, -34), (40, -80, 70, 2, 52)):
        dx, dy = find_places((size, size), raster.density)
        away, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
        swept = np.abs(((angle + 0.006 * away) * number / (2 * np.pi)) % 1 - 0.5) * 2 * np.pi / number
        blade = np.minimum(0.035 * size + 0.05 * away - away * swept, size / 2 - 2 - away)
        worn = make_surface(random, (size, size), raster.density, ["2e3236", "70757a", "c8c4b4"], 0.08)
        hub = 0.07 * size - away
        rotor = Texture(with_alpha(worn, cover(np.maximum(blade, hub), raster.density)), raster.density)
        rotors.append((rotor, drift(x, y, 4, spin=speed)))
    return stack(raster, [(behind, pan(-5, 2)), *rotors])


def make_borders(random: Random, raster: Raster) -> Show:
    """Let large things enter and leave at all four borders, 15 to 45 units a pair, over what hardly moves."""
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, INDOORS, leaves=2, grain=0.05), pan(1, 0.5))]
    tall = raster.extent[1]
    for i, (x, y) in enumerate(((-230, -60), (235, 40), (-90, -tall / 2), (80, tall / 2), (225, -90), (-235, 95))):
        size, palette = random.uniform(45, 120), (STREET, GARDEN, EARTH)[i % 3]
        thing = cutout(random, size, raster.density, palette, (0, 5, 4)[i % 3])
        speed, early = random.uniform(15, 45) * random.choice([-1, 1]), random.uniform(-1, 1)
        right, down = (speed, 3) if abs(x) > 200 else (4, speed)
        layers.append((thing, drift(x + right * early, y + down * early, right, down)))
    return stack(raster, layers)


def make_blind(random: Random, raster: Raster) -> Show:
    """Look through a blind of equal slats that sways and grows, at people-sized things that move behind."""
    slats = paint_slats(16, 0.55, ["d9d2c4", "efeae0"], rails=80)
    blind = pattern(random, (620, 420), raster.density, slats, "box", (300, 200))
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, GARDEN), pan(-3))]
    for _ in range(3):
        card = cutout(random, random.uniform(60, 120), raster.density, STREET, int(random.choice([0, 4, 6])))
        x, y, speed = random.uniform([-180, -60, -18], [180, 60, 18])
        layers.append((card, drift(x, y, speed, spin=speed)))
    layers.append((blind, lambda t: shift(5 * (t - 2) + 2 * wave(t, 5), 0) @ turn(90 + 1.5 * t) @ enlarge(1.02**t)))
    return stack(raster, layers)
