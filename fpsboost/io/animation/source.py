"""Read an animation file: GIF, APNG and WebP, every frame as players show it, with its own delay."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from fpsboost.errors import InputError, explained
from fpsboost.frame import ClipInfo, Frame, Image
from fpsboost.io import ClosesOnExit
from fpsboost.io.animation import gif, png, webp
from fpsboost.io.animation.canvas import Outline, TimedImage, composed, damaged
from fpsboost.io.images.exact_reads import DamagedError
from fpsboost.io.images.png_chunks import SIGNATURE
from fpsboost.io.images.sizes import declared_size
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.stream_info import StreamInfo

MAX_HEADER = 64
"""Bytes in which an animation says its size."""

Format = Literal["gif", "apng", "webp"]

_read_outline: dict[Format, Callable[[BinaryIO], Outline]] = {
    "gif": gif.read_outline,
    "apng": png.read_outline,
    "webp": webp.read_outline,
}


def animation_format(path: Path) -> Format | None:
    """Tell from its content which type of animation a file is; None where it is none, or cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(12)
            file.seek(0)
            if start.startswith(b"GIF8"):
                return "gif"
            if start.startswith(SIGNATURE) and png.is_apng(file):
                return "apng"
            if start[8:] == b"WEBP" and webp.is_animated(file):
                return "webp"
    except OSError:
        pass
    return None


class AnimationSource(ClosesOnExit):
    """Frames of an animation.

    Parameters
    ----------
    path : str
        A file of a type that `animation_format` knows. Opening reads headers, and of a GIF the first frame.
    keeps_alpha : bool
        Yield BGRA where anything can be seen through; otherwise lay such frames over white, and say so.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Attributes
    ----------
    path : Path
    plays : int
        How often it is shown; 0 for ever again.

    Raises
    ------
    InputError
        It cannot be read, is damaged or too large; while iterating also: the first frame cannot be decoded.
    """

    def __init__(self, path: str, *, keeps_alpha: bool = True, limit: MemoryLimit | None = None) -> None:
        self._name, self.path = path, Path(path)
        self._format = animation_format(self.path)
        self._file = self._open()
        try:
            size = declared_size(self._file.read(MAX_HEADER))
            if size is not None:
                (limit or MemoryLimit()).check(path, *size)
            self._file.seek(0)
            if self._format is None:
                raise DamagedError
            self._outline = _read_outline[self._format](self._file)
        except DamagedError:
            self._file.close()
            raise damaged(path) from None
        except BaseException:
            self._file.close()
            raise
        outline = self._outline
        self.plays = outline.plays
        self._keeps_alpha = keeps_alpha
        self._remarks: list[str] = []
        if outline.has_alpha and not keeps_alpha:
            self._remarks.append(
                f"{path} has transparent parts, which the output cannot hold; they were laid over white."
            )
        rate = outline.frame_count / outline.duration
        self.info = ClipInfo(path, outline.height, outline.width, rate, outline.time_base, outline.frame_count)

    def _open(self) -> BinaryIO:
        with explained(InputError, "read", self._name, "check that it exists and that you may read it"):
            return self.path.open("rb")

    @property
    def stream_info(self) -> StreamInfo:
        """See `fpsboost.io.DescribedSource.stream_info`."""
        return StreamInfo(plays=self.plays, files=[self.path])

    @property
    def remarks(self) -> list[str]:
        """Remarks on alpha that was composited over white, and on damage."""
        return list(self._remarks)

    def __iter__(self) -> Iterator[Frame]:
        self._file.seek(0)
        time, count = Fraction(0), 0
        with closing(self._timed_images()) as pictures:
            while True:
                try:
                    shown = next(pictures, None)
                except DamagedError:
                    shown = None
                if shown is None:
                    break
                yield Frame(self._finished(shown.image), time, shown.delay)
                time += shown.delay
                count += 1
        if count == 0:
            raise damaged(self._name)
        if count < self._outline.frame_count or not self._outline.is_whole:
            frames = f"{count} frame{'' if count == 1 else 's'}"
            self._remarks.append(
                f"{self._name} is damaged or ends early; {frames} could be decoded and were converted."
            )

    def _timed_images(self) -> Generator[TimedImage, None, None]:
        if self._format == "gif":
            return gif.read_frames(self._file)
        steps = (png if self._format == "apng" else webp).read_steps(self._file)
        return composed(steps, self._outline.height, self._outline.width)

    def _finished(self, image: Image) -> Image:
        """Return BGRA if there is alpha and it is kept, else BGR."""
        if self._outline.has_alpha:
            return image if self._keeps_alpha else over_white(image)
        return np.ascontiguousarray(image[..., :3])

    def close(self) -> None:
        self._file.close()


def over_white(image: Image) -> Image:
    """Lay an image with straight alpha over white.

    Parameters
    ----------
    image : (H, W, 4) uint8 or uint16

    Returns
    -------
    (H, W, 3)
    """
    white = np.float32(np.iinfo(image.dtype).max)
    laid: Image = np.rint(white - (white - image[..., :3]) * (image[..., 3:] / white)).astype(image.dtype)
    return laid
