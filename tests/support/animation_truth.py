"""Animation files written and read by Pillow, which shares no code with the package."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image


class Seen(NamedTuple):
    """A whole picture, BGRA, and how many milliseconds it is shown."""

    image: NDArray[np.uint8]
    delay: float


def write_animation(
    path: Path, images: Sequence[NDArray[Any]], delays: int | Sequence[int] = 40, **options: Any
) -> Path:
    """Write BGR or BGRA images, shown for milliseconds each; `options` are Pillow's."""
    first, *others = [
        Image.fromarray(cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA if image.shape[2] == 4 else cv2.COLOR_BGR2RGB))
        for image in images
    ]
    kind = {".gif": "GIF", ".webp": "WEBP"}.get(path.suffix, "PNG")
    if kind == "WEBP":
        options = {"lossless": True, "exact": True, **options}
    duration = delays if isinstance(delays, int) else list(delays)
    first.save(path, kind, save_all=True, append_images=others, duration=duration, **options)
    return path


def read_animation(path: Path) -> list[Seen]:
    """All pictures of a file."""
    with Image.open(path) as file:
        seen = []
        for index in range(file.n_frames):
            file.seek(index)
            image = cv2.cvtColor(np.asarray(file.convert("RGBA")), cv2.COLOR_RGBA2BGRA)
            seen.append(Seen(image, file.info["duration"]))
        return seen


def plays_of(path: Path) -> int:
    """How often a file is to be played, as players count; 0 for ever again."""
    with Image.open(path) as file:
        loop: int | None = file.info.get("loop")
        if path.suffix == ".gif":
            return 1 if loop is None else loop + 1 if loop else 0
        return loop or 0


def disc(index: int, hidden: int = 0) -> NDArray[np.uint8]:
    """A soft-edged orange disc that moves four pixels a frame over transparency with some colour that nobody sees."""
    rows, columns = np.mgrid[0:48, 0:64]
    alpha = np.clip(14.5 - np.hypot(columns - 16 - 4 * index, rows - 24), 0, 1)
    image = np.full((48, 64, 4), hidden, np.uint8)
    image[alpha > 0, :3] = (40, 120, 240)
    image[..., 3] = np.rint(alpha * 255)
    return image
