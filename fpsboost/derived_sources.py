"""Sources of the frames of another source: of a part of it, or as an edit lists them."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice

from fpsboost.contracts import ClosesOnExit, FrameSource, RandomAccess
from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.io.images.source import ImageSource
from fpsboost.io.video.source import VideoSource
from fpsboost.media import TIME_TOLERANCE, TimeMap, Window
from fpsboost.remarks import Remarks
from fpsboost.timing.edit import Edit
from fpsboost.timing.position import Trim


def trim_source(
    source: RandomAccess, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None
) -> tuple[RandomAccess, Window | None]:
    """Return a part of a clip, and the window on the clip's clock; None if the other streams of the clip are whole."""
    if trim.is_whole and curve is None:
        return source, None
    if isinstance(source, ImageSource):
        rate = source.info.rate
        begin, end = trim.seconds(source.info)
        source.keep(math.ceil(begin * rate), None if end is None else math.ceil(end * rate))
        return source, None
    trimmed = TrimmedSource(source, trim, may_skip=may_skip, curve=curve)
    return trimmed, trimmed.window


class TrimmedSource(ClosesOnExit):
    """Source of the frames that lie in a part of another source, not read yet; the first one has time 0.

    With `may_skip`, it seeks to the start if the source can; otherwise every frame before it is read and counted.
    `window` is filled in while frames are read, with `curve`; the frames keep their intervals. Raises `InputError` if
    the clip ends before the part begins, by its header or else when it is iterated.
    """

    def __init__(
        self, source: RandomAccess, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None
    ) -> None:
        self._source = source
        self._trim = trim
        by_frames = any(place is not None and place.is_frame for place in (trim.start, trim.end))
        origin = Fraction(0)
        self._sought: VideoSource | None = None
        if isinstance(source, VideoSource):
            origin = source.first_time()
            self._sought = source if may_skip and trim.start is not None and not by_frames else None
        begin, end = trim.seconds(source.info)
        planned_end = None if end is None else origin + end
        self._rounding = min(source.info.time_base, TIME_TOLERANCE)
        self._first = self._dropped = 0
        self._begun = False
        self._own_remarks = Remarks()
        self._ended = f"{source.info.name} has ended where `start={trim.start}` would be; name an earlier one."
        if source.info.duration is not None and begin >= source.info.duration:
            raise InputError(self._ended)
        self.window = Window(origin + begin, None if by_frames else planned_end, planned_end, origin, curve=curve)

    @property
    def info(self) -> ClipInfo:
        return self._trim.of_info(self._source.info)

    @property
    def remarks(self) -> list[str]:
        return [*self._own_remarks, *self._source.remarks]

    def position_of(self, number: int, seconds: Fraction) -> SourcePosition:
        """Return the position of a frame of the part in the clip; see `fpsboost.contracts.HasPositions`.

        If frames before the part were skipped without reading them, they are counted by the nominal rate.
        """
        window = self.window
        before = window.frames_before(self._source.info.rate) if self._sought else window.skipped
        return SourcePosition(before + number, window.begin - window.origin + seconds)

    def close(self) -> None:
        self._source.close()

    def frame_times(self) -> Sequence[Fraction] | None:
        times = self._source.frame_times()
        if times is None:
            return None
        numbers = self._numbers(times)
        return [times[number] - times[numbers[0]] for number in numbers]

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, and fill `window` as far as the times of frames tell it."""
        times = self._source.frame_times()
        if times is None:
            self._dropped = number
            if number:
                self._own_remarks.add("range-read-from-beginning", name=self.info.name)
            return
        numbers = self._numbers(times)
        if number >= len(numbers):
            raise InputError(
                f"The range of {self.info.name} has {len(numbers)} frames, and none has the number {number}."
            )
        self._first = numbers[number]
        self._begun = True
        self._source.begin_at(self._first)
        self.window.origin = times[0]
        self.window.begin = times[numbers[0]]
        self.window.skipped = numbers[0]

    def _numbers(self, times: Sequence[Fraction]) -> range:
        """Return the numbers of the frames in the part, by the times of all frames of the clip."""
        numbers = self._trim.numbers(times, self._rounding)
        if not numbers:
            raise InputError(self._ended)
        return numbers

    def __iter__(self) -> Iterator[Frame]:
        start = self._trim.start
        end = self._trim.end
        window = self.window
        if self._sought is not None and not self._begun:
            self._sought.skip_to(window.begin - self._rounding)
        last: Frame | None = None
        for number, frame in enumerate(self._source, self._first):
            if number == 0 and self._sought is None:
                window.origin = frame.time
            seconds = frame.time - window.origin + self._rounding
            if start is not None and not start.is_reached(number, seconds):
                continue
            if end is not None and end.is_reached(number, seconds):
                window.end = frame.time if end.is_frame else window.origin + end.value
                last = last and replace(last, duration=window.end - last.time)
                break
            if not self._begun:
                self._begun = True
                window.begin = frame.time
                window.skipped = number
            if self._dropped:
                self._dropped -= 1
                continue
            if last is not None:
                yield replace(last, time=last.time - window.begin)
            last = frame
        if last is None:
            raise InputError(self._ended)
        yield replace(last, time=last.time - window.begin)


@dataclass
class EditedSource(ClosesOnExit):
    """Source of the frames of another one as an edit lists them; it opens the other one for each run of them.

    `open_at` opens it at a frame, until the block ends.
    """

    info: ClipInfo
    remarks: Remarks
    edit: Edit
    open_at: Callable[[int], AbstractContextManager[FrameSource]]
    position_of: Callable[[int, Fraction], SourcePosition]
    """See `fpsboost.contracts.HasPositions`."""
    first: int = 0
    """Place in the edit where reading begins."""

    def frame_times(self) -> Sequence[Fraction]:
        return self.edit.times

    def begin_at(self, number: int) -> None:
        self.first = number

    def again(self, number: int) -> "EditedSource":
        """Return the same source once more, to be read from a frame on."""
        return replace(self, remarks=Remarks(), first=number)

    def __iter__(self) -> Iterator[Frame]:
        place = self.first
        for run in self.edit.runs(place):
            begin = min(run)
            # to the end of the clip, if this is all that is wanted
            length = None if self.first + len(run) == len(self.edit.frames) else max(run) + 1 - begin
            with self.open_at(begin) as source:
                frames = _kept(enumerate(islice(source, length), begin), {*run})
                for frame in frames if run[0] == begin else list(frames)[::-1]:
                    ends_gap = frame.ends_gap or place in self.edit.after_gaps
                    yield replace(frame, time=self.edit.times[place], duration=Fraction(0), ends_gap=ends_gap)
                    place += 1
                self.remarks.take(source.remarks)


def _kept(numbered: Iterable[tuple[int, Frame]], wanted: set[int]) -> Iterator[Frame]:
    """Yield the wanted frames with the closed captions of those left out before each, or behind the last one."""
    last = None
    captions = b""
    for number, frame in numbered:
        captions += frame.captions
        if number in wanted:
            if last is not None:
                yield last
            last = replace(frame, captions=captions)
            captions = b""
    if last is not None:
        yield replace(last, captions=last.captions + captions)
