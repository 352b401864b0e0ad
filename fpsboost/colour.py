"""Colours as numbers: values of arrays, scene-linear light as it is compared, and the coding of YCbCr.

A renderer's numbers are proportional to light. A difference of 0.1 is nothing in a highlight and everything in a
shadow, and the same scene with another exposure has other numbers. So frames are compared on a scale of ratios: their
log-average is shown as middle gray (Reinhard, Stark, Shirley, Ferwerda 2002, doi:10.1145/566654.566575), and the curve
is a logarithm above, with the slope of sRGB in the darkest shadows. What is mixed are the numbers as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

HIGHLIGHT_SLOPE = np.float32(0.5)
"""Factor on the logarithm of values above white: twice as bright as white is brighter by 0.35, as is twice as bright as
a middle gray."""

MAX_VALUE = np.float32(1e6)
"""Maximum magnitude of a value in motion estimation, in units of white."""

MIDDLE_GRAY = np.float32(0.18)  # value that the log-average of a frame is scaled to
STEEPNESS = np.float32(51)  # curvature of the scale: the slope at black is then 12.9, that of sRGB
MAX_RATIO = np.float32(1e6)  # maximum of the scaled values; damaged files hold the largest numbers of their type
SRGB_TOE = np.float32(0.0031308)  # largest value of the straight part of sRGB's curve


def has_alpha(image: Any) -> bool:
    """Return whether the last channel of an image of any kind is alpha."""
    return bool(image.shape[2] in {2, 4})


def with_red_and_blue_swapped(image: np.ndarray) -> np.ndarray:
    """Return an image, (H, W, C), with BGR(A) for RGB(A), or the other way round; one without colours as it is."""
    conversion = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}.get(image.shape[2])
    return image if conversion is None else cv2.cvtColor(np.ascontiguousarray(image), conversion)


def normalised(image: np.ndarray) -> np.ndarray:
    """Return the image as float32 with 1.0 for white and unchanged shape; NaN becomes black, infinity white.

    A float32 image without these is returned itself, not a copy.
    """
    if image.dtype == np.float32:
        # to look costs a tenth of what it takes to replace
        return image if np.isfinite(image).all() else np.asarray(np.nan_to_num(image, nan=0.0, posinf=1.0, neginf=0.0))
    return image.astype(np.float32) * np.float32(1 / np.iinfo(image.dtype).max)


def composite_on_black(image: np.ndarray) -> np.ndarray:
    """Return the `normalised` image with straight alpha premultiplied: what is transparent does not show."""
    values = normalised(image)
    if has_alpha(image) and image.dtype != np.float32:  # float images have that done already
        values[..., :-1] *= values[..., -1:]
    return values


def premultiplied(image: np.ndarray) -> np.ndarray:
    """Return (H, W, C) float32 with the image's own white, with straight alpha premultiplied."""
    if image.dtype == np.float32:  # NaN and infinity would spread to their surroundings
        return normalised(image)
    values = image.astype(np.float32)
    if has_alpha(image):
        values[..., :-1] *= values[..., -1:] / np.float32(np.iinfo(image.dtype).max)
    return values


def soft_clipped(image: np.ndarray) -> np.ndarray:
    """Return an image of floats with a logarithmic curve above white, one of whole numbers as it is.

    Contrast matters in highlights, not difference: otherwise the similarity of two frames of a brightly lit scene would
    be 0, and motion could not be estimated. NaN and infinity are those of `normalised`.
    """
    if image.dtype != np.float32:
        return image
    values = clipped(normalised(image))
    if values.max(initial=0) <= 1:
        return values
    # in place, as to clear the memory of an image takes longer than to compute it
    curve = values.clip(1)
    np.log(curve, out=curve)
    curve *= HIGHLIGHT_SLOPE
    curve += 1
    np.copyto(curve, values, where=values <= 1)
    return curve


def colour_components(image: np.ndarray) -> np.ndarray:
    """Return colours, (H, W, 3) float32, with highlights compressed; those of gray images have the other two zero.

    They are multiplied by alpha, so that the colour of a transparent pixel has no influence.
    """
    values = normalised(soft_clipped(image))
    if has_alpha(image):
        values = np.einsum("yxc,yx->yxc", values[..., :-1], values[..., -1])
    return np.dstack([values, np.zeros_like(values), np.zeros_like(values)]) if values.shape[2] == 1 else values


