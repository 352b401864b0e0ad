"""Positions in a clip as users write them, a time or the number of a frame, and the part of a clip between two."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from fpsboost.errors import OptionError
from fpsboost.options import Checked, option

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo


@dataclass(frozen=True)
class Position:
    """Position in a clip, counted from its first frame.

    Parameters
    ----------
    value : Fraction
        Seconds, or a frame number counted from 0.
    is_frame : bool
        Whether the value is a frame number.
    """

    value: Fraction
    is_frame: bool = False

    def __str__(self) -> str:
        return f"{self.value}f" if self.is_frame else f"{float(self.value):g} s"

    def as_option(self) -> str:
        """Return the position as text for `parse_position`."""
        return f"{self.value}f" if self.is_frame else f"{float(self.value):.9f}".rstrip("0").rstrip(".")

    def is_reached(self, number: int, seconds: Fraction) -> bool:
        """Return whether a frame lies at or after the position."""
        return self.value <= (number if self.is_frame else seconds)

    def seconds(self, rate: Fraction) -> Fraction:
        """Return the position in seconds, at a constant frame rate."""
        return self.value / rate if self.is_frame else self.value


def format_time(seconds: Fraction, decimals: int = 3) -> str:
    """Return seconds as players show them, to the millisecond by default; options that are positions read it.

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


def parse_position(text: str, option: str) -> Position:
    """Parse ``90``, ``90.5``, ``1:30``, ``00:01:30.5`` or ``2700f``; messages name it by `option`."""
    word = text.strip()
    if re.fullmatch(r"[0-9]{1,15}f", word):
        return Position(Fraction(word[:-1]), is_frame=True)
    found = re.fullmatch(r"(?:(?:([0-9]{1,9}):)?([0-9]{1,9}):)?([0-9]{1,15}(?:\.[0-9]{1,15})?|\.[0-9]{1,15})", word)
    if found is None or (found[2] and Fraction(found[3]) >= 60) or (found[1] and int(found[2]) >= 60):
        raise OptionError(
            f"{option} {text!r} is no place in a clip; write seconds (90.5), a time (1:30 or 00:01:30.5), or the "
            "number of a frame (2700f)."
        )
    return Position(int(found[1] or 0) * 3600 + int(found[2] or 0) * 60 + Fraction(found[3]))


def parse_positions(texts: Sequence[str], option: str) -> tuple[Position, ...]:
    """Parse several positions; see `parse_position`."""
    return tuple(parse_position(text, option) for text in texts)


@dataclass(frozen=True)
class Trim(Checked):
    """Part of a clip: the frames from `start` to before `end`.

    Parameters
    ----------
    start, end : Position, optional
        By default the clip's own.

    Raises
    ------
    OptionError
        The end does not lie after the start.
    """

    start: Position | None = option(None, "Start position: 90, 1:30.5, or frame 120f.", parse=parse_position)
    end: Position | None = option(None, "End position (exclusive); same syntax as `start`.", parse=parse_position)

    def __post_init__(self) -> None:
        super().__post_init__()
        start, end = self.start or Position(Fraction(0)), self.end
        comparable = end is not None and (start.is_frame == end.is_frame or not start.value or not end.value)
        if end is not None and comparable and end.value <= start.value:
            raise OptionError(f"`end={end}` does not lie behind `start={start}`; the end is not part of the range.")

    @property
    def is_whole(self) -> bool:
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

    def of_info(self, info: ClipInfo) -> ClipInfo:
        """Return the information about the trimmed clip, if the header of the clip is right."""
        begin, end = self.seconds(info)
        duration, count = info.duration, info.frame_count
        if duration is not None:
            duration = max(Fraction(0), min(duration, duration if end is None else end) - begin)
        if count is not None:
            last = count if end is None else min(count, math.ceil(end * info.rate))
            count = max(0, last - math.ceil(begin * info.rate))
        return replace(info, duration=duration or None, frame_count=count or None)
