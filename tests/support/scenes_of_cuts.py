"""Constructed shots and how one follows another: cuts, and all that only looks like one.

A scenery is a large picture of one kind, a camera sees a moving part of it, and something may move in front. Clips are
shots joined by cuts, fades, dissolves; or one shot with a flash, a whip pan, a shake... All frames are 144x80 BGR.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
HEIGHT, WIDTH = 80, 144
CANVAS = 480, 864  # height and width of a scenery: six frames of it beside each other at zoom 1


class Clip(NamedTuple):
    """Frames, and the pairs that are cuts: pair k leads from frame k to k + 1."""

    name: str
    frames: list[Array]
    cuts: set[int]


def smooth(random: np.random.Generator) -> Array:
    """Hills and clouds: noise of several sizes, each colour its own."""
    canvas = np.zeros((*CANVAS, 3), np.float32)
    for cells, strength in ((5, 0.5), (11, 0.35), (29, 0.25), (73, 0.12)):
        coarse = random.random((cells, cells * 9 // 5, 1)) * 0.7 + random.random((cells, cells * 9 // 5, 3)) * 0.3
        canvas += strength * cv2.resize(coarse.astype(np.float32) - 0.5, CANVAS[::-1], interpolation=cv2.INTER_CUBIC)
    return canvas + colour(random, 0.35, 0.65)


def edges(random: np.random.Generator) -> Array:
    """A town: polygons of all colours over each other."""
    canvas = np.full((*CANVAS, 3), colour(random), np.float32)
    for _ in range(260):
        centre = random.uniform((0, 0), CANVAS[::-1])
        corners = centre + random.normal(0, 32, (random.integers(3, 6), 2))
        cv2.fillPoly(canvas, [corners.astype(np.int32)], colour(random))
    return canvas


def people(random: np.random.Generator) -> Array:
    """A room with people: flat walls with a shade, furniture, heads and bodies."""
    canvas = np.full((*CANVAS, 3), colour(random, 0.3, 0.7), np.float32)
    canvas *= np.linspace(*random.uniform(0.7, 1.3, 2), CANVAS[1], dtype=np.float32)[:, np.newaxis]
    for _ in range(40):
        x, y, w, h = (int(each) for each in random.uniform((0, 0, 20, 20), (*CANVAS[::-1], 120, 90)))
        cv2.rectangle(canvas, (x, y), (x + w, y + h), colour(random), -1)
    for _ in range(45):
        x, y = (int(each) for each in random.uniform((0, 0), CANVAS[::-1]))
        size = int(random.uniform(8, 20))
        cv2.ellipse(canvas, (x, y + 3 * size), (int(1.6 * size), 2 * size), 0, 0, 360, colour(random), -1)
        cv2.ellipse(canvas, (x, y), (size * 3 // 4, size), 0, 0, 360, (0.45, 0.6, 0.85), -1)
        cv2.ellipse(canvas, (x, y - size // 2), (size * 3 // 4, size // 2), 0, 0, 360, colour(random, 0, 0.4), -1)
    return canvas


def fine(random: np.random.Generator) -> Array:
    """Foliage and fences: detail of a few pixels over patches of middling colours."""
    canvas = 0.45 * smooth(random) + 0.25
    grain = random.normal(0, 1, CANVAS).astype(np.float32)
    y, x = np.mgrid[: CANVAS[0], : CANVAS[1]]
    fence = np.sin(2 * np.pi * (x + 0.2 * y) / random.uniform(8, 14)) > 0.3
    detail = 0.3 * cv2.GaussianBlur(grain, (0, 0), 1.2) + 0.12 * (fence & (y % 170 > 85))
    return canvas + detail[..., np.newaxis].astype(np.float32)


def dark(random: np.random.Generator) -> Array:
    """A night with a few lamps."""
    canvas = 0.14 * people(random)
    for _ in range(70):
        x, y = (int(each) for each in random.uniform((0, 0), CANVAS[::-1]))
        cv2.circle(canvas, (x, y), int(random.uniform(2, 7)), colour(random, 0.5, 1), -1)
    return cv2.GaussianBlur(canvas, (0, 0), 1)


def fog(random: np.random.Generator) -> Array:
    """Little contrast around one gray, but still something to be seen."""
    picture = (people if random.random() < 0.5 else edges)(random)
    return 0.3 * (picture - 0.5) + np.float32(random.uniform(0.4, 0.75))


def cartoon(random: np.random.Generator) -> Array:
    """Flat colours with black outlines: a ground, a sky, a few large figures."""
    canvas = np.full((*CANVAS, 3), colour(random, 0.5, 1), np.float32)
    cv2.rectangle(canvas, (0, int(CANVAS[0] * random.uniform(0.4, 0.7))), CANVAS[::-1], colour(random), -1)
    for _ in range(70):
        centre = tuple(int(each) for each in random.uniform((0, 0), CANVAS[::-1]))
        axes = tuple(int(each) for each in random.uniform(10, 50, 2))
        angle = random.uniform(0, 180)
        cv2.ellipse(canvas, centre, axes, angle, 0, 360, colour(random), -1)
        cv2.ellipse(canvas, centre, axes, angle, 0, 360, (0.05, 0.05, 0.05), 3)
    return canvas


SCENERIES = (smooth, edges, people, fine, dark, fog, cartoon)


def colour(random: np.random.Generator, low: float = 0.0, high: float = 1.0) -> tuple[float, float, float]:
    """One colour, blue first: a gray between the two and a tint."""
    values = random.uniform(low, high) + random.normal(0, 0.15 * (high - low), 3)
    blue, green, red = (float(each) for each in values.clip(low, high))
    return blue, green, red


@dataclass(frozen=True)
class Shot:
    """A camera over a scenery: `frame(k)` is what it sees at time k."""

    canvas: Array
    place: tuple[float, float]  # of the frame's centre at time 0, pixels of the canvas
    path: Callable[[float], tuple[float, float, float, float]]  # the camera's move since: dx, dy, zoom, degrees
    shutter: float = 0.3  # how long a frame is exposed, of the time to the next
    actor: Callable[[float, Array], None] | None = None  # draws into the frame at a time what moves in front
    bars: int = 0  # rows of black at top and bottom
    noise: float = 0.008  # deviation of the camera's noise, with 1 for white
    seed: int = 0

    def frame(self, t: float) -> Array:
        """Float32, with 1 for white."""
        speed = np.hypot(*np.subtract(self.path(t + 0.5)[:2], self.path(t - 0.5)[:2]))
        moments = max(1, min(12, round(self.shutter * speed)))
        seen = [self._seen(t + self.shutter * (k / moments - 0.5)) for k in range(moments)]
        image = np.mean(seen, axis=0, dtype=np.float32)
        image += np.random.default_rng((self.seed, int(1000 * t))).normal(0, self.noise, image.shape)
        if self.bars:
            image[: self.bars] = image[-self.bars :] = 0
        return image.clip(0, 1)

    def _seen(self, t: float) -> Array:
        dx, dy, zoom, degrees = self.path(t)
        matrix = cv2.getRotationMatrix2D((self.place[0] + dx, self.place[1] + dy), degrees, zoom)
        matrix[:, 2] += (WIDTH / 2 - self.place[0] - dx, HEIGHT / 2 - self.place[1] - dy)
        flags = cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR
        image = cv2.warpAffine(self.canvas, matrix, (WIDTH, HEIGHT), flags=flags, borderMode=cv2.BORDER_REFLECT_101)
        if self.actor is not None:
            self.actor(t, image)
        return image

    def frames(self, count: int, start: float = 0) -> list[Array]:
        """So many of them."""
        return [self.frame(start + k) for k in range(count)]


def make_shot(random: np.random.Generator, canvas: Array | None = None, **how: Any) -> Shot:
    """A usual one: a camera that pans, zooms or rests over some scenery, now and then with bars."""
    if canvas is None:
        canvas = SCENERIES[random.integers(len(SCENERIES))](random)
    speed, heading = random.uniform(1.5, 5), random.uniform(0, 2 * np.pi)
    dx, dy, zoom = speed * np.cos(heading), speed * np.sin(heading), random.uniform(-0.012, 0.012)
    size = random.uniform(0.5, 1.1)
    usual: dict[str, Any] = {
        "place": tuple(random.uniform((150, 100), (CANVAS[1] - 150, CANVAS[0] - 100))),
        "path": lambda t: (dx * t, dy * t, size * (1 + zoom * t), 0.0),
        "bars": 10 if random.random() < 0.2 else 0,
        "seed": int(random.integers(1 << 30)),
    }
    return Shot(canvas, **{**usual, **how})


def exposed(frames: list[Array], mean: float) -> list[Array]:
    """The same light for all, such that the first has this mean."""
    gain = mean / max(0.02, float(frames[0].mean()))
    return [(frame * gain).clip(0, 1) for frame in frames]


def joined(name: str, *shots: list[Array]) -> Clip:
    """Shots with hard cuts between them."""
    frames = [frame for shot in shots for frame in shot]
    ends = np.cumsum([len(shot) for shot in shots])[:-1]
    return Clip(name, frames, {int(end) - 1 for end in ends})


def hard_cuts(random: np.random.Generator) -> Clip:
    """Between any two sceneries, of any brightness."""
    return joined("hard cuts", *(make_shot(random).frames(4) for _ in range(3)))


def equally_bright(random: np.random.Generator) -> Clip:
    """Between sceneries of one mean."""
    mean = random.uniform(0.25, 0.6)
    return joined("equally bright", *(exposed(make_shot(random).frames(4), mean) for _ in range(3)))


def other_angles(random: np.random.Generator) -> Clip:
    """The same room or landscape from places that share nothing, with the same palette and bars."""
    canvas = SCENERIES[random.integers(len(SCENERIES))](random)
    bars = 10 if random.random() < 0.3 else 0
    places = ((140, 120), (430, 340), (720, 120))
    order = random.permutation(3)
    return joined(
        "other angles", *(make_shot(random, canvas, place=places[each], bars=bars).frames(4) for each in order)
    )


def rapid(random: np.random.Generator) -> Clip:
    """Shots of two and three frames, between two longer ones."""
    lengths = 4, *random.integers(2, 4, 5), 4
    return joined("rapid", *(make_shot(random).frames(int(each)) for each in lengths))


def slides(random: np.random.Generator) -> Clip:
    """A talk's slides: each stands still for a third of a second, and all share a white ground, a header and a foot."""
    header = colour(random, 0.1, 0.8)

    def slide() -> Array:
        page = np.full((HEIGHT, WIDTH, 3), 0.97, np.float32)
        page[:9] = header
        page[-4:] = 0.8
        for _ in range(random.integers(2, 5)):
            x, y, w, h = (int(each) for each in random.uniform((4, 14, 30, 12), (90, 45, 70, 30)))
            kind = random.random()
            if kind < 0.55:
                for row in range(y, y + h, 5):
                    page[row : row + 2, x : x + int(w * random.uniform(0.5, 1))] = 0.25
            else:
                page[y : y + h, x : x + w] = colour(random)
        return page

    return joined("slides", *([slide()] * 8 for _ in range(3)))


