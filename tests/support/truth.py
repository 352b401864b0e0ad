"""Constructed clips whose motion and in-between frames are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair

Array = NDArray[Any]

SCENES = Path(__file__).parents[2] / "samples" / "scenes"
needs_scenes = pytest.mark.skipif(not SCENES.is_dir(), reason="the source distribution has no rendered scenes")


@dataclass(frozen=True)
class Clip:
    """Two frames, what moves where, and the true frame at any time between.

    Attributes
    ----------
    image0, image1 : (H, W, C), read-only
    flow01, flow10 : (H, W, 2) float64
        Exact motion, ``(dx, dy)``.
    seen0, seen1 : (H, W) bool
        Pixels of frame 0 (1) whose counterpart is visible in the other frame.
    at : callable
        ``at(t)`` is the true frame at time t.
    """

    image0: Array
    image1: Array
    flow01: Array
    flow10: Array
    seen0: Array
    seen1: Array
    at: Callable[[float], Array]

    @property
    def prepared(self) -> tuple[FrameCache, FrameCache]:
        """Both frames as estimators take them, nothing remembered of them yet."""
        return FrameCache(self.image0), FrameCache(self.image1)


def prepared(*images: Array) -> list[FrameCache]:
    """The images as estimators take them, nothing remembered of them yet."""
    return [FrameCache(image) for image in images]


class CutsWhere:
    """Cut policy that takes every pair for a cut of which a function of its two frames is true."""

    def __init__(self, is_cut: Callable[[FrameCache, FrameCache], bool]) -> None:
        self._is_cut = is_cut

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        return float(not self._is_cut(image0, image1))

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        return match_score == 0

    def is_gradual(self, *match_scores: float) -> bool:
        return False

    is_flash = is_gradual


def frozen(image: Array) -> Array:
    """The same image, safe from being written to."""
    image = np.ascontiguousarray(image)
    image.flags.writeable = False
    return image


def as_type(values: Array, dtype: type) -> Array:
    """Colours in [0, 1] as an image of a type."""
    if dtype is np.float32:
        return frozen(values.astype(np.float32))
    return frozen(np.rint(values.clip(0, 1) * np.iinfo(dtype).max).astype(dtype))


def white_of(image: Array) -> float:
    """The value of white in images of this type."""
    return 1 if image.dtype == np.float32 else np.iinfo(image.dtype).max


def equal_luma(blue: Array, red: Array, luma: float = 0.5) -> Array:
    """Colours in BGR with these differences of blue and red from the luma, (H, W): pictures of one level in gray."""
    blue, red = blue + luma, red + luma
    return np.dstack([blue, (luma - 0.114 * blue - 0.299 * red) / 0.587, red])


def noise(height: int, width: int, channels: int = 3, dtype: type = np.uint8, seed: int = 0) -> Array:
    """Every pixel a colour of its own: no two patches alike."""
    return as_type(np.random.default_rng(seed).random((height, width, channels)), dtype)


def waves(x: Array, y: Array, channels: int = 3, seed: int = 0) -> Array:
    """A smooth texture in [0, 1], defined between the pixels too: plane waves 7 to 40 pixels long.

    Places are a grid that may be shifted, zoomed, turned or sheared. There the phase of a wave is a part that hangs on
    the row plus one that hangs on the column, and the sine of such sums over all places is a product of matrices.
    """
    random = np.random.default_rng(seed)
    lengths, angles, phases = random.uniform(0, 1, (channels, 12, 3)).transpose(2, 0, 1)[..., np.newaxis]
    lengths, angles, phases = 7 + 33 * lengths, 2 * np.pi * angles, 2 * np.pi * phases
    for places in (x, y):
        assert np.abs(places[:, :1] + places[:1] - places[0, 0] - places).max() < 1e-9
    down, across = (
        2 * np.pi * (places_x * np.cos(angles) + places_y * np.sin(angles)) / lengths
        for places_x, places_y in ((x[:, 0], y[:, 0]), (x[0] - x[0, 0], y[0] - y[0, 0]))
    )
    down = (down + phases).swapaxes(1, 2)
    values = np.sin(down) @ np.cos(across) + np.cos(down) @ np.sin(across)
    return np.clip(0.5 + np.moveaxis(values, 0, -1) / 14, 0, 1)


def moved_waves(size: tuple[int, int], dx: float = 0, dy: float = 0, channels: int = 3, seed: int = 0) -> Array:
    """The smooth texture of a picture of this size, (height, width), moved by (dx, dy)."""
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    return waves(x - dx, y - dy, channels, seed)


def affine(
    height: int,
    width: int,
    *,
    zoom: float = 1,
    degrees: float = 0,
    shift: tuple[float, float] = (0, 0),
    channels: int = 3,
    dtype: type = np.uint8,
    seed: int = 0,
) -> Clip:
    """A smooth texture that zooms and turns about the centre and shifts by ``(dx, dy)``, each point along a line."""
    y, x = np.mgrid[0:height, 0:width].astype(float)
    places = np.stack([x, y], axis=-1)
    centre, move = np.array([(width - 1) / 2, (height - 1) / 2]), np.array(shift, float)
    angle = np.radians(degrees)
    matrix = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def origin(t: float) -> Array:
        now = np.eye(2) + t * (matrix - np.eye(2))
        return (places - centre - t * move) @ np.linalg.inv(now).T + centre

    def at(t: float) -> Array:
        from_x, from_y = np.moveaxis(origin(t), -1, 0)
        return as_type(waves(from_x, from_y, channels, seed), dtype)

    flow01 = (places - centre) @ (matrix - np.eye(2)).T + move
    flow10 = origin(1) - places
    seen0, seen1 = (inside(places + flow, height, width) for flow in (flow01, flow10))
    return Clip(at(0), at(1), flow01, flow10, seen0, seen1, at)


def translation(
    height: int, width: int, dx: int, dy: int, channels: int = 3, dtype: type = np.uint8, seed: int = 0
) -> Clip:
    """Noise that moves by whole pixels, new noise coming in at the edges; `at` needs t that gives whole pixels."""
    margin = max(abs(dx), abs(dy))
    canvas = noise(height + 2 * margin, width + 2 * margin, channels, dtype, seed)

    def at(t: float) -> Array:
        top, left = margin - whole(t * dy), margin - whole(t * dx)
        return frozen(canvas[top : top + height, left : left + width])

    flow = np.broadcast_to(np.array([dx, dy], float), (height, width, 2))
    y, x = np.mgrid[0:height, 0:width].astype(float)
    places = np.stack([x, y], axis=-1)
    return Clip(
        at(0), at(1), flow, -flow, inside(places + flow, height, width), inside(places - flow, height, width), at
    )


def moving_object(height: int, width: int, *, box: tuple[int, int, int, int], dx: int, dy: int) -> Clip:
    """A rectangle of noise, ``box = (top, left, bottom, right)`` at time 0, moving over still noise."""
    background = noise(height, width)
    top, left, bottom, right = box
    thing = noise(bottom - top, right - left, seed=1)

    def covered(t: float) -> Array:
        mask = np.zeros((height, width), bool)
        mask[top + whole(t * dy) : bottom + whole(t * dy), left + whole(t * dx) : right + whole(t * dx)] = True
        return mask

    def at(t: float) -> Array:
        image = background.copy()
        image[covered(t)] = thing.reshape(-1, 3)
        return frozen(image)

    flow = np.array([dx, dy], float)
    flow01, flow10 = covered(0)[..., np.newaxis] * flow, covered(1)[..., np.newaxis] * -flow
    seen0, seen1 = covered(0) | ~covered(1), covered(1) | ~covered(0)
    return Clip(at(0), at(1), flow01, flow10, seen0, seen1, at)


def layers(
    height: int,
    width: int,
    *,
    box: tuple[float, float, float, float],
    shift: tuple[float, float],
    background: tuple[float, float] = (0, 0),
    bright: bool = False,
) -> Clip:
    """A smooth rectangle, ``box`` at time 0, that moves by `shift` over a smooth background with a motion of its own.

    The rectangle's outline is as soft as its pixels' share, so that any fraction of a pixel is exact. Both have the
    same contrast, or the rectangle is `bright` and the background dim.
    """
    y, x = np.mgrid[0:height, 0:width].astype(float)
    top, left, bottom, right = box

    def share(t: float) -> Array:
        down = np.minimum(y + 1, bottom + t * shift[1]) - np.maximum(y, top + t * shift[1])
        across = np.minimum(x + 1, right + t * shift[0]) - np.maximum(x, left + t * shift[0])
        return down.clip(0, 1) * across.clip(0, 1)

    def at(t: float) -> Array:
        behind = waves(x - t * background[0], y - t * background[1])
        front = waves(x - t * shift[0], y - t * shift[1], seed=1)
        covered = share(t)[..., np.newaxis]
        if bright:
            behind, front = 0.3 + 0.15 * behind, 0.6 + 0.4 * front
        return as_type(behind * (1 - covered) + front * covered, np.uint8)

    covered0, covered1 = share(0) > 0, share(1) > 0
    flow01, flow10 = np.empty((height, width, 2)), np.empty((height, width, 2))
    flow01[:], flow10[:] = background, np.negative(background)
    flow01[covered0], flow10[covered1] = shift, np.negative(shift)
    places = np.stack([x, y], axis=-1)
    seen0, seen1 = inside(places + flow01, height, width), inside(places + flow10, height, width)
    if background == (0, 0):
        seen0, seen1 = seen0 & (covered0 | ~covered1), seen1 & (covered1 | ~covered0)
    return Clip(at(0), at(1), flow01, flow10, seen0, seen1, at)


def accelerating(
    height: int, width: int, *, velocity: tuple[float, float], acceleration: tuple[float, float]
) -> Callable[[float], Array]:
    """A smooth texture at any time: moved by ``v t + a t^2 / 2``."""

    def at(t: float) -> Array:
        dx, dy = (v * t + a * t * t / 2 for v, a in zip(velocity, acceleration, strict=True))
        return as_type(moved_waves((height, width), dx, dy), np.uint8)

    return at


def inside(places: Array, height: int, width: int) -> Array:
    """Which of the (x, y) places lie in the frame."""
    x, y = np.moveaxis(places, -1, 0)
    return (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)


def eroded(mask: Array, by: int) -> Array:
    """The mask without its outermost pixels, the frame's border counting as outside."""
    padded = np.pad(mask, by)
    height, width = mask.shape
    shifted = [padded[i : i + height, j : j + width] for i in range(2 * by + 1) for j in range(2 * by + 1)]
    return np.logical_and.reduce(shifted)


def whole(value: float) -> int:
    """A value that must be a whole number already."""
    assert value == int(value), f"{value} is no whole number of pixels"
    return int(value)


def true_fields(clip: Clip) -> tuple[MotionField, MotionField]:
    """The exact motion; what is hidden in the other frame is similar to nothing."""
    return tuple(
        MotionField(np.array(flow, np.float32, order="C"), seen.astype(np.float32))
        for flow, seen in ((clip.flow01, clip.seen0), (clip.flow10, clip.seen1))
    )


def true_transition(clip: Clip) -> FramePair:
    """Both frames and the exact motion between them."""
    return FramePair(*clip.prepared, *true_fields(clip))
