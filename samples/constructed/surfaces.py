"""Large surfaces: faces and cloth that deform, hand-held cameras, titles, reflections, and light that changes."""

from __future__ import annotations

import math

import numpy as np

from .layers import Show, backdrop, pan, stack, wave
from .raster import Array, Raster, Texture, enlarge, find_places, shift, tilt, turn
from .textures import (
    EARTH,
    EVENING,
    GARDEN,
    INDOORS,
    STREET,
    Random,
    cover,
    make_surface,
    noise,
    read_colour,
    rise,
    with_alpha,
    write_letters,
)

# -------------------------------------------------------------------------------------------------- deforming surfaces


def pulse(time: float, middle: float, length: float) -> float:
    """Rise from 0 to 1 and fall again around a time."""
    return math.exp(-(((time - middle) / length) ** 2))


def bulge(x: Array, y: Array, bumps: list[tuple[float, float, float, float, float]]) -> tuple[Array, Array]:
    """Add up smooth displacements: each has a middle, a radius, and how far it moves to the right and down."""
    dx, dy = np.zeros_like(x), np.zeros_like(y)
    for middle_x, middle_y, radius, right, down in bumps:
        weight = np.exp(-((x - middle_x) ** 2 + (y - middle_y) ** 2) / radius**2)
        dx, dy = dx + right * weight, dy + down * weight
    return dx, dy


def blend_in(canvas: Array, share: Array, paint: Array) -> Array:
    """Paint over a canvas, in place, where `share` says how much."""
    canvas += share[..., None] * (paint - canvas)
    return canvas


def make_head(random: Random, raster: Raster) -> Texture:
    """Draw a large face: skin with freckles and shading, brows, a nose, lips, and eyes that are open."""
    extent = (raster.extent[0] + 60, raster.extent[1] + 60)
    density = raster.density
    x, y = find_places(extent, density)
    skin = make_surface(random, extent, density, ["b98466", "cf9a7a", "deb193"], 0.025)
    freckles = rise(noise(random, extent, density, coarse=7, fine=2), 1.6, 2.3) * 0.25
    skin *= (1 - freckles)[..., None] * (1 - 0.0011 * x)[..., None]
    for side in (-1, 1):
        eye = cover((1 - np.hypot((x - side * 62) / 30, (y + 30) / 13)) * 14, density)
        blend_in(skin, eye, read_colour("efe9e2"))
        away = np.hypot(x - side * 62, y + 30)
        streaks = 1 + 0.25 * np.sin(23 * np.arctan2(y + 30, x - side * 62))
        blend_in(skin, eye * cover(11 - away, density), read_colour("4a6a5a") * streaks[..., None])
        blend_in(skin, eye * cover(5 - away, density), read_colour("0c0c0e"))
        brow = cover(4 - np.abs(y + 62 + 0.004 * (x - side * 62) ** 2), density) * cover(
            36 - np.abs(x - side * 62), density
        )
        hairs = 0.6 + 0.4 * np.sin(2.2 * x + 0.7 * y * side)
        blend_in(skin, brow * hairs.astype(np.float32), read_colour("3a2618"))
        blend_in(
            skin, 0.5 * cover((1 - np.hypot((x - side * 11) / 6, (y - 32) / 4)) * 4, density), read_colour("5a2f22")
        )
    lips = cover((1 - np.hypot(x / 48, (y - 78) / 13)) * 13, density)
    blend_in(skin, 0.8 * lips, read_colour("a8544e") * (1 + 0.1 * np.sin(1.1 * x))[..., None])
    blend_in(skin, 0.8 * lips * cover(1.2 - np.abs(y - 77 - 3 * np.cos(x / 14)), density), read_colour("4a1c1c"))
    outside = rise(np.hypot(x / 225, y / 185), 0.93, 0.97)
    hair = make_surface(random, extent, density, ["20140c", "3c2616", "5c3d22"], 0.3)
    return Texture(np.clip(blend_in(skin, outside, hair), 0, 1).astype(np.float32), density)


