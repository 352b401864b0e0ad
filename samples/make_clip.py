"""Draw the sample clip: ``python samples/make_clip.py samples/orbit.mp4``.

Three seconds, two scenes with a cut at 2 s, made of nothing but noise with a fixed seed: planets that pass in front of
each other, a turning tile, a pendulum and a small fast ball over a panning ground, and a tone that follows them. Every
frame is drawn at twice its size and averaged down, so that motion is smooth to a fraction of a pixel.

Needs numpy, OpenCV and PyAV.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from fractions import Fraction

import av
import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, SCALE = 640, 360, 2  # SCALE: pixels drawn per pixel shown, each way
RATE = 24
CUT, END = 2.0, 3.0  # seconds
SAMPLE_RATE = 48000

Picture = NDArray[np.float32]  # (height, width, 3) RGB from 0 to 1, or with alpha as the fourth channel


# ------------------------------------------------------------------------------------------------------------- textures


def noise(random: np.random.Generator, size: int, cells: int, octaves: int = 5, fall: float = 0.55) -> Picture:
    """Make a square of smooth noise from 0 to 1, `cells` coarse blobs across, each octave half as large."""
    total = np.zeros((size, size), np.float32)
    for octave in range(octaves):
        count = min(cells * 2**octave + 3, size)
        grid = random.random((count, count), dtype=np.float32)
        total += fall**octave * cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
    low, high = np.percentile(total, [0.5, 99.5])
    return np.clip((total - low) / (high - low), 0, 1).astype(np.float32)


def colour(values: Picture, palette: list[str]) -> Picture:
    """Turn values from 0 to 1 into colours, evenly spread over a palette of ``rrggbb``."""
    stops = np.array([[int(entry[i : i + 2], 16) / 255 for i in (0, 2, 4)] for entry in palette])
    places = np.linspace(0, 1, len(palette))
    return np.stack([np.interp(values, places, stops[:, i]) for i in range(3)], axis=-1).astype(np.float32)


def make_ground(random: np.random.Generator, palette: list[str], ink: float) -> Picture:
    """Draw a map: heights in colour, lines where they are equal, and the grain of paper."""
    size = 1900
    heights = noise(random, size, 5, 5, 0.5)
    picture = colour(heights, palette)
    levels = cv2.GaussianBlur(heights, (0, 0), 2.5) * 16 + 0.4  # no line on the plateaus at 0 and 1
    steepness = np.hypot(cv2.Sobel(levels, -1, 1, 0, scale=1 / 8), cv2.Sobel(levels, -1, 0, 1, scale=1 / 8)) + 1e-3
    lines = np.clip(1.9 - np.abs(levels - np.round(levels)) / steepness, 0, 1)
    major = np.round(levels) % 4 == 0
    picture *= (1 - ink * lines * np.where(major, 1.0, 0.55))[..., None]
    grain = noise(random, size, 160, 3, 0.8)
    return np.clip(picture * (0.86 + 0.28 * grain[..., None]), 0, 1).astype(np.float32)


def make_planet(random: np.random.Generator, palette: list[str], bands: float) -> Picture:
    """Draw the surface of a planet, bands that the wind has bent; `draw_planet` makes it round."""
    size = 360
    down = np.linspace(0, bands, size, dtype=np.float32)[:, None]
    bent = down + 1.3 * noise(random, size, 3) + 0.35 * noise(random, size, 14)
    mixed = 0.5 + 0.5 * np.sin(2 * np.pi * bent)
    return colour((0.65 * mixed + 0.35 * noise(random, size, 10)).astype(np.float32), palette)


def make_tile(random: np.random.Generator, palette: list[str]) -> Picture:
    """Draw a glazed tile with rounded corners: rings, a star and a cracked surface, with alpha."""
    size = 320
    y, x = (np.mgrid[0:size, 0:size].astype(np.float32) + 0.5) / size * 2 - 1
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    star = radius * (1 + 0.22 * np.cos(8 * angle))
    pattern = 0.5 + 0.5 * np.tanh(3 * np.sin(11 * star))
    corner = 0.5 + 0.5 * np.tanh(6 * np.sin(9 * (np.abs(x) + np.abs(y))))
    values = np.where(star < 0.88, pattern, corner) * 0.7 + 0.3 * noise(random, size, 20)
    picture = colour(values.astype(np.float32), palette)
    inside = np.maximum(np.abs(x), np.abs(y)) + 0.03 * (np.abs(x * y) > 0.86)
    picture *= (1 - 0.55 * (inside > 0.93))[..., None]
    distance = np.hypot(np.maximum(np.abs(x) - 0.8, 0), np.maximum(np.abs(y) - 0.8, 0))
    alpha = np.clip((0.19 - distance) * size / 2, 0, 1)
    return np.dstack([picture, alpha]).astype(np.float32)


# -------------------------------------------------------------------------------------------------------------- drawing


def draw(canvas: Picture, sprite: Picture, x: float, y: float, size: float, *, angle: float = 0) -> None:
    """Lay a square sprite with alpha over the canvas: centre and size in shown pixels, angle in radians."""
    extent = sprite.shape[0]
    zoom = size * SCALE / extent
    turn = zoom * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    middle = np.array([x, y]) * SCALE
    reach = size * SCALE * 0.72 + 2
    left, top = np.maximum(np.floor(middle - reach), 0).astype(int)
    right, bottom = np.minimum(np.ceil(middle + reach), (canvas.shape[1], canvas.shape[0])).astype(int)
    if right <= left or bottom <= top:
        return
    shift = middle - turn @ np.full(2, extent / 2) - (left, top)
    premultiplied = np.dstack([sprite[..., :3] * sprite[..., 3:], sprite[..., 3]])
    area = (int(right - left), int(bottom - top))
    placed = cv2.warpAffine(premultiplied, np.column_stack([turn, shift]), area, flags=cv2.INTER_LINEAR)
    part = canvas[top:bottom, left:right]
    part *= 1 - placed[..., 3:]
    part += placed[..., :3]


def make_ball_of_light(size: int, softness: float) -> Picture:
    """Make a disc of alpha whose rim is `softness` of its radius wide."""
    y, x = (np.mgrid[0:size, 0:size].astype(np.float32) + 0.5) / size * 2 - 1
    alpha = np.clip((0.96 - np.hypot(x, y)) / softness, 0, 1)
    return (alpha * alpha * (3 - 2 * alpha)).astype(np.float32)


def draw_shadow(canvas: Picture, x: float, y: float, size: float, strength: float = 0.5) -> None:
    """Darken the ground below a round thing, softly and a little to the lower right."""
    alpha = make_ball_of_light(128, 0.55) * strength
    shade = np.dstack([np.zeros((128, 128, 3), np.float32), alpha])
    draw(canvas, shade, x + 0.09 * size, y + 0.13 * size, size * 1.22)


def draw_planet(canvas: Picture, surface: Picture, x: float, y: float, size: float, *, angle: float) -> None:
    """Draw a planet: its surface turns, the light on it comes from the upper left all the time."""
    extent = surface.shape[0]
    turn = cv2.getRotationMatrix2D((extent / 2 - 0.5, extent / 2 - 0.5), math.degrees(angle), 0.95)
    turned = cv2.warpAffine(surface, turn, (extent, extent), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    v, u = (np.mgrid[0:extent, 0:extent].astype(np.float32) + 0.5) / extent * 2 - 1
    depth = np.sqrt(np.clip(1 - u * u - v * v, 0, 1))
    light = np.clip(-0.5 * u - 0.55 * v + 0.67 * depth, 0, 1)
    lit = turned * (0.24 + 0.86 * light[..., None]) + 0.35 * light[..., None] ** 24
    draw_shadow(canvas, x, y, size)
    alpha = make_ball_of_light(extent, 2.5 / size)
    draw(canvas, np.dstack([np.clip(lit, 0, 1), alpha]).astype(np.float32), x, y, size)


def draw_ground(ground: Picture, x: float, y: float, zoom: float, angle: float) -> Picture:
    """Show the part of the ground around (x, y), in shown pixels from its middle."""
    turn = zoom * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    middle = np.full(2, ground.shape[0] / 2) + np.array([x, y]) * SCALE
    shift = np.array([WIDTH, HEIGHT]) * SCALE / 2 - turn @ middle
    place = np.column_stack([turn, shift])
    size = (WIDTH * SCALE, HEIGHT * SCALE)
    return np.clip(cv2.warpAffine(ground, place, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT), 0, 1)


def draw_rod(canvas: Picture, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw a thin anti-aliased rod; its ends are given in shown pixels."""
    ends = [(round(x * SCALE * 64), round(y * SCALE * 64)) for x, y in (start, end)]
    mask = np.zeros(canvas.shape[:2], np.uint8)
    cv2.line(mask, ends[0], ends[1], 255, 3 * SCALE, cv2.LINE_AA, shift=6)
    alpha = mask.astype(np.float32)[..., None] / 255
    canvas *= 1 - alpha
    canvas += alpha * np.array([0.16, 0.11, 0.09], np.float32)


