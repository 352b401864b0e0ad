"""Frames to be replaced by interpolated ones: a list of them as users write it, and which frames of a clip it means."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from typing import TYPE_CHECKING, Self

from fpsboost.errors import InputError, OptionError, explained
from fpsboost.timing.position import Position, parse_position

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo

MAX_RUN = 8
TOO_LONG = f"at most {MAX_RUN} can be interpolated; motion is not known across longer gaps"
SYNTAX = "write frames (340, 120-123), times (1:02.5), auto, or the name of a file with these"
TIME_TOLERANCE = Fraction(1, 1000)  # seconds by which a time may miss its frame: people write three decimals
MAX_CHARACTERS = 1_000_000  # of a file with a list

Range = tuple[Position, Position]
"""First and last frame of a run; a time stands for the frame that is shown then."""


@dataclass(frozen=True)
class Replacement:
    """Frames of a clip to be replaced by frames interpolated between the good ones around them.

    Parameters
    ----------
    ranges : tuple of (Position, Position)
        First and last frame of each run, counted from the clip's first frame; a time stands for the frame shown then.
    detect : bool
        Also replace single frames that are detected as damaged.

    Raises
    ------
    OptionError
        A range ends before it begins, has more than 8 frames, or begins with the first frame of the clip.

    Examples
    --------
    >>> found = Replacement.parse("120-123, 340, 1:02.5")
    >>> [number for number in range(400) if found.includes(number, Fraction(number, 24), Fraction(number + 1, 24))]
    [120, 121, 122, 123, 340]
    """

    ranges: tuple[Range, ...] = ()
    detect: bool = False

    def __post_init__(self) -> None:
        for first, last in self.ranges:
            count = last.value - first.value + 1
            if not first.value:
                raise OptionError("`replace` needs a good frame on both sides, and frame 0 is the first; leave it out.")
            if first.is_frame == last.is_frame and count < 1:
                raise OptionError(f"`replace` has a range from {first} to {last}, which ends before it begins.")
            if first.is_frame and last.is_frame and count > MAX_RUN:
                raise OptionError(f"`replace` has {count} frames in a row ({first} to {last}), and {TOO_LONG}.")

    @classmethod
    def parse(cls, text: str, option: str = "`replace`") -> Self:
        """Parse ``120-123,340,1:02.5``, ``auto``, or the name of a file with these; messages name it by `option`.

        Whole numbers are frames; times have a colon or a point. A file has lines of them, and comments after ``#``.
        Raises `OptionError`, or `InputError` if the file cannot be read.
        """
        lines = [text]
        if os.path.isfile(text):
            with (
                explained(InputError, "read", text, f"check {option}"),
                open(text, encoding="utf-8-sig", errors="replace") as file,
            ):
                lines = file.read(MAX_CHARACTERS).splitlines()
        items = {item.strip(): None for line in lines for item in line.partition("#")[0].split(",") if item.strip()}
        if not items:
            raise OptionError(f"{option} {text!r} names no frame; {SYNTAX}.")
        return cls(tuple(_parse_range(item, option) for item in items if item != "auto"), "auto" in items)

    def as_option(self) -> str:
        """Return the frames as text for `parse`."""
        items = (_as_text(first) + ("" if last == first else f"-{_as_text(last)}") for first, last in self.ranges)
        return ",".join([*items, *["auto"] * self.detect])

    def includes(self, number: int, begin: Fraction, end: Fraction) -> bool:
        """Return whether a frame is listed, by its number and the seconds from when to when it is shown."""
        tolerance = min(TIME_TOLERANCE, (end - begin) / 4)
        return any(
            first.is_reached(number, end - tolerance) and last.value >= (number if last.is_frame else begin - tolerance)
            for first, last in self.ranges
        )

    def behind(self, number: int, end: Fraction) -> list[str]:
        """Return the ranges, as text, that lie behind a frame."""
        return [Replacement((each,)).as_option() for each in self.ranges if not each[0].is_reached(number, end)]

    def check(self, info: ClipInfo) -> None:
        """Raise `OptionError` for the last frame and those behind it, if the header of a clip says how many it has."""
        latest = max((last.value for _, last in self.ranges if last.is_frame), default=Fraction(-1))
        if info.frame_count is not None and latest >= info.frame_count - 1:
            raise OptionError(
                f"`replace` has frame {latest}, and {info.name} ends with frame {info.frame_count - 1}, which has no "
                "good one after it; name earlier ones."
            )


def as_ranges(numbers: Iterable[int]) -> str:
    """Return rising numbers as text, those that follow each other as a range: ``120-122, 340``."""
    runs = groupby(enumerate(numbers), lambda counted: counted[1] - counted[0])
    found = ([number for _, number in run] for _, run in runs)
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in found)


def _parse_range(text: str, option: str) -> Range:
    words = [word.strip() for word in text.split("-", 1)]
    try:
        first, *last = (parse_position(f"{word}f" if word.isdecimal() else word, option) for word in words)
    except OptionError:
        raise OptionError(f"{option} {text!r} names no frame; {SYNTAX}.") from None
    return first, last[0] if last else first


def _as_text(place: Position) -> str:
    """Return a position so that a whole number is a frame."""
    text = place.as_option().removesuffix("f")
    return text if place.is_frame or "." in text else f"{text}.0"
