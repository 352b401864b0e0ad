"""A part of a clip: from one place to another, as a source of its own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol, runtime_checkable

from fpsboost.errors import InputError, OptionError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.io import Closing, FrameSource
from fpsboost.timing.position import Position

ROUNDED = Fraction(1, 1000)
"""Clocks that count in milliseconds put a frame up to so much before its place."""


@dataclass(frozen=True)
class Trim:
    """Which part of a clip: the frames from `start` to before `end`.

    Parameters
    ----------
    start, end : Position, optional
        The clip's own where they are not given.

    Raises
    ------
    OptionError
        The end does not come after the start.
    """

    start: Position | None = None
    end: Position | None = None

    def __post_init__(self) -> None:
        start, end = self.start or Position(Fraction(0)), self.end
        comparable = end is not None and (start.is_frame == end.is_frame or not start.value or not end.value)
        if end is not None and comparable and end.value <= start.value:
            raise OptionError(f"--end {end} does not lie behind --start {start}; the end is not part of the range.")

    @property
    def is_whole(self) -> bool:
        return self.start is None and self.end is None

    @property
    def needs_rate(self) -> bool:
        """Whether seconds are asked for."""
        return any(place is not None and not place.is_frame for place in (self.start, self.end))

    def seconds(self, info: ClipInfo) -> tuple[Fraction, Fraction | None]:
        """When it begins and ends, counted from the first frame, at the nominal rate; None for the clip's end."""
        begin = Fraction(0) if self.start is None else self.start.seconds(info.rate)
        end = None if self.end is None else self.end.seconds(info.rate)
        return begin, end

    def of_info(self, info: ClipInfo) -> ClipInfo:
        """What is known of the excerpt, if the header of the clip is right."""
        begin, end = self.seconds(info)
        duration, count = info.duration, info.frame_count
        if duration is not None:
            duration = max(Fraction(0), min(duration, duration if end is None else end) - begin)
        if count is not None:
            last = count if end is None else min(count, math.ceil(end * info.rate))
            count = max(0, last - math.ceil(begin * info.rate))
        return replace(info, duration=duration or None, frame_count=count or None)


@dataclass
class Window:
    """Which part of a clip becomes the output, on the clip's own clock, seconds.

    Attributes
    ----------
    begin : Fraction
        Time that becomes 0: of the first frame of the excerpt. What the options say until that has been read.
    end : Fraction or None
        Where the excerpt ends; None where that is the clip's own end, or a frame that has not been read yet.
    planned_end : Fraction or None
        Where it ends by the options and the nominal rate.
    origin : Fraction
        Time of the clip's first frame.
    skipped : int
        Frames before the excerpt, as far as they were read.
    stretch : Fraction
        How many times as long it lasts in the output.
    """

    begin: Fraction
    end: Fraction | None
    planned_end: Fraction | None
    origin: Fraction = Fraction(0)
    skipped: int = 0
    stretch: Fraction = Fraction(1)

    def frames_before(self, rate: Fraction) -> int:
        """How many frames of this rate lie before it."""
        return max(0, math.ceil((self.begin - self.origin - ROUNDED) * rate))


@runtime_checkable
class Seekable(Protocol):
    """Contract: a source that can leave out what comes before a time without reading it."""

    def first_time(self) -> Fraction:
        """Time of the clip's first frame, seconds."""
        ...

    def skip_to(self, time: Fraction) -> None:
        """Begin at or before a time, as near to it as the source can; before the first frame is read.

        All frames from that time on are the same as without.
        """
        ...


class TrimmedSource(Closing):
    """The frames of a source that lie in an excerpt; the first one is shown at 0.

    Parameters
    ----------
    source : FrameSource
        The whole clip, not read yet.
    trim : Trim
    may_skip : bool
        Go to the start at once where the source can; else every frame before it is read and counted.
    stretch : Fraction
        For `window`; the frames keep their distances.

    Attributes
    ----------
    window : Window
        Filled in while frames are read.

    Raises
    ------
    InputError
        While iterating: the clip ends before the excerpt begins.
    """

    def __init__(
        self, source: FrameSource, trim: Trim, *, may_skip: bool = True, stretch: Fraction = Fraction(1)
    ) -> None:
        self._source, self._excerpt = source, trim
        counts_frames = any(place is not None and place.is_frame for place in (trim.start, trim.end))
        self._may_skip = may_skip and not counts_frames
        origin = source.first_time() if isinstance(source, Seekable) else Fraction(0)
        begin, end = trim.seconds(source.info)
        planned_end = None if end is None else origin + end
        self._rounding = min(source.info.time_base, ROUNDED)
        self._is_cut_short = False
        self.window = Window(
            origin + begin, None if counts_frames else planned_end, planned_end, origin, stretch=stretch
        )

    @property
    def info(self) -> ClipInfo:
        return self._excerpt.of_info(self._source.info)

    @property
    def remarks(self) -> list[str]:
        return self._source.remarks

    @property
    def beginning(self) -> SourcePosition:
        """When the first frame of the excerpt is shown in its clip; asked for when that has been read.

        Where frames before it were left out without reading them, its number is that of the nominal rate.
        """
        left_out = self._excerpt.start is not None and self._may_skip and isinstance(self._source, Seekable)
        number = self.window.frames_before(self._source.info.rate) if left_out else self.window.skipped
        return SourcePosition(number, self.window.begin - self.window.origin)

    def close(self) -> None:
        self._source.close()

    def __iter__(self) -> Iterator[Frame]:
        last: Frame | None = None
        for frame in self._from_start():
            if last is not None:
                yield replace(last, time=last.time - self.window.begin)
            last = frame
        if last is None:
            raise InputError(
                f"{self._source.info.name} has ended where --start {self._excerpt.start} would be; name an earlier one."
            )
        if self._is_cut_short:
            assert self.window.end is not None
            last = replace(last, duration=self.window.end - last.time)
        yield replace(last, time=last.time - self.window.begin)

    def _from_start(self) -> Iterator[Frame]:
        """The frames of the excerpt at their own times."""
        start, end, window = self._excerpt.start, self._excerpt.end, self.window
        if start is not None and self._may_skip and isinstance(self._source, Seekable):
            self._source.skip_to(window.begin - self._rounding)
        begun = False
        for number, frame in enumerate(self._source):
            if number == 0 and not isinstance(self._source, Seekable):
                window.origin = frame.time
            seconds = frame.time - window.origin + self._rounding
            if start is not None and not start.is_reached(number, seconds):
                continue
            if end is not None and end.is_reached(number, seconds):
                window.end = frame.time if end.is_frame else window.origin + end.value
                self._is_cut_short = True
                return
            if not begun:
                begun = True
                window.begin, window.skipped = frame.time, number
            yield frame