def make_face(random: Random, raster: Raster) -> Show:
    """Show a face that fills the frame: it nods a little, the mouth moves, and the eyes blink twice."""
    head = make_head(random, raster)
    x, y = raster.places

    def show(time: float) -> Array:
        dx, dy = 2.2 * wave(time, 7), 1.5 * wave(time, 5, 0.2)
        turned_x, turned_y = x - dx, y - dy
        mouth, cheek = 5 * wave(time, 6.3, 0.1), 2.5 * wave(time, 5.1)
        bumps = [
            (0, 96, 34, 0, mouth),
            (0, 62, 26, 0, -0.3 * mouth),
            (-80, 40, 40, -cheek, -cheek),
            (85, 40, 45, cheek, -cheek),
        ]
        bent_x, bent_y = bulge(turned_x, turned_y, [*bumps, (0, -75, 70, 0, 2 * wave(time, 6))])
        canvas = raster.look_up(head, turned_x - bent_x, turned_y - bent_y)
        closed = max(pulse(time, 1.2, 0.5), pulse(time, 3.1, 0.4), pulse(time, 7.3, 0.5))
        for side in (-1, 1):
            ex, ey = turned_x - side * 62, turned_y + 30
            # the lid comes down from the upper rim of the eye
            half = 13.5 * np.sqrt(np.maximum(1 - (ex / 30.5) ** 2, 0))
            lid = np.minimum(half - np.abs(ey), -half + 2 * half * closed - ey)
            tone = read_colour("c08c6e") * (1 - 0.012 * (ey + 13))[..., None]
            blend_in(canvas, cover(lid, raster.density), tone)
            lash = cover(1 - np.abs(ey + half - 2 * half * closed), raster.density) * (half > 2)
            blend_in(canvas, 0.8 * lash, read_colour("2a1a12"))
        return canvas

    return show


def make_cloth(random: Random, raster: Raster) -> Show:
    """Let cloth with a print breathe and ripple by up to 5 units, while small lamps on it light up for a moment."""
    extent = (raster.extent[0] + 60, raster.extent[1] + 60)
    base = make_surface(random, extent, raster.density, ["3d4a5e", "55657a", "6d7d90"], 0.05)
    u, v = find_places(extent, raster.density)
    weave = 1 + 0.05 * np.sin(2 * np.pi * u / 3.5) * np.sin(2 * np.pi * v / 3.5)
    base *= weave[..., None]
    for _ in range(26):
        place, size = random.uniform([-260, -150], [260, 150]), random.uniform(5, 20)
        spot = cover((1 - np.hypot((u - place[0]) / size, (v - place[1]) / (0.6 * size))) * size * 0.6, raster.density)
        blend_in(base, 0.7 * spot, read_colour(random.choice(["c9b07a", "a8584a", "d8d4c8"])))
    cloth = Texture(np.clip(base, 0, 1).astype(np.float32), raster.density)
    x, y = raster.places
    places = [
        (random.uniform([-220, -120, 30], [220, 120, 90]), random.uniform(4, 9), random.random()) for _ in range(9)
    ]
    lamps = [(random.uniform([-200, -110], [200, 110]), 0.6 + 0.55 * i) for i in range(8)]

    def show(time: float) -> Array:
        bumps = []
        for (left, top, radius), period, phase in places:
            bumps.append((left, top, radius, 5 * wave(time, period, phase), 5 * wave(time, period * 1.3, phase + 0.3)))
        dx, dy = bulge(x, y, bumps)
        canvas = raster.look_up(cloth, x - dx, y - dy)
        canvas *= (1 + 0.012 * dx - 0.02 * dy)[..., None]
        for (left, top), middle in lamps:
            lamp = cover(4.5 - np.hypot(x - dx - left, y - dy - top), raster.density)
            glow = 0.15 + 0.85 * pulse(time, middle, 0.45)
            blend_in(canvas, lamp, glow * np.array([1, 0.85, 0.5], np.float32) + (1 - glow) * read_colour("30241c"))
        return canvas

    return show


# ------------------------------------------------------------------------------------------------------------ hand-held