# --------------------------------------------------------------------------------------------------------------- scenes


def swing(time: float) -> float:
    """Tell the angle of the pendulum from the vertical, radians."""
    return 0.62 * math.cos(2 * math.pi * time / 1.7 + 0.5)


def bounce(time: float, period: float) -> float:
    """Tell the height of a bouncing ball, 0 to 1."""
    phase = time / period % 1
    return 4 * phase * (1 - phase)


def make_day(random: np.random.Generator) -> Callable[[float], Picture]:
    """Prepare the first scene: two planets round each other, a tile, a pendulum and a bouncing ball."""
    ground = make_ground(random, ["1f5a66", "3f8c85", "8fbf9a", "ead9a4", "e2a766", "b9663f"], 0.5)
    warm = make_planet(random, ["6b1f2a", "c4513a", "f2a65a", "fbe3b0"], 2.6)
    cool = make_planet(random, ["17324f", "2f6f9f", "8fc7d6", "f3f3e6"], 3.4)
    small = make_planet(random, ["fff3c4", "ffd447", "f08a24"], 2)
    bob = make_planet(random, ["4b2a56", "9b4f8e", "e59ac0"], 4)
    tile = make_tile(random, ["12394b", "1d7080", "f0ead2", "f7f3e3"])

    def show(time: float) -> Picture:
        canvas = draw_ground(ground, -30 + 38 * time, 14 * time, 1.0, 0)
        x, y = 105 + 58 * time, 262 - 12 * time
        draw_shadow(canvas, x, y, 120, 0.45)
        draw(canvas, tile, x, y, 108, angle=1.1 * time + 0.3)
        phase = 2 * math.pi * time / 2.6 - 0.9
        planets = [(warm, phase, 128, 0.9), (cool, phase + math.pi, 92, -1.4)]
        for surface, place, size, spin in sorted(planets, key=lambda planet: math.sin(planet[1])):
            near = 1 + 0.16 * math.sin(place)
            x, y = 318 + 158 * math.cos(place), 160 + 46 * math.sin(place)
            draw_planet(canvas, surface, x, y, size * near, angle=spin * time)
        x, y = 505 + 205 * math.sin(swing(time)), -28 + 205 * math.cos(swing(time))
        draw_rod(canvas, (505, -28), (x, y))
        draw_planet(canvas, bob, x, y, 62, angle=-swing(time))
        draw_planet(canvas, small, 20 + 330 * time, 318 - 150 * bounce(time + 0.2, 0.8), 26, angle=7 * time)
        return canvas

    return show


