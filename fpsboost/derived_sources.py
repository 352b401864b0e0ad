"""Sources of the frames of another source: of a part of it, in another order, without repeats, at other times."""

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate, islice, pairwise
from typing import Protocol, runtime_checkable

from fpsboost.analysis.cadence import Repeats
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame
from fpsboost.analysis.gaps import find_gaps
from fpsboost.contracts import ClosesOnExit, FrameSource, RandomAccess
from fpsboost.errors import InputError, OptionError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource, SeekableSource
from fpsboost.media import TIME_TOLERANCE, Window, counted
from fpsboost.timing.position import Gaps, Position, Trim
from fpsboost.timing.rate import readable
from fpsboost.timing.schedule import ByRate
from fpsboost.timing.time_map import TimeMap

BLOCK = 16
"""Frames that are in memory at a time where a source plays backwards."""

MOST_LISTED = 40  # gaps that a remark lists


@runtime_checkable
class Sliceable(Protocol):
    """Contract: source that can leave out frames without reading them, because it has a file for each."""

    def keep(self, first: int, last: int | None) -> None:
        """Read only the frames from one place to before another; must be called before the first frame is read."""


def trim_source(
    source: FrameSource, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None
) -> tuple[FrameSource, Window | None]:
    """Return a part of a clip, and the window on the clip's clock; None if the other streams of the clip are whole."""
    if trim.is_whole and curve is None:
        return source, None
    if isinstance(source, Sliceable):
        rate = source.info.rate
        begin, end = (None if time is None else math.ceil(time * rate) for time in trim.seconds(source.info))
        source.keep(begin or 0, end)
        return source, None
    trimmed = TrimmedSource(source, trim, may_skip=may_skip, curve=curve)
    return trimmed, trimmed.window


class TrimmedSource(ClosesOnExit):
    """Source of the frames that lie in a part of another source, not read yet; the first one has time 0.

    With `may_skip`, it seeks to the start if the source can; otherwise every frame before it is read and counted.
    `window` is filled in while frames are read, with `curve`; the frames keep their intervals. Iterating raises
    `InputError` if the clip ends before the part begins.
    """

    def __init__(self, source: FrameSource, trim: Trim, *, may_skip: bool = True, curve: TimeMap | None = None) -> None:
        self._source = source
        self._trim = trim
        by_frames = any(place is not None and place.is_frame for place in (trim.start, trim.end))
        self._seekable = source if isinstance(source, SeekableSource) else None
        self._may_skip = may_skip and trim.start is not None and not by_frames and self._seekable is not None
        origin = Fraction(0) if self._seekable is None else self._seekable.first_time()
        begin, end = trim.seconds(source.info)
        planned_end = None if end is None else origin + end
        self._rounding = min(source.info.time_base, TIME_TOLERANCE)
        self._is_cut_short = False
        self._first = self._dropped = 0
        self._begun = False
        self._own_remarks: list[str] = []
        self._ended = f"{source.info.name} has ended where `start={trim.start}` would be; name an earlier one."
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
        before = window.frames_before(self._source.info.rate) if self._may_skip else window.skipped
        return SourcePosition(before + number, window.begin - window.origin + seconds)

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
        self._first = numbers[number]
        self._begun = True
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
        if first >= last:
            raise InputError(self._ended)
        return times, range(first, last)

    def __iter__(self) -> Iterator[Frame]:
        last: Frame | None = None
        for frame in islice(self._trimmed_frames(), self._dropped, None):
            if last is not None:
                yield replace(last, time=last.time - self.window.begin)
            last = frame
        if last is None:
            raise InputError(self._ended)
        if self._is_cut_short and self.window.end is not None:
            last = replace(last, duration=self.window.end - last.time)
        yield replace(last, time=last.time - self.window.begin)

    def _trimmed_frames(self) -> Iterator[Frame]:
        start = self._trim.start
        end = self._trim.end
        window = self.window
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
                window.begin = frame.time
                window.skipped = number
            yield frame


