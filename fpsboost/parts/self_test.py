"""Digest of in-between frames, by which two machines tell whether they compute the same bits.

Processors differ in the instructions that a compiler or a library chooses for them, and with them in how results are
rounded. The frames are made of whole random numbers, so that the input at least is the same everywhere.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import FrameImage, as_array
from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Interpolator
from fpsboost.layered import Layer, LayeredImage
from fpsboost.ycbcr import YCbCrImage

SIZE = (48, 480)
"""Height and width of the frames, pixels: those of `Interpolator.compile_for`, so that the same kernels run."""

SAMPLE_BITS = 16
TIMES = (0.25, 0.5)
FRAMES = 4
"""Frames of the clip: a pair, and one frame on each side of it."""

OBJECT = (20, 96)
"""Height and width of the object that moves in front, pixels."""


def self_test(interpolator: Interpolator, image: FrameImage) -> str:
    """Return a digest of frames that an interpolator makes of a small constructed clip.

    A texture with coarse and fine structure moves by two and a half pixels per frame, and in front of it an object in
    the other direction. A renderer's motion vectors are not used.

    Parameters
    ----------
    interpolator : Interpolator
    image : (H, W, C) uint8, uint16 or float32, YCbCrImage or LayeredImage
        Any image of the clip to convert; only its type, channels and layers matter.

    Returns
    -------
    str
        SHA-256 in hexadecimal digits; the same wherever the same frames are made, bit for bit.

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
    frames = [FrameCache(_in_form_of(image, samples)) for samples in _moving_samples()]
    before, pair, after = (rehearsal.pair(*two) for two in pairwise(frames))
    return digest_of(*rehearsal.between(pair, TIMES, before, after).images)


def digest_of(*images: FrameImage) -> str:
    """Return a digest of images: SHA-256 in hexadecimal digits."""
    digest = hashlib.sha256()
    for image in images:
        for plane in _planes(image):
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


def _in_form_of(image: FrameImage, samples: NDArray[np.int64]) -> FrameImage:
    """Return samples as an image of the same type, channels and layers."""
    if isinstance(image, YCbCrImage):
        steps = (1, 1), image.subsampling, image.subsampling
        codes = (samples >> (SAMPLE_BITS - image.coding.bits)).astype(image.dtype)
        y, cb, cr = (codes[::rows, ::columns, k].copy() for k, (rows, columns) in enumerate(steps))
        return replace(image, planes=(y, cb, cr))
    channels = image.shape[2]
    # the last of two or four channels is alpha
    picture = _as_type(samples[..., [0, 3] if channels == 2 else slice(channels)], image.dtype)
    if not isinstance(image, LayeredImage):
        return picture
    return LayeredImage(picture, tuple(_layer(layer, samples) for layer in image.layers))


def _as_type(samples: NDArray[np.int64], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return samples in the whole range of integers, or in [0, 1) of floats, which hold them exactly."""
    if np.issubdtype(dtype, np.floating):
        return np.ascontiguousarray((samples / (1 << SAMPLE_BITS)).astype(dtype))
    return np.ascontiguousarray((samples >> max(0, SAMPLE_BITS - 8 * dtype.itemsize)).astype(dtype))


def _layer(layer: Layer, samples: NDArray[np.int64]) -> Layer:
    """Return a layer like this one whose planes hold samples, each another channel of them."""
    numbered = enumerate(layer.planes.items())
    return replace(layer, planes={name: _as_type(samples[..., k % 4], plane.dtype) for k, (name, plane) in numbered})


def _planes(image: FrameImage) -> list[NDArray[Any]]:
    """Return all arrays that an image consists of."""
    if isinstance(image, YCbCrImage):
        return list(image.planes)
    layers = list(image.planes().values()) if isinstance(image, LayeredImage) else []
    return [as_array(image), *layers]
