"""Frames in memory: a source and a sink of them, and the cheapest interpolator and encodings."""

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from fractions import Fraction
from itertools import pairwise

import numpy as np

from fpsboost import ClipInfo, Encoding, Frame, Interpolator
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend

BLEND = Interpolator(ZeroMotion(), Blend(), cuts=None, compensate_illumination=False)
FAST = Encoding(preset="ultrafast")
LOSSLESS = Encoding(crf=0, preset="ultrafast")
SIZE = (8, 12)


def make_frames(times: Iterable[Fraction], end: Fraction) -> list[Frame]:
    """One flat frame per time, each brighter than the one before, with a decoder's picture of its own."""
    times = list(times)
    durations = [b - a for a, b in pairwise([*times, end])]
    images = [np.full((*SIZE, 3), 10 * index % 256, np.uint8) for index in range(len(times))]
    return [
        Frame(image, time, duration, original=object())
        for image, time, duration in zip(images, times, durations, strict=True)
    ]


def regular(count: int, rate: Fraction = Fraction(25), start: Fraction = Fraction(0)) -> list[Frame]:
    return make_frames([start + k / rate for k in range(count)], start + count / rate)


class FakeSource(AbstractContextManager):
    """Frames from memory."""

    def __init__(self, frames: Iterable[Frame], rate: Fraction = Fraction(25), frame_count: int | None = None) -> None:
        self.info = ClipInfo("fake.mp4", *SIZE, rate, Fraction(1, 100), frame_count)
        self.remarks: list[str] = []
        self._frames = frames

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames
        self.remarks.append("The source was guessed at.")

    def close(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


class FakeSink(AbstractContextManager):
    """Keeps what it gets; raises `error` in place of frame `fail_at`."""

    def __init__(
        self, holds_last_frame: bool = True, fail_at: int | None = None, error: BaseException | None = None
    ) -> None:
        self.holds_last_frame = holds_last_frame
        self.frames: list[Frame] = []
        self.remarks = ["The target lost something."]
        self._fail_at, self._error = fail_at, error

    def write(self, frame: Frame) -> None:
        if len(self.frames) == self._fail_at and self._error:
            raise self._error
        self.frames.append(frame)

    def __exit__(self, *_: object) -> None: ...
