"""Coding of YCbCr: what the code values of luma and chroma mean, and the matrices to BGR and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    bgr_of : callable, optional
        Converts a `YCbCrImage` of this coding to BGR, (H, W, 3) uint8 or uint16; OpenCV does by default. Sources of
        video give FFmpeg's conversion.
    """

    bits: int
    color_space: int
    full_range: bool
    chroma_location: str
    pixel_format: str
    bgr_of: Callable[[Any], NDArray[Any]] | None = field(default=None, repr=False, compare=False)

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
