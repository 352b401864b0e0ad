"""The clock of a video file: presentation times that increase from frame to frame, and the end that its header gives.

Decoders output frames in presentation order, so that order is trusted more than the times.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import TypeVar

import av

from fpsboost.io.video.demuxer import Demuxer
from fpsboost.io.video.pyav import as_fraction
from fpsboost.io.video.remarks import Damage

T = TypeVar("T")

DURATION_IN_HEADER = ("matroska", "mov", "avi", "flv", "asf")
"""Containers whose header says how long they are; elsewhere the duration is FFmpeg's estimate."""

MAX_WAITING = 8
"""Number of consecutive frames, each not later than the last good one, that ends the wait for a later frame.

If the times of these frames increase, the clock has jumped back.
"""


@dataclass(frozen=True)
class VideoClock:
    """Times of the pictures of a video, in seconds from the start of the clip.

    Attributes
    ----------
    file : Demuxer
    start : Fraction
        Start of the clip on the file's own clock, seconds.
    tick : Fraction
        Time base of the video stream, seconds.
    time_base : Fraction
        Time base of frames, seconds; half of `tick` where each field is a frame.
    rate : Fraction
        Nominal rate of frames per second.
    """

    file: Demuxer
    start: Fraction
    tick: Fraction
    time_base: Fraction
    rate: Fraction

    def time_of(self, picture: av.VideoFrame, end: Fraction | None, damage: Damage) -> Fraction:
        """Return when a picture is presented; without a time of its own, at `end`, where the one before it ends."""
        if picture.pts is not None:
            return picture.pts * (as_fraction(picture.time_base) or self.time_base) - self.start
        damage.untimed += 1
        return Fraction(0) if end is None else round(end / self.time_base) * self.time_base

    def duration_of(self, picture: av.VideoFrame) -> Fraction:
        """Return how long a picture is presented, by itself or else by the nominal rate."""
        time_base = as_fraction(picture.time_base) or self.time_base
        return picture.duration * time_base if picture.duration > 0 else 1 / self.rate

    def last_duration(self, time: Fraction, duration: Fraction) -> Fraction:
        """Return how long the last picture, at `time`, is presented so that the clip ends where the container says.

        Where that is implausible it is the picture's own `duration`. It is plausible, too, where packets that became no
        picture reach that far: captures leave out what stands still.
        """
        stream = self.file.stream
        if self._says_duration and stream.duration is not None and stream.start_time is not None:
            end = (stream.start_time + stream.duration) * self.tick - self.start
            last_packet = max(Fraction(0), self.file.last_start - self.start)
            if 0 < end - time <= 4 / self.rate or time < end <= last_packet + 4 / self.rate:
                return end - time
        return duration

    def promise(self, end: Fraction) -> tuple[Fraction, Fraction]:
        """Return when the video ends by the header and when it has ended, `end`, both from the same clock."""
        container, stream = self.file.container, self.file.stream
        promised, reached = Fraction(0), Fraction(0)
        if stream.duration is not None:
            begin = (stream.start_time or 0) * self.tick
            promised, reached = begin + stream.duration * self.tick - self.start, end
        # The whole file may outlast its video, so it is short only if no stream reaches its end.
        if container.duration and self._says_duration:
            whole = Fraction(container.duration, 1_000_000)
            if whole - self.file.furthest > promised - reached:
                promised, reached = whole, self.file.furthest
        return promised, reached

    @property
    def _says_duration(self) -> bool:
        return self.file.container.format.name.startswith(DURATION_IN_HEADER)


def in_rising_order(
    timed: Iterable[tuple[T, Fraction]], interval: Fraction, tick: Fraction, damage: Damage
) -> Iterator[tuple[T, Fraction, bool]]:
    """Yield frames at strictly increasing times, each as soon as the next valid time is known; say which is the last.

    A frame far ahead of the next one is moved back to follow the frame before it. Frames not later than the frame
    before them are spread over the gap that follows, as many as fit; the others are left out. If the clock jumps back,
    as in joined recordings, all later times are offset to continue from there.

    Parameters
    ----------
    timed : iterable of (frame, Fraction)
        Frames in presentation order with their times, seconds.
    interval : Fraction
        Usual frame interval, seconds.
    tick : Fraction
        Seconds per tick; repaired times are offset by multiples of it.
    damage : Damage
        Counts of the frames that were repaired and left out, which are updated.
    """
    before: Fraction | None = None
    last: tuple[T, Fraction] | None = None
    strays: list[tuple[T, Fraction]] = []
    shift = Fraction(0)
    for frame, own_time in timed:
        time = own_time + shift
        if last is not None and _is_far_ahead(before, last[1], time, interval):
            last = last[0], time - interval if before is None else before + min(interval, (time - before) / 2)
            damage.far_ahead += 1
        if last is not None and time <= last[1]:
            strays.append((frame, time))
            if len(strays) < MAX_WAITING:
                continue
            rising = all(one < other for (_, one), (_, other) in pairwise(strays))
            ahead = last[1] + math.ceil(interval / tick) * tick - strays[0][1]
            following = [(stray, at + ahead) for stray, at in strays] if rising else []
            shift += ahead if rising else 0
            damage.jumps += rising
            damage.misplaced += 0 if rising else len(strays)
        else:
            following = [(frame, time)]
            if last is not None:
                fitting = _spread_evenly([stray for stray, _ in strays], last[1], time, interval, tick)
                damage.displaced += len(fitting)
                damage.misplaced += len(strays) - len(fitting)
                following = [*fitting, *following]
        strays = []
        for placed in following:
            if last is not None:
                yield *last, False
                before = last[1]
            last = placed
    damage.misplaced += len(strays)
    if last is not None:
        yield *last, True


def _is_far_ahead(before: Fraction | None, time: Fraction, after: Fraction, interval: Fraction) -> bool:
    """Return whether `time`, between `before` and `after`, is damaged: far ahead, so that `after` seems too early."""
    far = max(Fraction(1), 10 * interval)
    return after <= time and (time - after > far if before is None else before < after and time - before > far)


def _spread_evenly(
    strays: list[T], begin: Fraction, end: Fraction, interval: Fraction, tick: Fraction
) -> list[tuple[T, Fraction]]:
    """Return the frames that fit between two times, with times spread evenly between them."""
    room = round((end - begin) / interval) - 1
    fitting = strays[: max(room, 0)]
    step = (end - begin) / (len(fitting) + 1)
    places = [begin + math.floor(step * (number + 1) / tick) * tick for number in range(len(fitting))]
    return list(zip(fitting, places, strict=True)) if step > tick else []
