"""The clock of a video file: when it starts, its frame rate, and presentation times that increase from frame to frame.

Start, rate and duration are read from the header and the first packets, before any is decoded. Decoders output frames
in presentation order, so that order is trusted more than the times.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple, Self

from av import VideoFrame
from av.container import InputContainer

from fpsboost.media.demuxer import Demuxer, clock_may_jump, is_encrypted, is_fragmented, is_raw, read_packets
from fpsboost.media.pyav import as_fraction
from fpsboost.media.remarks import Damage, Remarks, counted
from fpsboost.media.time_map import TimeMap

DURATION_IN_HEADER = ("matroska", "mov", "avi", "flv", "asf")
"""Containers whose header has the duration; elsewhere it is FFmpeg's estimate."""

DURATION_FROM_BEGIN = ("mov", "flv")  # those that count it from the beginning, wherever on the clock that is

MAX_WAITING = 8
"""Number of consecutive frames no later than the last good one that ends the wait; if they rise, the clock jumped."""


MAX_SURVEY_PACKETS = 1000
"""Maximum number of video packets that are read: enough to distinguish 23.976 and 24 fps by times in milliseconds."""

MAX_SURVEY_BYTES = 1 << 26
"""Maximum size of the packets that are read, bytes; it limits the time for reading large packets."""


TIME_TOLERANCE = Fraction(1, 1000)
"""Maximum seconds by which a clock that counts in milliseconds puts a frame before its position."""


def survey(container: InputContainer, video: int) -> tuple[list[int], Fraction, Fraction | None]:
    """Return the times of a stream's pictures in ticks, and the start of the file on its own clock in seconds.

    The third is how long the pictures last that are before an encrypted one, or None; in a file with an index, only
    the first one is looked at.

    Times are all that the index lists, or those of the first packets, in increasing order; a raw stream has none. The
    clocks of transmitters, cameras and streaming servers start at an arbitrary time, so the start of a file becomes
    time 0; fragments of MP4 are cut out of such streams. If the clock starts at the beginning, times before 0 are kept:
    they belong to decoder preroll, such as the first samples of AAC and Opus.
    """
    if is_raw(container):
        return [], Fraction(0), None
    stream = container.streams.get(video)[0]
    keeps_delays = container.format.name.startswith("mov") and not is_fragmented(stream)  # those of edit lists
    is_complete = len(stream.index_entries) == stream.frames
    listed = sorted({entry.timestamp for entry in stream.index_entries}) if is_complete else []
    most = 1 if listed and keeps_delays else MAX_SURVEY_PACKETS
    clear: Fraction | None = None
    times: list[int] = []
    can_begin = False
    starts: dict[int, Fraction] = {}
    size = 0
    for packet in read_packets(container, {video, *(sound.index for sound in container.streams.audio)}, Damage()):
        index = packet.stream.index
        if packet.pts is not None and packet.time_base:
            if index == video:
                times.append(packet.pts)
                can_begin = can_begin or packet.is_keyframe
                if clear is None and is_encrypted(packet):
                    clear = (packet.pts - times[0]) * Fraction(packet.time_base)
            if index != video or can_begin:  # pictures before the first keyframe cannot be decoded
                time = packet.pts * Fraction(packet.time_base)
                starts[index] = min(time, starts.get(index, time))
        size += packet.size
        if len(times) >= most or size >= MAX_SURVEY_BYTES:
            break
    start = min(starts.values(), default=Fraction(0))
    if keeps_delays or (start < 0 and (container.format.name == "ogg" or not clock_may_jump(container))):
        start = Fraction(0)
    return listed or sorted(set(times)), start, clear


