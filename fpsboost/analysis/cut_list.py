"""Scene cuts read from a list of times or frame numbers."""

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

TIME_TOLERANCE = Fraction(1, 1000)
"""Seconds by which a listed time may lie after the frame that it refers to: lists are written with three decimals."""
SECONDS_COLUMN = "Start Time (seconds)"
"""Column of PySceneDetect's scene lists with the start of each scene. Their column of frames counts from 1."""


@dataclass(frozen=True)
class CutList:
    """Cut policy with the scene cuts of a list and no others; takes the place of a `CutDetector`.

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
        """Whether any position is a frame number."""
        return bool(self._frames)

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """Return 0 if a listed cut lies between the two frames, else 1; 1 if a source position is unknown."""
        if image0.source_position is None or image1.source_position is None:
            return 1.0
        return float(self._count_cuts_until(image0.source_position) == self._count_cuts_until(image1.source_position))

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Return whether a scene ends within a pair, regardless of its neighbours."""
        return match_score == 0

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Return False: every listed cut is a cut."""
        return False

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Return False: every listed cut is a cut."""
        return False

    def _count_cuts_until(self, position: SourcePosition) -> int:
        """Return the number of cuts at or before a frame."""
        return bisect_right(self._frames, position.number) + bisect_right(
            self._seconds, position.seconds + TIME_TOLERANCE
        )

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
        A text file with one position per line, as `parse_position` reads it, and comments after ``#``; or the list of
        scenes that PySceneDetect writes as CSV.

    Raises
    ------
    InputError
        The file cannot be read.
    OptionError
        A line is not a position in a clip.
    """
    name = os.fspath(path)
    with explained(InputError, "read", name, "check `cuts`"):
        try:
            with open(path, encoding="utf-8-sig", newline="") as file:
                return CutList(tuple(_read_positions(file, name)))
        except UnicodeDecodeError:
            raise InputError(f"{name} is no text; give `cuts` a file with a time or frame on each line.") from None


def _read_positions(lines: Iterable[str], name: str) -> Iterator[Position]:
    column: int | None = None
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        fields = next(csv.reader([text]), [])
        if SECONDS_COLUMN in fields:
            column = fields.index(SECONDS_COLUMN)
        elif text and not text.startswith("Timecode List"):
            place = text if column is None else fields[column] if column < len(fields) else ""
            yield parse_position(place, f"{name}, line {number}:")
