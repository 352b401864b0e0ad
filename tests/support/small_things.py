"""Things of a few pixels that move by many, before flat and textured ground, and how much of each a middle shows.

``python tests/support/small_things.py METHOD,METHOD`` prints a table of methods.
"""

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import interpolate

Array = NDArray[Any]

HEIGHT, WIDTH = 240, 384
MARGIN = 4  # of the ground around the frame, as far as it pans
SAMPLES = 4  # of a thing along each axis of a pixel
REACH = 36  # of a thing around its middle, pixels

COLOURS = (12, 14, 16), (235, 238, 230), (30, 40, 190), (60, 220, 235)
"""Of the things: dark, bright, red, yellow; each stands out from the ground."""


def is_rod(x: Array, y: Array, width: float, t: float) -> Array:
    """Leaning a little, sixty pixels long."""
    return (np.abs(x + 0.2 * y) < width / 2) & (np.abs(y) < 30)


def is_note(x: Array, y: Array, width: float, t: float) -> Array:
    """A head, a stem and a flag, as high as the note is wide."""
    x, y = x / width, y / width
    head = ((x + 0.2) / 0.3) ** 2 + ((y - 0.28) / 0.22) ** 2 < 1
    stem = (np.abs(x - 0.04) < 0.09) & (np.abs(y) < 0.5)
    flag = (x > 0) & (x < 0.45) & (np.abs(y + 0.35 - 0.4 * x) < 0.12)
    return head | stem | flag


def is_ball(x: Array, y: Array, width: float, t: float) -> Array:
    """A plain disc."""
    return np.hypot(x, y) < width / 2


def is_bird(x: Array, y: Array, width: float, t: float) -> Array:
    """A body and two wings, whose tips fall by half of the bird's width."""
    x, y = np.abs(x) / width, y / width
    body = (x / 0.14) ** 2 + (y / 0.24) ** 2 < 1
    wings = (x < 0.5) & (np.abs(y + (0.5 - t) * x) < 0.17 - 0.2 * x)
    return body | wings


KINDS: dict[str, Callable[[Array, Array, float, float], Array]] = {
    "rod": is_rod,
    "note": is_note,
    "ball": is_ball,
    "bird": is_bird,
}
"""Which places, from the middle of a thing of a width at a time, belong to it."""


@lru_cache(maxsize=4)
def draw_ground(seed: int, textured: bool) -> Array:
    """Detail at every scale, or next to none, on a slope of light; larger than the frame."""
    size = HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN
    random = np.random.default_rng(seed)
    scales = [cv2.GaussianBlur(random.standard_normal((*size, 3)), (0, 0), s) * s for s in (1, 3, 9)]
    y, x, _ = np.mgrid[: size[0], : size[1], :1]
    return 128 + (x - y) / 60 + (26 if textured else 0.4) * sum(scales) / np.std(sum(scales))


@dataclass(frozen=True)
class SmallThing:
    """A thing that moves over a ground.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    textured : bool
        Whether the ground has texture.
    width : int
        Pixels: the thickness of a rod, the whole size of all others.
    motion : (dx, dy)
        From the first frame to the second, pixels.
    seed : int
        Of the ground, its motion, and the colour of the thing.
    """

    kind: str
    textured: bool
    width: int
    motion: tuple[float, float]
    seed: int

    def ground(self, t: float) -> Array:
        """The ground at time t, (H, W, 3) from 0 to 255: at rest, or panning by whole pixels in half of the time."""
        pan = np.random.default_rng([self.seed, 1]).integers(-2, 3, 2) * (self.seed % 2)
        top, left = (MARGIN + np.rint((2 * t - 1) * pan)).astype(int)
        return draw_ground(self.seed, self.textured)[top : top + HEIGHT, left : left + WIDTH]

    def cover(self, t: float) -> Array:
        """How much of each pixel the thing covers at time t, (H, W) from 0 to 1."""
        middle = np.array([HEIGHT, WIDTH]) / 2 + (t - 0.5) * np.array(self.motion[::-1])
        top, left = middle.astype(int) - REACH
        places = (np.mgrid[: 2 * REACH * SAMPLES, : 2 * REACH * SAMPLES] + 0.5) / SAMPLES
        y, x = places + np.array([top, left])[:, np.newaxis, np.newaxis] - middle[:, np.newaxis, np.newaxis]
        inside = KINDS[self.kind](x, y, self.width, t).astype(np.float64)
        cover = np.zeros((HEIGHT, WIDTH))
        shape = 2 * REACH, SAMPLES, 2 * REACH, SAMPLES
        cover[top : top + 2 * REACH, left : left + 2 * REACH] = inside.reshape(shape).mean(axis=(1, 3))
        return cover

    def at(self, t: float) -> Array:
        """The frame at time t, uint8."""
        cover = self.cover(t)[..., np.newaxis]
        colour = np.array(COLOURS[self.seed % len(COLOURS)])
        return np.rint(self.ground(t) * (1 - cover) + colour * cover).clip(0, 255).astype(np.uint8)


