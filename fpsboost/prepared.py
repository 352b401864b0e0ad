"""What is computed from one image alone: once, for both pairs that the image is part of."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from fractions import Fraction
from typing import Any, NamedTuple, TypeVar

from fpsboost.frame import Image

Result = TypeVar("Result")


class Moment(NamedTuple):
    """When a source shows an image: as which frame, and how many seconds, after the first one of the clip."""

    number: int
    seconds: Fraction


class PreparedImage:
    """An image that remembers what was made of it.

    Parameters
    ----------
    pixels : (H, W, C) uint8, uint16 or float32
        Not to be written to any more.
    place : Fraction, optional
        Where the image lies among the frames of the output, counted from 0: for motion that was rendered for each of
        those.
    moment : Moment, optional
        When the source shows it.

    Examples
    --------
    >>> import numpy as np
    >>> image = PreparedImage(np.zeros((2, 3, 1), np.uint8))
    >>> image.once(np.zeros_like) is image.once(np.zeros_like)
    True
    """

    def __init__(self, pixels: Image, place: Fraction | None = None, moment: Moment | None = None) -> None:
        self.pixels = pixels
        self.place = place
        self.moment = moment
        self._results: dict[tuple[Hashable, ...], Any] = {}

    def once(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """``function(pixels, *arguments)``, computed when it is first asked for."""
        key = function, *arguments
        if key not in self._results:
            self._results[key] = function(self.pixels, *arguments)
        result: Result = self._results[key]
        return result

    def forget(self) -> None:
        """Let go of all results; what is asked for again is computed again."""
        self._results.clear()
