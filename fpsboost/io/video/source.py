"""Read a video file: frames in presentation order, exact times, no silent loss.

FFmpeg decodes, through PyAV, because times stay exact ticks, deep formats stay deep, and damage is reported packet by
packet.
"""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path
from typing import Any, cast

import av
import av.container
import av.error
from av.video.reformatter import VideoReformatter

from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame, Image
from fpsboost.io import ClosesOnExit
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.stream_info import StreamInfo, VideoFile
from fpsboost.io.video.damage import Damage, counted
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.entry_points import can_begin
from fpsboost.io.video.fields import frames_of_fields
from fpsboost.io.video.frame_index import INDEXED, EntryPoint, FrameIndex, TickTimes, UnindexedError, read_index
from fpsboost.io.video.frame_times import in_rising_order
from fpsboost.io.video.nominal_rate import (
    as_fraction,
    assumed_rate_remark,
    declared_duration,
    measured_cadence,
    nominal_rate,
)
from fpsboost.io.video.orientation import is_on_its_side, turned_upright
from fpsboost.io.video.packets import read_packets
from fpsboost.io.video.planes import coding_of, in_planes
from fpsboost.io.video.reorder_buffer import MAX_REORDERED, ReorderBuffer
from fpsboost.io.video.size_change import FormatUnifier
from fpsboost.io.video.stream_choice import choose_video, left_out_remarks
from fpsboost.io.video.survey import survey
from fpsboost.io.video.traits import VideoTraits, read_traits
from fpsboost.io.video.unsupported import (
    interlaced_remark,
    lost_alpha_remark,
    lost_companions_remark,
    lost_shape_remark,
)
from fpsboost.io.video.ycc import has_alpha, to_bgr, to_bgra
from fpsboost.threads import available_cores

DURATION_IN_HEADER = ("matroska", "mov", "avi", "flv", "asf")
STEPS_BACK = (0, 1, 10)
CHECKED_PICTURES = 2 * MAX_REORDERED
"""Number of pictures, from the first, that an index is compared with before it is believed."""
decoders_of_hidden_alpha = {"vp8": "libvpx", "vp9": "libvpx-vp9"}


