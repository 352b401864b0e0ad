"""Start, frame rate and duration of a video, from its header and the times of its packets, before any is decoded."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import av
import av.container
import av.stream

from fpsboost.io.video.demuxer import clock_may_jump, read_packets
from fpsboost.io.video.pyav import as_fraction
from fpsboost.io.video.remarks import Damage
from fpsboost.timing.schedule import is_implausible

MAX_RATE = 1000
ASSUMED_RATE = Fraction(25)
MAX_DRIFT = Fraction(1, 8)
"""Maximum deviation of the end of a clip from its time at the declared rate, frames."""
JITTER_DIVISOR = 8
"""Intervals within 1/8 (the reciprocal of this) of the median count as usual ones, since cameras have jitter."""
MIN_USUAL_SHARE = Fraction(3, 4)
"""Minimum share of usual intervals at which the rate counts as constant with frames missing."""
MIN_ROUNDED_SHARE = Fraction(9, 10)
"""Minimum share of intervals that differ only by rounding at which the others count as faults and are excluded."""
MAX_DENOMINATORS = (1, 100, 10_000)
"""Maximum denominators of measured rates, tried in this order until a rate matches the times."""

MAX_SURVEY_PACKETS = 1000
"""Maximum number of video packets that are read: enough to tell 23.976 from 24 frames per second in milliseconds."""

MAX_SURVEY_BYTES = 1 << 26
"""Maximum size of the packets that are read, bytes; it limits the time for reading large packets."""

EDIT_LIST_FORMAT = "mov"
"""Start of FFmpeg's name of the container whose edit lists set the delay before each stream, which is kept."""


@dataclass(frozen=True)
class Cadence:
    """Usual interval between frames and its statistics.

    Attributes
    ----------
    interval : Fraction
        Mean of the usual intervals, seconds.
    error : Fraction
        Maximum error of `interval` by rounding and jitter, seconds.
    count : int
        Number of usual intervals.
    is_constant : bool
        Whether nearly all intervals are usual ones.
    mean_rate : Fraction
        Mean over all intervals, including pauses, frames per second.
    tick : Fraction
        Time base, seconds per tick.
    """

    interval: Fraction
    error: Fraction
    count: int
    is_constant: bool
    mean_rate: Fraction
    tick: Fraction

    def is_exactly(self, rate: Fraction) -> bool:
        """Return whether a rate matches the interval within its error."""
        return abs(1 / rate - self.interval) <= self.error

    def is_nearly(self, rate: Fraction) -> bool:
        """Return whether a declared rate is near enough.

        At a constant rate it may miss the end by less than `MAX_DRIFT` frames, at a variable rate by less than 1 %.
        """
        missed = abs(self.interval * rate - 1)
        return missed * self.count < MAX_DRIFT if self.is_constant else missed < Fraction(1, 100)


def nominal_rate(stream: av.VideoStream, cadence: Cadence | None) -> tuple[Fraction, bool]:
    """Return the frame rate of a stream, or its most frequent rate if it varies, and whether it is known.

    Of the rates that agree with the presentation times, the declared rate is chosen, else a standard rate, else the
    measured rate. FFmpeg's mean includes pauses and damage, so it is used only if it is a standard rate, or if no other
    rate fits. A single interval that is too long or too short has no effect.

    Parameters
    ----------
    stream : av.VideoStream
    cadence : Cadence or None
        Cadence measured from the stream's times; None if there are too few.
    """
    rates = (as_fraction(stream.guessed_rate), as_fraction(stream.average_rate))
    declared = [rate for rate in rates if rate is not None and 0 < rate <= MAX_RATE]
    if cadence is None or cadence.interval * MAX_RATE < 1:
        return (declared[0], True) if declared else (ASSUMED_RATE, False)
    usual = _usual_rates_near(1 / cadence.interval)
    # A frame duration that is no whole number of ticks was rounded: 19001/317 is 59.94 in Matroska's nanoseconds.
    countable = [rate for rate in declared[:1] if (1 / rate / cadence.tick).denominator == 1]
    preferred = [*countable, *(rate for rate in declared if rate in usual), *usual, *declared[:1]]
    exact = [rate for rate in preferred if cadence.is_exactly(rate)]
    near = [rate for rate in declared if cadence.is_nearly(rate)]
    if not cadence.is_constant:
        near += [rate for rate in usual if cadence.is_nearly(rate)]
    found = [*exact, *near, _simplest(cadence), *declared[:1]]
    return next((rate for rate in found if not is_implausible(rate, cadence.mean_rate)), found[0]), True