@dataclass
class Window:
    """Part of a clip that becomes the output, on the clip's own clock, seconds."""

    begin: Fraction
    """Time that becomes 0: of the first frame of the part. Until that has been read, the time by the options."""
    end: Fraction | None
    """End of the part; None if that is the clip's own end, or a frame that has not been read yet."""
    planned_end: Fraction | None
    """End of the part by the options and the nominal rate; None for the clip's end."""
    origin: Fraction = Fraction(0)
    """Time of the clip's first frame."""
    skipped: int = 0
    """Number of frames before the part that were read, or that reading it has left out by their times."""
    curve: TimeMap | None = None
    """Map of output times to times of the part; None if it plays at its own speed."""

    @property
    def reverses(self) -> bool:
        """Whether the source plays backwards somewhere."""
        return self.curve is not None and self.curve.reverses

    def frames_before(self, rate: Fraction) -> int:
        """Return the number of frames before the part, at a rate."""
        return max(0, math.ceil((self.begin - self.origin - TIME_TOLERANCE) * rate))

    def output_time(self, time: Fraction) -> Fraction:
        """Return the output time, seconds, at which a time of the source is first shown."""
        return time - self.begin if self.curve is None else self.curve.time_of(time - self.begin)

    def passages(self, begin: Fraction, end: Fraction) -> Sequence[tuple[Fraction, Fraction]]:
        """Return the output times, from and to, between which a part of the source, `begin` to `end`, is shown."""
        part = begin - self.begin, end - self.begin
        return [part] if self.curve is None else self.curve.passages(*part)


class TimedPicture(NamedTuple):
    """Decoded picture, when it is presented, and for how long, seconds."""

    picture: VideoFrame
    time: Fraction
    duration: Fraction

    def later(self, by: Fraction) -> Self:
        """Return the picture as it is presented later."""
        return self._replace(time=self.time + by)


@dataclass(frozen=True)
class VideoClock:
    """Converter of the times of pictures to seconds from the start of the clip.

    A raw stream has no clock: its `tick` is half a frame, and `Pictures` counts frames instead.

    Parameters
    ----------
    file : Demuxer
        Open file, whose header and packets give the end of the clip.
    start : Fraction
        Time of the file's own clock that becomes 0, seconds.
    tick : Fraction
        Time base of the stream, seconds.
    time_base : Fraction
        Time base of the frames, seconds: half a tick where each field becomes a frame.
    rate : Fraction
        Nominal frames per second; twice the coded rate where each field becomes a frame.
    raw_rate : Fraction, optional
        For a raw stream, the rate by which FFmpeg derived the durations of its packets; None for all other files.
    """

    file: Demuxer
    start: Fraction
    tick: Fraction
    time_base: Fraction
    rate: Fraction
    raw_rate: Fraction | None = None

    def time_of(self, picture: VideoFrame, end: Fraction | None, damage: Damage) -> Fraction:
        """Return when a picture is presented, seconds; without a time of its own, at `end` of the one before."""
        if picture.pts is not None:
            return picture.pts * (as_fraction(picture.time_base) or self.time_base) - self.start
        damage.untimed += 1
        return Fraction(0) if end is None else round(end / self.time_base) * self.time_base

    def presented(self, pictures: Iterable[VideoFrame], damage: Damage) -> Iterator[tuple[TimedPicture, bool]]:
        """Yield pictures at strictly increasing times, each with whether it is the last one; see `in_rising_order`.

        The last one's duration may come from the header.
        """
        for timed, is_last in in_rising_order(self._timed(pictures, damage), 1 / self.rate, self.time_base, damage):
            yield (timed._replace(duration=self._last_duration(timed)) if is_last else timed), is_last

    def _timed(self, pictures: Iterable[VideoFrame], damage: Damage) -> Iterator[TimedPicture]:
        """Yield pictures at their own times, which may not increase yet, for their own durations.

        FFmpeg's duration of a picture without a time is unreliable, and not used.
        """
        end: Fraction | None = None
        for picture in pictures:
            time = self.time_of(picture, end, damage)
            duration = 1 / self.rate
            if picture.pts is not None and picture.duration > 0:
                duration = picture.duration * (as_fraction(picture.time_base) or self.time_base)
            end = time + duration
            yield TimedPicture(picture, time, duration)

    def _last_duration(self, last: TimedPicture) -> Fraction:
        """Return the duration of the last picture, seconds: until the clip's end as the container declares it.

        If that end is implausible, it is the picture's own. An end is plausible within four frames after the time of
        the picture, or after the last packet even if that became no picture, since screen recordings omit pictures
        without change.
        """
        time = last.time
        end = self._declared_end
        if self._says_duration and end is not None and self.file.stream.start_time is not None:
            last_packet = max(Fraction(0), self.file.last_start - self.start)
            if 0 < end - time <= 4 / self.rate or time < end <= last_packet + 4 / self.rate:
                return end - time
        return last.duration

    def remark_on_early_end(self, remarks: Remarks, name: str, end: Fraction, count: int, listed: int | None) -> None:
        """Add a remark if a file ends earlier than its header declares, at `end` after `count` frames."""
        container = self.file.container
        declared = self._declared_end
        promised = Fraction(0)
        reached = Fraction(0)
        if declared is not None and not clock_may_jump(container):  # there FFmpeg estimates it
            promised = declared
            reached = end
        # The whole file may outlast its video, so it is short only if no stream reaches its end.
        if container.duration and self._says_duration and self.file.duration == self.file.stream.duration:
            whole, begin = (Fraction(time or 0, 1_000_000) for time in (container.duration, container.start_time))
            # some headers count from the beginning, others from time 0 of the clock, if that is not after the end
            whole += begin if container.format.name.startswith(DURATION_FROM_BEGIN) or begin >= whole else 0
            if whole - self.file.furthest > promised - reached:
                promised = whole - self.start
                reached = self.file.furthest - self.start
        if promised - reached > max(5 / self.rate, promised / 20):
            frames = counted(count, "frame") + ("" if listed is None else f" of {listed}")
            remarks.add("ends-early", name=name, reached=float(reached), promised=float(promised), frames=frames)

    @property
    def _declared_end(self) -> Fraction | None:
        """End of the stream by its header, seconds; None if unknown, or ASF, which declares only the file's."""
        duration = self.file.duration
        if duration is None or self.file.container.format.name.startswith("asf"):
            return None
        return ((self.file.stream.start_time or 0) + duration) * self.tick - self.start

    @property
    def _says_duration(self) -> bool:
        """Whether the duration is read from the header and not FFmpeg's estimate."""
        return self.file.container.format.name.startswith(DURATION_IN_HEADER)