class VideoSource(ClosesOnExit):
    """Frames of one of a video file's streams.

    Parameters
    ----------
    path : str or path
        A file that FFmpeg can read. Opening reads headers only.
    for_images : bool
        For targets that hold pictures and nothing else: turn them upright as the file's display matrix says, and remark
        what is left behind. Decodes the first picture at once to know the size; frames keep no decoder's picture.
    keeps_alpha : bool
        Yield BGRA where the file has alpha; it is left out otherwise, with a remark.
    keeps_planes : bool
        Yield pictures of Y, Cb and Cr as they are, as `YCbCrImage`; others, and all without it, become BGR.
    decoding : DecodeOptions, optional
        Which stream, and what is done to its pictures first.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.

    Attributes
    ----------
    start : Fraction
        What lies at 0 by the file's own clock, seconds; all times count from there.
    coded_rate : Fraction
        Nominal rate of the file's own pictures, whatever becomes of their fields.

    Raises
    ------
    InputError
        Missing, not a video, or coded in a way that cannot be decoded; while iterating also: nothing decodes, or the
        picture's size or pixel format changes and `decoding` does not say what then.
    OptionError
        There is no such video stream.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        for_images: bool = False,
        keeps_alpha: bool = False,
        keeps_planes: bool = False,
        decoding: DecodeOptions | None = None,
        limit: MemoryLimit | None = None,
    ) -> None:
        self._name = os.fspath(path)
        self._for_images, self._keeps_alpha = for_images, keeps_alpha
        self._keeps_planes = keeps_planes and not for_images
        self._decoding = decoding or DecodeOptions()
        self._limit = limit or MemoryLimit()
        self.path = Path(path)
        self._container = open_video(self.path, self._name)
        try:
            self._stream = choose_video(self._container, self._name, self._decoding.stream)
            self._limit.check(self._name, self._stream.codec_context.width, self._stream.codec_context.height)
            with open_video(self.path, self._name) as file:
                clocks = survey(file, self._stream.index)
            tick = as_fraction(self._stream.time_base)
            cadence = None if tick is None else measured_cadence(clocks.times, tick)
            self._rate, rate_is_known = nominal_rate(self._stream, cadence)
        except BaseException:
            self._container.close()
            raise
        _decode_in_threads(self._stream)
        self._reformatter = VideoReformatter()
        self._remarks = left_out_remarks(self._container, self._stream, self._name)
        if not rate_is_known:
            self._remarks.append(assumed_rate_remark(self._name))
        self._unifier: FormatUnifier | None = None
        self._furthest = self._last_packet = Fraction(0)
        self._ahead: list[av.VideoFrame] = []
        self._index: FrameIndex | None = None
        self._unindexed: str | None = None
        self._first = self._dropped = 0
        self.start = clocks.start
        self._ticks = tick or 1 / self._rate
        self.coded_rate = self._rate
        fields = 2 if self._decoding.deinterlace else 1
        self._rate *= fields
        self._begin()
        self._started = False
        self._traits: VideoTraits | None = None
        context = self._stream.codec_context
        self._info = ClipInfo(
            name=self._name,
            height=context.height,
            width=context.width,
            rate=self._rate,
            time_base=self._ticks / fields,
            frame_count=fields * self._stream.frames or None,
            duration=declared_duration(self._stream),
            mean_rate=None if cadence is None else cadence.mean_rate * fields,
        )
        if for_images:
            self._prepare_for_images()

    @property
    def info(self) -> ClipInfo:
        return self._info

    @property
    def stream_info(self) -> StreamInfo:
        """See `fpsboost.io.DescribedSource.stream_info`; decodes the first frame."""
        return StreamInfo(traits=self.traits, video=self.file, files=[self.path])

    @property
    def file(self) -> VideoFile:
        """The file, for what is read of it besides the pictures."""
        streams = self._container.streams
        companions = ["sound"] * bool(streams.audio) + ["subtitles"] * bool(streams.subtitles)
        return VideoFile(self.path, self._name, self._stream.index, self.start, self.coded_rate, companions)

    @property
    def remarks(self) -> list[str]:
        return list(self._remarks)

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first change of size, at which reading stops if so configured."""
        if self._unifier is None or self._unifier.first_change is None:
            return None
        return (
            f"{self._name} changes {self._unifier.first_change}; convert it with `size_change='scale'` to make all "
            "frames like the first, or cut it there and convert the parts one by one."
        )

    @property
    def traits(self) -> VideoTraits:
        """Colour, pixel shape, orientation; decodes the first frame and keeps it for the iteration.

        Raises
        ------
        InputError
            Nothing decodes, or the colour matrix is one that is not supported.
        """
        if self._traits is None:
            picture = next(self._progressive, None)
            if picture is None:
                raise InputError(f"{self._name} holds no frame that can be decoded; check it with a player.")
            self._ahead.append(picture)
            self._traits = self._read_traits(picture)
        return self._traits

    def __iter__(self) -> Iterator[Frame]:
        if self._started:
            raise InputError(f"{self._name} can be read only once; open it again.")
        self._started = True
        return self._frames()

    def first_time(self) -> Fraction:
        """Time of the clip's first frame, seconds; decodes it. Before the first frame is read."""
        assert self.traits is not None
        if not self._ahead:  # begun again since
            self._ahead.append(next(self._progressive))
        picture = self._ahead[0]
        return Fraction(0) if picture.pts is None else self._time_of(picture)

    def skip_to(self, time: Fraction) -> None:
        """Go to the key frame before a time, where the file's index is to be trusted.

        Not where fields become frames, which hang on those before.

        Raises
        ------
        InputError
            Nothing decodes.
        """
        first = self.first_time()
        seekable = self._container.format.name.startswith(INDEXED) and not self._decoding.deinterlace
        if time <= first or not seekable or self._ahead[0].pts is None:
            return
        for earlier in STEPS_BACK:  # some indexes count decoding times, which come before those of showing
            picture = self._picture_after_seek(max(first, time - earlier))
            if picture is None or picture.pts is None or picture.is_corrupt:
                continue  # what follows would hang on what came before
            if first <= self._time_of(picture) <= time:
                self._ahead = [picture]
                return
        self._reopen()

    def _picture_after_seek(self, time: Fraction) -> av.VideoFrame | None:
        try:
            self._container.seek(math.floor((time + self.start) / self._ticks), stream=self._stream, backward=True)
        except av.error.FFmpegError:
            return None
        self._begin()
        return next(self._progressive, None)

    def frame_times(self) -> Sequence[Fraction] | None:
        """See `fpsboost.io.RandomAccess.frame_times`; reads all packets, and decodes the first frames.

        Raises
        ------
        InputError
            Nothing decodes.
        """
        if self._index is None and self._unindexed is None:
            try:
                self._index = self._checked_index()
            except UnindexedError as reason:
                self._unindexed = str(reason)
                self._count_packets()
        return None if self._index is None else TickTimes(self._index.ticks, self._ticks, self.start)

    def _count_packets(self) -> None:
        """Take the number of packets for that of frames if the header does not say it, nor the duration."""
        if self._info.frame_count is None and self._info.duration is None:
            with open_video(self.path, self._name) as file:
                count = sum(1 for _ in read_packets(file, {self._stream.index}, Damage()))
            fields = 2 if self._decoding.deinterlace else 1
            self._info = replace(self._info, frame_count=fields * count)

    @property
    def frame_index(self) -> FrameIndex | None:
        """See `fpsboost.io.SharesIndex.frame_index`."""
        return self._index

    def take_index(self, index: FrameIndex) -> None:
        """See `fpsboost.io.SharesIndex.take_index`."""
        self._index = index

    def begin_at(self, number: int) -> None:
        """See `fpsboost.io.RandomAccess.begin_at`; decodes from the key frame before.

        Raises
        ------
        InputError
            Nothing decodes, or there is no such frame.
        """
        times = self.frame_times()
        if times is not None and number >= len(times):
            raise InputError(f"{self._name} has {counted(len(times), 'frame')}, and none has the number {number}.")
        if number == 0:
            return
        if self._index is not None:
            points = self._index.entry_points_before(number)
            for point in [points[step] for step in STEPS_BACK if step < len(points)]:
                reached = self._seek_to(point, points)
                if reached is not None and self._decode_up_to(number, reached):
                    self._first = number
                    return
            is_short = bool(points) and points[0].number == 0
            reason = None if is_short else "decoding cannot begin at the key frames before"
        else:
            reason = self._unindexed
        self._reopen()
        self._dropped = number
        if reason is not None:
            self._remarks.append(f"{self._name} was read from its beginning, because {reason}.")

    def _checked_index(self) -> FrameIndex:
        """Return the index of the frames, of which the first ones have been compared with their pictures."""
        assert self.traits is not None
        if not self._container.format.name.startswith(INDEXED):
            raise UnindexedError("its container has no index of frames")
        if self._decoding.deinterlace:
            raise UnindexedError("its packets tell nothing of fields")
        index = read_index(self.path, self._stream.index)
        pictures = list(islice((picture.pts for picture in self._in_order()), CHECKED_PICTURES))
        is_right = pictures == index.ticks[:CHECKED_PICTURES].tolist() and not self._is_off_index()
        self._reopen()
        if not is_right:
            raise UnindexedError("its packets and its pictures have different times")
        return index

    def _is_off_index(self) -> bool:
        """Return whether what was decoded so far shows that packets and pictures do not correspond."""
        has_interchanged = self._buffer is not None and self._buffer.has_interchanged
        return has_interchanged or self._damage != Damage(corrupt=self._damage.corrupt)

    def _seek_to(self, point: EntryPoint, points: list[EntryPoint]) -> EntryPoint | None:
        """Seek to an entry point or, where the container's index leads elsewhere, to another one of some; return it.

        None where nothing can be read there, or what is there hangs on what is before.
        """
        for time in (point.pts, point.dts):  # indexes count either
            if time is None:
                continue
            try:
                self._container.seek(time, stream=self._stream, backward=True)
                packet = next((packet for packet in self._container.demux(self._stream) if packet.size), None)
                reached = next((each for each in points if packet is not None and each.pts == packet.pts), None)
                if packet is None or reached is None:
                    continue
                self._container.seek(time, stream=self._stream, backward=True)
            except av.error.FFmpegError:
                continue
            return reached if can_begin(self._stream, packet) else None
        return None

    def _decode_up_to(self, number: int, point: EntryPoint) -> bool:
        """Decode from an entry point, where the file is, up to a frame; return whether the pictures are those listed.

        Pictures before the entry point's are left out: they hang on what is before.
        """
        assert self._index is not None
        self._begin()  # nothing has been read since the seek
        ticks = self._index.ticks
        expected = point.number
        for picture in self._pictures:
            if picture.pts is not None and picture.pts < ticks[point.number]:
                continue
            if picture.pts != ticks[expected] or picture.is_corrupt or self._is_off_index():
                return False
            if expected == number:
                self._ahead = [picture]
                self._count_from(picture)
                return True
            expected += 1
        return False

    def _count_from(self, picture: av.VideoFrame) -> None:
        """Count damage and interlaced pictures from a picture on, as if the ones before had not been decoded."""
        self._damage.corrupt = 0
        self._decoded, self._flagged_interlaced = 1, int(picture.interlaced_frame)

    def _begin(self) -> None:
        """Decode from where the file is, and count what is wrong from there on."""
        self._damage = Damage()
        self._decoded = self._flagged_interlaced = 0
        self._buffer: ReorderBuffer[av.VideoFrame] | None = None
        self._pictures = self._decode()
        fields = self._decoding.deinterlace
        self._progressive = frames_of_fields(self._pictures, self._ticks, self._name) if fields else self._pictures

    def _reopen(self) -> None:
        """Begin again at the very first frame."""
        index = self._stream.index
        self._pictures.close()
        self._container.close()
        self._container = open_video(self.path, self._name)
        self._stream = cast(av.VideoStream, self._container.streams[index])
        _decode_in_threads(self._stream)
        self._ahead = []
        self._begin()

    def close(self) -> None:
        self._pictures.close()
        self._container.close()

    def _frames(self) -> Iterator[Frame]:
        """Yield the frames; only the last one's duration comes from the header."""
        matrix = self.traits.display_matrix
        coding = coding_of(self.traits) if self._keeps_planes else None
        count, end = self._first, None
        timed = in_rising_order(self._timed(), 1 / self._rate, self._info.time_base, self._damage)
        try:
            for picture, time, is_last in timed:
                self._compare_with_index(count, time)
                count += 1
                if count <= self._dropped:
                    continue
                duration = self._duration_of(picture)
                if is_last:
                    self._compare_with_index(count, None)
                    duration = self._last_duration(time, duration)
                    end = time + duration
                if coding is not None:
                    yield Frame(in_planes(picture, coding), time, duration, picture)
                elif self._for_images:
                    yield Frame(turned_upright(self._convert(picture), matrix), time, duration)
                else:
                    yield Frame(self._convert(picture), time, duration, picture)
            if end is None:  # `traits` has found a frame, and the first one is never left out
                raise InputError(f"{self._name} has ended before frame {self._dropped}; begin at an earlier one.")
        finally:  # also where not all of the clip was asked for
            self._conclude(count)
        self._compare_with_header(end, count)

    def _compare_with_index(self, number: int, time: Fraction | None) -> None:
        """Raise `InputError` if a frame, or that there is none, is not what `frame_times` has promised."""
        if self._index is None:
            return
        ticks = self._index.ticks
        listed = None if number == len(ticks) else int(ticks[number]) * self._ticks - self.start
        if time != listed:
            raise InputError(
                f"{self._name} is damaged: its frame {number} is not at the time that its packets promise; convert it "
                "whole, in one run."
            )

    def _timed(self) -> Iterator[tuple[av.VideoFrame, Fraction]]:
        """Yield the pictures, all alike, with the times that the file gives them."""
        end: Fraction | None = None
        for number, decoded in enumerate(self._in_order(), self._first):
            picture = self._unified(decoded, number)
            time = self._time_of(picture, end)
            end = time + self._duration_of(picture)
            yield picture, time

    def _prepare_for_images(self) -> None:
        traits = self.traits
        if is_on_its_side(traits.display_matrix):
            self._info = replace(self._info, width=self._info.height, height=self._info.width)
        if self.file.companions:
            self._remarks.append(lost_companions_remark(self._name, self.file.companions, "images"))
        if traits.sample_aspect_ratio not in (None, 1):
            self._remarks.append(lost_shape_remark(self._name, traits.sample_aspect_ratio))

    def _in_order(self) -> Iterator[av.VideoFrame]:
        while self._ahead:
            yield self._ahead.pop(0)
        yield from self._progressive

    def _decode(self) -> Generator[av.VideoFrame, None, None]:
        seeing = self._decoder_of_hidden_alpha()
        decoder = self._stream.codec_context if seeing is None else seeing
        lost_alpha = lost_alpha_remark(self._name)
        buffer = ReorderBuffer[av.VideoFrame](float(1 / self._rate / self._ticks)) if decoder.codec.reorder else None
        self._buffer = buffer
        for packet in chain(self._packets(), [None]):
            if packet is not None and seeing is None and lost_alpha not in self._remarks:
                self._remarks += [lost_alpha] * self._has_hidden_alpha(packet)
            if buffer is not None and packet is not None:
                buffer.expect(packet.pts)
            try:
                pictures = decoder.decode(packet)
            except av.error.FFmpegError:
                self._damage.undecodable += 1
                if buffer is not None and packet is not None:
                    buffer.drop(packet.pts)
                continue
            for picture in pictures:
                if picture.time_base is None:  # of the last ones, which no packet brought out
                    picture.time_base = self._ticks
                yield from self._counted([picture] if buffer is None else buffer.push(picture))
        if buffer is not None:
            yield from self._counted(buffer.flush())

    def _counted(self, pictures: list[av.VideoFrame]) -> Iterator[av.VideoFrame]:
        for picture in pictures:
            self._damage.corrupt += picture.is_corrupt
            self._decoded += 1
            self._flagged_interlaced += picture.interlaced_frame
            yield picture

    def _decoder_of_hidden_alpha(self) -> av.VideoCodecContext | None:
        """Return a decoder for VP8/VP9 alpha, which FFmpeg's native decoders ignore; None if not needed."""
        name = decoders_of_hidden_alpha.get(self._stream.codec_context.name)
        if name is None or not self._keeps_alpha or self._stream.metadata.get("alpha_mode") != "1":
            return None
        return cast(av.VideoCodecContext, av.CodecContext.create(name, "r"))

    def _has_hidden_alpha(self, packet: av.Packet[Any]) -> bool:
        says_so = self._stream.metadata.get("alpha_mode") == "1"  # as every recording by a browser does
        return says_so and packet.has_sidedata("matroska_block_additional")

    def _packets(self) -> Iterator[av.Packet[Any]]:
        """Yield the stream's packets; read past damage, and note how far the streams reach that are shown or heard."""
        streams = self._container.streams
        shown = {stream.index for stream in (*streams.audio, *streams.subtitles)}
        for packet in read_packets(self._container, {self._stream.index, *shown}, self._damage):
            start = packet.pts if packet.pts is not None else packet.dts
            if start is not None and packet.time_base:
                end = (start + (packet.duration or 0)) * Fraction(packet.time_base)
                self._furthest = max(end, self._furthest)
                if packet.stream.index == self._stream.index:
                    self._last_packet = max(start * self._ticks - self.start, self._last_packet)
            if packet.stream.index == self._stream.index:
                yield packet

    def _convert(self, picture: av.VideoFrame) -> Image:
        try:
            with_alpha = self._keeps_alpha and has_alpha(picture.format.name)
            return (to_bgra if with_alpha else to_bgr)(picture, self._reformatter)
        except (av.error.FFmpegError, ValueError):
            raise InputError(
                f"{self._name} has the pixel format {picture.format.name}, which cannot be converted to BGR; "
                "convert it to yuv444p16le first."
            ) from None

    def _time_of(self, picture: av.VideoFrame, end: Fraction | None = None) -> Fraction:
        """Return when a picture is shown; where it does not say, when the one before it ends."""
        if picture.pts is not None:
            return picture.pts * (as_fraction(picture.time_base) or self._info.time_base) - self.start
        self._damage.untimed += 1
        tick = self._info.time_base
        return Fraction(0) if end is None else round(end / tick) * tick

    def _duration_of(self, picture: av.VideoFrame) -> Fraction:
        time_base = as_fraction(picture.time_base) or self._info.time_base
        return picture.duration * time_base if picture.duration > 0 else 1 / self._rate

    def _last_duration(self, time: Fraction, duration: Fraction) -> Fraction:
        """Return how long the last picture is shown so that the clip ends where the container says, if plausible.

        It is, too, where packets that became no picture reach that far: captures leave out what stands still.

        Parameters
        ----------
        time, duration : Fraction
            When the picture is shown, and its own duration, which holds otherwise; seconds.
        """
        is_said = self._container.format.name.startswith(DURATION_IN_HEADER)  # elsewhere it is FFmpeg's estimate
        if is_said and self._stream.duration is not None and self._stream.start_time is not None:
            end = (self._stream.start_time + self._stream.duration) * self._ticks - self.start
            if 0 < end - time <= 4 / self._rate or time < end <= self._last_packet + 4 / self._rate:
                return end - time
        return duration

    def _unified(self, picture: av.VideoFrame, index: int) -> av.VideoFrame:
        assert self._unifier is not None  # there since the traits were read
        try:
            unified = self._unifier.unified(picture, index)
        except (av.error.FFmpegError, ValueError):
            raise InputError(
                f"{self._name} changes to {picture.format.name} at frame {index}, which cannot be converted; cut it "
                "there and convert the parts one by one."
            ) from None
        if self._decoding.size_change == "stop" and self.stopped_by is not None:
            raise InputError(self.stopped_by)
        return unified

    def _read_traits(self, picture: av.VideoFrame) -> VideoTraits:
        # The header may be wrong or silent about the size; the first picture is not.
        self._limit.check(self._name, picture.width, picture.height)
        self._info = replace(self._info, width=picture.width, height=picture.height)
        if has_alpha(picture.format.name) and not self._keeps_alpha:
            self._remarks.append(lost_alpha_remark(self._name))
        traits = read_traits(picture, self._stream, self._reformatter, self._name)
        self._unifier = FormatUnifier(picture.width, picture.height, traits)
        return traits

    def _conclude(self, count: int) -> None:
        """Say what was wrong with the file, now that as much of it was read as is wanted."""
        self._remarks += self._interlacing_remarks()
        if self._unifier is not None:
            self._remarks += self._unifier.remarks(self._name)
        self._remarks += self._damage.remarks(self._name, count)

    def _compare_with_header(self, end: Fraction, count: int) -> None:
        """Say whether the file ends before its time."""
        promised, got = self._promise(end)
        of_all = "" if self._info.frame_count is None else f" of {self._info.frame_count}"
        if promised - got > max(5 / self._rate, promised / 20):
            self._remarks.append(
                f"{self._name} ends after {float(got):.1f} s of the {float(promised):.1f} s its header promises; "
                f"{counted(count, 'frame')}{of_all} could be read."
            )

    def _interlacing_remarks(self) -> list[str]:
        flagged, decoded = self._flagged_interlaced, self._decoded
        if not self._decoding.deinterlace:
            which = "" if flagged == decoded else f" in {flagged} of {counted(decoded, 'frame')}"
            return [interlaced_remark(self._name, which, "pass `deinterlace=True`")] if flagged else []
        if flagged == decoded:
            return []
        which = "no frame" if not flagged else f"only {flagged} of {counted(decoded, 'frame')}"
        return [f"{self._name} flags {which} as interlaced; every frame was made into two all the same."]

    def _promise(self, end: Fraction) -> tuple[Fraction, Fraction]:
        """Return when the video ends by the header and when it was found to end, from the same clock."""
        promised, got = Fraction(0), Fraction(0)
        if self._stream.duration is not None:
            begin = (self._stream.start_time or 0) * self._ticks
            promised, got = begin + self._stream.duration * self._ticks - self.start, end
        # The whole file may outlast its video, so it is short only if no stream reaches its end.
        if self._container.duration and self._container.format.name.startswith(DURATION_IN_HEADER):
            whole = Fraction(self._container.duration, 1_000_000)
            if whole - self._furthest > promised - got:
                promised, got = whole, self._furthest
        return promised, got


def open_video(path: Path, name: str) -> av.container.InputContainer:
    """Open a file for demuxing, or raise `InputError` with a sentence about `name`."""
    if path.is_dir():
        raise InputError(f"{name} is a folder; name a video file, or a pattern of images inside it.")
    if not path.exists():
        raise InputError(f"{name} does not exist; check the path.")
    try:
        # An absolute path, because FFmpeg takes what stands before a colon in a relative one for a protocol.
        container = av.open(str(path.absolute()), "r", metadata_errors="replace")
    except PermissionError:
        raise InputError(f"{name} may not be read; check its permissions.") from None
    except (av.error.FFmpegError, OSError, ValueError):
        raise InputError(f"{name} is not a video file that can be read, or it is damaged at its beginning.") from None
    if container.format.name == "tty":  # FFmpeg shows any text file as a terminal session
        container.close()
        raise InputError(f"{name} is a text file; name a video file.")
    return container


def _decode_in_threads(stream: av.VideoStream) -> None:
    """Let a decoder use a quarter of the cores: it has little to do, and every thread holds frames of its own."""
    stream.thread_type = "AUTO"
    stream.thread_count = max(1, available_cores() // 4)