def clipped(values: np.ndarray) -> np.ndarray:
    """Return the values clipped to MAX_VALUE: damaged files hold float32's largest numbers, whose sums overflow."""
    return values if cv2.norm(values, cv2.NORM_INF) <= MAX_VALUE else values.clip(-MAX_VALUE, MAX_VALUE)


def compared_colours(image: np.ndarray) -> np.ndarray:
    """Return scene-linear colours, (H, W, C) float32, as they are compared: middle gray is 0.59, alpha stays as it is.

    Negative values and NaN count as black, infinity as the maximum.
    """
    colours = np.fmax(image[..., : image.shape[2] - has_alpha(image)], 0)  # 0 for NaN, too
    channels = colours.shape[2]
    # in place, as above
    colours[np.isinf(colours)] = MAX_RATIO
    colours *= exposure_of(cv2.transform(colours, np.full((1, channels), 1 / channels)))
    np.minimum(colours, MAX_RATIO, out=colours)
    colours *= STEEPNESS
    colours += 1
    cv2.log(colours, colours)
    colours /= np.log1p(STEEPNESS)
    return np.concatenate([colours, image[..., channels:]], axis=2) if has_alpha(image) else colours


def exposure_of(light: np.ndarray) -> np.float32:
    """Return the factor that brings the log-average of light, as far as it is positive, to middle gray."""
    light = light[light > 0]
    return np.float32(MIDDLE_GRAY / np.exp(cv2.log(light).mean()) if light.size else 1)


def displayed_colours(image: np.ndarray) -> np.ndarray:
    """Return scene-linear colours as an sRGB display shows them, float32 in [0, 1]; alpha stays as it is."""
    displayed = np.array(image, np.float32)
    colours = displayed[..., : image.shape[2] - has_alpha(image)]
    colours[:] = srgb_encoded(np.nan_to_num(colours, nan=0.0))
    return displayed


def srgb_encoded(light: np.ndarray) -> np.ndarray:
    """Return linear light as sRGB values (IEC 61966-2-1), float32 in [0, 1]; white is 1 in both."""
    light = light.clip(0, 1)
    curve = np.float32(1.055) * light ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.where(light <= SRGB_TOE, light * np.float32(12.92), curve).clip(0, 1)


luma_weights = {
    1: (0.2126, 0.0722),
    4: (0.30, 0.11),
    5: (0.299, 0.114),
    6: (0.299, 0.114),
    7: (0.212, 0.087),
    9: (0.2627, 0.0593),
}
"""Luma weights (red, blue) by AVColorSpace: BT.709, FCC, BT.601 (625 and 525 lines), SMPTE 240M, BT.2020."""


class Levels(NamedTuple):
    """Reference code values of luma and chroma."""

    black: float  # luma of black
    luma_span: float  # range of luma, from black to white
    neutral: float  # chroma of gray
    chroma_span: float  # range of chroma, from the lowest of a colour to the highest


def code_levels(full_range: bool, bits: int) -> Levels:
    """Return the reference code values of YCbCr by range and bit depth (ITU-T H.273, 8.3)."""
    unit = 2.0 ** (bits - 8)
    if full_range:
        return Levels(0.0, 2.0**bits - 1, 128 * unit, 2.0**bits - 1)
    return Levels(16 * unit, 219 * unit, 128 * unit, 224 * unit)


def inverse_affine(forward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a matrix of (3, 4), whose last column is an offset."""
    inverse = np.linalg.inv(forward[:, :3])
    return np.column_stack([inverse, -inverse @ forward[:, 3]])


def bgr_to_ycc(color_space: int, full_range: bool, bits: int, top: float) -> NDArray[np.float64]:
    """Return the matrix from BGR in [0, top] to the code values of Y, Cb, Cr, (3, 4); the last column is the offset."""
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
    bgr_of: Callable[[Any], np.ndarray] | None = field(default=None, repr=False, compare=False)

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
        return inverse_affine(bgr_to_ycc(self.color_space, self.full_range, self.bits, 1))


def as_shown(image: np.ndarray) -> np.ndarray:
    """Return an image as a screen shows it, (H, W, 3) uint8: clipped; over mid gray; float as linear light."""
    linear = image.dtype == np.float32
    values = composite_on_black(image)
    if has_alpha(image):
        values = values[..., :-1] + (0.5**2.2 if linear else 0.5) * (1 - values[..., -1:].clip(0, 1))
    values = values.clip(0, 1)
    if linear:
        values = srgb_encoded(values)
    levels = np.rint(values * 255).astype(np.uint8)
    return np.ascontiguousarray(levels if levels.shape[2] == 3 else levels.repeat(3, axis=2))
