"""Layers at different distances: posts and trees that pass, thin things in front of what moves."""

from __future__ import annotations

import math

import numpy as np

from .layers import Motion, Show, backdrop, pan, stack, wave
from .raster import Array, Raster, Texture, enlarge, find_places, shift, to_bytes, to_floats, turn
from .textures import (
    EARTH,
    EVENING,
    GARDEN,
    INDOORS,
    STREET,
    Random,
    colour,
    cover,
    make_surface,
    noise,
    read_colour,
    scenery,
    with_alpha,
)

# ------------------------------------------------------------------------------------------------------------ occlusion


def make_post(random: Random, raster: Raster, wide: float, palette: list[str]) -> Texture:
    """Draw a post or a trunk, taller than the frame, with slightly uneven edges."""
    extent = (wide * 1.4, raster.extent[1] * 1.4)
    x, _ = find_places(extent, raster.density)
    ragged = 0.03 * wide * noise(random, extent, raster.density, coarse=40, fine=5)
    surface = make_surface(random, extent, raster.density, palette, 0.12)
    light = 0.8 - 0.5 * x / wide
    alpha = cover(wide / 2 + ragged - np.abs(x), raster.density)
    return Texture(with_alpha(np.clip(surface * light[..., None], 0, 1), alpha), raster.density)


def make_crown(random: Random, raster: Raster, size: float) -> Texture:
    """Draw leaves with ragged gaps between."""
    extent = (size, size * 0.8)
    x, y = find_places(extent, raster.density)
    round_ = 1 - np.hypot(x / extent[0], y / extent[1]) * 2
    dense = round_ * 2.2 + 0.55 * noise(random, extent, raster.density, coarse=size / 5, fine=2.5)
    leaves = scenery(random, extent, raster.density, GARDEN, leaves=25, grain=0.2).pixels
    return Texture(with_alpha(leaves, cover((dense - 0.5) * 6, raster.density)), raster.density)


def make_skyline(random: Random, raster: Raster, wide: float) -> Texture:
    """Draw a row of houses with windows, side by side, and sky (nothing) above them."""
    extent = (wide, 190.0)
    x, y = find_places(extent, raster.density)
    colours, alpha = np.zeros((*x.shape, 3), np.float32), np.zeros_like(x)
    left = -wide / 2
    while left < wide / 2:
        house, tall = random.uniform(36, 80), random.uniform(60, 170)
        inside = np.minimum(np.minimum(x - left, left + house - x), y - (95 - tall))
        part = cover(inside, raster.density)[..., None]
        cell = random.uniform(9, 15)
        window = np.minimum(cell * 0.28 - np.abs((x - left) % cell - cell / 2), 4 - np.abs(y % 13 - 6.5))
        pane = (cover(window, raster.density) * cover(inside - 4, raster.density))[..., None]
        wall = read_colour(random.choice(STREET[1:])) * random.uniform(0.8, 1.1)
        face = wall + pane * (read_colour(random.choice(["20262c", "3c4a55", "c8b070"])) - wall)
        colours, alpha = colours + part * (face - colours), np.maximum(alpha, part[..., 0])
        left += house + random.choice([0, 0, 14])
    stains = 1 + 0.07 * noise(random, extent, raster.density, coarse=50)
    return Texture(with_alpha(np.clip(colours * stains[..., None], 0, 1), alpha), raster.density)


def make_posts(random: Random, raster: Raster) -> Show:
    """Pan past a far hill, houses and near posts, 6, 15 and 44 units a pair."""
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, GARDEN, leaves=4), pan(-6))]
    houses = make_skyline(random, raster, 700)
    layers.append((houses, lambda t: shift(-15 * (t - 2), 45)))
    for x, wide in ((-250, 16), (-95, 24), (70, 12), (175, 30), (300, 18)):
        post = make_post(random, raster, wide, ["3a3129", "5e5347", "8a7d6c"])
        layers.append((post, lambda t, x=x: shift(x - 44 * (t - 2), 0) @ turn(2)))
    return stack(raster, layers)


