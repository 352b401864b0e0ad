"""Construct clips whose in-between frames are known: ``python samples/construct_clips.py OUT``.

Each clip is a function of time that is drawn anew for every frame, so that a frame which is hidden from a method is not
an estimate of what was there but the truth: ``OUT/CLIP/0000.png`` and so on. ``constructed/`` holds the clips, one kind
a file. They are drawn from noise with fixed seeds, at several samples a pixel.

Needs numpy and OpenCV.
"""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from constructed.catalogue import clips
from constructed.layers import Clip, Show
from constructed.raster import Array, Raster, to_bytes

Size = tuple[int, int]  # width, height
FRAMES_PER_PAIR = 2
SHUTTER = 0.5  # the part of the time from frame to frame in which light comes in, where there is motion blur


def expose(clip: Clip, show: Show, raster: Raster, number: int) -> Array:
    """Draw frame `number` as the lens sees it, (height, width, 3) RGB from 0 to 1."""
    total: Array = np.zeros((raster.height, raster.width, 3), np.float32)
    for i in range(clip.subframes):
        late = SHUTTER * ((i + 0.5) / clip.subframes - 0.5)
        picture = np.clip(show((number + late) / FRAMES_PER_PAIR), 0, 1)
        total += cv2.resize(picture, (raster.width, raster.height), interpolation=cv2.INTER_AREA)
    picture = total / np.float32(clip.subframes)
    return cv2.GaussianBlur(picture, (0, 0), clip.blur) if clip.blur else picture


def construct(name: str, size: Size, numbers: Iterator[int] | range, seed: int = 0) -> Iterator[Array]:
    """Draw frames of a clip, (height, width, 3) BGR uint8 each."""
    clip = clips[name]
    clip = replace(clip, blur=clip.blur * size[0] / 480)
    raster = Raster(*size, clip.supersampling)
    key = [seed, zlib.crc32(name.encode())]
    show = clip.make(np.random.default_rng(key), raster)
    for number in numbers:
        picture = expose(clip, show, raster, number)
        # each frame has noise of its own, whichever others are drawn
        grain = np.random.default_rng([*key, number]).standard_normal(picture.shape, dtype=np.float32)
        yield to_bytes(picture + grain * np.float32(clip.noise / 255))[..., ::-1]


def read_size(text: str) -> Size:
    """Read ``480x270``."""
    width, height = (int(part) for part in text.split("x"))
    return width, height


def main() -> None:
    """Construct what the command line asks for."""
    parser = argparse.ArgumentParser(description="Construct clips whose in-between frames are known.")
    parser.add_argument("out", type=Path, help="folder that takes a folder for each clip")
    parser.add_argument("--only", choices=list(clips), action="append", help="only this clip; may be repeated")
    parser.add_argument("--frames", type=int, default=9, help="how many (default: %(default)s)")
    parser.add_argument("--size", type=read_size, default=(480, 270), help="WIDTHxHEIGHT (default: 480x270)")
    parser.add_argument("--seed", type=int, default=0, help="another seed, other textures (default: %(default)s)")
    options = parser.parse_args()
    for name in options.only or clips:
        folder = options.out / name
        folder.mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(construct(name, options.size, range(options.frames), options.seed)):
            cv2.imwrite(str(folder / f"{number:04d}.png"), picture)
        print(name, flush=True)


if __name__ == "__main__":
    main()
