"""Images of all kinds through one contract, `ImageView`, which `view` gives: arrays, and planes of YCbCr.

A view copies no pixels. Images read from a video and written to one keep their planes: no colour matrix, no
intermediate rounding, and half as many samples to compute with. `fpsboost.layered` has pictures with further layers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import Coding, clipped, colour_components, has_alpha, normalised, premultiplied, soft_clipped
from fpsboost.errors import InputError

type_names = {np.dtype(np.uint8): "8-bit", np.dtype(np.uint16): "16-bit", np.dtype(np.float32): "float"}

SAMPLE_BITS = 16
"""Bits of the samples of which `ImageView.filled` makes an image."""

Image = np.ndarray
"""(height, width, channels) uint8, uint16 or float32; see `fpsboost.frame`."""

Plane = np.ndarray
"""(height, width)."""


class ImageView:
    """What the package asks of an image of any kind; the view of an array, (H, W, C) uint8, uint16 or float32."""

    coding: Coding | None = None
    """Meaning of the code values; None for colours."""
    layers: Sequence[Any] | None = None
    """Further layers, see `fpsboost.layered`; None for an image that is no renderer's."""

    def __init__(self, pixels: Image) -> None:
        self._pixels = pixels

    @property
    def shape(self) -> tuple[int, ...]:
        """Height, width and channels, as of a BGR array."""
        return self.array().shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.array().dtype

    @property
    def picture(self) -> Pixels:
        """The image without further layers."""
        return self.array()

    @property
    def compared(self) -> Pixels:
        """The picture as frames are compared; scene-linear colours have another scale there."""
        return self.picture

    @property
    def subsampling(self) -> tuple[int, int]:
        """Rows and columns of pixels per chroma sample."""
        return 1, 1

    @property
    def luma(self) -> Plane | None:
        """Luma as it is stored, in code values; None if it must be computed from colours."""
        return None

    @property
    def white(self) -> np.float32:
        """Number of levels from black to white."""
        return np.float32(1) if self.dtype == np.float32 else self.value_range[1]

    @property
    def value_range(self) -> tuple[np.float32, np.float32]:
        """Lowest and highest value that images of this type hold."""
        if self.dtype == np.float32:
            return np.finfo(np.float32).min, np.finfo(np.float32).max
        return np.float32(0), np.float32(np.iinfo(self.dtype).max)

    @property
    def gray_weight(self) -> float:
        """Factor on squared differences, summed over channels, that gives one in gray the same scale in all kinds."""
        return max(1.0, 3 / self.shape[2])

    def describe(self) -> str:
        """Return size and type as readable text: ``640x360, 3 channels, 8-bit``."""
        height, width, channels = self.shape
        return f"{width}x{height}, {channels} channel{'s' if channels > 1 else ''}, {type_names[self.dtype]}"

    def array(self) -> Image:
        """Return the picture for functions that cannot work on planes; raises `InputError` for a `YCbCrImage`."""
        return self._pixels

    def to_bgr(self) -> Image:
        """Return the picture as an array, planes converted to BGR, (H, W, 3) uint8 or uint16."""
        return self.array()

    def arrays(self) -> list[np.ndarray]:
        """Return all arrays of which the image consists; their first two axes are rows and columns."""
        return [self.array()]

    def map(self, function: Callable[..., np.ndarray], *others: ImageView) -> Pixels:
        """Return the image with a function applied to each array, or to each with the same array of other images."""
        result = function(self.array(), *(other.array() for other in others))
        return result.reshape(*result.shape[:2], self.shape[2])

    def mix(self, other: ImageView, t: float) -> Pixels:
        """Return the mean of two images of one kind, the other weighted by t."""
        return self.map(lambda first, second: cv2.addWeighted(first, 1 - t, second, t, 0), other)

    def copy(self) -> Any:
        return self.array().copy()

    def deep_copy(self) -> Any:
        """Return a copy with pixels and layers of its own."""
        return self.copy()

    def filled(self, samples: NDArray[np.int64]) -> Any:
        """Return an image of the same kind and type that shows (H, W, 4) whole numbers of `SAMPLE_BITS` bits."""
        channels = self.shape[2]  # the last of two or four is alpha
        return in_type(samples[..., [0, 3] if channels == 2 else slice(channels)], self.dtype)

    def blank(self) -> tuple[Pixels, np.ndarray, np.ndarray]:
        """Return an image like this one to be filled, and views of it: (C, H, W), and subsampled chroma (C, h, w)."""
        blank = np.empty_like(self.array())
        return blank, blank.transpose(2, 0, 1), np.empty((0, 0, 0), self.dtype)

    def gray(self) -> Plane:
        """Return luma, (H, W) uint8."""
        if self.dtype == np.uint8 and self.shape[2] == 3:
            return cv2.cvtColor(self.array(), cv2.COLOR_BGR2GRAY)
        return cv2.convertScaleAbs(self.float_luma().clip(0))  # which would take the absolute value

    def float_luma(self) -> Plane:
        """Return luma on the 8-bit scale, (H, W) float32, not clipped."""
        colours = soft_clipped(self.array())
        luma: Plane = colours[..., 0] if self.shape[2] < 3 else cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
        luma = luma * (255 / self.white)
        if has_alpha(self):
            luma *= colours[..., -1] / self.white
        return luma

    def chroma(self) -> list[Plane]:
        """Return both colour differences, uint8 or float32 on the 8-bit scale, up to a constant; none of gray images.

        Those of planes are as they are stored: subsampled, and in code values.
        """
        if self.shape[2] < 3:
            return []
        colours = self.array()
        if self.dtype != np.uint8 or self.shape[2] > 3:
            colours = colour_components(colours) * np.float32(255)
        return list(cv2.split(cv2.cvtColor(colours, cv2.COLOR_BGR2YCrCb))[1:])

    def luma_and_chroma(self) -> tuple[Plane, Plane]:
        """Return luma in [0, 1], and the mean of both colour differences: 0.5 for gray, 0 for images of one channel."""
        colours = colour_components(self.array())
        if self.shape[2] < 3:
            return colours[..., 0], colours[..., 1]
        converted = cv2.cvtColor(colours, cv2.COLOR_BGR2YCrCb)
        return converted[..., 0], (converted[..., 1] + converted[..., 2]) * 0.5

    def thumbnail(self, shrink: Callable[[Image], Image]) -> Image:
        """Return a small copy, gray or BGR, float32 with 1.0 for white; `shrink` makes it of an array, in float32."""
        return clipped(normalised(shrink(self.array()) * (1 / self.white)))

    def comparable(self) -> np.ndarray:
        """Return values to compare, (H, W, C) float32: black and white 1 apart, straight alpha premultiplied."""
        values = premultiplied(self.array())
        # damaged files hold numbers whose squares overflow
        return clipped(values) if self.dtype == np.float32 else values / self.white

    def channels(self) -> list[Plane]:
        """Return luma and chroma, or all channels but alpha, in the image's own type."""
        return list(cv2.split(self.array())[: self.shape[2] - has_alpha(self)])

    def with_channels(self, channels: Sequence[Plane]) -> Pixels:
        """Return the image with other `channels`, all of its own type; alpha stays."""
        return np.dstack([*channels, self.array()[..., len(channels) :]])

    def spline_planes(self) -> tuple[np.ndarray, np.ndarray, np.float32, int]:
        """Return the planes of which splines are made, with straight alpha premultiplied.

        Returns
        -------
        full : (C, H, W), contiguous
            Planes at full resolution.
        half : (C, h, w)
            Subsampled chroma; (0, 1, 1) if there is none.
        unit : float32
            Factor that makes white 1.
        bits : int
            Bits per sample.
        """
        nothing = np.empty((0, 1, 1), self.dtype)
        pixels = normalised(self.array()) if self.dtype == np.float32 else self.array()  # NaN would spread around
        planes = np.empty((self.shape[2], *self.shape[:2]), self.dtype)
        cv2.split(pixels, list(planes))  # into memory that is there, a third of the time
        unit = 1 / self.white
        if has_alpha(self) and self.dtype != np.float32:
            planes = planes * unit
            unit = np.float32(1)
            planes[:-1] *= planes[-1]
        return planes, nothing, unit, 8 if self.dtype == np.uint8 else 16


