"""Trimming of a clip to the frames from one position to another, as a source of its own."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from typing import Protocol, runtime_checkable

from fpsboost.contracts import ClosesOnExit, FrameSource, RandomAccess
from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.io import SeekableSource
from fpsboost.io.output import TIME_TOLERANCE, Window
from fpsboost.timing.position import Position, Trim


@runtime_checkable
class Sliceable(Protocol):
    """Contract: source that can leave out frames without reading them, because it has a file for each."""

    def keep(self, first: int, last: int | None) -> None:
        """Read only the frames from one place to before another; must be called before the first frame is read."""


def trim_source(
    source: FrameSource, trim: Trim, *, may_skip: bool = True, stretch: Fraction = Fraction(1)
) -> tuple[FrameSource, Window | None]:
    """Return a part of a clip, and the window on the clip's clock; None if the other streams of the clip are whole."""
    if trim.is_whole and stretch == 1:
        return source, None
    if isinstance(source, Sliceable):
        rate = source.info.rate
        begin, end = (None if time is None else math.ceil(time * rate) for time in trim.seconds(source.info))
        source.keep(begin or 0, end)
        return source, None
    trimmed = TrimmedSource(source, trim, may_skip=may_skip, stretch=stretch)
    return trimmed, trimmed.window


class TrimmedSource(ClosesOnExit):
    """Source of the frames that lie in a part of another source, not read yet; the first one has time 0.

    With `may_skip`, it seeks to the start if the source can; otherwise every frame before it is read and counted.
    `window` is filled in while frames are read, with `stretch`; the frames keep their intervals. Iterating raises
    `InputError` if the clip ends before the part begins.
    """

    def __init__(
        self, source: FrameSource, trim: Trim, *, may_skip: bool = True, stretch: Fraction = Fraction(1)
    ) -> None:
        self._source, self._trim = source, trim
        counts_frames = any(place is not None and place.is_frame for place in (trim.start, trim.end))
        self._seekable = source if isinstance(source, SeekableSource) else None
        self._may_skip = may_skip and trim.start is not None and not counts_frames and self._seekable is not None
        origin = Fraction(0) if self._seekable is None else self._seekable.first_time()
        begin, end = trim.seconds(source.info)
        planned_end = None if end is None else origin + end
        self._rounding = min(source.info.time_base, TIME_TOLERANCE)
        self._is_cut_short = False
        self._first = self._dropped = 0
        self._begun = False
        self._own_remarks: list[str] = []
        self.window = Window(
            origin + begin, None if counts_frames else planned_end, planned_end, origin, stretch=stretch
        )

    @property
    def info(self) -> ClipInfo:
        return self._trim.of_info(self._source.info)

    @property
    def remarks(self) -> list[str]:
        return [*self._own_remarks, *self._source.remarks]

    @property
    def beginning(self) -> SourcePosition:
        """Position of the part's first frame in its clip; valid when that has been read.

        If frames before it were skipped without reading them, its number is that of the nominal rate.
        """
        rate = self._source.info.rate
        number = self.window.frames_before(rate) if self._may_skip else self.window.skipped
        return SourcePosition(number, self.window.begin - self.window.origin)

    def close(self) -> None:
        self._source.close()

    def frame_times(self) -> Sequence[Fraction] | None:
        part = self._listed()
        if part is None:
            return None
        times, numbers = part
        return [times[number] - times[numbers[0]] for number in numbers]

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, and fill `window` as far as the times of frames tell it."""
        part = self._listed()
        if part is None:
            self._dropped = number
            if number:
                self._own_remarks.append(
                    f"{self.info.name} was read from where the range begins, because the times of its frames are known "
                    "only by decoding them."
                )
            return
        times, numbers = part
        if number >= len(numbers):
            raise InputError(
                f"The range of {self.info.name} has {len(numbers)} frames, and none has the number {number}."
            )
        assert isinstance(self._source, RandomAccess)
        self._first, self._begun = numbers[number], True
        self._source.begin_at(self._first)
        self.window.origin, self.window.begin, self.window.skipped = times[0], times[numbers[0]], numbers[0]

    def _listed(self) -> tuple[Sequence[Fraction], range] | None:
        """Return the times of the clip's frames, and the numbers of those in the part; None if only decoding tells."""
        times = self._source.frame_times() if isinstance(self._source, RandomAccess) else None
        if times is None:
            return None
        first, last = (
            bisect_left(
                range(len(times)),
                True,
                key=lambda number: place.is_reached(number, times[number] - times[0] + self._rounding),
            )
            for place in (
                self._trim.start or Position(Fraction(0)),
                self._trim.end or Position(Fraction(len(times)), is_frame=True),
            )
        )
        return times, range(first, max(first, last))

    def __iter__(self) -> Iterator[Frame]:
        last: Frame | None = None
        for frame in islice(self._trimmed_frames(), self._dropped, None):
            if last is not None:
                yield replace(last, time=last.time - self.window.begin)
            last = frame
        if last is None:
            raise InputError(
                f"{self._source.info.name} has ended where `start={self._trim.start}` would be; name an earlier one."
            )
        if self._is_cut_short:
            assert self.window.end is not None
            last = replace(last, duration=self.window.end - last.time)
        yield replace(last, time=last.time - self.window.begin)

    def _trimmed_frames(self) -> Iterator[Frame]:
        """Yield the frames of the part at their times in the clip."""
        start, end, window = self._trim.start, self._trim.end, self.window
        if self._may_skip and self._seekable is not None and not self._begun:
            self._seekable.skip_to(window.begin - self._rounding)
        begun = self._begun
        for number, frame in enumerate(self._source, self._first):
            if number == 0 and self._seekable is None:
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