def make_night(random: np.random.Generator) -> Callable[[float], Picture]:
    """Prepare the second scene: a tile in the middle, three planets round it, and the ball in a figure of eight."""
    ground = make_ground(random, ["0d1030", "1f2259", "44357f", "8a4f95", "d5799a", "f5b99a"], 0.42)
    tile = make_tile(random, ["3a0f2b", "a2304e", "f4c77b", "fff0cf"])
    surfaces = [
        make_planet(random, ["0f3d3e", "1f8a70", "bedb92", "fdf6d8"], 3),
        make_planet(random, ["552211", "c8662b", "f6c667", "fff1cf"], 2.2),
        make_planet(random, ["20264d", "5a66b5", "aab4ee", "f2f2ff"], 4),
    ]
    small = make_planet(random, ["ffffff", "d7f6ff", "7fd6f2"], 2)

    def show(time: float) -> Picture:
        canvas = draw_ground(ground, 40 - 44 * time, -20 + 26 * time, 1.04 + 0.1 * time, 0.05 * time)
        draw_shadow(canvas, 320, 184, 182, 0.45)
        draw(canvas, tile, 320, 180, 150, angle=-0.9 * time + 0.4)
        for i, (surface, size) in enumerate(zip(surfaces, (96, 76, 58), strict=True)):
            place = 1.9 * time + 2 * math.pi * i / 3 + 0.5
            x, y = 320 + 185 * math.cos(place), 180 + 98 * math.sin(place)
            draw_planet(canvas, surface, x, y, size, angle=1.5 * time)
        place = 2 * math.pi * time / 1.1
        x, y = 320 + 255 * math.sin(place), 180 + 120 * math.sin(2 * place)
        draw_planet(canvas, small, x, y, 24, angle=9 * time)
        return canvas

    return show


