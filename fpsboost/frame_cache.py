"""What is computed from one image alone: once, for both pairs that the image is part of."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from fractions import Fraction
from threading import Lock
from typing import Any, NamedTuple, TypeVar

from fpsboost.frame import Image, Pixels, as_array

Result = TypeVar("Result")


class SourcePosition(NamedTuple):
    """When a source shows an image: as which frame, and how many seconds, after the first one of the clip."""

    number: int
    seconds: Fraction


class Results:
    """What is computed once and asked for by several threads: the first one computes it, the others wait for it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._futures: dict[Hashable, Future[Any]] = {}

    def cached(self, key: Hashable, compute: Callable[[], Result]) -> Result:
        """What `compute` returns, computed when the key is first asked for."""
        with self._lock:
            future = self._futures.get(key)
            is_first = future is None
            if future is None:
                future = self._futures[key] = Future()
        if is_first:
            try:
                future.set_result(compute())
            except BaseException as error:
                self.clear(key)
                future.set_exception(error)
        result: Result = future.result()
        return result

    def clear(self, *keys: Hashable) -> None:
        """Let go of these results, or of all; what is asked for again is computed again."""
        with self._lock:
            if not keys:
                self._futures.clear()
            for key in keys:
                self._futures.pop(key, None)

    def __contains__(self, key: Hashable) -> bool:
        with self._lock:
            future = self._futures.get(key)
        return future is not None and future.done()


class FrameCache:
    """An image that remembers what was made of it.

    Parameters
    ----------
    pixels : (H, W, C) uint8, uint16 or float32, or YCbCrImage
        Not to be written to any more.
    output_position : Fraction, optional
        Where the image lies among the frames of the output, counted from 0: for motion that was rendered for each of
        those.
    source_position : SourcePosition, optional
        When the source shows it.

    Examples
    --------
    >>> import numpy as np
    >>> image = FrameCache(np.zeros((2, 3, 1), np.uint8))
    >>> image.cached(np.zeros_like) is image.cached(np.zeros_like)
    True
    """

    def __init__(
        self, pixels: Pixels, output_position: Fraction | None = None, source_position: SourcePosition | None = None
    ) -> None:
        self.pixels = pixels
        self.output_position = output_position
        self.source_position = source_position
        self._results = Results()
        self._lock = Lock()
        self._asked_once: set[Hashable] = set()

    @property
    def array(self) -> Image:
        """The pixels, which must be an array; see `fpsboost.frame.as_array`."""
        return as_array(self.pixels)

    def cached(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """``function(pixels, *arguments)``, computed when it is first asked for."""
        return self._results.cached((function, *arguments), lambda: function(self.pixels, *arguments))

    def cached_for_both_pairs(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """Like `cached`, but forgotten when it is asked for again: by the other pair that the image is part of."""
        result = self.cached(function, *arguments)
        key = function, *arguments
        with self._lock:
            is_second = key in self._asked_once
            self._asked_once ^= {key}
        if is_second:
            self._results.clear(key)
        return result

    def clear(self) -> None:
        """Let go of all results; what is asked for again is computed again."""
        self._results.clear()
