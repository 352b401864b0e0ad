"""Scene cuts that somebody else has found: a list of times or frames."""

from __future__ import annotations

import csv
import os
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from fpsboost.errors import InputError, explained
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.timing.position import Position, parse_position

ROUNDED = Fraction(1, 1000)
"""Lists are written with three decimals, which may lie behind the frame that is meant."""
SECONDS_COLUMN = "Start Time (seconds)"
"""Of PySceneDetect's lists of scenes. Their column of frames counts from 1."""


@dataclass(frozen=True)
class CutList:
    """Cuts are where a list says so, and nowhere else; takes the place of a `CutDetector`.

    Parameters
    ----------
    positions : tuple of Position
        First frames of new scenes, counted from the first frame of the clip.
    """

    positions: tuple[Position, ...]

    def __str__(self) -> str:
        return f"CutList of {len(self.positions)} cuts"

    @property
    def counts_frames(self) -> bool:
        """Whether any of them is the number of a frame."""
        return bool(self._frames)

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """0 where a listed cut lies behind the one frame and not behind the other, else 1."""
        if image0.source_position is None or image1.source_position is None:
            return 1.0
        return float(self._count_until(image0.source_position) == self._count_until(image1.source_position))

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair, whatever its neighbours are like."""
        return match_score == 0

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Never: a listed cut is one."""
        return False

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Never: a listed cut is one."""
        return False

    def _count_until(self, position: SourcePosition) -> int:
        """How many of the cuts lie before a frame."""
        return bisect_right(self._frames, position.number) + bisect_right(self._seconds, position.seconds + ROUNDED)

    @cached_property
    def _frames(self) -> list[Fraction]:
        return sorted(place.value for place in self.positions if place.is_frame)

    @cached_property
    def _seconds(self) -> list[Fraction]:
        return sorted(place.value for place in self.positions if not place.is_frame)


def read_cuts(path: str | os.PathLike[str]) -> CutList:
    """Read a list of cuts from a file.

    Parameters
    ----------
    path : str or path
        A text with a place on each line, as `parse_position` reads it, and comments behind ``#``; or the list of scenes
        that PySceneDetect writes as CSV.

    Raises
    ------
    InputError
        The file cannot be read.
    OptionError
        A line is no place in a clip.
    """
    name = os.fspath(path)
    with explained(InputError, "read", name, "check --cuts"):
        try:
            with open(path, encoding="utf-8-sig", newline="") as file:
                return CutList(tuple(_positions(file, name)))
        except UnicodeDecodeError:
            raise InputError(f"{name} is no text; give --cuts a file with a time or frame on each line.") from None


def _positions(lines: Iterable[str], name: str) -> Iterator[Position]:
    column: int | None = None
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        fields = next(csv.reader([text]), [])
        if SECONDS_COLUMN in fields:
            column = fields.index(SECONDS_COLUMN)
        elif text and not text.startswith("Timecode List"):
            place = text if column is None else fields[column] if column < len(fields) else ""
            yield parse_position(place, f"{name}, line {number}:")