@dataclass(frozen=True, eq=False)
class YCbCrImage(ImageView):
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
    coding: Coding = field()

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape (H, W, 3), as of a BGR array."""
        height, width = self.planes[0].shape
        return height, width, 3

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.planes[0].dtype

    @property
    def picture(self) -> YCbCrImage:
        return self

    @property
    def subsampling(self) -> tuple[int, int]:
        height, width = self.planes[0].shape
        rows, columns = self.planes[1].shape
        return (1 if rows == height else 2), (1 if columns == width else 2)

    @property
    def _full_planes(self) -> int:
        """Number of planes, from the first, of the size of the image."""
        return 3 if self.planes[1].shape == self.planes[0].shape else 1

    @property
    def luma(self) -> Plane:
        return self.planes[0]

    @property
    def white(self) -> np.float32:
        return np.float32(self.coding.levels.luma_span)

    @property
    def value_range(self) -> tuple[np.float32, np.float32]:
        return np.float32(0), np.float32(self.coding.highest)

    @property
    def gray_weight(self) -> float:
        return 3.0  # it is in luma alone

    def describe(self) -> str:
        height, width, _ = self.shape
        return f"{width}x{height}, {self.coding.pixel_format}"

    def array(self) -> Image:
        raise InputError(f"An image must be an array here, not {self.describe()}; read its video without keeps_planes.")

    def to_bgr(self) -> Image:
        return _bgr_by_opencv(self) if self.coding.bgr_of is None else self.coding.bgr_of(self)

    def arrays(self) -> list[np.ndarray]:
        return list(self.planes)

    def map(self, function: Callable[..., Plane], *others: ImageView) -> Self:
        """Return the image with a function applied to each plane, or to each with the same plane of other images."""
        both = zip(self.planes, *(each.arrays() for each in others), strict=True)
        return self.with_channels([function(*planes) for planes in both])

    def copy(self) -> Self:
        return self.map(np.copy)

    def filled(self, samples: NDArray[np.int64]) -> Self:
        codes = (samples >> (SAMPLE_BITS - self.coding.bits)).astype(self.dtype)
        steps = (1, 1), self.subsampling, self.subsampling
        return self.with_channels([codes[::rows, ::columns, k].copy() for k, (rows, columns) in enumerate(steps)])

    def blank(self) -> tuple[Self, np.ndarray, np.ndarray]:
        full = np.empty((self._full_planes, *self.planes[0].shape), self.dtype)
        half = np.empty((3 - len(full), *self.planes[1].shape), self.dtype)
        return self.with_channels([*full, *half]), full, half

    def gray(self) -> Plane:
        black, span, _, _ = self.coding.levels
        if self.dtype == np.uint8:
            of_codes = (np.arange(256) - black) * (255 / span)
            return cv2.LUT(self.luma, np.rint(of_codes.clip(0, 255)).astype(np.uint8))
        above: Plane = np.maximum(self.luma, self.dtype.type(black))  # because convertScaleAbs takes the absolute value
        return cv2.convertScaleAbs(above, alpha=255 / span, beta=-255 / span * black)

    def chroma(self) -> list[Plane]:
        return list(self.planes[1:])

    def luma_and_chroma(self) -> tuple[Plane, Plane]:
        black, luma_span, neutral, chroma_span = self.coding.levels
        height, width, _ = self.shape
        y, cb, cr = (plane.astype(np.float32) for plane in self.planes)
        chroma = ((cb + cr) * np.float32(0.5) - np.float32(neutral)) / np.float32(chroma_span) + np.float32(0.5)
        return (y - np.float32(black)) / np.float32(luma_span), cv2.resize(chroma, (width, height))

    def thumbnail(self, shrink: Callable[[Image], Image]) -> Image:
        codes = np.dstack([shrink(plane[..., np.newaxis]) for plane in self.planes])
        return cv2.transform(codes, self.coding.to_bgr()).clip(0, 1)

    def comparable(self) -> np.ndarray:
        height, width, _ = self.shape
        unit = np.float32(1 / self.coding.levels.luma_span)
        planes = (cv2.resize(plane, (width, height), interpolation=cv2.INTER_NEAREST) for plane in self.planes)
        return np.dstack([plane * unit for plane in planes])

    def channels(self) -> list[Plane]:
        return list(self.planes)

    def with_channels(self, channels: Sequence[Plane]) -> Self:
        y, cb, cr = channels
        return replace(self, planes=(y, cb, cr))

    def spline_planes(self) -> tuple[np.ndarray, np.ndarray, np.float32, int]:
        unit = 1 / self.white  # also for chroma, whose weight is then about that in a sum over B, G and R
        full = self.planes[: self._full_planes]
        half = self.planes[self._full_planes :]
        together = full[0][np.newaxis] if len(full) == 1 else np.stack(full)
        return together, np.stack(half) if half else np.empty((0, 1, 1), self.dtype), unit, self.coding.bits


Pixels = Image | YCbCrImage
"""Image data on which motion is estimated: an array, or planes of luma and chroma."""


def view(image: Image | ImageView) -> ImageView:
    """Return the view of an image; those that are no arrays are views already."""
    return ImageView(image) if isinstance(image, np.ndarray) else image  # the one place that tells arrays apart


def rounding_offset(image: Pixels) -> float:
    """Return the offset to add before the conversion to the image's type: 0.5 for integers, 0 for float."""
    return 0 if image.dtype == np.float32 else 0.5


