"""Source of the frames of GIF, APNG and animated WebP, with 8 bits per channel.

Pillow reads APNG and animated WebP, PyAV GIF.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import accumulate, count, islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import av
import av.filter
import numpy as np

from fpsboost.contracts import ClosesOnExit
from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Image
from fpsboost.io.animation.writers import MAX_DELAY_TERM, SHORTEST_GIF_DELAY, WEBP_ANIMATED
from fpsboost.io.images.colours import colours_of
from fpsboost.io.images.files import PNG_SIGNATURE, ImageMetadata, content_of, png_chunks
from fpsboost.io.output import StreamInfo
from fpsboost.media import as_fraction, counted, measure_rate
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage  # whoever reads no animation does not wait for Pillow

DEFAULT_DELAY = Fraction(1, 10)
"""Time for which players show a frame without a delay, seconds."""


HEADER_SIZE = 30
"""Bytes in which a PNG declares its depth, and a WebP its size."""


def is_animation(path: Path) -> bool:
    """Return whether a file is a GIF, an APNG or an animated WebP by its content; False if it cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(HEADER_SIZE)
        return (
            start.startswith(b"GIF8") or bool(_webp_size(start)) or any(name == b"acTL" for name, _ in png_chunks(path))
        )
    except OSError:
        return False


def _webp_size(start: bytes) -> tuple[int, int] | None:
    """Return the width and height that an animated WebP declares in its first bytes; None for other files."""
    if len(start) < HEADER_SIZE or start[8:16] != b"WEBPVP8X" or not start[20] & WEBP_ANIMATED:
        return None
    return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")


def opened(file: BinaryIO) -> PillowImage:
    """Open an animation without decoding it; its warnings become remarks or errors of the source."""
    from PIL import Image as Pillow  # noqa: PLC0415

    with warnings.catch_warnings(action="ignore"):
        return Pillow.open(file, formats=("GIF", "PNG", "WEBP"))