def in_rising_order(
    pictures: Iterable[TimedPicture], interval: Fraction, tick: Fraction, damage: Damage
) -> Iterator[tuple[TimedPicture, bool]]:
    """Yield frames at strictly increasing times, each as soon as the next valid time is known, and whether it is last.

    A frame far ahead of the next one is moved back to follow the frame before it. Frames not later than the frame
    before them are spread over the gap that follows, as many as fit; the others are left out. If the clock jumps back,
    as in joined recordings, all later times are offset to continue from there. Repaired times are multiples of `tick`.
    """
    before: Fraction | None = None
    last: TimedPicture | None = None
    strays: list[TimedPicture] = []
    shift = Fraction(0)
    for picture in pictures:
        frame = picture.later(shift)
        time = frame.time
        if last is not None and _is_far_ahead(before, last.time, time, interval, tick):
            back = time - interval if before is None else before + min(interval, (time - before) / 2 // tick * tick)
            last = last._replace(time=back)
            damage.far_ahead += 1
        if last is not None and time <= last.time:
            strays.append(frame)
            if len(strays) < MAX_WAITING:
                continue
            rising = all(one.time < other.time for one, other in pairwise(strays))
            ahead = last.time + math.ceil(interval / tick) * tick - strays[0].time
            following = [stray.later(ahead) for stray in strays] if rising else []
            shift += ahead if rising else 0
            damage.jumps += rising
            damage.misplaced += 0 if rising else len(strays)
        else:
            following = [frame]
            if last is not None:
                fitting = _spread_evenly(strays, last.time, time, interval, tick)
                damage.displaced += len(fitting)
                damage.misplaced += len(strays) - len(fitting)
                following = [*fitting, *following]
        strays = []
        for placed in following:
            if last is not None:
                yield last, False
                before = last.time
            last = placed
    damage.misplaced += len(strays)
    if last is not None:
        yield last, True


def _is_far_ahead(before: Fraction | None, time: Fraction, after: Fraction, interval: Fraction, tick: Fraction) -> bool:
    """Return whether `time`, between `before` and `after`, is damaged: far ahead, so that `after` seems too early.

    There must be a tick between these two to which it can be moved.
    """
    far = max(Fraction(1), 10 * interval)
    return after <= time and (time - after > far if before is None else after - before > tick and time - before > far)


def _spread_evenly(
    strays: list[TimedPicture], begin: Fraction, end: Fraction, interval: Fraction, tick: Fraction
) -> list[TimedPicture]:
    """Return the frames that fit between two times, with times spread evenly between them."""
    fitting = strays[: max(round((end - begin) / interval) - 1, 0)]
    step = (end - begin) / (len(fitting) + 1)
    if step <= tick:
        return []
    return [
        frame._replace(time=begin + math.floor(step * number / tick) * tick) for number, frame in enumerate(fitting, 1)
    ]
