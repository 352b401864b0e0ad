"""Videos, cameras and streams read by OpenCV, and arrays that are in memory, as sources."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame, Image, check_pair
from fpsboost.io import Closing
from fpsboost.io.memory_limit import MemoryLimit

MAX_DENOMINATOR = 1001
"""Of a rate that OpenCV gives as a float: 29.97 is 30000/1001."""


class ArraySource(Closing):
    """Images that come one after the other, at a constant rate.

    Parameters
    ----------
    images : iterable of (H, W, C) or (H, W) uint8, uint16 or float32
        All of one shape and type, not to be written to any more. The first one is taken at once.
    rate : Fraction
        Frames per second.
    name : str
        For messages.

    Raises
    ------
    InputError
        There is none, or the first is no image; while iterating also: another one differs from it.
    """

    def __init__(self, images: Iterable[Image], rate: Fraction, name: str = "The source") -> None:
        images = iter(images)
        first = next(images, None)
        if first is None:
            raise InputError(f"{name} gives no frame; check that it is open and not at its end.")
        self._first = _with_channels(first)
        check_pair(self._first, self._first)
        self._images = chain([first], images)
        height, width = self._first.shape[:2]
        self.info = ClipInfo(name, height, width, rate, 1 / rate, None)
        self.remarks: list[str] = []

    def __iter__(self) -> Iterator[Frame]:
        for number, image in enumerate(map(_with_channels, self._images)):
            check_pair(self._first, image)
            yield Frame(image, number / self.info.rate, 1 / self.info.rate)

    def close(self) -> None:
        """Do nothing: what the images come from belongs to the caller."""


class CaptureSource(ArraySource):
    """A file, a camera or a stream, read by OpenCV.

    Parameters
    ----------
    path : str
        Whatever `cv2.VideoCapture` takes: a file, an address, a GStreamer pipeline, the number of a camera.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Raises
    ------
    InputError
        OpenCV cannot open it, finds no frame in it, or it is too large.
    """

    def __init__(self, path: str, *, limit: MemoryLimit | None = None) -> None:
        self._capture = (
            cv2.VideoCapture(int(path)) if path.isdigit() and not Path(path).exists() else cv2.VideoCapture(path)
        )
        try:
            if not self._capture.isOpened():
                raise InputError(f"{path} cannot be opened by OpenCV; check the name, or leave --decoder out.")
            size = [int(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
            (limit or MemoryLimit()).check(path, *size)
            rate = rate_of(self._capture)
            if rate is None:
                raise InputError(f"{path} has no frame rate that OpenCV knows; leave --decoder out.")
            super().__init__(captured(self._capture), rate, path)
        except BaseException:
            self._capture.release()
            raise
        self.files = [Path(path)] if Path(path).is_file() else []
        self.remarks = [
            f"{path} was read by OpenCV: 8-bit colours at a constant rate, without sound, subtitles and metadata."
        ]

    def close(self) -> None:
        """Close the file or the device."""
        self._capture.release()


def captured(capture: cv2.VideoCapture) -> Iterator[Image]:
    """Yield the frames of a capture until it gives no more."""
    while True:
        is_there, image = capture.read()
        if not is_there:
            return
        yield np.asarray(image)


def rate_of(capture: cv2.VideoCapture) -> Fraction | None:
    """Return the frames per second that a capture says; None where it says nothing that can be."""
    rate = capture.get(cv2.CAP_PROP_FPS)
    return Fraction(rate).limit_denominator(MAX_DENOMINATOR) if math.isfinite(rate) and rate > 0 else None


def _with_channels(image: Image) -> Image:
    return np.ascontiguousarray(image[..., np.newaxis] if image.ndim == 2 else image)
