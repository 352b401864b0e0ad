"""Patterns that repeat: vents, windows, cloth, bricks and bars, with the truth drawn."""

import cv2
import numpy as np
import pytest

import fpsboost
from support.truth import noise

SIZE, FINER = (112, 128), 4


def pattern(kind: str, across: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Brightness, 0 to 1, at places in periods."""
    if kind == "cloth":
        return 0.5 + 0.25 * np.sin(2 * np.pi * across) * np.sin(2 * np.pi * down)
    if kind == "windows":
        return np.where((down % 1 < 0.6) & (across / 1.4 % 1 < 0.55), 0.2, 0.7)
    if kind == "bricks":
        joints = (down % 1 < 0.15) | ((across / 2.2 + np.floor(down) % 2 / 2) % 1 < 0.07)
        return np.where(joints, 0.75, 0.4)
    return np.where(down % 1 < 0.45, 0.1, 0.8)  # vents


def drawn(kind: str, period: float, motion: float, ground: np.ndarray, grain: np.random.Generator) -> np.ndarray:
    """A pattern with slanted rows that has moved down by so many pixels behind the edges of its frame."""
    height, width = (side * FINER for side in SIZE)
    y, x = (np.mgrid[:height, :width] + 0.5) / FINER
    down, slant = (y - motion) / period, 0.1
    shade = 1 + 0.12 * np.sin(x / 37)
    fine = pattern(kind, x / period + slant * down, down - slant * x / period) * shade
    image = cv2.resize(fine, SIZE[::-1], interpolation=cv2.INTER_AREA)[..., np.newaxis] * (0.9, 0.95, 1)
    image = np.where(ground > 0, ground, image) + grain.normal(0, 0.005, ground.shape)
    return np.rint(255 * image.clip(0, 1)).astype(np.uint8)


@pytest.mark.parametrize(
    ("kind", "period", "share"),
    [
        *(("vents", 4, 0.1), ("vents", 8, 0.3)),
        *(("windows", 4, 0.1), ("windows", 5.5, 0.1), ("windows", 8, 0.3), ("windows", 13, 0.1)),
        *(("cloth", 4, 0.1), ("cloth", 5.5, 0.3), ("cloth", 8, 0.1), ("cloth", 8, 0.3)),
        *(("bricks", 5.5, 0.3), ("bricks", 13, 0.1)),
    ],
)
def test_patterns_that_repeat_keep_their_own_motion(kind, period, share):
    """No motion by periods takes its place: the better one of `dis` and `blend` is 1 dB ahead at most."""
    grain = np.random.default_rng(3)
    ground = cv2.GaussianBlur(noise(*SIZE, 3, np.float32, 2), (0, 0), 1.5) * 0.6 + 0.1
    ground[16:-16, 24:-24] = 0
    first, truth, last = (drawn(kind, period, t * share * period, ground, grain) for t in (-0.5, 0, 0.5))
    made, by_dis, by_blend = (
        cv2.PSNR(fpsboost.interpolate(first, last, method=method), truth) for method in ("nlm", "dis", "blend")
    )
    assert made > max(by_dis, by_blend) - 1


def worn_bars(period: float, left: float, grain: np.random.Generator) -> np.ndarray:
    """Upright bars that fill the frame from so far to the left, in slowly varying light that moves with them."""
    height, width = 144, 240
    across = np.float32(np.arange(width) - left)
    wear = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (height, 5 * width)).astype(np.float32), (0, 0), 6)
    places = np.tile(5 * across / 2 + width, (height, 1))
    light = cv2.remap(wear, places, np.mgrid[:height, :width][0].astype(np.float32), cv2.INTER_CUBIC)
    bars = 128 + 70 * (3 * np.sin(2 * np.pi * across / period)).clip(-1, 1) + 6 * light / wear.std()
    image = (bars + grain.normal(0, 1, bars.shape)).clip(0, 255).round().astype(np.uint8)
    return np.repeat(image[..., np.newaxis], 3, axis=2)


@pytest.mark.parametrize(("period", "motion"), [(6, 4.2), (6, 8.4), (7, 4.2)])
def test_bars_that_fill_the_frame_are_told_apart_by_their_wear(period, motion):
    """The little by which the true motion is more similar decides, also where it leads out of the frame."""
    grain = np.random.default_rng(4)
    first, truth, last = (worn_bars(period, t * motion, grain) for t in (0, 0.5, 1))
    made = fpsboost.interpolate(first, last)
    assert cv2.PSNR(made, truth) > 30
