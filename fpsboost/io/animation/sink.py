"""Write an animation file: GIF, APNG or WebP, whole under its name or not at all."""

from __future__ import annotations

import contextlib
import math
import os
import secrets
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO, Self

import numpy as np

from fpsboost.errors import OutputError, explained
from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.io.animation.writers import AnimationWriter, types
from fpsboost.io.new_output import check_writable
from fpsboost.io.output import Output, check_frame_size
from fpsboost.io.staging import StagedSink
from fpsboost.io.video.pyav import missing_codecs
from fpsboost.io.video.ycc import straight_16_bit

ANIMATION_SUFFIXES = tuple(types)
"""Suffixes of the animations that can be written."""

BROWSERS_SLOW_DOWN = Fraction(1, 100)
"""Browsers show frames of this length and shorter ones for a tenth of a second."""


class AnimationSink(StagedSink):
    """An animation file, which appears under its name when it is complete.

    A frame is shown until the next one, rounded to the clock of the file; rounding does not accumulate.
    """

    holds_last_frame = True

    def __init__(self, output: Output) -> None:
        self._name, self._path, self._info = output.path, Path(output.path), output.info
        self._type = types[self._path.suffix.lower()]
        self._plays = min(output.stream.plays, self._type.most_plays)
        check_writable(self._path, output.path, output.stream.files, output.overwrite)
        self._check_fits(output.timing.rate)
        self._temporary = self._path.with_name(f".{self._path.name}.partial-{secrets.token_hex(4)}")
        self._tick = self._type.tick or output.timing.time_base
        self._shortest = max(1, math.ceil(self._type.shortest / self._tick))
        self._longest = int(self._type.longest / self._tick)
        self._file: BinaryIO
        self._writer: AnimationWriter
        self._begin: Fraction | None = None
        self._shown_until = 0
        self._latest = Fraction(0)
        self._losses: list[str] = []
        self._has_short_frames = False

    def _check_fits(self, rate: Fraction) -> None:
        suffix, largest = self._path.suffix.lower(), self._type.largest_side
        width, height = self._info.width, self._info.height
        if max(width, height) > largest:
            raise OutputError(
                f"{self._name} cannot hold {width}x{height} pixels, {suffix} ends at {largest}; use .apng."
            )
        if missing_codecs([self._type.codec], "w"):
            raise OutputError(
                f"{self._name} needs the encoder {self._type.codec}, which this FFmpeg lacks; install PyAV's wheel."
            )
        fastest = 1 / self._type.shortest
        if rate > fastest:
            others = "" if suffix == ".apng" else f", or write {'.webp or .apng' if suffix == '.gif' else '.apng'}"
            raise OutputError(
                f"{self._name} cannot show {float(rate):.6g} frames per second, {suffix} ends at {fastest}; use "
                f"`fps={fastest}` or less{others}."
            )

    @property
    def remarks(self) -> list[str]:
        remarks = list(self._losses)
        if self._latest >= self._type.shortest:
            remarks.append(
                f"{self._name} shows some frames up to {float(self._latest * 1000):.0f} ms late, because "
                f"{self._path.suffix.lower()} cannot show one for less than {float(self._type.shortest * 1000):.3g} ms."
            )
        if self._has_short_frames:
            remarks.append(
                f"{self._name} has frames of 10 ms and less, which browsers slow down to 100 ms; use `fps=90` or less "
                "for them."
            )
        return remarks

    def __enter__(self) -> Self:
        with self._explained():
            self._file = self._temporary.open("x+b")
        self._writer = self._type(self._file, self._plays, self._tick)
        return self

    def write(self, frame: Frame) -> None:
        """Encode one frame; times must increase."""
        check_frame_size(frame, self._info, self._name)
        image = self._storable(frame.array)
        if self._begin is None:
            self._begin = frame.time
        end = (frame.time + frame.duration - self._begin) / self._tick
        while True:  # a frame that is shown for longer than the file can say is repeated
            remaining = end - self._shown_until
            ticks = min(max(round(remaining), self._shortest), self._longest)
            with self._explained():
                self._writer.add(image, ticks)
            self._shown_until += ticks
            self._has_short_frames |= ticks * self._tick <= BROWSERS_SLOW_DOWN
            if remaining <= self._longest:
                break
        self._latest = max(self._latest, (self._shown_until - end) * self._tick)

    def _storable(self, image: Image) -> Image:
        """Convert an image to 3 or 4 channels of a type that the file can hold, and remark on what is lost."""
        if image.dtype == np.float32:
            self._lose("values beyond black and white, and precision beyond 16 bits" if self._type.is_deep else "depth")
            image = straight_16_bit(image)
        if image.dtype == np.uint16 and not self._type.is_deep:
            self._lose("depth")
            image = np.rint(image / np.float32(257)).astype(np.uint8)
        if image.shape[2] < 3:  # gray, or gray with alpha
            return image[..., [0, 0, 0, 1][: image.shape[2] + 2]]
        return image

    def _lose(self, what: str) -> None:
        remark = f"{self._name} lost {what}, because {self._path.suffix.lower()} holds "
        remark += "16 bits." if self._type.is_deep else "8 bits; write an .apng to keep it."
        if remark not in self._losses:
            self._losses.append(remark)

    def _finish(self) -> None:
        if self._begin is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        self._writer.finish()
        self._file.close()
        os.replace(self._temporary, self._path)

    def _leave(self, error: BaseException | None) -> None:
        for clean_up in (self._file.close, self._temporary.unlink):
            with contextlib.suppress(OSError):
                clean_up()

    def _explained(self) -> contextlib.AbstractContextManager[None]:
        return explained(OutputError, "write", self._name, "check the free space and the permissions")
