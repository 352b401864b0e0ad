"""Positions in a clip as users write them: a time or the number of a frame; and options that consist of positions.

These are `Trim`, the part of a clip between two positions, `Replacement`, the frames to be replaced by interpolated
ones, and `Gaps`, the frames behind which others are missing.
"""

from __future__ import annotations

import math
import os
import re
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import groupby
from typing import TYPE_CHECKING, Self

from fpsboost.errors import InputError, OptionError, explained
from fpsboost.media import FOREVER
from fpsboost.options import Checked, PathName, checked, option
from fpsboost.timing.schedule import parse_number

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo


@dataclass(frozen=True)
class Position(Checked):
    """Position in a clip, counted from its first frame.

    Parameters
    ----------
    value : Fraction
        Seconds, or a frame number counted from 0.
    is_frame : bool
        Whether the value is a frame number.

    Examples
    --------
    >>> str(Position(Fraction(181, 2))), str(Position(Fraction(2700), is_frame=True))
    ('90.5 s', '2700f')
    >>> Position(Fraction(120), is_frame=True).seconds(Fraction(24))
    Fraction(5, 1)
    """

    value: Fraction
    is_frame: bool = False

    @classmethod
    @checked
    def parse(cls, text: str, option: str = "The position", bare: str = "s", *, between: bool = False) -> Self:
        """Parse ``90s``, ``90.5s``, ``1:30``, ``00:01:30.5`` or ``2700f``; messages name it by `option`.

        `bare` is the unit of a number without one: ``s`` or ``f``. With `between`, a position may lie between two
        frames (``12.5f``). Raises `OptionError` for any other text, such as negative numbers or 75 seconds after
        minutes.

        Examples
        --------
        >>> Position.parse("1:30.5"), Position.parse("2700f").is_frame
        (Position(value=Fraction(181, 2), is_frame=False), True)
        """
        number = r"([0-9]{1,15}(?:\.[0-9]{1,30}|/[1-9][0-9]{,8})?|\.[0-9]{1,30})"
        found = re.fullmatch(rf"(?:(?:([0-9]{{1,9}}):)?([0-9]{{1,9}}):)?{number}([sf]?)", text.strip())
        if found is not None:
            hours, minutes, digits, unit = found.groups()
            value = parse_number(digits, option)
            is_frame = (unit or bare) == "f"
            if minutes is None:
                if between or not is_frame or value.denominator == 1:
                    return cls(value, is_frame)
            elif not unit and value < 60 and (hours is None or int(minutes) < 60):
                return cls(int(hours or 0) * 3600 + int(minutes) * 60 + value)
        raise OptionError(
            f"{option} {text!r} is not a position in a clip; write seconds (90.5 or 90.5s), a time (1:30 or "
            "00:01:30.5), or the number of a frame (2700f)."
        )

    def __str__(self) -> str:
        return f"{self.value}f" if self.is_frame else f"{float(self.value):g} s"

    def as_option(self) -> str:
        """Return the position as text for `parse`, with up to nine decimals."""
        return f"{self.value}f" if self.is_frame else f"{float(self.value):.9f}".rstrip("0").rstrip(".")

    def is_reached(self, number: int, seconds: Fraction) -> bool:
        """Return whether a frame, by its number and its time in seconds, lies at or after the position."""
        return self.value <= (number if self.is_frame else seconds)

    def seconds(self, rate: Fraction) -> Fraction:
        """Return the position in seconds, at a constant frame rate."""
        return self.value / rate if self.is_frame else self.value


@checked
def format_time(seconds: Fraction | float, decimals: int = 3) -> str:
    """Return seconds as players show them, to the millisecond by default; options that are positions read it.

    Parameters
    ----------
    seconds : Fraction or float
        Time from the first frame.
    decimals : int
        Digits after the point.

    Examples
    --------
    >>> format_time(Fraction(3723, 2))
    '31:01.500'
    """
    second = 10**decimals
    minutes, rest = divmod(round(seconds * second), 60 * second)
    hours, minutes = divmod(minutes, 60)
    whole, parts = divmod(rest, second)
    return f"{f'{hours}:{minutes:02}' if hours else minutes}:{whole:02}.{parts:0{decimals}}"


def parse_positions(texts: Sequence[str], option: str) -> tuple[Position, ...]:
    """Parse several positions; see `Position.parse`."""
    return tuple(Position.parse(text, option) for text in texts)


