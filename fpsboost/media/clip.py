"""A video file as a clip: its pictures in presentation order, exact times, no silent loss.

FFmpeg decodes, through PyAV, because times stay exact ticks, deep formats stay deep, and damage is reported packet by
packet.
"""

import math
import os
from collections.abc import Generator
from dataclasses import replace
from fractions import Fraction
from itertools import dropwhile, islice
from pathlib import Path
from typing import Self

from av.video.reformatter import VideoReformatter

from fpsboost.media.clip_header import read_clip_header
from fpsboost.media.clock import TimedPicture
from fpsboost.media.demuxer import Demuxer, read_packets
from fpsboost.media.errors import EncryptedError, InputError, undone_by
from fpsboost.media.frame_index import INDEXED, EntryPoint, FrameIndex, UnindexedError, read_index
from fpsboost.media.info import Reading
from fpsboost.media.output import StreamInfo
from fpsboost.media.pictures import FormatUnifier, Pictures
from fpsboost.media.pixels import has_alpha
from fpsboost.media.remarks import Damage, Remarks, counted, dolby_vision_sentence, encrypted_sentence
from fpsboost.media.reorder_buffer import MAX_REORDERED
from fpsboost.media.traits import VideoTraits, read_traits

STEPS_BACK = (0, 1, 10)  # seconds, or key frames, before the wanted one that are tried in turn

CHECKED_PICTURES = 2 * MAX_REORDERED
"""Number of pictures, from the first, that an index is compared with before it is believed."""

SELF_CONTAINED = {"h264", "hevc", "mpeg1video", "mpeg2video", "mpeg4", "vp8", "vp9", "av1", "ffv1"}
"""Codecs whose decoders give, from a key frame on, the same pictures as by decoding all, or leave out pictures."""