def measured_cadence(times: Sequence[int], tick: Fraction) -> Cadence | None:
    """Return the cadence of presentation times, or None for fewer than two different times.

    Parameters
    ----------
    times : sequence of int
        Presentation times in increasing order, ticks.
    tick : Fraction
        Seconds per tick.
    """
    intervals = [after - before for before, after in pairwise(times) if after > before]
    if not intervals:
        return None
    middle = statistics.median_low(intervals)
    # If frames are one tick apart, times are exact, and an interval of two ticks is a missing frame.
    # The margin is whole, as the intervals are: with fractions, those of a long film would take seconds to compare.
    margin = 0 if middle == 1 else 1
    if sum(abs(interval - middle) <= margin for interval in intervals) < MIN_ROUNDED_SHARE * len(intervals):
        margin = max(margin, middle // JITTER_DIVISOR)
    usual = [interval for interval in intervals if abs(interval - middle) <= margin]
    # Along a sequence of usual intervals the errors of the times cancel out, except at its two ends.
    rows = 1 + sum(
        abs(after - middle) <= margin < abs(before - middle) for before, after in pairwise([middle, *intervals])
    )
    jitter = max(1, statistics.median_high([abs(interval - middle) for interval in usual]))
    return Cadence(
        interval=Fraction(sum(usual), len(usual)) * tick,
        error=Fraction(rows * jitter, len(usual)) * tick,
        count=len(usual),
        is_constant=len(usual) >= MIN_USUAL_SHARE * len(intervals),
        mean_rate=len(intervals) / (sum(intervals) * tick),
        tick=tick,
    )


def listed_times(stream: av.stream.Stream) -> list[int]:
    """Return the times of all frames from the file's index in increasing order, ticks; [] if it is incomplete."""
    if not stream.frames or len(stream.index_entries) != stream.frames:
        return []
    return sorted({entry.timestamp for entry in stream.index_entries})


def _usual_rates_near(rate: Fraction) -> list[Fraction]:
    """Return the nearest integer rate and NTSC rate, the nearer one first, then the nearest multiple of 1/2.

    Rates that are not positive are left out.
    """
    ntsc = 3 * round(rate * 1001 / 3000) * Fraction(1000, 1001)  # 14.985, 23.976, 29.97 and their multiples
    near = sorted([Fraction(round(rate)), ntsc], key=lambda each: abs(each - rate))
    return [each for each in (*near, Fraction(round(2 * rate), 2)) if each > 0]


def _simplest(cadence: Cadence) -> Fraction:
    rates = [(1 / cadence.interval).limit_denominator(most) for most in MAX_DENOMINATORS]
    return next((rate for rate in rates if rate > 0 and cadence.is_exactly(rate)), rates[-1])


def declared_duration(stream: av.VideoStream) -> Fraction | None:
    """Return the duration that the header declares, seconds, or None if it declares none."""
    if not stream.duration or not stream.time_base or stream.duration <= 0:
        return None
    return stream.duration * Fraction(stream.time_base)


def assumed_rate_remark(name: str) -> str:
    """Return the remark on a clip that declares no frame rate."""
    return f"{name} does not say its frame rate; {ASSUMED_RATE} frames per second assumed."


@dataclass(frozen=True)
class Survey:
    """Presentation times and start time of a file.

    Attributes
    ----------
    times : list of int
        Presentation times of the pictures in increasing order, in ticks of their stream: all that the index lists, or
        the first ones. Pictures without a time are left out.
    start : Fraction
        Start of video and audio on the file's own clock, seconds; it becomes time 0.
    """

    times: list[int]
    start: Fraction


def survey(container: av.container.InputContainer, video: int) -> Survey:
    """Read the index of a file that was opened for this, or else its first packets.

    The clocks of transmitters, cameras and streaming servers start at an arbitrary time, so the start of a file becomes
    time 0. If the clock starts at the beginning, times before 0 are kept: they belong to decoder preroll, such as the
    first samples of AAC and Opus.

    Parameters
    ----------
    container : av.container.InputContainer
    video : int
        Number of the video stream that is read.
    """
    listed = listed_times(container.streams[video])
    if listed and container.format.name.startswith(EDIT_LIST_FORMAT):
        return Survey(listed, Fraction(0))
    sound = {stream.index for stream in container.streams.audio}
    times: list[int] = []
    can_begin = False
    starts: dict[int, Fraction] = {}
    count = size = 0
    for packet in read_packets(container, {video, *sound}, Damage()):
        if packet.pts is not None and packet.time_base:
            time = packet.pts * Fraction(packet.time_base)
            index = packet.stream.index
            if index == video:
                times.append(packet.pts)
                can_begin = can_begin or packet.is_keyframe
            if index != video or can_begin:  # pictures before the first keyframe cannot be decoded
                starts[index] = min(time, starts.get(index, time))
        count += packet.stream.index == video
        size += packet.size
        if count >= MAX_SURVEY_PACKETS or size >= MAX_SURVEY_BYTES:
            break
    return Survey(listed or sorted(set(times)), _start(container, starts))


def _start(container: av.container.InputContainer, starts: dict[int, Fraction]) -> Fraction:
    if not starts or container.format.name.startswith(EDIT_LIST_FORMAT):
        return Fraction(0)
    start = min(starts.values())
    return start if clock_may_jump(container) else max(start, Fraction(0))
