"""YCbCr images: a plane of luma and two planes of chroma, which are often subsampled.

Images read from a video and written to one keep their planes: no colour matrix, no intermediate rounding, and half as
many samples to compute with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[Any]
"""(H, W) uint8 or uint16."""

luma_weights = MappingProxyType(
    {
        1: (0.2126, 0.0722),
        4: (0.30, 0.11),
        5: (0.299, 0.114),
        6: (0.299, 0.114),
        7: (0.212, 0.087),
        9: (0.2627, 0.0593),
    }
)
"""Luma weights (red, blue) by AVColorSpace: BT.709, FCC, BT.601 (625 and 525 lines), SMPTE 240M, BT.2020."""


class Levels(NamedTuple):
    """Reference code values of luma and chroma."""

    black: float
    """Luma of black."""
    luma_span: float
    """Range of luma, from black to white."""
    neutral: float
    """Chroma of gray."""
    chroma_span: float
    """Range of chroma, from the lowest of a colour to the highest."""


def code_levels(full_range: bool, bits: int) -> Levels:
    """Return the reference code values of YCbCr by range and bit depth (ITU-T H.273, 8.3)."""
    unit = 2.0 ** (bits - 8)
    if full_range:
        return Levels(0.0, 2.0**bits - 1, 128 * unit, 2.0**bits - 1)
    return Levels(16 * unit, 219 * unit, 128 * unit, 224 * unit)


def bgr_to_ycc(color_space: int, full_range: bool, bits: int, top: float) -> NDArray[np.float64]:
    """Return the matrix from BGR in [0, top] to the code values of Y, Cb, Cr.

    Returns
    -------
    (3, 4) float64
        Linear part and, as the last column, the offset.
    """
    red, blue = luma_weights[color_space]
    luma = np.array([blue, 1 - red - blue, red])
    chroma_blue = (np.array([1, 0, 0]) - luma) / (2 * (1 - blue))
    chroma_red = (np.array([0, 0, 1]) - luma) / (2 * (1 - red))
    levels = code_levels(full_range, bits)
    scaled = [luma * levels.luma_span, chroma_blue * levels.chroma_span, chroma_red * levels.chroma_span]
    return np.column_stack([np.stack(scaled) / top, [levels.black, levels.neutral, levels.neutral]])


def bgr_by_bicubic_chroma(image: YCbCrImage) -> NDArray[Any]:
    """Return an image as BGR, (H, W, 3) uint8 or uint16, with chroma interpolated bicubically."""
    (height, width), coding = image.planes[0].shape, image.coding
    right = 0.5 if coding.chroma_location in ("center", "top", "bottom") else 0
    below = 0 if "top" in coding.chroma_location else 1 if "bottom" in coding.chroma_location else 0.5
    rows, columns = (
        (np.arange(length, dtype=np.float32) - (first if step > 1 else 0)) / step
        for length, first, step in zip((height, width), (below, right), image.subsampling, strict=True)
    )
    places = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    chroma = (cv2.remap(p, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for p in image.planes[1:])
    codes = cv2.merge([image.planes[0], *chroma])
    bgr: NDArray[Any] = cv2.transform(codes, coding.to_bgr() * np.iinfo(image.dtype).max)
    return bgr


@dataclass(frozen=True)
class Coding:
    """Meaning of the code values of YCbCr.

    Parameters
    ----------
    bits : int
        Bits per sample, 8 to 16.
    color_space : int
        Matrix, an AVColorSpace; a key of `luma_weights`.
    full_range : bool
        Whether black is 0 rather than 16 (in 8 bits).
    chroma_location : str
        Location of subsampled chroma samples: ``left``, ``center``, ``topleft``...
    pixel_format : str
        FFmpeg's name of the pixel format, ``yuv420p``.
    bgr_of : callable
        Converts an image of this coding to BGR, (H, W, 3) uint8 or uint16. Sources of video give FFmpeg's conversion.
    """

    bits: int
    color_space: int
    full_range: bool
    chroma_location: str
    pixel_format: str
    bgr_of: Callable[[YCbCrImage], NDArray[Any]] = field(default=bgr_by_bicubic_chroma, repr=False, compare=False)

    @property
    def highest(self) -> int:
        """The highest code value."""
        return (1 << self.bits) - 1

    @property
    def levels(self) -> Levels:
        """Reference code values."""
        return code_levels(self.full_range, self.bits)

    @cache  # noqa: B019 (a program meets few codings)
    def to_bgr(self) -> NDArray[np.float64]:
        """Return the matrix from code values of Y, Cb, Cr to BGR in [0, 1], in the form of `bgr_to_ycc`."""
        forward = bgr_to_ycc(self.color_space, self.full_range, self.bits, 1)
        inverse = np.linalg.inv(forward[:, :3])
        return np.column_stack([inverse, -inverse @ forward[:, 3]])


@dataclass(frozen=True, eq=False)
class YCbCrImage:
    """Image in planes of luma and chroma.

    Parameters
    ----------
    planes : tuple of 3 arrays
        Y of (H, W); Cb and Cr of that size, of half the width, or of half the width and height, rounded up. uint8 or
        uint16, contiguous.
    coding : Coding

    Examples
    --------
    >>> coding = Coding(8, 1, full_range=False, chroma_location="left", pixel_format="yuv420p")
    >>> gray = [np.full(size, 128, np.uint8) for size in ((4, 6), (2, 3), (2, 3))]
    >>> image = YCbCrImage(tuple(gray), coding)
    >>> image.shape, image.subsampling
    ((4, 6, 3), (2, 2))
    """

    planes: tuple[Plane, Plane, Plane]
    coding: Coding

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape (H, W, 3), as of a BGR array."""
        height, width = self.planes[0].shape
        return height, width, 3

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the samples."""
        return self.planes[0].dtype

    @property
    def subsampling(self) -> tuple[int, int]:
        """Chroma subsampling: rows and columns of pixels per chroma sample."""
        (height, width), (rows, columns) = self.planes[0].shape, self.planes[1].shape
        return (1 if rows == height else 2), (1 if columns == width else 2)

    @property
    def has_full_chroma(self) -> bool:
        """Whether chroma is not subsampled."""
        return self.planes[1].shape == self.planes[0].shape

    def mapped(self, function: Callable[..., Plane], *others: Self) -> Self:
        """Return the image with a function applied to each plane, or to each with the same plane of other images."""
        y, cb, cr = (function(*planes) for planes in zip(self.planes, *(other.planes for other in others), strict=True))
        return replace(self, planes=(y, cb, cr))

    def to_bgr(self) -> NDArray[Any]:
        """Return the image as BGR, (H, W, 3) uint8 or uint16."""
        return self.coding.bgr_of(self)

    def copy(self) -> Self:
        """Return a copy with planes of its own."""
        return self.mapped(np.copy)