@dataclass(frozen=True)
class Trim(Checked):
    """Part of a clip: the frames from `start` to before `end`.

    Parameters
    ----------
    start, end : Position, optional
        By default the clip's own. A time selects the frames that are shown from then on.

    Raises
    ------
    OptionError
        The end does not lie after the start. A time and a frame number can only be compared once the rate is known.

    Examples
    --------
    >>> trim = Trim(Position(Fraction(5)), Position(Fraction(240), is_frame=True))
    >>> trim.is_whole, trim.needs_rate
    (False, True)
    """

    start: Position | None = option(None, "Start: 90 or 90s, 1:30.5, or frame 120f.", parse=Position.parse)
    end: Position | None = option(None, "End position (exclusive); same syntax as `start`.", parse=Position.parse)

    def __post_init__(self) -> None:
        super().__post_init__()
        start = self.start or Position(Fraction(0))
        end = self.end
        comparable = end is not None and (start.is_frame == end.is_frame or not start.value or not end.value)
        if end is not None and comparable and end.value <= start.value:
            raise OptionError(f"`end={end}` must be after `start={start}`; the end is not part of the range.")

    @property
    def is_whole(self) -> bool:
        """Whether nothing is cut off."""
        return self.start is None and self.end is None

    @property
    def needs_rate(self) -> bool:
        """Whether a position is given in seconds."""
        return any(place is not None and not place.is_frame for place in (self.start, self.end))

    def seconds(self, info: ClipInfo) -> tuple[Fraction, Fraction | None]:
        """Return start and end in seconds from the first frame, at the nominal rate; None for the clip's end."""
        begin = Fraction(0) if self.start is None else self.start.seconds(info.rate)
        end = None if self.end is None else self.end.seconds(info.rate)
        return begin, end

    def numbers(self, times: Sequence[Fraction], tolerance: Fraction) -> range:
        """Return the numbers of the frames in the part, of a clip whose frames are at `times`, increasing seconds.

        Times of the trim may be so much later than those of their frames.
        """

        def first_at(place: Position) -> int:
            if place.is_frame:
                return min(math.ceil(place.value), len(times))
            return bisect_left(times, times[0] + place.value - tolerance)

        first = 0 if self.start is None else first_at(self.start)
        return range(first, len(times) if self.end is None else first_at(self.end))

    def of_info(self, info: ClipInfo) -> ClipInfo:
        """Return the information about the trimmed clip, with duration and number of frames if the header has them."""
        begin, end = self.seconds(info)
        duration = info.duration
        count = info.frame_count
        if duration is not None:
            duration = max(Fraction(0), min(duration, duration if end is None else end) - begin)
        if count is not None:
            last = count if end is None else min(count, math.ceil(end * info.rate))
            count = max(0, last - math.ceil(begin * info.rate))
        return replace(info, duration=duration or None, frame_count=count or None)


MAX_RUN = 8
"""Maximum number of consecutive frames that can be replaced."""
TOO_LONG = f"at most {MAX_RUN} can be interpolated; motion is not known across longer gaps"
"""End of the message for longer runs."""
SYNTAX = "write frames (340 or 340f, 120-123), times (62.5s, 1:02.5), auto, or the name of a file with these"
"""End of messages about items that cannot be read."""
TIME_TOLERANCE = Fraction(1, 1000)  # seconds by which a time may miss its frame, since users write three decimals
MAX_CHARACTERS = 1_000_000  # number of characters that are read from a file with a list

Range = tuple[Position, Position]
"""First and last frame of a run; a time stands for the frame that is shown then."""