class Clip:
    """Video file with one of its video streams, whose pictures can be read once, in presentation order.

    Opening reads headers and the first packets, and decodes nothing.

    Parameters
    ----------
    path : str or os.PathLike
        Video file; messages name it as it is given here.
    reading : Reading
        How it is read.

    Attributes
    ----------
    info : ClipInfo
        Size, frame rate and length by the headers; the size becomes that of the first picture when it is decoded.
    file : VideoFile
        The file, whose other streams a writer can carry over.
    remarks : Remarks
        What was lost, damaged or assumed so far.
    frame_index : FrameIndex or None
        List of the pictures, once `frame_times` has made it; that of another clip of the same file may be set before.

    Raises
    ------
    InputError
        The file cannot be read, holds no video, or is encrypted in the part to be read. While iterating also: it is
        read a second time, cannot be converted, or differs from its frame index.
    OptionError
        `reading` names a stream that is no video, or a frame rate for a file that declares its own.
    """

    def __init__(self, path: str | os.PathLike[str], reading: Reading) -> None:
        self._name = os.fspath(path)
        self.path = Path(path)
        self._reading = reading
        self.remarks = Remarks()
        self._demuxer = Demuxer(self._name, reading)
        with undone_by(self._demuxer.close):
            self._header = read_clip_header(self._demuxer, self.remarks)
            self._clock = self._header.clock
            self._check_clear(self._header.clear)
        self.info = self._header.info
        self.file = self._header.file
        self._reformatter = VideoReformatter()
        self._unifier: FormatUnifier | None = None
        self._started = False
        self.frame_index: FrameIndex | None = None
        self._unindexed: str | None = None
        self._refused: str | None = None
        self._first = self._dropped = 0
        self._pictures = self._pictures_from_here()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check_clear(self, clear: Fraction | None) -> None:
        """Raise `EncryptedError` unless the part to be read ends before what is encrypted, after `clear` seconds."""
        end = self._reading.end
        if clear is not None and (end is None or end(self._clock.rate) > clear):
            raise EncryptedError(encrypted_sentence(self._name, clear))

    @property
    def stream_info(self) -> StreamInfo:
        """Streams and traits that a sink may carry over; reading it decodes the first frame."""
        return StreamInfo(traits=self.traits, video=self.file, files=[self.path])

    @property
    def stopped_by(self) -> str | None:
        """Reason to refuse the clip: Dolby Vision without a base layer, or a change of size or format; else None."""
        return self._refused or (None if self._unifier is None else self._unifier.stopped_by)

    @property
    def traits(self) -> VideoTraits:
        """Colour, pixel shape, orientation; decodes the first frame and keeps it for the iteration."""
        return self._opened().traits

    def _opened(self) -> FormatUnifier:
        """Return the converter to the first picture's format; the first call decodes that picture, and keeps it.

        The first call also corrects the size in `info`. Raises `InputError` if no picture can be decoded, or if it is
        Dolby Vision without a base layer and `force_colours` is not given.
        """
        if self._unifier is None:
            picture = self._pictures.peek()
            if picture is None:
                self._check_clear(self._demuxer.clear)
                raise InputError(f"{self._name} holds no frame that can be decoded; check it with a player.")
            # The header may be wrong or silent about the size; the first picture is not.
            self._reading.check_size(self._name, picture.width, picture.height)
            self.info = replace(self.info, width=picture.width, height=picture.height)
            if has_alpha(picture.format.name) and not self._reading.keeps_alpha:
                self.remarks.add("alpha-left-out", name=self._name)
            traits = read_traits(
                picture, self._demuxer.stream, self._reformatter, self._name, self._header.sides.dolby_vision
            )
            if traits.dolby_vision_only:
                self._refused = dolby_vision_sentence(self._name)
                if not self._reading.force_colours:
                    raise InputError(self._refused)
                self.remarks.add("colours-wrong", name=self._name)
            stops = self._reading.size_change == "stop"
            aspect = self._pictures.aspect_of(picture)
            self._unifier = FormatUnifier(self._name, (picture.width, picture.height), traits, stops, aspect)
        return self._unifier

    def pictures(self) -> Generator[TimedPicture, None, None]:
        """Return an iterator over the pictures in presentation order, with strictly increasing times.

        A picture's duration is its own; the last one's may come from the header. Remarks on interlacing, changes of
        format and damage are added when the iteration ends, also when it is abandoned early. A second call raises
        `InputError`.
        """
        if self._started:
            raise InputError(f"{self._name} can be read only once; open it again.")
        self._started = True
        return self._presented()

    def close(self) -> None:
        """Close the decoder and the file."""
        self._pictures.close()
        self._demuxer.close()

    def _presented(self) -> Generator[TimedPicture, None, None]:
        """Yield the pictures; see `pictures`."""
        unifier = self._opened()
        clock = self._clock
        damage = self._pictures.damage
        count = self._first
        end = None
        try:
            for timed, is_last in clock.presented(self._pictures.unified(unifier, self._first), damage):
                self._compare_with_index(count, timed.time)
                count += 1
                if count <= self._dropped:
                    continue
                if is_last:
                    self._compare_with_index(count, None)
                    end = timed.time + timed.duration
                yield timed
            self._check_clear(self._demuxer.clear)
            if end is None:  # `traits` has decoded a frame, and the first one is never left out
                raise InputError(f"{self._name} has ended before frame {self._dropped}; begin at an earlier one.")
        finally:  # also where not all of the clip was asked for
            self._pictures.remark_on_interlacing()
            self.remarks += unifier.remarks()
            self.remarks += damage.remarks(self._name, count)
        if self._demuxer.clear is None:
            clock.remark_on_early_end(self.remarks, self._name, end, count, self.info.frame_count)

    def first_time(self) -> Fraction:
        """Return the time of the clip's first frame, seconds; call it before iterating. Decodes that frame."""
        self._opened()
        return self._next_time() or Fraction(0)

    def skip_to(self, time: Fraction) -> None:
        """Seek to the key frame at or before a time, seconds; call it before iterating.

        Does nothing if the container has no trustworthy index or if fields become frames. Where no seek ends at an
        intact picture at or before the time, the file is read from its beginning.
        """
        self._opened()
        first = self._next_time()
        if first is None or time <= first or not self._is_indexed or self._reading.deinterlace:
            return
        for earlier in STEPS_BACK:  # some indexes count decoding times, which come before those of presentation
            place = max(first, time - earlier) + self._clock.start
            if not self._demuxer.seek(math.floor(place / self._clock.tick)):
                continue
            self._pictures = self._pictures_from_here()
            reached = self._next_time()
            picture = self._pictures.peek()
            # what follows a corrupt picture would depend on pictures before it
            if reached is not None and first <= reached <= time and picture is not None and not picture.is_corrupt:
                return
        self._reopen()

    def frame_times(self) -> list[Fraction] | None:
        """Return the times of all frames, seconds; None if packets do not determine them. Call it before iterating.

        Reads all packets, and decodes the first frames to compare their times. If the result is None and the header
        gives neither count nor duration, packets are counted for `info.frame_count`. See
        `fpsboost.contracts.RandomAccess.frame_times`.
        """
        self._opened()
        if self.frame_index is None and self._unindexed is None:
            try:
                self.frame_index = self._checked_index()
            except UnindexedError as reason:
                self._unindexed = str(reason)
        if self.frame_index is None:
            if self.info.frame_count is None and self.info.duration is None:
                with self.file.open() as file:
                    packets = sum(1 for _ in read_packets(file, {self.file.stream_index}, Damage()))
                self.info = replace(self.info, frame_count=packets * (2 if self._reading.deinterlace else 1))
            return None
        return [ticks * self._clock.tick - self._clock.start for ticks in self.frame_index.ticks.tolist()]

    def begin_at(self, number: int) -> None:
        """Begin the iteration at a frame, counted from 0; call it before iterating.

        Seeks to a key frame if decoding from there gives exactly the pictures of the frame index; otherwise all frames
        are decoded from the beginning and dropped, and a remark gives the reason. Raises `InputError` if there is no
        such frame.
        """
        times = self.frame_times()
        if times is not None and number >= len(times):
            raise InputError(f"{self._name} has {counted(len(times), 'frame')}, and none has the number {number}.")
        if not number:
            return
        reason = self._unindexed
        if self.frame_index is not None:
            codec = self._demuxer.stream.codec_context.codec
            can_begin = codec.intra_only or codec.canonical_name in SELF_CONTAINED
            points = [point for point in self.frame_index.entry_points if can_begin and point.number <= number]
            for point in [points[-1 - step] for step in STEPS_BACK if step < len(points)]:
                if self._decode_up_to(number, point, self.frame_index):
                    self._first = number
                    return
            is_first = bool(points) and points[-1].number == 0
            reason = None if is_first else "decoding cannot begin at the key frames before"
        self._reopen()
        self._dropped = number
        if reason is not None:
            self.remarks.add("read-from-beginning", name=self._name, reason=reason)

    @property
    def _is_indexed(self) -> bool:
        """Whether the container has an index of key frames and a presentation time with every packet."""
        return self._demuxer.container.format.name.startswith(INDEXED)

    def _next_time(self) -> Fraction | None:
        """Return when the next picture is presented, seconds; None if it has no time, or there is none."""
        picture = self._pictures.peek()
        if picture is None or picture.pts is None:
            return None
        return self._clock.time_of(picture, None, self._pictures.damage)

    def _pictures_from_here(self) -> Pictures:
        """Return the pictures from the current position in the file, with all counters at 0."""
        return Pictures(self._clock, self._header.sides.crop, self.remarks)

    def _reopen(self) -> None:
        """Return to the beginning of the file, with a new decoder and all counters at 0."""
        self._pictures.close()
        self._demuxer.reopen()
        self._pictures = self._pictures_from_here()

    def _checked_index(self) -> FrameIndex:
        """Return the frame index after comparing its first times with decoded pictures; then reopen the file.

        Raises `UnindexedError` if the container has no index, fields become frames, or the times differ.
        """
        if not self._is_indexed:
            raise UnindexedError("its container has no index of frames")
        if self._reading.deinterlace:
            raise UnindexedError("its packets tell nothing of fields")
        index = read_index(self.file)
        times = [picture.pts for picture in islice(self._pictures, CHECKED_PICTURES)]
        is_right = times == index.ticks[:CHECKED_PICTURES].tolist() and not self._pictures.differ_from_packets
        self._reopen()
        if not is_right:
            raise UnindexedError("its packets and its pictures have different times")
        return index

    def _compare_with_index(self, number: int, time: Fraction | None) -> None:
        """Raise `InputError` if a frame is not at the time that `frame_times` returned.

        `time` is None for the end of the clip, which must come after the last frame of the index.
        """
        if self.frame_index is None:
            return
        ticks = self.frame_index.ticks
        listed = None if number == len(ticks) else int(ticks[number]) * self._clock.tick - self._clock.start
        if time != listed:
            raise InputError(
                f"{self._name} is damaged: its frame {number} is not at the time that its packets promise; "
                "convert it whole, in one run."
            )

    def _decode_up_to(self, number: int, point: EntryPoint, index: FrameIndex) -> bool:
        """Decode from an entry point up to a frame, which stays the next picture; return whether this succeeded.

        It fails if the container cannot seek there, or if a picture on the way is corrupt or not at its time in the
        index.
        """
        expected = index.ticks[point.number : number + 1].tolist()
        for time in (point.pts, point.dts):  # indexes of containers count either
            if time is None or not self._demuxer.seek(time):
                continue
            self._pictures = self._pictures_from_here()
            following = dropwhile(lambda picture: picture.pts is not None and picture.pts < point.pts, self._pictures)
            for ticks, picture in zip(expected, following, strict=False):
                if picture.pts != ticks or picture.is_corrupt or self._pictures.differ_from_packets:
                    break
                if ticks == expected[-1]:
                    self._pictures.forget_earlier(picture)
                    return True
        return False


def open(path: str | os.PathLike[str], reading: Reading | None = None) -> Clip:
    """Open a video file for reading.

    Parameters
    ----------
    path : str or os.PathLike
        Video file; messages name it as it is given here.
    reading : Reading, optional
        How it is read; by default the best stream, as it is.

    Returns
    -------
    Clip
        Clip, a context manager that closes the file.

    Raises
    ------
    InputError
        The file cannot be read, holds no video, or is encrypted from its beginning.
    OptionError
        `reading` names a stream that is no video, or a frame rate for a file that declares its own.
    """
    return Clip(path, reading or Reading())
