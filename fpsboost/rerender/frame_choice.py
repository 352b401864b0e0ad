"""Which frames to render at all, so that those between can be interpolated well enough.

A preview is taken for the truth. Two of its images some way apart give those between; where one of these misses the
bound, the interval is divided in the middle, and its halves are tried.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from fpsboost import FrameCache, Interpolator, MemoryLimit, OptionError, find_method
from fpsboost.image import Image, view
from fpsboost.io.images.files import read_image
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.new_output import new_folder
from fpsboost.io.staging import write_safely
from fpsboost.rerender.planning import open_images
from fpsboost.rerender.score import comparable, squared_error
from fpsboost.threads import available_cores, run_in_parallel

LONGEST = 16
"""Largest difference of two numbers between which frames are interpolated."""

VERSION = 1
FRAMES_FILE, LIST_FILE = "frames.json", "frames.txt"

InOrder = Callable[[Iterable[Callable[[], float]]], Iterator[float]]


@dataclass(frozen=True)
class FrameChoice:
    """Frames to render, of a range of numbers."""

    numbers: tuple[int, ...]
    """Numbers of the frames to render, rising, with the first and the last of the range."""
    quality: float
    """PSNR that every frame between must reach, dB."""
    lowest: float | None
    """Lowest PSNR of a frame between on the preview, dB; None if none was interpolated."""

    @property
    def total(self) -> int:
        """Number of all frames of the range."""
        return self.numbers[-1] - self.numbers[0] + 1

    def as_json(self) -> dict[str, Any]:
        """Return plain data, as it is written to ``frames.json``."""
        return {
            "version": VERSION,
            "numbers": list(self.numbers),
            "ranges": as_ranges(self.numbers, "-"),
            "total": self.total,
            "quality": self.quality,
            "lowest": None if self.lowest is None else round(self.lowest, 2),
        }

    def write(self, folder: Path) -> None:
        """Write ``frames.json``, and ``frames.txt`` as Blender's ``--render-frame`` takes it: ``1,3,5..9``."""
        write_safely(folder / LIST_FILE, f"{as_ranges(self.numbers, '..')}\n".encode())
        write_safely(folder / FRAMES_FILE, json.dumps(self.as_json(), indent=1).encode())


def as_ranges(numbers: Sequence[int], to: str) -> str:
    """Return rising numbers as text, three and more in a row as a range with `to` between its ends."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ",".join(f"{run[0]}{to}{run[-1]}" if len(run) > 2 else ",".join(map(str, run)) for run in runs)


def choose_frames(preview: str, folder: str, quality: float, *, method: str | Interpolator = "nlm") -> FrameChoice:
    """Choose the frames to render, so that all others can be interpolated, and write the list to a folder.

    Parameters
    ----------
    preview : str
        Folder or pattern of numbered images: all frames, rendered quickly.
    folder : str
        New folder for ``frames.json`` and ``frames.txt``.
    quality : float
        PSNR that every interpolated frame must reach, dB. Noise of the preview counts as error.
    method : str or Interpolator
        Method that is to interpolate them.

    Raises
    ------
    OptionError
        The quality is out of range, the images have no numbers or leave some out, or the method goes by a renderer's
        vectors.
    InputError
        The images cannot be read, differ, or are fewer than three.
    OutputError
        The folder exists and is not empty, or cannot be written.

    Examples
    --------
    >>> choose_frames("preview/", "list/", 35)  # doctest: +SKIP
    """
    if not 0 < quality <= 100:
        raise OptionError(f"`quality` must be above 0 and at most 100 dB, not {quality}.")
    interpolator = find_method(method)
    if interpolator.uses_vectors:
        raise OptionError("`vectors` lead from frame to frame, and frames are chosen at any distance; leave it out.")
    with open_images(preview, folder) as source:
        images, info = source.images, source.info
        for place, frame in enumerate(source):  # which checks that all are alike
            if place == 0:
                interpolator.compile_for(frame.image)
    if not images.numbers:
        raise OptionError(
            f"The images of {preview} have no numbers in their names, of which some are chosen; number them."
        )
    if images.step > 1:
        raise OptionError(
            f"The numbers of {preview} rise by {images.step}, and what lies between two frames is not known; render a "
            "quick preview of all frames."
        )
    threads = MemoryLimit().affordable_threads(info.width, info.height, available_cores())
    trials = _Trials(images, replace(interpolator, duplicates=None), 10 ** (-quality / 10))
    with run_in_parallel(threads) as in_order:
        indices, largest = _divide(trials, in_order)
    lowest = None if largest is None else -10 * math.log10(max(largest, 1e-10))
    choice = FrameChoice(tuple(images.numbers[index] for index in indices), quality, lowest)
    with new_folder(Path(folder)) as unfinished:
        choice.write(unfinished)
    return choice


@dataclass(frozen=True)
class _Trials:
    """Images of a preview, interpolated from others of them."""

    images: NumberedImages
    interpolator: Interpolator
    bound: float  # largest mean squared error, for white = 1

    def error_between(self, first: int, last: int) -> float:
        """Return the largest error of the images between two, or the first one above the bound."""
        image0, image1 = (FrameCache(self._read(index)) for index in (first, last))
        middle = (first + last) / 2
        inner = sorted(range(first + 1, last), key=lambda index: abs(index - middle))
        times = [Fraction(index - first, last - first) for index in inner]
        largest = 0.0
        pair = self.interpolator.pair(image0, image1, last - first)
        for index, image in zip(inner, self.interpolator.between(pair, times).images, strict=True):
            largest = max(largest, float(squared_error(view(image).array(), self._read(index)).mean()))
            if largest > self.bound:
                break
        return largest

    def _read(self, index: int) -> Image:
        return comparable(read_image(self.images.files[index]))


def _divide(trials: _Trials, in_order: InOrder) -> tuple[list[int], float | None]:
    """Return which images of a preview to render, and the largest error of the others."""
    last = len(trials.images.files) - 1
    indices = sorted({*range(0, last, LONGEST), last})
    errors: dict[tuple[int, int], float] = {}
    intervals = list(pairwise(indices))
    while intervals:
        tried = [interval for interval in intervals if interval[1] - interval[0] > 1]
        results = in_order(partial(trials.error_between, *interval) for interval in tried)
        intervals = []
        for (first, end), error in zip(tried, results, strict=True):
            errors[first, end] = error
            if error > trials.bound:
                middle = (first + end) // 2
                indices.append(middle)
                intervals += [(first, middle), (middle, end)]
    needed = _without_needless(trials, sorted(indices), errors)
    return needed, max((errors[each] for each in pairwise(needed) if each in errors), default=None)


def _without_needless(trials: _Trials, indices: Sequence[int], errors: dict[tuple[int, int], float]) -> list[int]:
    """Leave out images without which those around them suffice: halving divides more often than it must."""
    needed = [indices[0]]
    for index, following in pairwise(indices[1:]):
        joined = needed[-1], following
        if following - needed[-1] <= LONGEST and joined not in errors:
            errors[joined] = trials.error_between(*joined)
        if errors.get(joined, math.inf) > trials.bound:
            needed.append(index)
    return [*needed, indices[-1]]