def draw_frames() -> Iterator[NDArray[np.uint8]]:
    """Yield the frames, (360, 640, 3) RGB."""
    day, night = make_day(np.random.default_rng(6)), make_night(np.random.default_rng(11))
    for index in range(round(END * RATE)):
        time = index / RATE
        large = day(time) if time < CUT else night(time - CUT)
        frame = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        yield np.clip(np.round(frame * 255), 0, 255).astype(np.uint8)


# ---------------------------------------------------------------------------------------------------------------- sound


def make_sound() -> NDArray[np.float32]:
    """Make the tone, (2, samples): the pendulum bends its pitch, the ball its loudness, and the cut its chord."""
    time = np.arange(round(END * SAMPLE_RATE)) / SAMPLE_RATE
    is_night = time >= CUT
    wave = np.sin(2 * np.pi * (time - CUT) / 1.1)  # the ball of the second scene, from left to right
    bend = np.where(is_night, 0.12 * wave, 0.62 * np.cos(2 * np.pi * time / 1.7 + 0.5))
    root = np.where(is_night, 164.81, 220.0) * 2 ** (bend * 2 / 12)
    phase = 2 * np.pi * np.cumsum(root) / SAMPLE_RATE
    chord = np.where(is_night, 6 / 5, 5 / 4)
    tone = np.sin(phase) + 0.5 * np.sin(1.5 * phase) + 0.35 * np.sin(2 * phase)
    tone += 0.45 * np.sin(2 * np.pi * np.cumsum(root * chord) / SAMPLE_RATE)
    hop = (time + 0.2) / 0.8 % 1
    loudness = 0.55 + 0.45 * np.where(is_night, wave**2, (2 * hop - 1) ** 2)
    loudness *= np.clip(np.minimum(time, END - time) / 0.08, 0, 1) * np.clip(np.abs(time - CUT) / 0.02, 0, 1)
    side = np.where(is_night, 0.7 * wave, time - 1)  # where the ball is
    sides = np.stack([np.sqrt((1 - 0.8 * side) / 2), np.sqrt((1 + 0.8 * side) / 2)])
    return (0.16 * tone * loudness * sides).astype(np.float32)


# -------------------------------------------------------------------------------------------------------------- writing


def convert_to_bt709(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert RGB to planar 4:2:0 of limited range, chroma between the rows and on the even columns as H.264 has it."""
    red, green, blue = (image[..., i].astype(np.float32) / 255 for i in range(3))
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    planes = [16 + 219 * luma]
    along, down = np.array([0.25, 0.5, 0.25]), np.array([1.0])
    for chroma in ((blue - luma) / 1.8556, (red - luma) / 1.5748):
        smooth = cv2.sepFilter2D(chroma, -1, along, down, borderType=cv2.BORDER_REFLECT_101)
        planes.append(128 + 224 * (smooth[0::2, 0::2] + smooth[1::2, 0::2]) / 2)
    flat = np.concatenate([np.clip(np.round(plane), 0, 255).astype(np.uint8).ravel() for plane in planes])
    return flat.reshape(HEIGHT * 3 // 2, WIDTH)


def write_clip(path: str) -> None:
    """Encode frames and sound as H.264 and AAC."""
    with av.open(path, "w", options={"movflags": "+faststart"}) as container:
        video = container.add_stream("libx264", rate=RATE, options={"crf": "20", "preset": "slow"})
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        context = video.codec_context
        context.color_primaries = context.color_trc = context.colorspace = 1  # BT.709
        context.color_range = 1  # limited
        audio = container.add_stream("aac", rate=SAMPLE_RATE, layout="stereo")
        audio.bit_rate = 96000
        for index, image in enumerate(draw_frames()):
            frame = av.VideoFrame.from_ndarray(convert_to_bt709(image), format="yuv420p")
            frame.pts, frame.time_base = index, Fraction(1, RATE)
            frame.colorspace, frame.color_range = 1, 1
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        sound = make_sound()
        for start in range(0, sound.shape[1], 1024):
            part = np.ascontiguousarray(sound[:, start : start + 1024])
            block = av.AudioFrame.from_ndarray(part, format="fltp", layout="stereo")
            block.sample_rate, block.pts, block.time_base = SAMPLE_RATE, start, Fraction(1, SAMPLE_RATE)
            container.mux(audio.encode(block))
        container.mux(audio.encode(None))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("Usage: python samples/make_clip.py OUT.mp4")
    write_clip(sys.argv[1])
