"""Read the pictures of a video from its beginning or from another frame on, by an index that was compared with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import islice

import av
import av.error

from fpsboost.errors import InputError
from fpsboost.io.output import VideoFile
from fpsboost.io.video.clock import VideoClock
from fpsboost.io.video.demuxer import Demuxer, open_video, read_packets
from fpsboost.io.video.frame_index import (
    INDEXED,
    EntryPoint,
    FrameIndex,
    TickTimes,
    UnindexedError,
    can_begin,
    read_index,
)
from fpsboost.io.video.pictures import MAX_REORDERED, Pictures
from fpsboost.io.video.remarks import Damage

STEPS_BACK = (0, 1, 10)
"""Seconds, or key frames, before the wanted one that are tried in turn."""

CHECKED_PICTURES = 2 * MAX_REORDERED
"""Number of pictures, from the first, that an index is compared with before it is believed."""


class PictureReader:
    """Pictures of a video stream, which begin at the first one until another place is asked for.

    `from_here` returns the pictures from where the file is, with nothing counted yet. `first` is the number of the
    first frame that comes, and `dropped` that of frames to leave out, since decoding could not begin later.
    """

    def __init__(self, demuxer: Demuxer, clock: VideoClock, file: VideoFile, from_here: Callable[[], Pictures]) -> None:
        self._demuxer, self._clock, self._file, self._from_here = demuxer, clock, file, from_here
        self._is_indexed = demuxer.container.format.name.startswith(INDEXED)
        self._unindexed: str | None = None
        self.index: FrameIndex | None = None
        self.first = self.dropped = 0
        self.pictures = from_here()

    def first_time(self) -> Fraction:
        picture = self.pictures.peek()
        return Fraction(0) if picture is None or picture.pts is None else self._time_of(picture)

    def skip_to(self, time: Fraction) -> None:
        """Go to the key frame before a time, where the container's index is to be trusted."""
        first, picture = self.first_time(), self.pictures.peek()
        if (
            time <= first
            or not self._is_indexed
            or picture is None
            or picture.pts is None
            or self.pictures.deinterlaced
        ):
            return
        for earlier in STEPS_BACK:  # some indexes count decoding times, which come before those of presentation
            place = max(first, time - earlier) + self._clock.start
            if not self._demuxer.seek(math.floor(place / self._clock.tick)):
                continue
            self.pictures = self._from_here()
            picture = self.pictures.peek()
            if picture is None or picture.pts is None or picture.is_corrupt:
                continue  # what follows would depend on pictures before it
            if first <= self._time_of(picture) <= time:
                return
        self._reopen()

    def frame_times(self) -> Sequence[Fraction] | None:
        """Return the times of all frames, from the packets; None if these do not give them."""
        if self.index is None and self._unindexed is None:
            try:
                self.index = self._checked_index()
            except UnindexedError as reason:
                self._unindexed = str(reason)
        return None if self.index is None else TickTimes(self.index.ticks, self._clock.tick, self._clock.start)

    def count_packets(self) -> int:
        with open_video(self._file.path, self._file.name) as file:
            return sum(1 for _ in read_packets(file, {self._file.stream_index}, Damage()))

    def begin_at(self, number: int) -> str | None:
        """Decode from a key frame before a frame, or else from the beginning; return why, if that is far before."""
        reason = self._unindexed
        if self.index is not None:
            points = self.index.entry_points_before(number)
            for point in [points[step] for step in STEPS_BACK if step < len(points)]:
                reached = self._seek_to(point, points)
                if reached is not None and self._decode_up_to(number, reached, self.index):
                    self.first = number
                    return None
            is_short = bool(points) and points[0].number == 0
            reason = None if is_short else "decoding cannot begin at the key frames before"
        self._reopen()
        self.dropped = number
        return reason

    def compare_with_index(self, number: int, time: Fraction | None) -> None:
        """Raise `InputError` if a frame, or that there is none, is not what `frame_times` has promised."""
        if self.index is None:
            return
        ticks = self.index.ticks
        listed = None if number == len(ticks) else int(ticks[number]) * self._clock.tick - self._clock.start
        if time != listed:
            raise InputError(
                f"{self._file.name} is damaged: its frame {number} is not at the time that its packets promise; "
                "convert it whole, in one run."
            )

    def _checked_index(self) -> FrameIndex:
        """Return the index of the frames, of which the first ones have been compared with their pictures."""
        if not self._is_indexed:
            raise UnindexedError("its container has no index of frames")
        if self.pictures.deinterlaced:
            raise UnindexedError("its packets tell nothing of fields")
        index = read_index(self._file.path, self._file.stream_index)
        times = [picture.pts for picture in islice(self.pictures, CHECKED_PICTURES)]
        is_right = times == index.ticks[:CHECKED_PICTURES].tolist() and not self.pictures.differ_from_packets
        self._reopen()
        if not is_right:
            raise UnindexedError("its packets and its pictures have different times")
        return index

    def _seek_to(self, point: EntryPoint, points: list[EntryPoint]) -> EntryPoint | None:
        """Seek to an entry point or, where the container's index leads elsewhere, to another one of some; return it.

        None where nothing can be read there, or where decoding depends on earlier packets.
        """
        demuxer = self._demuxer
        for time in (point.pts, point.dts):  # indexes count either
            if time is None or not demuxer.seek(time):
                continue
            try:
                packet = next((packet for packet in demuxer.container.demux(demuxer.stream) if packet.size), None)
            except av.error.FFmpegError:
                continue
            reached = next((other for other in points if packet is not None and other.pts == packet.pts), None)
            if packet is not None and reached is not None and demuxer.seek(time):
                return reached if can_begin(demuxer.stream, packet) else None
        return None

    def _decode_up_to(self, number: int, point: EntryPoint, index: FrameIndex) -> bool:
        """Decode from an entry point, where the file is, up to a frame; return whether the pictures are those listed.

        Pictures before the entry point's are left out, since decoding them depends on earlier packets.
        """
        self.pictures = self._from_here()
        ticks, expected = index.ticks, point.number
        for picture in self.pictures:
            if picture.pts is not None and picture.pts < ticks[point.number]:
                continue
            if picture.pts != ticks[expected] or picture.is_corrupt or self.pictures.differ_from_packets:
                return False
            if expected == number:
                self.pictures.forget_earlier(picture)
                return True
            expected += 1
        return False

    def _reopen(self) -> None:
        self.pictures.close()
        self._demuxer.reopen()
        self.pictures = self._from_here()

    def _time_of(self, picture: av.VideoFrame) -> Fraction:
        return self._clock.time_of(picture, None, self.pictures.damage)