class AnimationSource(ClosesOnExit):
    """Source of the frames of a GIF, APNG or animated WebP, composited as players show them.

    The file is kept in memory as it is stored, so that nothing stays open. Opening decodes the whole of it once,
    because nothing else gives all delays; iterating decodes it again. `plays` is the number of times that players show
    it, 0 for ever; `remarks` say what is damaged or not read.

    Parameters
    ----------
    path : str
        File to read; messages name it so.
    keeps_alpha : bool
        Yield BGRA if there are transparent parts; otherwise these are composited over white, with a remark.
    limit : MemoryLimit, optional
        Limit that the size of the pictures is checked against; by default the free memory.

    Raises
    ------
    InputError
        The file cannot be read, is too large, or has no frame that can be decoded.
    """

    def __init__(self, path: str, *, keeps_alpha: bool = True, limit: MemoryLimit | None = None) -> None:
        data = content_of(Path(path))
        limit = limit or MemoryLimit()
        self._file = BytesIO(data)
        self._keeps_alpha = keeps_alpha
        self._has_alpha = False
        self._begin = 0
        declared = _webp_size(data[:HEADER_SIZE])
        if declared is not None:  # Pillow allocates the canvas of a WebP when it opens the file
            limit.check(path, *declared)
        try:
            image = opened(self._file)
        except Exception as error:  # damage makes Pillow raise nearly anything
            raise InputError(f"{path} is damaged or no animation; replace it.") from error
        self._format = image.format
        width, height = image.size
        limit.check(path, width, height)
        self._first = int(getattr(image, "default_image", False))  # which an APNG has for viewers without animation
        self._delays = list[Fraction]()
        is_whole = self._survey(image)
        if not self._delays:
            raise InputError(f"{path} is damaged or no animation; replace it.")
        profile = image.info.get("icc_profile", b"")
        self.remarks = Remarks()
        colours = colours_of(self.remarks, Path(path), ImageMetadata(profile, chunks=tuple(png_chunks(Path(path)))))
        if data.startswith(PNG_SIGNATURE) and data[24] == 16:
            self.remarks.add("eight-bits-read", name=path)
        if not is_whole:
            self.remarks.add("animation-damaged", name=path, frames=counted(len(self._delays), "frame"))
        if self._has_alpha and not keeps_alpha:
            self.remarks.add("alpha-over-white", name=path)
        self.plays = _plays_of(image)
        self.stream_info = StreamInfo(colours=colours, plays=self.plays, files=[Path(path)])
        per_second = 100 if self._format == "GIF" else 1000
        tick = Fraction(1, math.lcm(per_second, *(delay.denominator for delay in self._delays)))
        times = list(accumulate(self._delays, initial=Fraction(0)))
        measured = measure_rate([int(time / tick) for time in times], tick)
        assert measured is not None, "every delay is above 0"
        self.info = ClipInfo(path, height, width, 1 / measured.interval, tick, len(self._delays), times[-1])

    def _survey(self, image: PillowImage) -> bool:
        """Read delays and alpha up to the end or the first damage; return whether all frames could be decoded.

        A GIF does not tell the number of its frames, and ends where it ends.
        """
        try:
            for pixels, delay in self._decoded():
                self._has_alpha |= bool((pixels[..., 3] < 255).any())
                self._delays.append(delay)
            return self._format == "GIF" or self._first + len(self._delays) == getattr(image, "n_frames", 1)
        except Exception:  # damage, as above
            return False

    def frame_times(self) -> Sequence[Fraction]:
        """Return the times of all frames, seconds, by the delays that opening has found."""
        return list(accumulate(self._delays[:-1], initial=Fraction(0)))

    def begin_at(self, number: int) -> None:
        """Begin iterating at a frame, counted from 0; those before it are decoded, as each is drawn over the last."""
        self._begin = number

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames, BGR or BGRA uint8, with the times and delays that opening has found.

        Each is decoded when it is due. Damaged files end with the last frame that opening could decode.
        """
        time = sum(self._delays[: self._begin], Fraction(0))
        for image, delay in islice(self._decoded(), self._begin, len(self._delays)):
            pixels = image
            if not self._has_alpha:
                pixels = np.ascontiguousarray(image[..., :3])
            elif not self._keeps_alpha:  # over white
                white = np.float32(255)
                pixels = np.rint(white - (white - image[..., :3]) * (image[..., 3:] / white)).astype(np.uint8)
            yield Frame(pixels, time, delay)
            time += delay

    def _decoded(self) -> Iterator[tuple[Image, Fraction]]:
        """Decode the composited frames from the first on, BGRA, with their delays in seconds.

        FFmpeg decodes GIF, because Pillow fills with a colour what browsers clear after an opaque frame; Pillow decodes
        others.
        """
        self._file.seek(0)
        if self._format == "GIF":
            with av.open(self._file, "r", format="gif") as container:
                for picture in container.decode(video=0):
                    delay = picture.duration * (as_fraction(picture.time_base) or Fraction(0))
                    image = np.ascontiguousarray(picture.to_ndarray(format="bgra"))
                    yield image, delay if delay >= SHORTEST_GIF_DELAY else DEFAULT_DELAY
            return
        file = opened(self._file)
        with suppress(EOFError):
            for index in count(self._first):
                file.seek(index)
                # of 16-bit gray Pillow would clip all that is no 8-bit level
                shown = file.point(lambda level: level * (1 / 256)) if file.mode == "I;16" else file
                image = np.ascontiguousarray(np.asarray(shown.convert("RGBA"))[..., [2, 1, 0, 3]])
                milliseconds = Fraction(file.info.get("duration") or 100)
                # of an APNG, the quotient of two 16-bit numbers as float
                yield image, (milliseconds / 1000).limit_denominator(MAX_DELAY_TERM)


def _plays_of(image: PillowImage) -> int:
    """Return how often players show an animation, 0 for ever; a GIF counts the repeats after the first time."""
    loop = image.info.get("loop")
    if image.format != "GIF":
        return loop or 0
    return 1 if loop is None else loop + 1 if loop else 0