def through_black(random: np.random.Generator) -> Clip:
    """A fade to black or white, some frames of it, and a fade to another shot: no cut anywhere."""
    first, second = make_shot(random), make_shot(random)
    steps = int(random.integers(8, 16))
    ground = np.float32(random.random() < 0.3)
    lights = np.linspace(1, 0, steps)
    out = [light * first.frame(k) + (1 - light) * ground for k, light in enumerate(lights)]
    back = [light * second.frame(k) + (1 - light) * ground for k, light in enumerate(lights[::-1])]
    return Clip("fades", [*out, *[np.full_like(out[0], ground)] * 3, *back], set())


def dissolve(random: np.random.Generator) -> Clip:
    """One shot becomes another over six frames and more."""
    first, second = make_shot(random), make_shot(random)
    shares = [0.0, 0.0, *np.linspace(0, 1, int(random.integers(6, 16)) + 1), 1.0, 1.0]
    return Clip("dissolves", [(1 - b) * first.frame(k) + b * second.frame(k) for k, b in enumerate(shares)], set())


def flash(random: np.random.Generator) -> Clip:
    """A photographer's in one frame, which may burn out all of it, or lightning, which dies away over two or three."""
    frames = make_shot(random).frames(10)
    lasts = int(random.integers(1, 4))
    strength, added = random.uniform(0.3, 3 if lasts == 1 else 1.2), random.uniform(0, 0.5 if lasts == 1 else 0.2)
    for k in range(lasts):
        frames[4 + k] = (frames[4 + k] * (1 + strength * 0.6**k) + added * 0.6**k).clip(0, 1)
    return Clip("flashes", frames, set())


