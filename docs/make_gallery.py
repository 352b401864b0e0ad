"""Make the gallery of the documentation: ``python docs/make_gallery.py``, into ``docs/figures/`` and ``docs/gallery/``.

Animations of the rendered samples before and after, which are kept in the repository, and a comparison page of each,
which is not: the site shows those that are there when it is built. Needs an installed fpsboost; takes about a minute.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import fpsboost

Picture = NDArray[Any]
"""(H, W, 3) uint8, BGR."""

ROOT = Path(__file__).parents[1]
SCENES, FIGURES, GALLERY = ROOT / "samples" / "scenes", ROOT / "docs" / "figures", ROOT / "docs" / "gallery"

FRAMES = 13
"""Frames of the source."""

FACTOR = 4
"""Frames for each of the source."""

RATE = 6
"""Frames a second of the source; a quarter of its own, so that its steps are seen one by one."""

QUALITY = 88
"""WebP quality of the animations: below some 85, blocks of the compression are taken for faults of the method."""

GAP, LABEL, TEXT = 8, 22, 13
"""Between both sides, height of a label, and size of its text, pixels."""


def main() -> None:
    """Make an animation and a comparison page of each scene, and print the size of each file."""
    GALLERY.mkdir(exist_ok=True)
    for folder in sorted(SCENES.iterdir()):
        for path in (draw_animation(folder), write_page(folder)):
            print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def draw_animation(scene: Path) -> Path:
    """Draw frames of a scene beside what is made of them."""
    rendered = [cv2.imread(str(path)) for path in sorted(scene.glob("*.png"))[:FRAMES]]
    after = list(fpsboost.stream(rendered, factor=FACTOR))[: 1 - FACTOR]  # all but repetitions of the last one
    before = [rendered[index // FACTOR] for index in range(len(after))]
    frames = [
        side_by_side(labelled(left, f"rendered: {RATE} frames a second"), labelled(right, f"fpsboost: {FACTOR * RATE}"))
        for left, right in zip(before, after, strict=True)
    ]
    pause = 1000 // RATE
    return save_animation(scene.name, frames, [1000 // (FACTOR * RATE)] * (len(frames) - 1) + [pause])


def save_animation(name: str, frames: list[Image.Image], durations: list[int]) -> Path:
    """Save pictures, each shown for milliseconds, as a WebP that plays for ever; return its path."""
    path = FIGURES / f"{name}.webp"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=QUALITY, method=6)
    return path


def labelled(picture: Picture, label: str) -> Image.Image:
    """Return a picture with a label in its lower left corner."""
    image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    font = ImageFont.load_default(TEXT)
    draw = ImageDraw.Draw(image, "RGBA")
    top = image.height - LABEL
    draw.rectangle((0, top, int(draw.textlength(label, font)) + 16, image.height), fill=(0, 0, 0, 160))
    draw.text((8, top + LABEL // 2), label, fill="white", font=font, anchor="lm")
    return image


def side_by_side(left: Image.Image, right: Image.Image) -> Image.Image:
    """Return two pictures with a transparent gap between them."""
    both = Image.new("RGBA", (left.width + GAP + right.width, left.height))
    both.paste(left, (0, 0))
    both.paste(right, (left.width + GAP, 0))
    return both


def write_page(scene: Path) -> Path:
    """Write the comparison page of a scene, in place of an older one."""
    folder = GALLERY / scene.name
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "fpsboost", "compare", str(scene), "--input-fps", "24", "--report", str(folder)]
    subprocess.run([*command, "-m", "nlm,dis,blend", "--quiet"], check=True)
    return folder / "index.html"


if __name__ == "__main__":
    main()