def make_trees(random: Random, raster: Raster) -> Show:
    """Pan past trees, 9, 20 and 56 units a pair on a path that is curved a little."""
    layers: list[tuple[Texture, Motion]] = [(backdrop(random, raster, EVENING, leaves=4), pan(9, 0.5))]
    for plane, speed, size in ((0, 20, 110), (1, 56, 190)):
        for x in np.arange(-2, 3) * (150 + 130 * plane) + random.uniform(-50, 50, 5):

            def move(time: float, x: float = x, speed: float = speed, y: float = 60 * plane) -> Array:
                return shift(x + speed * (time - 2), y + 0.08 * speed * wave(time, 5))

            layers.append((make_post(random, raster, 0.1 * size, ["2b241d", "4a3d30", "6b5a45"]), move))
            crown = make_crown(random, raster, size)
            layers.append((crown, lambda t, move=move, up=0.42 * size + 50 * plane: move(t) @ shift(0, -up)))
    return stack(raster, layers)


def make_doorway(random: Random, raster: Raster) -> Show:
    """Walk through an opening with ragged leaves round it: it grows by 12 % a pair, what is behind by 3 %."""
    extent = (900.0, 620.0)
    x, y = find_places(extent, raster.density)
    edge = np.hypot(x / 190, y / 105) - 1 + 0.16 * noise(random, extent, raster.density, coarse=60, fine=2.5, fall=0.65)
    leaves = scenery(random, extent, raster.density, GARDEN, leaves=6, grain=0.2).pixels
    opening = Texture(with_alpha(leaves * 0.8, cover(edge * 60, raster.density)), raster.density)
    room = backdrop(random, raster, STREET)
    near, far = (lambda t: shift(4 * t, 0) @ enlarge(0.8 * 1.12**t)), (lambda t: shift(2 * t, 1 * t) @ enlarge(1.03**t))
    return stack(raster, [(room, far), (opening, near)])


# ---------------------------------------------------------------------------------------------------------- thin things


def make_hair(random: Random, raster: Raster) -> Show:
    """Let 170 hairs and some blades swing in front of what pans."""
    behind = backdrop(random, raster, INDOORS)
    along = np.linspace(0, 1, 24)
    strands, colours = [], []
    for _ in range(170):
        root = np.array([random.normal(-20, 45), -raster.extent[1] / 2 - 8 + random.uniform(0, 40)])
        bend, length = random.normal(0, 0.9), random.uniform(110, 250)
        angle = 0.35 * random.normal() + bend * along
        path = root + np.cumsum(np.stack([np.sin(angle), np.cos(angle)], axis=1) * length / 24, axis=0)
        strands.append((path, random.uniform(6, 20), random.uniform(7, 14), random.random()))
        colours.append(colour(random.random(1), ["1a110b", "4a2f1b", "8a6238", "c9a468"])[0])

    def show(time: float) -> Array:
        canvas = to_bytes(raster.fill(behind, shift(7 * (time - 2), -2 * (time - 2))))
        lines = []
        for path, reach, period, phase in strands:
            sway = [wave(time, period, phase + 0.12 * s) for s in along]
            lines.append(path + np.stack([reach * along**2 * sway, 0.15 * reach * along**2 * np.abs(sway)], axis=1))
        raster.stroke(canvas, lines[:120], colours[:120], 1)
        raster.stroke(canvas, lines[120:], colours[120:], 2)
        return to_floats(canvas)

    return show


def find_lattice(length: float, wide: float) -> list[Array]:
    """Give the bars of a lattice beam along x that begins in the middle."""
    bars = [np.array([[0, side], [length, side]]) for side in (-wide / 2, wide / 2)]
    number = int(length / wide)
    for i in range(number):
        left, right = i * length / number, (i + 1) * length / number
        side = wide / 2 * (-1) ** i
        bars += [np.array([[left, side], [right, -side]]), np.array([[left, -wide / 2], [left, wide / 2]])]
    return bars