def small_things(widths: tuple[int, ...], lengths: tuple[int, ...], seeds: int) -> Iterator[SmallThing]:
    """Every kind before either ground, in every width, by every length of motion; no two move the same way."""
    for kind, textured, width, length, seed in product(KINDS, (False, True), widths, lengths, range(seeds)):
        number = 37 * seed + 5 * widths.index(width) + lengths.index(length)
        motion = length * np.cos(2.4 * number), length * np.sin(2.4 * number)
        yield SmallThing(kind, textured, width, motion, number)


class Shown(NamedTuple):
    """What a middle shows of a thing."""

    psnr: float
    """Within four pixels of where the thing is at the times 0, 1/2 and 1, dB."""
    share: float
    """Of the thing that is there: 1 as in the truth, 0 as if there were only the ground."""


def shown(thing: SmallThing, method: str) -> Shown:
    """Compare the middle that a method makes with the truth."""
    image = interpolate(thing.at(0), thing.at(1), method=method)
    truth, ground, cover = thing.at(0.5).astype(float), thing.ground(0.5), thing.cover(0.5)
    path = np.maximum(cover, np.maximum(thing.cover(0), thing.cover(1)))
    around = cv2.dilate(path, np.ones((9, 9), np.uint8)) > 0
    squared = np.mean((image[around] - truth[around]) ** 2)
    own = (truth - ground) * (cover[..., np.newaxis] > 0)
    return Shown(10 * np.log10(255**2 / max(squared, 0.1)), np.sum((image - ground) * own) / np.sum(own**2))


def shown_by_kind(things: Iterator[SmallThing], methods: tuple[str, ...]) -> dict[tuple[str, bool], list[Array]]:
    """By kind and ground, and for each method, what it shows of each thing, (things, 2)."""
    rows: dict[tuple[str, bool], list[list[Shown]]] = defaultdict(lambda: [[] for _ in methods])
    for thing in things:
        for of_method, method in zip(rows[thing.kind, thing.textured], methods, strict=True):
            of_method.append(shown(thing, method))
    return {key: [np.array(of_method) for of_method in row] for key, row in rows.items()}


def main() -> None:
    """Print what each method shows of each kind: dB, the share, and how many things are hardly there."""
    parser = argparse.ArgumentParser(description="How much of small things that move fast is there half-way?")
    parser.add_argument("methods", nargs="?", default="nlm,nlm-fast,dis,blend", help="(default: %(default)s)")
    methods = tuple(parser.parse_args().methods.split(","))
    things = small_things((3, 5, 7, 10), (6, 12, 24, 40, 58), 2)
    for (kind, textured), row in shown_by_kind(things, methods).items():
        print(f"{kind:5s} {'textured' if textured else 'flat':9s}", end="")
        for method, found in zip(methods, row, strict=True):
            psnr, share = found.mean(axis=0)
            print(f"{method:>10s} {psnr:6.2f} {share:5.2f} {sum(found[:, 1] < 0.5):3d}/{len(found)}", end="")
        print()


if __name__ == "__main__":
    main()
