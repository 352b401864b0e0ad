"""Read an animation file: APNG and animated WebP with Pillow, GIF with PyAV, 8 bits per channel."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import av
import numpy as np

from fpsboost.contracts import ClosesOnExit
from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Image
from fpsboost.io.images.encoder import colours_of
from fpsboost.io.images.files import PNG_SIGNATURE, ImageMetadata, content_of, png_chunks
from fpsboost.io.output import StreamInfo
from fpsboost.media import as_fraction
from fpsboost.memory import MemoryLimit

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage  # whoever reads no animation does not wait for Pillow

DEFAULT_DELAY, SHORTEST_GIF_DELAY = Fraction(1, 10), Fraction(1, 50)
"""Seconds that players show a frame without a delay, or one of a GIF with a shorter delay than the second."""

MAX_DELAY_TERM = 65535
"""Largest numerator and denominator of an APNG's delay."""

WEBP_ANIMATED = 0x02
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
        data, limit = content_of(Path(path)), limit or MemoryLimit()
        self._file, self._keeps_alpha, self._has_alpha = BytesIO(data), keeps_alpha, False
        declared = _webp_size(data[:HEADER_SIZE])
        if declared is not None:  # Pillow allocates the canvas of a WebP when it opens the file
            limit.check(path, *declared)
        try:
            image = opened(self._file)
        except Exception as error:  # damage makes Pillow raise nearly anything
            raise InputError(f"{path} is damaged or no animation; replace it.") from error
        self._format, (width, height) = image.format, image.size
        limit.check(path, width, height)
        self._first = int(getattr(image, "default_image", False))  # which an APNG has for viewers without animation
        self._delays = list[Fraction]()
        is_whole = self._survey(image)
        if not self._delays:
            raise InputError(f"{path} is damaged or no animation; replace it.")
        profile = image.info.get("icc_profile", b"")
        colours, untaggable = colours_of(Path(path), ImageMetadata(profile, chunks=tuple(png_chunks(Path(path)))))
        frames = f"{len(self._delays)} frame{'' if len(self._delays) == 1 else 's'}"
        said = {
            **dict.fromkeys(untaggable, True),
            f"{path} has 16 bits per channel, of which 8 were read.": data.startswith(PNG_SIGNATURE) and data[24] == 16,
            f"{path} is damaged or ends early; {frames} could be decoded and were converted.": not is_whole,
            f"{path} has transparent parts, which the output cannot hold; they were laid over white.": self._has_alpha
            and not keeps_alpha,
        }
        self.remarks = [remark for remark, is_due in said.items() if is_due]
        self.plays = _plays_of(image)
        self.stream_info = StreamInfo(colours=colours, plays=self.plays, files=[Path(path)])
        rate = len(self._delays) / sum(self._delays, Fraction(0))
        time_base = Fraction(1, math.lcm(*(delay.denominator for delay in self._delays)))
        self.info = ClipInfo(path, height, width, rate, time_base, len(self._delays))

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

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames, BGR or BGRA uint8, with the times and delays that opening has found.

        Each is decoded when it is due. Damaged files end with the last frame that opening could decode.
        """
        time = Fraction(0)
        for image, delay in islice(self._decoded(), len(self._delays)):
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