@dataclass(frozen=True)
class FrameList(Checked):
    """Frames of a clip as users list them, by numbers or times, or to be detected.

    Parameters
    ----------
    ranges : tuple of (Position, Position)
        First and last frame of each run, counted from the clip's first frame; a time stands for the frame shown then.
    detect : bool
        Also detect frames.
    """

    ranges: tuple[Range, ...] = ()
    detect: bool = False

    @classmethod
    @checked
    def parse(cls, text: PathName, option: str = "`replace`") -> Self:
        """Parse ``120-123,340,1:02.5``, ``auto``, or the name of a file with these; messages name it by `option`.

        Whole numbers without a unit are frames, and others are seconds. A file has lines of them, and comments after
        ``#``. Raises `OptionError`, or `InputError` if the file cannot be read.
        """
        lines = [os.fspath(text)]
        if os.path.isfile(text):
            with (
                explained(InputError, "read", lines[0], f"check {option}"),
                open(text, encoding="utf-8-sig", errors="replace") as file,
            ):
                lines = file.read(MAX_CHARACTERS).splitlines()
        items = {item.strip(): None for line in lines for item in line.partition("#")[0].split(",") if item.strip()}
        if not items:
            raise OptionError(f"{option} {text!r} contains no frame; {SYNTAX}.")
        return cls(sum((cls.parse_item(item, option) for item in items if item != "auto"), ()), "auto" in items)

    @classmethod
    def parse_item(cls, text: str, option: str) -> tuple[Range, ...]:
        """Parse a frame, a time, or two of them joined by a hyphen; whole numbers are frames here."""
        words = [word.strip() for word in text.split("-", 1)]
        try:
            places = [Position.parse(word, option, "f" if word.isdecimal() else "s") for word in words]
        except OptionError:
            raise OptionError(f"{option} {text!r} contains no frame; {SYNTAX}.") from None
        if places[0].is_frame == places[-1].is_frame and places[-1].value < places[0].value:
            raise OptionError(f"{option} has a range from {places[0]} to {places[-1]}, which ends before it begins.")
        return ((places[0], places[-1]),)

    def as_option(self) -> str:
        """Return the frames as text for `parse`; ``340x2`` for a range that is listed twice."""
        items = (
            _as_text(each[0])
            + ("" if each[1] == each[0] else f"-{_as_text(each[1])}")
            + ("" if self.ranges.count(each) == 1 else f"x{self.ranges.count(each)}")
            for each in dict.fromkeys(self.ranges)
        )
        return ",".join([*items, "auto"] if self.detect else items)

    def times_listed(self, number: int, begin: Fraction, end: Fraction) -> int:
        """Return how often a frame is listed, by its number and the times, seconds, between which it is shown.

        Times may miss the frame by `TIME_TOLERANCE`, but never by more than a quarter of its duration.
        """
        tolerance = min(TIME_TOLERANCE, (end - begin) / 4)
        return sum(
            first.is_reached(number, end - tolerance) and last.value >= (number if last.is_frame else begin - tolerance)
            for first, last in self.ranges
        )

    def behind(self, number: int, end: Fraction) -> list[str]:
        """Return the ranges, as text, that end after a frame: after the last one, those that the clip does not have."""
        return [
            FrameList((each,)).as_option()
            for each in dict.fromkeys(self.ranges)
            if not each[1].is_reached(number, end - TIME_TOLERANCE)
        ]

    def check(self, option: str, info: ClipInfo) -> None:
        """Raise `OptionError`, which names the list by `option`, for a clip's last frame, and for what is behind it.

        Nothing is known of them if the header has no number of frames, and not of times if it has no duration.
        """
        if info.frame_count is None:
            return
        last = info.frame_count - 1
        for late in self.behind(last - 1, info.duration or FOREVER):
            raise OptionError(f"`{option}` has {late}, and the last frame of {info.name} is {last}; end before it.")


@dataclass(frozen=True)
class Replacement(FrameList):
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
        A range has more than 8 frames, or begins with the first frame of the clip.

    Examples
    --------
    >>> found = Replacement.parse("120-123, 340, 1:02.5")
    >>> [each for each in range(400) if found.times_listed(each, Fraction(each, 24), Fraction(each + 1, 24))]
    [120, 121, 122, 123, 340]
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        for first, last in self.ranges:
            count = last.value - first.value + 1
            if not first.value:
                raise OptionError("`replace` needs a good frame on both sides, and frame 0 is the first; leave it out.")
            if first.is_frame and last.is_frame and count > MAX_RUN:
                raise OptionError(f"`replace` has {count} frames in a row ({first} to {last}), and {TOO_LONG}.")


@dataclass(frozen=True)
class Gaps(FrameList):
    """Frames of a clip behind each of which a frame is missing, or several: those that are listed more than once.

    Examples
    --------
    >>> gaps = Gaps.parse("120, 340x2")
    >>> [gaps.times_listed(number, Fraction(number, 24), Fraction(number + 1, 24)) for number in (119, 120, 340)]
    [0, 1, 2]
    >>> gaps.as_option()
    '120,340x2'
    """

    @classmethod
    def parse_item(cls, text: str, option: str) -> tuple[Range, ...]:
        """Parse an item of other lists, with the number of missing frames after an ``x``: ``340x2``."""
        found = re.fullmatch(r"(.*[^ ]) *x *([1-9][0-9]{0,2})", text)
        return (
            super().parse_item(text, option) if found is None else super().parse_item(found[1], option) * int(found[2])
        )


def as_ranges(numbers: Iterable[int]) -> str:
    """Return rising numbers as text, with consecutive ones as a range: ``120-122, 340``.

    Examples
    --------
    >>> as_ranges([120, 121, 122, 340])
    '120-122, 340'
    """
    runs = groupby(enumerate(numbers), lambda counted: counted[1] - counted[0])
    found = ([number for _, number in run] for _, run in runs)
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in found)


def _as_text(place: Position) -> str:
    """Return a position as text in which a whole number is a frame, and a time has a point."""
    text = place.as_option().removesuffix("f")
    return text if place.is_frame or "." in text else f"{text}.0"
