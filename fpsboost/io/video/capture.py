"""Frame sources that read videos, cameras and streams with OpenCV, or arrays in memory."""

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path

import cv2
import numpy as np

from fpsboost.contracts import ReadInOrder
from fpsboost.errors import InputError, undone_by
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Image
from fpsboost.image_checks import check_pair, check_values
from fpsboost.io.output import StreamInfo
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

MAX_DENOMINATOR = 1001  # maximum denominator of a frame rate that OpenCV gives as a float: 29.97 becomes 30000/1001


class ArraySource(ReadInOrder):
    """Source of the images of an iterable, at a constant frame rate; the first one is read at once.

    Closing it does nothing, since the caller owns the origin of the images.

    Parameters
    ----------
    images : iterable of ndarray
        Images, (H, W, C) or (H, W), all of one shape and dtype, which must not be modified afterwards.
    rate : Fraction
        Frames per second.
    name : str
        The source in messages.

    Raises
    ------
    InputError
        There is no image, or one is invalid; while iterating also: one differs from the first.
    OptionError
        While iterating: float images are not on the scale from 0 to 1, by the first one that is not of one value.
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
        self.remarks = Remarks()
        self.stream_info = StreamInfo()

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; the images are consumed."""
        is_checked = False
        for number, image in islice(enumerate(map(_with_channels, self._images)), self._begin, None):
            check_pair(self._first, image)
            if not is_checked and (image != image[0, 0, 0]).any():  # black tells nothing
                check_values(image, self.info.name)
                is_checked = True
            yield Frame(image, number / self.info.rate, 1 / self.info.rate)


class CaptureSource(ArraySource):
    """Source of the frames that OpenCV captures, 8-bit BGR at a constant rate, without sound and metadata.

    Parameters
    ----------
    path : str
        File, URL, GStreamer pipeline, or number of a camera.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Raises
    ------
    InputError
        OpenCV cannot open it, reports no frame rate, or it is too large.
    """

    def __init__(self, path: str, *, limit: MemoryLimit | None = None) -> None:
        camera = int(path) if path.isdigit() and not Path(path).exists() else path
        self._capture = cv2.VideoCapture(camera)
        with undone_by(self._capture.release):
            if not self._capture.isOpened():
                raise InputError(f"{path} cannot be opened by OpenCV; check the name, or leave `decoder` out.")
            size = [int(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
            (limit or MemoryLimit()).check(path, *size)
            rate = rate_of(self._capture)
            if rate is None:
                raise InputError(f"{path} has no frame rate that OpenCV knows; leave `decoder` out.")
            super().__init__(captured(self._capture), rate, path)
        self.stream_info = StreamInfo(files=[Path(path)] if Path(path).is_file() else [])
        self.remarks.add("read-by-opencv", name=path)

    def close(self) -> None:
        """Release the capture."""
        self._capture.release()


def captured(capture: cv2.VideoCapture) -> Iterator[Image]:
    """Yield the frames of a capture until it ends."""
    while (result := capture.read())[0]:
        yield np.asarray(result[1])


def rate_of(capture: cv2.VideoCapture) -> Fraction | None:
    """Return the frame rate that a capture reports, in frames per second, or None if it is not finite and positive."""
    rate = capture.get(cv2.CAP_PROP_FPS)
    return Fraction(rate).limit_denominator(MAX_DENOMINATOR) if math.isfinite(rate) and rate > 0 else None


def _with_channels(image: Image) -> Image:
    """Return an image as a contiguous (H, W, C) array."""
    array = np.ascontiguousarray(image)
    return array[..., np.newaxis] if array.ndim == 2 else array