@dataclass
class FoldedSource(ClosesOnExit):
    """Source of the frames of another one in any order of runs, at times of its own; it opens the other one for each.

    `order` are numbers of its frames, and `read_from` opens it at a frame. A run rises, with or without steps, and is
    read at once; what runs backwards is read in short blocks.
    """

    info: ClipInfo
    remarks: list[str]
    order: Sequence[int]
    times: Sequence[Fraction]
    read_from: Callable[[int], AbstractContextManager[FrameSource]]
    position_of: Callable[[int, Fraction], SourcePosition] = SourcePosition
    """See `fpsboost.contracts.HasPositions`."""
    first: int = 0
    missing: Sequence[int] = ()
    """Numbers of frames that are missing behind each one, if any."""

    def frame_times(self) -> Sequence[Fraction]:
        return self.times

    def begin_at(self, number: int) -> None:
        self.first = number

    def __iter__(self) -> Iterator[Frame]:
        place = self.first
        order = self.order
        while place < len(order):
            step = order[place + 1] - order[place] if place + 1 < len(order) else 0
            stop = place + 1
            while stop < len(order) and (
                order[stop] > order[stop - 1]
                if step > 0
                else order[stop] - order[stop - 1] == step < 0 and stop - place < BLOCK
            ):
                stop += 1
            first = min(order[place], order[stop - 1])
            wanted = {*order[place:stop]}
            with self.read_from(first) as source:
                begin = first if isinstance(source, RandomAccess) else 0
                # to the end of the clip, if this is all that is wanted
                length = None if len(wanted) + self.first == len(order) else max(wanted) + 1 - begin
                frames = _kept(enumerate(islice(source, length), begin), wanted)
                for frame in frames if step >= 0 else list(frames)[::-1]:
                    ends_gap = any(self.missing[place - 1 : place])
                    yield replace(frame, time=self.times[place], duration=Fraction(0), ends_gap=ends_gap)
                    place += 1
                self.remarks += [remark for remark in source.remarks if remark not in self.remarks]


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


def without_repeats(
    interpolator: Interpolator,
    whole: DescribedSource,
    source: FrameSource,
    read_from: Callable[[int], AbstractContextManager[FrameSource]],
) -> FoldedSource:
    """Read a part of the `whole` clip, and return a source of its frames without those that repeat a picture.

    `read_from` opens the part once more at a frame. Raises `OptionError` if the clip can be read only once.
    """
    if not whole.stream_info.files:
        raise OptionError("`duplicates='drop'` reads a clip twice, which a pipe does not allow; name a file.")
    info = source.info
    found = Repeats(interpolator.duplicates or DuplicateDetector())
    for _ in found.groups(map(SourceFrame, source)):
        pass
    cadence = found.cadence(info.rate)
    how = "keep their own times"
    order, times = found.kept(cadence)
    if cadence is not None and cadence.is_certain:
        info = replace(info, rate=cadence.rate, time_base=ByRate(cadence.rate).time_base(info.time_base))
        how = f"are evenly spaced, {readable(info.rate)} per second ({cadence.name})"
    remark = (
        f"{len(found.times) - len(order)} of {len(found.times)} frames repeat another and were dropped; "
        f"the others {how}."
    )
    length = times[-1] - times[0] if times else Fraction(0)  # a clip without any frame is refused by the loop
    info = replace(info, frame_count=len(order), duration=length + 1 / info.rate, mean_rate=None)
    return FoldedSource(info, [*whole.remarks, remark], order, times, read_from)


def without_gaps(
    gaps: Gaps,
    whole: DescribedSource,
    source: FrameSource,
    read_from: Callable[[int], AbstractContextManager[FrameSource]],
) -> FoldedSource:
    """Return a source of the frames of the `whole` clip, each later by the frames that are missing before it.

    These are found by reading the clip, unless all are listed. `read_from` opens it once more at a frame. Raises
    `OptionError` if its rate is not constant, or the last frame is listed.
    """
    info = source.info
    times = (source.frame_times() if isinstance(source, RandomAccess) else None) or ()
    if not times or any(abs((after - time) * info.rate - 1) > Fraction(1, 2) for time, after in pairwise(times)):
        raise OptionError(
            f"`gaps` needs a constant rate and a file that says when each frame is shown, unlike {info.name}; convert "
            "it with `factor=1` first."
        )
    for late in gaps.behind(len(times) - 2, times[-1] - times[0]):
        raise OptionError(
            f"`gaps` has {late}, and the last frame of {info.name} is {len(times) - 1}; name earlier ones."
        )
    found = find_gaps(FrameCache(frame.image) for frame in source) if gaps.detect else {}
    missing = [
        gaps.times_listed(number, *(each - times[0] for each in shown)) or found.get(number, 0)
        for number, shown in enumerate(pairwise(times))
    ]
    later = [time + count / info.rate for time, count in zip(times, accumulate(missing, initial=0), strict=True)]
    listed = [f"{number}" + f"x{count}" * (count > 1) for number, count in enumerate(missing) if count]
    remark = (
        f"Missing behind {','.join(listed[:MOST_LISTED])}{', ...' * (len(listed) > MOST_LISTED)}: "
        f"{counted(sum(missing), 'frame')}; with them, the picture is {float(sum(missing) / info.rate):.3f} s longer."
        if listed
        else "No gap was found in camera motion; `gaps` takes a list of those in other motion."
    )
    return FoldedSource(
        replace(info, duration=later[-1] - later[0] + 1 / info.rate),
        [*whole.remarks, remark],
        range(len(times)),
        later,
        read_from,
        missing=missing,
    )
