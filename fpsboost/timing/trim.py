"""Options for the part of a clip that is converted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from fpsboost.errors import OptionError
from fpsboost.options import option
from fpsboost.timing.position import Position, parse_position

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo


@dataclass(frozen=True)
class Trim:
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
