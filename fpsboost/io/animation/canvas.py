"""What animation files have in common: pieces drawn onto a canvas, each shown for a time of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import cv2
import numpy as np

from fpsboost.errors import InputError
from fpsboost.frame import Image
from fpsboost.io.images.exact_reads import DamagedError
from fpsboost.io.images.sizes import declared_size

ANIMATION_SUFFIXES = (".gif", ".apng", ".webp")
"""Suffixes of the animations that can be written."""

MAX_PIXELS = 2**28  # 16384 x 16384; a header can promise anything

DEFAULT_DELAY = Fraction(1, 10)
"""What players take a delay of nothing for."""

Disposal = Literal["keep", "clear", "restore"]


@dataclass(frozen=True)
class Outline:
    """Properties of an animation, read from its headers without decoding.

    Attributes
    ----------
    height, width : int
        Of the canvas, pixels.
    frame_count : int
    duration, time_base : Fraction
        Seconds of all frames together, and the largest tick that every delay is a multiple of.
    plays : int
        How often it is shown; 0 for ever again.
    has_alpha : bool
        Whether anything can be seen through.
    is_whole : bool
        Whether the file ends where it should.
    """

    height: int
    width: int
    frame_count: int
    duration: Fraction
    time_base: Fraction
    plays: int
    has_alpha: bool
    is_whole: bool


class TimedImage(NamedTuple):
    """A whole picture, (H, W, 4) uint8 or uint16, and for how many seconds it is shown."""

    image: Image
    delay: Fraction


class Step(NamedTuple):
    """Position, delay, blending and disposal of one frame on the canvas."""

    height: int
    width: int
    top: int
    left: int
    delay: Fraction
    is_over: bool
    """Laid over what is there by its alpha; otherwise put in its place."""
    disposal: Disposal


class AnimationWriter(Protocol):
    """Contract: writes one type of animation into an open file, frame by frame."""

    def add(self, image: Image, delay: Fraction) -> None:
        """Write the next frame, (H, W, 1, 3 or 4), shown for `delay` seconds, a delay that the format can say."""
        ...

    def finish(self) -> None:
        """Write what comes behind the last frame, and into the header what is known only now."""
        ...


def outline_of(
    size: tuple[int, int], delays: Counter[Fraction], plays: int, *, has_alpha: bool, is_whole: bool
) -> Outline:
    """Add up what the headers of all frames say.

    Parameters
    ----------
    size : (int, int)
        Height and width.
    delays : Counter of Fraction
        How many frames are shown for how long.
    plays : int
    has_alpha, is_whole : bool

    Raises
    ------
    DamagedError
        No frames, or no size or an unbelievable one.
    """
    height, width = size
    if not delays or not 0 < height * width <= MAX_PIXELS:
        raise DamagedError
    duration = sum((delay * count for delay, count in delays.items()), Fraction(0))
    time_base = Fraction(1, int(np.lcm.reduce([delay.denominator for delay in delays], dtype=object)))
    return Outline(height, width, delays.total(), duration, time_base, plays, has_alpha, is_whole)


def composed(steps: Iterable[tuple[Step, bytes]], height: int, width: int) -> Generator[TimedImage, None, None]:
    """Draw still images, each the content of a file, onto a canvas that is transparent at first; one picture for each.

    Raises
    ------
    DamagedError
        One cannot be decoded, is of another size than its step says, or lies outside of the canvas.
    """
    canvas: Image | None = None
    for step, still in steps:
        is_inside = step.top + step.height <= height and step.left + step.width <= width
        if not is_inside or declared_size(still) != (step.width, step.height):
            raise DamagedError
        image = decoded_still(still)
        if canvas is None:
            canvas = np.zeros((height, width, 4), image.dtype)
        part = canvas[step.top : step.top + step.height, step.left : step.left + step.width]
        if part.shape != image.shape or part.dtype != image.dtype:
            raise DamagedError
        before = part.copy() if step.disposal == "restore" else 0
        part[...] = laid_over(image, part) if step.is_over else image
        yield TimedImage(canvas.copy(), step.delay)
        if step.disposal != "keep":
            part[...] = before


def laid_over(image: Image, ground: Image) -> Image:
    """Lay an image over another one; straight alpha in both and in the result.

    Parameters
    ----------
    image, ground : (H, W, 4) uint8 or uint16
    """
    white = np.float32(np.iinfo(image.dtype).max)
    share = image[..., 3:] / white
    below = (1 - share) * (ground[..., 3:] / white)
    alpha = share + below
    colours = (image[..., :3] * share + ground[..., :3] * below) / np.maximum(alpha, np.float32(1e-9))
    result: Image = np.rint(np.concatenate([colours, alpha * white], axis=-1)).astype(image.dtype)
    return result


def with_four_channels(image: Image) -> Image:
    """Convert gray, gray with alpha or BGR to BGRA; images without alpha become opaque."""
    if image.shape[2] == 4:
        return image
    white = 1 if image.dtype == np.float32 else np.iinfo(image.dtype).max
    alpha = image[..., 1:] if image.shape[2] == 2 else np.full_like(image[..., :1], white)
    colours = image if image.shape[2] == 3 else np.repeat(image[..., :1], 3, axis=2)
    return np.concatenate([colours, alpha], axis=-1)


def changed_part(before: Image | None, image: Image, step: int) -> tuple[slice, slice]:
    """Return the rows and columns outside of which two images are the same; one pixel where they are equal.

    Parameters
    ----------
    before, image : (H, W, C)
        Of one size and type; without one before, everything has changed.
    step : int
        Where the rectangle may begin: at multiples of this.
    """
    if before is None:
        return slice(0, image.shape[0]), slice(0, image.shape[1])
    changed = (before != image).any(axis=2).astype(np.uint8)
    left, top, width, height = cv2.boundingRect(changed)
    return slice(top - top % step, max(top + height, 1)), slice(left - left % step, max(left + width, 1))


def decoded_still(data: bytes) -> Image:
    """Decode one frame, stored as a still image file, to four channels.

    Raises
    ------
    DamagedError
        It cannot be decoded.
    """
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise DamagedError
    return with_four_channels(image.reshape(*image.shape[:2], -1))


def damaged(path: Path | str) -> InputError:
    """Return the error of a file that violates its format."""
    return InputError(f"{path} is damaged or no animation; replace it.")