def as_image(values: np.ndarray, image0: Image, image1: Image, t: float) -> Image:
    """Convert `premultiplied` float values, which may be modified, to an image of the type of the frames around it."""
    straight_alpha = has_alpha(image0) and image0.dtype != np.float32
    lowest, highest = view(image0).value_range
    if straight_alpha:
        values[..., :-1] *= highest / np.maximum(values[..., -1:], np.float32(1e-6))
    image = (values + rounding_offset(image0)).clip(lowest, highest).astype(image0.dtype)
    if straight_alpha:
        colour_unseen(image, image0, image1, t)
    return image


def colour_unseen(image: Image, image0: Image, image1: Image, t: float) -> None:
    """Set the colour of fully transparent pixels to that of the blended frames, in place."""
    unseen = image[..., -1] == 0
    image[unseen, :-1] = np.rint(image0[unseen, :-1] * (1 - t) + image1[unseen, :-1] * t)


def in_type(samples: NDArray[np.int64], dtype: np.dtype[Any]) -> np.ndarray:
    """Return samples in the whole range of integers, or in [0, 1) of floats, which hold them exactly."""
    if np.issubdtype(dtype, np.floating):
        return np.ascontiguousarray((samples / (1 << SAMPLE_BITS)).astype(dtype))
    return np.ascontiguousarray((samples >> max(0, SAMPLE_BITS - 8 * dtype.itemsize)).astype(dtype))


def _bgr_by_opencv(image: YCbCrImage) -> Image:
    """Return an image as BGR, with chroma interpolated bicubically."""
    location = image.coding.chroma_location
    right = 0.5 if location in ("center", "top", "bottom") else 0
    below = 0 if "top" in location else 1 if "bottom" in location else 0.5
    rows, columns = (
        ((np.arange(length) - (first if step > 1 else 0)) / step).astype(np.float32)
        for length, first, step in zip(image.shape, (below, right), image.subsampling, strict=False)
    )
    places = np.meshgrid(columns, rows)
    chroma = (cv2.remap(p, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for p in image.planes[1:])
    return cv2.transform(cv2.merge([image.luma, *chroma]), image.coding.to_bgr() * np.iinfo(image.dtype).max)
