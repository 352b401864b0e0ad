"""Batches of images as ComfyUI passes them, as the source and the sink of a conversion.

A batch is a tensor (N, H, W, C), RGB or RGBA, 0 to 1; images of fpsboost are BGR or BGRA. Torch is not imported:
methods of the tensors suffice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import Frame, InputError, MemoryLimit

swaps = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
"""Conversions of OpenCV that turn RGB into BGR and back, by the number of channels."""


class Tensor(Protocol):
    """The part of ``torch.Tensor`` that is used."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, index: int) -> Tensor: ...
    def cpu(self) -> Tensor: ...
    def float(self) -> Tensor: ...
    def numpy(self) -> NDArray[Any]: ...
    def new_empty(self, size: tuple[int, ...]) -> Tensor: ...


def check_batch(images: Tensor) -> None:
    """Raise `InputError` unless a tensor is a batch of RGB or RGBA images."""
    if len(images.shape) != 4 or images.shape[3] not in swaps or 0 in images.shape:
        raise InputError(
            f"`images` must have the shape (frames, height, width, 3 or 4), not {tuple(images.shape)}; "
            "connect a batch of images."
        )


def frames_of(images: Tensor, numbers: Iterable[int]) -> Iterator[NDArray[Any]]:
    """Yield images of a batch by their numbers, one after the other, (H, W, C) float32, BGR or BGRA."""
    for number in numbers:
        yield cv2.cvtColor(images[number].cpu().float().numpy(), swaps[images.shape[3]])


class BatchSink:
    """Sink that writes frames into a batch of its own, with the confidence of every pixel; 1 for frames of the source.

    `images` (count, H, W, C) and `confidence` (count, H, W) are float32, in the machine's own memory. Of `memory`,
    which is for the frames and for interpolating them, `memory_left` remains.
    """

    holds_last_frame = False
    needs_confidence = True
    needs_motion = False

    def __init__(self, like: Tensor, count: int, memory: MemoryLimit) -> None:
        given, height, width, channels = like.shape
        needed = 4 * count * height * width * (channels + 1)
        if needed >= memory.bytes:
            raise InputError(
                f"{given} images of {width}x{height} become {count}, which take {needed / 1e9:.1f} GB of memory where "
                f"{memory.bytes / 1e9:.1f} GB are available; take a smaller `multiplier`, or fewer images at a time."
            )
        self.memory_left = MemoryLimit(memory.bytes - needed)
        first = like[0].cpu().float()  # whose type and device the new ones get
        self.images = first.new_empty((count, height, width, channels))
        self.confidence = first.new_empty((count, height, width))
        self.remarks: list[str] = []
        self._images, self._confidence = self.images.numpy(), self.confidence.numpy()
        self._written = 0

    def write(self, frame: Frame) -> None:
        """Write the next frame."""
        self._images[self._written] = cv2.cvtColor(frame.array, swaps[self._images.shape[3]])
        self._confidence[self._written] = np.float32(1) if frame.confidence is None else frame.confidence
        self._written += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Do nothing: the batch is handed over whole, or not at all where an exception ends the run."""
