"""How sharp: the detail of frames at every eighth between two, where moving texture softens and pulses.

``python benchmarks/sharpness.py`` draws textures at 16 times the size and moves them by parts of a pixel, so that the
true frame at every time is known: noise of three spectra, needles, leaves and gravel; clean, with grain, and as JPEG.
Detail is the energy of the luma's Laplacian, percent of the true frame's.

``python benchmarks/sharpness.py CLIPS`` interpolates between neighbouring frames of clips, some pairs of each. Detail
is that of the half of blocks of 16 pixels with the most of it, percent of the mean of both frames by time.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scoring import find_clips, one_thread, read_frames

from fpsboost import interpolate

Array = NDArray[Any]

FINER = 16
"""Factor by which textures are drawn larger."""
SIZE = 144, 208
MARGIN = 8
"""Pixels around a texture, from which it moves into the frame."""
BORDER = 12
"""Pixels at each side that do not count."""
MOTIONS = (1, 0), (3, 1), (5, 3), (7, 2), (11, 6)
"""Motion from frame to frame, half pixels."""
EIGHTHS = range(1, 8)
BLOCK = 16


def empty_canvas(level: float) -> Array:
    """Return a canvas of one level."""
    return np.full([(side + 2 * MARGIN) * FINER for side in SIZE], level, np.float32)


def draw_noise(slope: float, random: np.random.Generator) -> Array:
    """Return noise whose amplitude falls with the frequency, up to four times what pixels can show."""
    height, width = empty_canvas(0).shape
    frequency = np.hypot(np.fft.fftfreq(height)[:, np.newaxis], np.fft.rfftfreq(width)) * FINER
    frequency[0, 0] = 1
    amplitude = frequency**-slope * ((frequency > 1 / 40) & (frequency < 2))
    noise = np.fft.irfft2(amplitude * np.exp(2j * np.pi * random.random(amplitude.shape)), (height, width))
    return (128 + noise * (40 / noise.std())).astype(np.float32)


def draw_needles(random: np.random.Generator) -> Array:
    """Return thin strokes over each other, most of them upright."""
    canvas = empty_canvas(60)
    for _ in range(9000):
        x, y = random.integers(0, canvas.shape[::-1])
        angle, length = random.normal(1.1, 0.5) * random.choice([-1, 1]), random.uniform(6, 22) * FINER
        end = int(x + np.cos(angle) * length), int(y + np.sin(angle) * length)
        level, width = random.uniform(30, 200), random.uniform(0.5, 1.4) * FINER
        cv2.line(canvas, (int(x), int(y)), end, float(level), int(width))
    return canvas


def draw_leaves(random: np.random.Generator) -> Array:
    """Return ellipses over each other, the more the smaller."""
    canvas = empty_canvas(100)
    share = random.random(14000)
    for radius in ((1 - share) / 1.5**2 + share / 12**2) ** -0.5 * FINER:
        x, y = random.integers(0, canvas.shape[::-1])
        axes = int(radius), int(radius * random.uniform(0.4, 1))
        turn, level = random.uniform(0, 180), random.uniform(40, 215)
        cv2.ellipse(canvas, (int(x), int(y)), axes, float(turn), 0, 360, float(level), -1)
    return canvas


def draw_gravel(random: np.random.Generator) -> Array:
    """Return stones with a bright top and a dark rim."""
    canvas = empty_canvas(70)
    for _ in range(5200):
        radius, centre = random.uniform(1.5, 5) * FINER, random.integers(0, canvas.shape[::-1])
        angles, away = np.sort(random.uniform(0, 2 * np.pi, 7)), radius * random.uniform(0.7, 1, 7)
        corners = np.stack([away * np.cos(angles), away * np.sin(angles)], 1)
        level = float(random.uniform(70, 190))
        cv2.fillPoly(canvas, [(corners + centre).astype(np.int32)], level)
        cv2.polylines(canvas, [(corners + centre).astype(np.int32)], True, level * 0.55, FINER // 2)
        cv2.fillPoly(canvas, [(corners * 0.5 + centre - radius * 0.2).astype(np.int32)], min(level * 1.2, 230))
    return canvas


TEXTURES: Mapping[str, Callable[[np.random.Generator], Array]] = {
    "noise, f^-1.5": lambda random: draw_noise(1.5, random),
    "noise, f^-1": lambda random: draw_noise(1, random),
    "noise, f^-0.5": lambda random: draw_noise(0.5, random),
    "needles": draw_needles,
    "leaves": draw_leaves,
    "gravel": draw_gravel,
}
WEAR = {"clean": (0, 0), "grain": (4, 0), "JPEG": (2, 85)}
"""Standard deviation of grain, levels, and quality of JPEG."""


def take_frame(canvas: Array, across: int, down: int, wear: tuple[int, int], random: np.random.Generator) -> Array:
    """Return what a camera would see of a canvas that has moved so many of its own pixels, 8-bit BGR."""
    top, left = MARGIN * FINER - down, MARGIN * FINER - across
    seen = canvas[top : top + SIZE[0] * FINER, left : left + SIZE[1] * FINER]
    pixels = cv2.resize(seen, SIZE[::-1], interpolation=cv2.INTER_AREA)
    grain, quality = wear
    gray = (pixels + random.normal(0, 1, SIZE) * grain).clip(0, 255).round().astype(np.uint8)
    frame = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    return cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 1) if quality else frame


def detail(frame: Array) -> Array:
    """Return the energy of the Laplacian of the luma in each block, levels squared."""
    square = np.square(cv2.Laplacian(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), cv2.CV_32F))
    rows, columns = (side // BLOCK for side in square.shape)
    return square[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))


def psnr(frame: Array, truth: Array) -> float:
    """Return the PSNR, dB."""
    return float(10 * np.log10(255**2 / np.square(frame.astype(float) - truth).mean()))


def of_textures(method: str) -> Iterator[tuple[str, list[float]]]:
    """Yield the name of each drawn texture, its detail at every eighth, percent, and its PSNR half-way."""
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    for name, draw in TEXTURES.items():
        canvas = draw(np.random.default_rng(1))
        for worn, wear in WEAR.items():
            figures = []
            for x, y in MOTIONS:
                random = np.random.default_rng(2)
                truths = [take_frame(canvas, x * k, y * k, wear, random) for k in range(9)]
                made = [interpolate(truths[0], truths[8], k / 8, method=method) for k in EIGHTHS]
                pairs = [(one[inner], other[inner]) for one, other in zip(made, truths[1:8], strict=True)]
                shares = [100 * detail(one).mean() / detail(other).mean() for one, other in pairs]
                figures.append([*shares, psnr(*pairs[3])])
            yield f"{name}, {worn}", list(np.mean(figures, axis=0))


def of_clips(paths: list[str], method: str, count: int) -> Iterator[tuple[str, list[float]]]:
    """Yield the name of each clip and its detail at every eighth, percent."""
    for name, path in find_clips(paths).items():
        frames = read_frames(path, 2 * count)
        figures = []
        for first, second in zip(frames[::2], frames[1::2], strict=False):
            energies = detail(first), detail(second)
            textured = (energies[0] + energies[1]) >= np.median(energies[0] + energies[1])
            before, after = (float(energy[textured].mean()) for energy in energies)
            made = (detail(interpolate(first, second, k / 8, method=method))[textured].mean() for k in EIGHTHS)
            figures.append(
                [100 * each / (before + k / 8 * (after - before)) for k, each in zip(EIGHTHS, made, strict=True)]
            )
        yield name, list(np.mean(figures, axis=0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="*", metavar="CLIP")
    parser.add_argument("--pairs", type=int, default=2, help="how many of each clip (default: %(default)s)")
    parser.add_argument("--method", default="nlm", help="which method (default: %(default)s)")
    options = parser.parse_args()
    one_thread()
    print(f"| | {' | '.join(f'{k}/8' for k in EIGHTHS)} |{'' if options.clips else ' dB |'}")
    print(f"|---|{'---|' * (7 + (not options.clips))}")
    rows = of_clips(options.clips, options.method, options.pairs) if options.clips else of_textures(options.method)
    total = []
    for name, figures in rows:
        print(f"| {name} | {' | '.join(f'{each:.1f}' for each in figures)} |", flush=True)
        total.append(figures)
    print(f"| mean | {' | '.join(f'{each:.1f}' for each in np.mean(total, axis=0))} |")


if __name__ == "__main__":
    main()