def make_handheld(random: Random, raster: Raster, *, reach: float) -> Show:
    """Hold a camera by hand: shifts of up to about `reach` units on curved paths, some tilt, turn and zoom."""
    still = backdrop(random, raster, STREET if reach > 2 else INDOORS, more=(160, 120), leaves=5)
    random_phases = random.random(12)

    def shake(time: float, index: int) -> float:
        phases = random_phases[2 * index : 2 * index + 2]
        return 0.9 * wave(time, 7 + 0.7 * index, phases[0]) + 0.1 * wave(time, 2.5 + 0.3 * index, phases[1])

    def move(time: float) -> Array:
        zoom = 1.02 + 0.004 * reach * shake(time, 2)
        lean = tilt(0.35 * reach * shake(time, 3), 0.3 * reach * shake(time, 4))
        return (
            shift(reach * shake(time, 0), reach * shake(time, 1))
            @ turn(0.25 * reach * shake(time, 5))
            @ lean
            @ enlarge(zoom)
        )

    return stack(raster, [(still, move)])


# ------------------------------------------------------------------------------------------------------------- overlays


def make_titles(random: Random, raster: Raster) -> Show:
    """Lay a still logo and a title, and a ticker that scrolls, over what pans."""
    behind, density = backdrop(random, raster, GARDEN), raster.density
    x, y = find_places((50, 50), density)
    away = np.hypot(x, y)
    ring = np.maximum(cover(3 - np.abs(away - 19), density), cover(9 - np.abs(x) - np.abs(y), density))
    logo = Texture(with_alpha(np.broadcast_to(read_colour("f4f4f4"), (*x.shape, 3)), ring), density)
    title = write_letters(random, density, 13, 22, "ffe9a8", 0.16)
    news = write_letters(random, density, 110, 12, "f2f2f2", 0.14)
    bottom = raster.extent[1] / 2

    def show(time: float) -> Array:
        canvas = raster.fill(behind, shift(9 * (time - 2), 3 * (time - 2)))
        raster.draw(canvas, logo, shift(200, 32 - bottom), 0.75)
        raster.draw(canvas, title, shift(-80, bottom - 52))
        band = cover(11 - np.abs(raster.places[1] - (bottom - 20)), density)
        blend_in(canvas, 0.85 * band, read_colour("14233f"))
        raster.draw(canvas, news, shift(90 - 18 * time, bottom - 20))
        return canvas

    return show


def make_reflection(random: Random, raster: Raster) -> Show:
    """Look through a pane of glass: what is behind pans one way, what it reflects the other way and zooms."""
    behind, front = backdrop(random, raster, EARTH), backdrop(random, raster, STREET, leaves=4, grain=0.06)

    def show(time: float) -> Array:
        mirrored = raster.fill(front, shift(-7 * (time - 2), 4 * wave(time, 6)) @ enlarge(1.05 + 0.01 * time))
        canvas = 0.72 * raster.fill(behind, shift(5 * (time - 2), 1.5 * (time - 2))) + 0.3 * mirrored
        return np.asarray(canvas)

    return show


# ------------------------------------------------------------------------------------------------------------- lighting


def make_dimming(random: Random, raster: Raster) -> Show:
    """Pan while the light goes down by 6 % a pair."""
    room = stack(raster, [(backdrop(random, raster, INDOORS), pan(8, -2))])
    return lambda time: room(time) * (1.1 * 0.94**time)


def make_sunrise(random: Random, raster: Raster) -> Show:
    """Zoom slowly while a soft patch of warm light wanders over the scene and grows brighter."""
    extent = raster.extent
    land = stack(raster, [(backdrop(random, raster, EVENING), lambda t: shift(-5 * (t - 2), 0) @ enlarge(1.015**t))])
    x, y = raster.places
    warm = np.array([1.0, 0.85, 0.6], np.float32)

    def show(time: float) -> Array:
        away = np.hypot(x - 14 * (time - 2), (y + extent[1] / 5) * 1.3)
        patch = (0.25 + 0.1 * time) * np.exp(-((away / 150) ** 2))
        return land(time) * (0.8 + patch[..., None] * warm)

    return show
