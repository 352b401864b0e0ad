"""Frames that are shown several times, as arrays and as encoded clips."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.frame import Frame
from support.truth import as_type, frozen, moved_waves
from support.video_truth import write_clip

HEIGHT, WIDTH = 64, 96
RATE = Fraction(24)
SPEED = 1.5  # pixels per source interval of the pan

CADENCES = {"twos": [2] * 7, "threes": [3] * 5, "missed": [1, 1, 2, 1, 1, 3, 1, 1, 2, 1, 1], "pulldown": [3, 2] * 3}


def pan(position: float, seed: int = 0, dtype: type = np.uint8) -> Any:
    """A smooth texture moved by so many pixels."""
    return as_type(moved_waves((HEIGHT, WIDTH), position, seed=seed), dtype)


def held(cadence: Sequence[int], picture: Callable[[float], Any] = lambda time: pan(SPEED * time)) -> list[Frame]:
    """Each picture for so many frames, taken at the time that the first one is shown; the last one is shown once."""
    firsts = [0, *accumulate(cadence)]
    pictures = [(picture(first), count) for first, count in zip(firsts, [*cadence, 1], strict=True)]
    images = [frozen(image + 0) for image, count in pictures for _ in range(count)]
    return [Frame(image, k / RATE, 1 / RATE, original=object()) for k, image in enumerate(images)]


def encode(path: Path, images: Sequence[Any], crf: int) -> Path:
    """A clip as people keep them."""
    clip = {"times": range(len(images)), "time_base": 1 / RATE, "picture": lambda number, *size: images[number]}
    return write_clip(path, size=(HEIGHT, WIDTH), options={"crf": str(crf), "preset": "medium", "g": "10"}, **clip)