def whip_pan(random: np.random.Generator) -> Clip:
    """The camera is thrown around by up to a quarter of the width a frame, and comes to rest."""
    fastest = random.uniform(0.1, 0.25) * WIDTH * random.choice((-1, 1))
    lasts, slant = random.uniform(3, 8), random.uniform(-0.2, 0.2)

    def path(t: float) -> tuple[float, float, float, float]:
        # speed rises and falls as one arch of a cosine between the times 3 and 3 + lasts
        u = min(max((t - 3) / lasts, 0), 1)
        way = fastest * lasts * (u - np.sin(2 * np.pi * u) / (2 * np.pi)) / 2
        return way, slant * way, 1.0, 0.0

    start = 150 if fastest > 0 else CANVAS[1] - 150
    return Clip("whip pans", make_shot(random, place=(start, 240), path=path, shutter=0.5).frames(14), set())


def zoom(random: np.random.Generator) -> Clip:
    """Up to a sixth larger or smaller each frame, and turned."""
    rate, turn = random.uniform(0.86, 1.16), random.uniform(-4, 4)
    size = 0.7 if rate > 1 else 1.6
    path = lambda t: (0.0, 0.0, size * rate**t, turn * t)  # noqa: E731
    return Clip("zooms", make_shot(random, path=path).frames(6), set())


