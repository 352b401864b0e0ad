"""Cache of results computed from one image, shared by the two pairs that contain the image."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from fractions import Fraction
from functools import cached_property
from itertools import count
from threading import Lock
from typing import Any, NamedTuple, TypeVar

from fpsboost.image import Image, Pixels, view
from fpsboost.layered import FrameImage
from fpsboost.options import checked

Result = TypeVar("Result")


class SourcePosition(NamedTuple):
    """Position of an image in its source: frame number and seconds, counted from the first frame of the clip."""

    number: int
    seconds: Fraction


class Results:
    """Thread-safe cache of results: the first thread that asks for one computes it, the others wait for it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._stored: dict[Hashable, Any] = {}
        self._computing: dict[Hashable, Lock] = {}  # held by the thread that computes a result

    def cached(self, key: Hashable, compute: Callable[[], Result]) -> Result:
        """Return the result of `compute`, computed when the key is first asked for."""
        with self._lock:
            stored: Result = self._stored.get(key, self)
            if stored is not self:
                return stored
            turn = self._computing.setdefault(key, Lock())
        with turn:
            stored = self._stored.get(key, self)
            if stored is not self:  # another thread has computed it meanwhile
                return stored
            result = compute()
            with self._lock:
                if self._computing.get(key) is turn:  # not discarded meanwhile
                    self._stored[key] = result
                    del self._computing[key]
        return result

    def discard(self, is_needless: Callable[[Hashable], bool]) -> None:
        """Discard the results whose keys are needless; they are computed again when asked for again."""
        with self._lock:
            for results in (self._stored, self._computing):
                for key in list(filter(is_needless, results)):
                    del results[key]

    def get(self, key: Hashable) -> Any:
        """Return a result that has been computed; None if there is none."""
        return self._stored.get(key)


class FrameCache:
    """Image with a cache of the results computed from it.

    Parameters
    ----------
    image : (H, W, C) uint8, uint16 or float32, YCbCrImage or LayeredImage
        Must not be written to afterwards.
    output_position : Fraction, optional
        Position of the image among the output frames, counted from 0: for motion that was rendered for each output
        frame.
    source_position : SourcePosition, optional
        Position of the image in the source.

    Attributes
    ----------
    pixels : (H, W, C) uint8, uint16 or float32, or YCbCrImage
        Image on which motion and weights are estimated: the image itself; of images with layers, whose colours are
        scene-linear, these colours as they are compared, see `fpsboost.colour`.
    guide : (h, w, C) array, YCbCrImage, LayeredImage or None
        Cheap picture of the image, by which guides of the images made of it are calibrated.

    Examples
    --------
    >>> import numpy as np
    >>> image = FrameCache(np.zeros((2, 3, 1), np.uint8))
    >>> image.cached(np.zeros_like) is image.cached(np.zeros_like)
    True
    """

    @checked
    def __init__(
        self, image: FrameImage, output_position: Fraction | None = None, source_position: SourcePosition | None = None
    ) -> None:
        self.image = image
        self.output_position = output_position
        self.source_position = source_position
        self.guide: FrameImage | None = None
        self._results = Results()

    def with_image(self, image: FrameImage) -> FrameCache:
        """Return another image of the same frame."""
        other = FrameCache(image, self.output_position, self.source_position)
        other.guide = self.guide
        return other

    @cached_property
    def pixels(self) -> Pixels:
        """See the class."""
        return view(self.image).compared

    @property
    def array(self) -> Image:
        """The pixels, which must be an array; see `ImageView.array`."""
        return view(self.pixels).array()

    def cached(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """Return ``function(pixels, *arguments)``, computed when it is first asked for."""
        return self._results.cached((function, *arguments), lambda: function(self.pixels, *arguments))

    def derived(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """Return ``function(self, *arguments)`` likewise, for a function that uses other results of the image."""
        return self._results.cached((function, *arguments), lambda: function(self, *arguments))

    def cached_for_both_pairs(self, function: Callable[..., Result], *arguments: Hashable) -> Result:
        """Return a result like `cached`, but discard it at the second request, which the image's other pair makes."""
        result = self.cached(function, *arguments)
        key = function, *arguments
        requests = self._results.cached(("requests of", key), count)
        if next(requests) == 1:
            self._results.discard({key, ("requests of", key)}.__contains__)
        return result

    def clear(self, *kept: Callable[..., Any]) -> None:
        """Discard all results but those of these functions; they are computed again when asked for again."""
        self._results.discard(lambda key: key not in {(function,) for function in kept})
