"""Read the pictures of a video from its beginning or from another frame on, by an index that was compared with them."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from itertools import dropwhile, islice

from fpsboost.errors import InputError
from fpsboost.io.output import VideoFile
from fpsboost.io.video.clock import VideoClock
from fpsboost.io.video.demuxer import Demuxer, open_video, read_packets
from fpsboost.io.video.frame_index import INDEXED, EntryPoint, FrameIndex, UnindexedError, read_index
from fpsboost.io.video.pictures import MAX_REORDERED, Pictures
from fpsboost.io.video.remarks import Damage

STEPS_BACK = (0, 1, 10)
"""Seconds, or key frames, before the wanted one that are tried in turn."""

CHECKED_PICTURES = 2 * MAX_REORDERED
"""Number of pictures, from the first, that an index is compared with before it is believed."""

SELF_CONTAINED = {"h264", "hevc", "mpeg1video", "mpeg2video", "mpeg4", "vp8", "vp9", "av1", "ffv1"}
"""Codecs whose decoders give, from a key frame on, the same pictures as by decoding all, or leave out pictures."""


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

    def next_time(self) -> Fraction | None:
        """Return when the next picture is presented, seconds; None if it has no time, or there is none."""
        picture = self.pictures.peek()
        if picture is None or picture.pts is None:
            return None
        return self._clock.time_of(picture, None, self.pictures.damage)

    def skip_to(self, time: Fraction) -> None:
        """Go to the key frame before a time, where the container's index is to be trusted."""
        first = self.next_time()
        if first is None or time <= first or not self._is_indexed or self.pictures.deinterlaced:
            return
        for earlier in STEPS_BACK:  # some indexes count decoding times, which come before those of presentation
            place = max(first, time - earlier) + self._clock.start
            if not self._demuxer.seek(math.floor(place / self._clock.tick)):
                continue
            self.pictures = self._from_here()
            reached, picture = self.next_time(), self.pictures.peek()
            # what follows a corrupt picture would depend on pictures before it
            if reached is not None and first <= reached <= time and picture is not None and not picture.is_corrupt:
                return
        self._reopen()

    def frame_times(self) -> list[Fraction] | None:
        """Return the times of all frames, from the packets; None if these do not give them."""
        if self.index is None and self._unindexed is None:
            try:
                self.index = self._checked_index()
            except UnindexedError as reason:
                self._unindexed = str(reason)
        if self.index is None:
            return None
        return [ticks * self._clock.tick - self._clock.start for ticks in self.index.ticks.tolist()]

    def count_packets(self) -> int:
        with open_video(self._file.path, self._file.name) as file:
            return sum(1 for _ in read_packets(file, {self._file.stream_index}, Damage()))

    def begin_at(self, number: int) -> str | None:
        """Decode from a key frame before a frame, or else from the beginning; return why, if that is far before."""
        reason = self._unindexed
        if self.index is not None:
            codec = self._demuxer.stream.codec_context.codec
            can_begin = codec.intra_only or codec.canonical_name in SELF_CONTAINED
            points = self.index.entry_points_before(number) if can_begin else []
            for point in [points[step] for step in STEPS_BACK if step < len(points)]:
                if self._decode_up_to(number, point, self.index):
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

    def _decode_up_to(self, number: int, point: EntryPoint, index: FrameIndex) -> bool:
        """Decode from an entry point up to a frame; return whether the pictures are those listed.

        Pictures before the entry point's are left out, since decoding them depends on earlier packets.
        """
        expected = index.ticks[point.number : number + 1].tolist()
        for time in (point.pts, point.dts):  # indexes of containers count either
            if time is None or not self._demuxer.seek(time):
                continue
            self.pictures = self._from_here()
            following = dropwhile(lambda picture: picture.pts is not None and picture.pts < point.pts, self.pictures)
            for ticks, picture in zip(expected, following, strict=False):
                if picture.pts != ticks or picture.is_corrupt or self.pictures.differ_from_packets:
                    break
                if ticks == expected[-1]:
                    self.pictures.forget_earlier(picture)
                    return True
        return False

    def _reopen(self) -> None:
        self.pictures.close()
        self._demuxer.reopen()
        self.pictures = self._from_here()