def fast(random: np.random.Generator, **how: Any) -> Shot:
    """A camera that pans by a tenth to a quarter of the width with every frame, and hardly faster or slower."""
    speed, heading = random.uniform(0.1, 0.25) * WIDTH, random.choice((0, np.pi)) + random.uniform(-0.3, 0.3)
    dx, dy, swing = speed * np.cos(heading), speed * np.sin(heading), random.uniform(0, 0.3)
    path = lambda t: (dx * (t + swing * np.sin(2 * t)), dy * t, 1.0, 0.0)  # noqa: E731
    start = 180 if dx > 0 else CANVAS[1] - 180
    return make_shot(random, place=(start, 240), path=path, shutter=random.uniform(0.2, 0.7), bars=0, **how)


def tracking(random: np.random.Generator) -> Shot:
    """A camera that follows something among trees: trunks and leaves pass in front, several times as fast."""
    speed = random.uniform(0.08, 0.3) * WIDTH * random.choice((-1, 1))
    leaves = fine(random)
    trunks = [(random.uniform(0, 4 * WIDTH), random.uniform(4, 22), colour(random, 0.05, 0.4)) for _ in range(14)]
    crowns = [(*random.uniform((0, -10), (4 * WIDTH, 30)), random.uniform(10, 28)) for _ in range(10)]
    body = colour(random, 0.3, 1)

    def actor(t: float, image: Array) -> None:
        for x, width, shade in trunks:
            left = (x + speed * t) % (4 * WIDTH) - width
            cv2.rectangle(image, (round(left), 0), (round(left + width), HEIGHT), shade, -1)
        for x, y, size in crowns:
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            left = (x + speed * t) % (4 * WIDTH) - size
            cv2.circle(mask, (round(left), round(y)), round(size), 255, -1)
            shifted = leaves[100 : 100 + HEIGHT, int(300 - left) % 500 :][:, :WIDTH]
            image[mask > 0] = 0.6 * shifted[mask > 0]
        cv2.ellipse(image, (WIDTH // 2, HEIGHT // 2), (8, 16), 10 * np.sin(2 * t), 0, 360, body, -1)

    pan = 0.3 * speed
    path = lambda t: (-pan * t, 2 * np.sin(1.3 * t), 1.0, 0.0)  # noqa: E731
    start = CANVAS[1] - 200 if pan > 0 else 200
    return make_shot(random, place=(start, 240), path=path, actor=actor, shutter=0.6, bars=0)


def one_shot_or_more(name: str, make: Callable[[np.random.Generator], Shot]) -> Callable[[np.random.Generator], Clip]:
    """Shots of one kind with cuts between them, or one of them alone."""

    def clip(random: np.random.Generator) -> Clip:
        return joined(name, *(make(random).frames(5) for _ in range(random.integers(1, 4))))

    return clip


KINDS = (
    *(hard_cuts, equally_bright, other_angles, rapid, slides, through_black, dissolve, flash, whip_pan, zoom),
    one_shot_or_more("fast pans", fast),
    one_shot_or_more("among trees", tracking),
)


def make_clips(count: int, seed: int = 0) -> Iterator[Clip]:
    """So many clips of each kind, with frames of 8 bits."""
    for number, kind in enumerate(KINDS):
        for index in range(count):
            clip = kind(np.random.default_rng((seed, number, index)))
            yield clip._replace(frames=[np.rint(255 * frame.clip(0, 1)).astype(np.uint8) for frame in clip.frames])