def make_crane(random: Random, raster: Raster) -> Show:
    """Turn lattice cranes by 3 to 5 degrees a pair, and pass wires, in front of clouds and a street that pan."""
    behind = backdrop(random, raster, STREET, leaves=4, grain=0.08)
    # place, length and width of the beam, degrees a pair
    cranes = [(-150, 20, 210, 14, 4), (120, 50, 170, 10, -5), (20, -20, 130, 8, 3)]
    sag = np.linspace(-1, 1, 40)

    def show(time: float) -> Array:
        canvas = to_bytes(raster.fill(behind, shift(-7 * (time - 2), 1.5 * (time - 2))))
        for i, (x, y, length, wide, speed) in enumerate(cranes):
            slope = math.radians(-35 + 20 * i + speed * (time - 2))
            to = np.array([[math.cos(slope), math.sin(slope)], [-math.sin(slope), math.cos(slope)]])
            tower = [line[:, ::-1] + np.array([x, y]) for line in find_lattice(160, wide)]
            arms = find_lattice(length, wide) + find_lattice(-0.3 * length, -wide)
            jib = [line @ to + np.array([x, y]) for line in arms]
            bars = [line + np.array([3 * (time - 2), 0]) for line in tower + jib]
            raster.stroke(canvas, bars, [read_colour(("c9992b", "8a3b2a", "3b4650")[i])] * len(bars), 1.25)
        wires = []
        for i, height in enumerate((-105, -92, -70, 84, 100)):
            level = height + 9 * sag**2 - 12 * (i + 1) / 5 * sag + (2 + i) * (time - 2) + 3 * wave(time, 4 + i, i / 5)
            wires.append(np.stack([sag * 280, level], axis=1))
        raster.stroke(canvas, wires[:3], [read_colour("16181b")] * 3, 1)
        raster.stroke(canvas, wires[3:], [read_colour("22252a"), read_colour("d8d8d4")], 2)
        return to_floats(canvas)

    return show


def make_rods(random: Random, raster: Raster, leaves: float, grain: float) -> Show:
    """Move rods, wires, strings and legs of 2 to 8 units by 5 to 20 a pair, straight and on curves, over what pans."""
    behind = backdrop(random, raster, EARTH, leaves=leaves, grain=grain)
    # thickness, place, length, slope in radians, units a pair
    straight = [(2, -190, 220, 0.15, 8), (4, -120, 260, -0.3, 14), (8, 150, 200, 0.4, -20), (3, 40, 300, 1.2, 6)]
    # thickness, place, length, reach in radians, period
    pendulums = [
        (3, -40, 170, 0.5, 17),
        (5, 70, 200, 0.35, 13),
        (2, 190, 150, 0.6, 19),
    ]  # thickness, place, length, reach in radians, period

    def show(time: float) -> Array:
        canvas = to_bytes(raster.fill(behind, shift(-3 * (time - 2), 1.5 * (time - 2))))
        for i, (thickness, place, length, slope, speed) in enumerate(straight):
            along = np.array([math.sin(slope), math.cos(slope)]) * length / 2
            middle = np.array([place + speed * (time - 2), -20.0])
            paint = read_colour(("191512", "e8e2d0", "7a2323", "20303a")[i])
            raster.stroke(canvas, [np.stack([middle - along, middle + along])], [paint], thickness)
        for i, (thickness, place, length, reach, period) in enumerate(pendulums):
            slope = reach * wave(time, period, 0.21 + 0.3 * i)
            top = np.array([place, -140.0])
            foot = top + length * np.array([math.sin(slope), math.cos(slope)])
            raster.stroke(canvas, [np.stack([top, foot])], [read_colour(("141414", "dcd6c8", "2b1a10")[i])], thickness)
        for i in range(2):  # legs that walk: knees bend
            step, hip = 0.5 * wave(time, 6, 0.5 * i), np.array([-60 + 9 * (time - 2), 30.0])
            knee = hip + 45 * np.array([math.sin(step), math.cos(step)])
            bend = step - 0.5 * max(wave(time, 6, 0.5 * i + 0.2), 0)
            leg = np.stack([hip, knee, knee + 45 * np.array([math.sin(bend), math.cos(bend)])])
            raster.stroke(canvas, [leg], [read_colour("2a2430")], 7)
        return to_floats(canvas)

    return show
