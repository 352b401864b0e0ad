"""What changes while it moves: fire, water that bends the light from below, smoke."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from .layers import Show, backdrop, wave
from .raster import Array, Raster, find_places, index_matrix, shift
from .textures import EARTH, EVENING, GARDEN, STREET, Random, colour, noise, rise

TILE = 512.0  # units after which drifting noise repeats, each way
DENSITY = 1.0  # places per unit at which smooth values are computed; samples between them are interpolated
FLAMES = ["000000", "3a0800", "a02408", "ec6a12", "ffb93a", "fff1b0"]


@dataclass(frozen=True)
class Drift:
    """Noise that is carried along: fields, (n, n) each, with a weight and a speed (units a pair) of their own."""

    fields: tuple[tuple[Array, float, float, float], ...]

    @classmethod
    def make(cls, random: Random, octaves: list[tuple[float, float, float, float]]) -> Drift:
        """Draw the fields; each octave is the size of its cells, a weight, and a speed to the right and down."""
        fields = []
        for cell, weight, x, y in octaves:
            cells = round(TILE / cell)
            grid = np.pad(random.standard_normal((cells, cells), dtype=np.float32), 3, mode="wrap")
            fields.append((grid, weight, x, y))
        return cls(tuple(fields))

    def at(self, x: Array, y: Array, time: float) -> Array:
        """Add the fields up at places, (H, W)."""
        total = np.zeros_like(x)
        for grid, weight, speed_x, speed_y in self.fields:
            cells = (grid.shape[0] - 6) / TILE
            columns = ((x - speed_x * time) % TILE * cells + 3).astype(np.float32)
            rows = ((y - speed_y * time) % TILE * cells + 3).astype(np.float32)
            total += np.float32(weight) * cv2.remap(grid, columns, rows, cv2.INTER_CUBIC)
        return total


def interpolate(raster: Raster, values: Array) -> Array:
    """Interpolate what was computed at `DENSITY` to all samples."""
    into = index_matrix(raster.shape, raster.density) @ np.linalg.inv(index_matrix(values.shape, DENSITY))
    return cv2.warpPerspective(values, into, raster.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def make_fire(random: Random, raster: Raster) -> Show:
    """Let flames rise at 14 to 34 units a pair, each size of swirl at its own speed, in front of a dark ground."""
    behind = backdrop(random, raster, EVENING)
    swirls = [(60, 0.6, 1, -14), (34, 0.5, -2, -20), (20, 0.4, 3, -26), (12, 0.3, -2, -30), (7, 0.2, 1, -34)]
    heat, bend = Drift.make(random, swirls), Drift.make(random, [(48, 1, 3, -10), (22, 0.5, -4, -16)])
    x, y = find_places(raster.extent, DENSITY)
    top = raster.extent[1] / 2

    def show(time: float) -> Array:
        bent = x + 9 * bend.at(x, y, time)
        flames = heat.at(bent, y * 0.6, time * 0.6)  # stretched upwards
        narrow = 1 - (np.abs(x + 10 * wave(time, 7)) / 190) ** 2
        values = np.clip(0.55 * narrow + 0.8 * (y / top) + 0.33 * flames - 0.1, 0, 1)
        values = interpolate(raster, values.astype(np.float32))
        canvas = raster.fill(behind, shift(0, 0)) * 0.55
        return canvas * (1 - 0.9 * rise(values, 0.1, 0.7))[..., None] + colour(values, FLAMES)

    return show


def make_waves(
    random: Random, shortest: float, longest: float, steepness: float, speed: float
) -> list[tuple[float, ...]]:
    """Draw waves of deep water: wave vector, amplitude, frequency (as the root of the wave number) and phase."""
    waves = []
    for _ in range(14):
        length = shortest * (longest / shortest) ** random.random()
        angle, number = random.normal(0.4, 0.8), 2 * np.pi / length
        frequency = speed * math.sqrt(number)
        waves.append(
            (number * math.cos(angle), number * math.sin(angle), steepness / number, frequency, random.uniform(0, 6))
        )
    return waves


def make_water(random: Random, raster: Raster, *, steepness: float, speed: float) -> Show:
    """Show a pebbled ground through moving waves; light glints where they lean to the upper left."""
    ground = backdrop(random, raster, EARTH, leaves=7, grain=0.12)
    waves = make_waves(random, 16, 110, steepness, speed)
    x, y = find_places(raster.extent, DENSITY)

    def show(time: float) -> Array:
        slope_x, slope_y = np.zeros_like(x), np.zeros_like(x)
        for across, down, amplitude, frequency, phase in waves:
            slope = amplitude * np.cos(across * x + down * y - frequency * time + phase)
            slope_x, slope_y = slope_x + across * slope, slope_y + down * slope
        slope_x, slope_y = interpolate(raster, slope_x), interpolate(raster, slope_y)
        full_x, full_y = raster.places
        depth = 40  # units: how far a slope of 1 displaces what is seen below
        canvas = raster.look_up(ground, full_x + depth * slope_x, full_y + depth * slope_y)
        glint = rise(-0.7 * slope_x - 0.7 * slope_y, 2.2 * steepness, 5 * steepness)[..., None]
        tinted = canvas * np.array([0.62, 0.85, 0.9], np.float32) + (0.25 * slope_y)[..., None]
        return tinted + glint * (np.array([0.93, 0.97, 1], np.float32) - tinted) * 0.8

    return show


def make_smoke(random: Random, raster: Raster, *, wind: float, density: float) -> Show:
    """Blow soft translucent smoke past what stands behind, which pans the other way."""
    behind = backdrop(random, raster, GARDEN if wind > 10 else STREET)
    swirls = [
        (96, 0.7, wind, -3.0),
        (50, 0.5, 1.2 * wind, -6.0),
        (26, 0.3, 0.8 * wind, -9.0),
        (13, 0.15, 1.4 * wind, -8.0),
    ]
    smoke, bend = Drift.make(random, swirls), Drift.make(random, [(70, 1, 4, -8), (40, 0.6, -5, -3)])
    x, y = find_places(raster.extent, DENSITY)
    light = 0.75 + 0.06 * noise(random, raster.extent, raster.density, coarse=120, fine=30)

    def show(time: float) -> Array:
        bent_x, bent_y = x + 14 * bend.at(x, y, time), y + 14 * bend.at(y, x, time)
        thick = interpolate(raster, rise(smoke.at(bent_x, bent_y, time) + 0.003 * y, -0.4, 1.9))
        alpha = (density * thick)[..., None]
        canvas = raster.fill(behind, shift(-3 * (time - 2), 0))
        return canvas * (1 - alpha) + alpha * light[..., None]

    return show
