"""Sink of animations, which appear under their names when they are complete."""

import math
import os
import secrets
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Self

import numpy as np

from fpsboost.errors import OutputError, undone_by
from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.io.animation.source import opened
from fpsboost.io.animation.writers import types
from fpsboost.io.output import Output, check_frame_size
from fpsboost.io.video.ycc import straight_16_bit
from fpsboost.media import MASTERING, StagedSink, check_writable, missing_codecs
from fpsboost.remarks import Remarks

BROWSERS_SLOW_DOWN = Fraction(1, 100)  # browsers show frames of this length and shorter ones for a tenth of a second


class AnimationSink(StagedSink):
    """Sink that writes a GIF, APNG or WebP, which appears under its name when it is complete.

    A frame is shown until the next one, rounded to ticks of the file; rounding does not accumulate. Frames longer than
    the type can store are repeated, shorter ones are lengthened, with a remark if others become late by that.

    Parameters
    ----------
    output : Output
        Path, size, rate and plays of the frames to come. Its suffix determines the type, its time base the ticks of an
        APNG; colour tags that the type cannot store are lost with a remark.

    Raises
    ------
    OutputError
        The path cannot be written, exists or is an input; the type cannot hold the size or rate; an encoder is missing.
    """

    holds_last_frame = True

    def __init__(self, output: Output) -> None:
        self._name = output.path
        self._path = Path(output.path)
        self._info = output.info
        self._suffix = self._path.suffix.lower()
        self._type = types[self._suffix]
        self._plays = min(output.stream.plays, self._type.most_plays)
        check_writable(self._path, output.path, output.stream.files, output.overwrite)
        self._check_fits(output.timing.rate)
        self._temporary = self._path.with_name(f".{self._path.name}.partial-{secrets.token_hex(4)}")
        self._tick = self._type.tick or output.timing.time_base
        self._shortest = max(1, math.ceil(self._type.shortest / self._tick))
        self._longest = int(self._type.longest / self._tick)
        self._begin: Fraction | None = None
        self._latest = Fraction(0)
        self._ticks = list[int]()
        colours = output.stream.traits or output.stream.colours
        self._code_points = colours.code_points
        lost = " and the ".join(word for word in colours.beyond_sdr() if not self._type.has_tags or word == MASTERING)
        self._losses = Remarks()
        if lost:
            self._losses.add("not-said-in-animation", name=self._name, what=lost)

    def _check_fits(self, rate: Fraction) -> None:
        """Raise `OutputError` if the type cannot hold the size or the rate, or FFmpeg lacks its encoder."""
        largest = self._type.largest_side
        width = self._info.width
        height = self._info.height
        fastest = 1 / self._type.shortest
        others = {".gif": ", or write .webp or .apng", ".webp": ", or write .apng"}.get(self._suffix, "")
        if max(width, height) > largest:
            raise OutputError(
                f"{self._name} cannot hold {width}x{height} pixels, {self._suffix} ends at {largest}; use .apng."
            )
        if missing_codecs([self._type.codec], "w"):
            raise OutputError(
                f"{self._name} needs the encoder {self._type.codec}, which this FFmpeg lacks; install PyAV's wheel."
            )
        if rate > fastest:
            raise OutputError(
                f"{self._name} cannot show {float(rate):.6g} frames per second, {self._suffix} ends at {fastest}; use "
                f"`fps={fastest}` or less{others}."
            )

    @property
    def remarks(self) -> Remarks:
        """Remarks on losses so far: colour tags, depth, short frames, and frames that come late."""
        remarks = Remarks(self._losses)
        before, last = [0, 0, *self._ticks][-2:]
        if self._latest >= self._type.shortest:
            late, shortest = (float(time * 1000) for time in (self._latest, self._type.shortest))
            remarks.add("frames-late", name=self._name, late=late, file_type=self._suffix, shortest=shortest)
        if any(ticks * self._tick <= BROWSERS_SLOW_DOWN for ticks in self._ticks):
            remarks.add("frames-slowed-by-browsers", name=self._name)
        if self._suffix == ".apng" and 2 * abs(before - last) > before > 0:
            remarks.add("last-frame-as-before", name=self._name)
        return remarks

    def __enter__(self) -> Self:
        """Create the hidden file that is renamed at the end, and open its muxer; `OutputError` if it cannot be made."""
        with self._explained():
            self._file = self._temporary.open("x+b")
        with undone_by(lambda: self._leave(None)):
            self._writer = self._type(self._file, self._plays, self._tick, self._code_points)
        return self

    def write(self, frame: Frame) -> None:
        """Encode the next frame, shown from its time for its duration; times must increase.

        Gray becomes colour, and depth that the type cannot hold is lost with a remark. Raises `OutputError` if the
        frame has another size or shape than the first, or if writing fails.
        """
        check_frame_size(frame, self._info, self._name)
        image = self._storable(frame.array)
        if self._begin is None:
            self._begin = frame.time
        end = (frame.time + frame.duration - self._begin) / self._tick
        while True:  # a frame that is longer than the type can store is repeated
            remaining = end - self._writer.ticks
            ticks = min(max(round(remaining), self._shortest), self._longest)
            with self._explained():
                self._writer.add(image, ticks)
            self._ticks.append(ticks)
            if remaining <= self._longest:
                break
        self._latest = max(self._latest, (self._writer.ticks - end) * self._tick)

    def _storable(self, image: Image) -> Image:
        """Convert an image to 3 or 4 channels of a type that the file can hold, and remark on what is lost."""
        if image.dtype == np.float32:
            self._lose("values beyond black and white, and precision beyond 16 bits" if self._type.is_deep else "depth")
            image = straight_16_bit(image)
        if image.dtype == np.uint16 and not self._type.is_deep:
            self._lose("depth")
            image = np.rint(image / np.float32(257)).astype(np.uint8)
        # gray, and gray with alpha, become colour
        return image[..., [0, 0, 0, 1][: image.shape[2] + 2]] if image.shape[2] < 3 else image

    def _lose(self, what: str) -> None:
        """Remark, once, on a property of the frames that the type cannot hold."""
        bits = "16 bits" if self._type.is_deep else "8 bits; write an .apng to keep it"
        self._losses.add("depth-lost", name=self._name, what=what, file_type=self._suffix, bits=bits)

    def _finish(self) -> None:
        """Write the end, read the file back and give it its name; `OutputError` without frames or if it is damaged."""
        if self._begin is None:
            raise OutputError(f"{self._name} was not written because there were no frames.")
        self._writer.finish()
        self._file.seek(0)
        try:
            opened(self._file).load()
        except Exception as error:  # damage makes Pillow raise nearly anything
            raise OutputError(
                f"{self._name} was not written because it cannot be read back; check the disk."
            ) from error
        self._file.close()
        os.replace(self._temporary, self._path)

    def _leave(self, error: BaseException | None) -> None:
        """Close and remove the hidden file; after `_finish` it has its name, and stays."""
        for clean_up in (self._file.close, self._temporary.unlink):
            with suppress(OSError):
                clean_up()
