"""True frames hidden between those that are shown, read as a stream."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import NamedTuple

import numpy as np

from fpsboost.errors import InputError, OptionError
from fpsboost.frame import Frame, Image
from fpsboost.media.opening import PIPES, Purpose, open_source
from fpsboost.prepared import PreparedImage


class Hidden(NamedTuple):
    """A frame that a method does not get to see."""

    number: int
    """In the clip, counted from 0."""
    t: Fraction
    """Its place between the shown frames."""
    truth: Image


class Interval(NamedTuple):
    """Two shown frames and those hidden between them."""

    number: int
    """Of the first shown frame in the clip."""
    shown0: Frame
    shown1: Frame
    hidden: tuple[Hidden, ...]

    def prepared(self) -> tuple[PreparedImage, PreparedImage]:
        """The shown frames as methods take them, each in its place in the clip, nothing remembered of them yet."""
        places = self.number, self.number + len(self.hidden) + 1
        first, last = (
            PreparedImage(each.image, Fraction(place))
            for each, place in zip((self.shown0, self.shown1), places, strict=True)
        )
        return first, last


@dataclass(frozen=True)
class Hiding:
    """Which frames of a clip are hidden.

    Parameters
    ----------
    skip : int
        Frames hidden between every two that are shown.
    first, last : int or None
        The frames from `first` up to, but not including, `last`; to the end where that is None.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    skip: int = 1
    first: int = 0
    last: int | None = None

    def __post_init__(self) -> None:
        if self.skip < 1:
            raise OptionError(f"--skip must be at least 1, the number of frames to hide, not {self.skip}.")
        if self.first < 0 or (self.last is not None and self.last - self.first < self.skip + 2):
            wanted = "" if self.last is None else self.last
            raise OptionError(
                f"--range {self.first}:{wanted} leaves nothing to hide; with --skip {self.skip} give at least "
                f"{self.skip + 2} frames."
            )

    def intervals(self, path: str, input_fps: Fraction | None = None) -> Iterator[Interval]:
        """Read a clip; a rest at its end that fills no interval is left out.

        Parameters
        ----------
        path : str
            A video, a folder or a pattern of images.
        input_fps : Fraction, optional
            Frames per second of images.

        Raises
        ------
        InputError
            It cannot be read, or is too short to hide a frame.
        """
        shown: tuple[int, Frame] | None = None
        waiting: list[Frame] = []
        found = False
        if path in PIPES:
            raise InputError("Standard input can be read only once, and every method needs it; name a file.")
        with open_source(path, input_fps, purpose=Purpose(pictures_alone=True, upright=True)) as source:
            for number, frame in islice(enumerate(source), self.first, self.last):
                _check_numbers(frame.image, number, path)
                if shown is not None and len(waiting) < self.skip:
                    waiting.append(frame)
                    continue
                if shown is not None:
                    found = True
                    yield self._interval(shown, frame, waiting)
                shown, waiting = (number, frame), []
        if not found:
            raise InputError(
                f"{path} has too few frames to hide {'one' if self.skip == 1 else self.skip} between two others; "
                f"{self.skip + 2} are needed in the range."
            )

    def _interval(self, shown: tuple[int, Frame], after: Frame, waiting: list[Frame]) -> Interval:
        number, before = shown
        steps = self.skip + 1
        hidden = tuple(Hidden(number + k, Fraction(k, steps), frame.image) for k, frame in enumerate(waiting, start=1))
        return Interval(number, before, after, hidden)


def _check_numbers(image: Image, number: int, path: str) -> None:
    if image.dtype == np.float32 and not np.isfinite(image).all():
        raise InputError(
            f"Frame {number} of {path} holds values that are no numbers (NaN or infinity), to which nothing can be "
            "compared; repair it, or leave it out with --range."
        )


def parse_range(text: str) -> tuple[int, int | None]:
    """Read ``A:B``, either of which may be left out.

    Raises
    ------
    OptionError
        It is written in another way.

    Examples
    --------
    >>> parse_range("10:"), parse_range(":25")
    ((10, None), (0, 25))
    """
    first, colon, last = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return int(first or 0), int(last) if last else None
    except ValueError:
        raise OptionError(f"--range {text!r} is no range; write it like 0:50, 100: or :50.") from None
