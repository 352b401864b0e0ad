"""What tests of comparisons share: clips written as images, an observer, and results with given scores."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.results import FrameResult, Scores
from support.truth import as_type, moved_waves

HEIGHT, WIDTH = 48, 64
NAMES = ("dis", "blend", "nearest")  # methods of the page of a comparison that several tests look at


class Nobody:
    """An observer that notes what it is told."""

    def __init__(self) -> None:
        self.told: list[Any] = []

    def begin(self, name: str, frames: int | None) -> None:
        """A method begins."""
        self.told.append((name, frames))

    def advance(self) -> None:
        """A frame is done."""
        self.told.append("frame")


def save_clip(folder: Path, images: Iterable[NDArray[Any]], suffix: str = ".png") -> str:
    """Write images of any depth into a folder, which may be new, and return it."""
    folder.mkdir(exist_ok=True)
    for number, image in enumerate(images):
        (folder / f"{number:04d}{suffix}").write_bytes(cv2.imencode(suffix, image)[1].tobytes())
    return str(folder)


def pan(position: float, dtype: type = np.uint8, height: int = HEIGHT, width: int = WIDTH) -> NDArray[Any]:
    """A smooth texture, moved to the right by so many pixels."""
    return as_type(0.5 + 0.4 * moved_waves((height, width), position, seed=3), dtype)


def scored(number: int, psnr: float = 30.0, mae: float = 1.0, cpu_seconds: float = 0.1) -> FrameResult:
    """The result of a frame."""
    return FrameResult(number, Scores(mae**2, psnr, 0.9, mae), 0.1, cpu_seconds, {}, {})
