"""Digest of in-between frames, by which two machines tell whether they compute the same bits.

Processors differ in the instructions that a compiler or a library chooses for them, and with them in how results are
rounded. The frames are made of whole random numbers, so that the input at least is the same everywhere.
"""

from __future__ import annotations

import hashlib
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fpsboost.frame_cache import FrameCache
from fpsboost.image import SAMPLE_BITS, view
from fpsboost.interpolator import Interpolator
from fpsboost.layered import FrameImage

SIZE = (48, 480)
"""Height and width of the frames, pixels: those of `Interpolator.compile_for`, so that the same kernels run."""

TIMES = (0.25, 0.5)
FRAMES = 4
"""Frames of the clip: a pair, and one frame on each side of it."""

OBJECT = (20, 96)
"""Height and width of the object that moves in front, pixels."""


def self_test(interpolator: Interpolator, image: FrameImage) -> str:
    """Return a digest of frames that an interpolator makes of a small constructed clip.

    A texture with coarse and fine structure moves by two and a half pixels per frame, and in front of it an object in
    the other direction. A renderer's motion vectors are not used. `image` is any of the clip to convert; only its type,
    channels and layers matter. The digest is SHA-256 in hexadecimal digits, the same wherever the same frames are made.

    Examples
    --------
    >>> from fpsboost.method_table import methods
    >>> image = np.zeros((90, 160, 3), np.uint8)
    >>> self_test(methods["blend"], image) == self_test(methods["blend"], image)
    True
    >>> self_test(methods["blend"], image) == self_test(methods["nearest"], image)
    False
    """
    rehearsal = interpolator.without_vectors()
    frames = [FrameCache(view(image).filled(samples)) for samples in _moving_samples()]
    before, pair, after = (rehearsal.pair(*two) for two in pairwise(frames))
    return digest_of(*rehearsal.between(pair, TIMES, before, after).images)


def digest_of(*images: FrameImage) -> str:
    """Return a digest of images: SHA-256 in hexadecimal digits."""
    digest = hashlib.sha256()
    for image in images:
        for plane in view(image).arrays():
            digest.update(f"{plane.dtype} {plane.shape} ".encode())
            digest.update(plane.tobytes())
    return digest.hexdigest()


def _moving_samples() -> list[NDArray[np.int64]]:
    """Return the frames as samples of four channels, (H, W, 4), from 0 to 2**16 - 1."""
    (height, width), random = SIZE, np.random.default_rng(0)
    behind = _texture(random, height, width + 5 * FRAMES)
    in_front = _texture(random, *OBJECT)
    frames = []
    for number in range(FRAMES):
        frame = behind[:, 5 * number : 2 * width + 5 * number].reshape(height, width, 2, 4).sum(axis=2) // 2
        top, left = 12 + number, 160 + 4 * number
        frame[top : top + OBJECT[0], left : left + OBJECT[1]] = in_front[:, ::2]
        frames.append(frame)
    return frames


def _texture(random: np.random.Generator, height: int, width: int) -> NDArray[np.int64]:
    """Return samples of twice the width: half of each is a plain patch of 8 x 8 pixels, the rest noise."""
    coarse = random.integers(0, 1 << SAMPLE_BITS, (-(-height // 8), -(-width // 8), 4))
    patches = coarse.repeat(8, axis=0).repeat(16, axis=1)[:height, : 2 * width]
    return (patches + random.integers(0, 1 << SAMPLE_BITS, patches.shape)) // 2
