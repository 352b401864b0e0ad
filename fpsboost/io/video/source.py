"""Read a video file: frames in presentation order, exact times, no silent loss.

FFmpeg decodes, through PyAV, because times stay exact ticks, deep formats stay deep, and damage is reported packet by
packet.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import av.error
from av.video.reformatter import VideoReformatter

from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.image import Image
from fpsboost.io import ClosesOnExit
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.io.output import StreamInfo, VideoFile
from fpsboost.io.video.clock import (
    VideoClock,
    assumed_rate_remark,
    declared_duration,
    in_rising_order,
    measured_cadence,
    nominal_rate,
    survey,
)
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.demuxer import Demuxer, left_out_remarks, open_video
from fpsboost.io.video.frame_index import FrameIndex
from fpsboost.io.video.picture_reader import PictureReader
from fpsboost.io.video.pictures import FormatUnifier, Pictures, is_on_its_side, turned_upright
from fpsboost.io.video.pyav import as_fraction
from fpsboost.io.video.remarks import counted, lost_alpha_remark, lost_companions_remark, lost_shape_remark
from fpsboost.io.video.traits import VideoTraits, coding_of, read_traits
from fpsboost.io.video.ycc import has_alpha, in_planes, to_bgr, to_bgra


class VideoSource(ClosesOnExit):
    """Frames of one of a video file's streams; opening reads headers only.

    For targets that hold pictures and nothing else (`for_images`), they are turned upright as the file's display matrix
    says, and what is left behind is remarked; the first picture is decoded at once to know the size, and frames keep no
    decoder's picture. Where the file has alpha, `keeps_alpha` yields BGRA. With `keeps_planes`, pictures of Y, Cb and
    Cr stay as they are, as `YCbCrImage`; others, and all without it, become BGR.

    All times count from `start`, seconds on the file's own clock. `coded_rate` is the nominal rate of the file's own
    pictures, whatever becomes of their fields.
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
        self._name, self.path = os.fspath(path), Path(path)
        self._for_images, self._keeps_alpha = for_images, keeps_alpha
        self._keeps_planes = keeps_planes and not for_images
        self._decoding, self._limit = decoding or DecodeOptions(), limit or MemoryLimit()
        self._remarks: list[str] = []
        self._demuxer = Demuxer(self.path, self._name, self._decoding.stream)
        try:
            self._info = self._read_header()
        except BaseException:
            self._demuxer.close()
            raise
        self._reformatter = VideoReformatter()
        self._unifier: FormatUnifier | None = None
        self._traits: VideoTraits | None = None
        self._started = False
        from_here = partial(
            Pictures,
            self._demuxer,
            self._name,
            tick=self._clock.tick,
            interval=1 / self._clock.rate,
            deinterlace=self._decoding.deinterlace,
            keeps_alpha=keeps_alpha,
            remarks=self._remarks,
        )
        self._reader = PictureReader(self._demuxer, self._clock, self.file, from_here)
        if for_images:
            self._prepare_for_images()

    def _read_header(self) -> ClipInfo:
        container, stream = self._demuxer.container, self._demuxer.stream
        context = stream.codec_context
        self._limit.check(self._name, context.width, context.height)
        with open_video(self.path, self._name) as file:
            times, self.start = survey(file, stream.index)
        tick = as_fraction(stream.time_base)
        cadence = None if tick is None else measured_cadence(times, tick)
        self.coded_rate, rate_is_known = nominal_rate(stream, cadence)
        self._remarks += left_out_remarks(container, stream, self._name)
        self._remarks += [] if rate_is_known else [assumed_rate_remark(self._name)]
        tick = tick or 1 / self.coded_rate
        self._fields = fields = 2 if self._decoding.deinterlace else 1
        self._clock = VideoClock(self._demuxer, self.start, tick, tick / fields, self.coded_rate * fields)
        streams = container.streams
        companions = ["sound"] * bool(streams.audio) + ["subtitles"] * bool(streams.subtitles)
        self.file = VideoFile(self.path, self._name, stream.index, self.start, self.coded_rate, companions)
        return ClipInfo(
            name=self._name,
            height=context.height,
            width=context.width,
            rate=self._clock.rate,
            time_base=self._clock.time_base,
            frame_count=fields * stream.frames or None,
            duration=declared_duration(stream),
            mean_rate=None if cadence is None else cadence.mean_rate * fields,
        )

    def _prepare_for_images(self) -> None:
        traits = self.traits
        if is_on_its_side(traits.display_matrix):
            self._info = replace(self._info, width=self._info.height, height=self._info.width)
        if self.file.companions:
            self._remarks.append(lost_companions_remark(self._name, self.file.companions, "images"))
        if traits.sample_aspect_ratio not in (None, 1):
            self._remarks.append(lost_shape_remark(self._name, traits.sample_aspect_ratio))

    @property
    def info(self) -> ClipInfo:
        return self._info

    @property
    def stream_info(self) -> StreamInfo:
        """See `fpsboost.io.DescribedSource.stream_info`; decodes the first frame."""
        return StreamInfo(traits=self.traits, video=self.file, files=[self.path])

    @property
    def remarks(self) -> list[str]:
        return list(self._remarks)

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first change of size, at which reading stops if so configured."""
        return None if self._unifier is None else self._unifier.stopped_by

    @property
    def traits(self) -> VideoTraits:
        """Colour, pixel shape, orientation; decodes the first frame and keeps it for the iteration."""
        if self._traits is None:
            picture = self._reader.pictures.peek()
            if picture is None:
                raise InputError(f"{self._name} holds no frame that can be decoded; check it with a player.")
            # The header may be wrong or silent about the size; the first picture is not.
            self._limit.check(self._name, picture.width, picture.height)
            self._info = replace(self._info, width=picture.width, height=picture.height)
            if has_alpha(picture.format.name) and not self._keeps_alpha:
                self._remarks.append(lost_alpha_remark(self._name))
            self._traits = read_traits(picture, self._demuxer.stream, self._reformatter, self._name)
            self._unifier = FormatUnifier(self._name, picture, self._traits, self._decoding.size_change == "stop")
        return self._traits

    def __iter__(self) -> Iterator[Frame]:
        if self._started:
            raise InputError(f"{self._name} can be read only once; open it again.")
        self._started = True
        return self._frames()

    def close(self) -> None:
        self._reader.pictures.close()
        self._demuxer.close()

    def _frames(self) -> Iterator[Frame]:
        """Yield the frames; only the last one's duration comes from the header."""
        matrix = self.traits.display_matrix
        coding = coding_of(self.traits) if self._keeps_planes else None
        unifier = self._unifier
        assert unifier is not None  # there since the traits were read
        reader, clock, damage = self._reader, self._clock, self._reader.pictures.damage
        count, end = reader.first, None
        try:
            for picture, time, is_last in in_rising_order(
                self._timed(unifier), 1 / clock.rate, clock.time_base, damage
            ):
                reader.compare_with_index(count, time)
                count += 1
                if count <= reader.dropped:
                    continue
                duration = clock.duration_of(picture)
                if is_last:
                    reader.compare_with_index(count, None)
                    duration = clock.last_duration(time, duration)
                    end = time + duration
                if coding is not None:
                    yield Frame(in_planes(picture, coding), time, duration, picture)
                elif self._for_images:
                    yield Frame(turned_upright(self._convert(picture), matrix), time, duration)
                else:
                    yield Frame(self._convert(picture), time, duration, picture)
            if end is None:  # `traits` has decoded a frame, and the first one is never left out
                raise InputError(f"{self._name} has ended before frame {reader.dropped}; begin at an earlier one.")
        finally:  # also where not all of the clip was asked for
            self._remarks += reader.pictures.interlacing_remarks()
            self._remarks += unifier.remarks()
            self._remarks += damage.remarks(self._name, count)
        self._remarks += clock.early_end_remarks(self._name, end, count, self._info.frame_count)

    def _timed(self, unifier: FormatUnifier) -> Iterator[tuple[av.VideoFrame, Fraction]]:
        """Yield the pictures, all alike, with the times that the file gives them."""
        end: Fraction | None = None
        for number, decoded in enumerate(self._reader.pictures, self._reader.first):
            picture = unifier.unified(decoded, number)
            time = self._clock.time_of(picture, end, self._reader.pictures.damage)
            end = time + self._clock.duration_of(picture)
            yield picture, time

    def _convert(self, picture: av.VideoFrame) -> Image:
        try:
            with_alpha = self._keeps_alpha and has_alpha(picture.format.name)
            return (to_bgra if with_alpha else to_bgr)(picture, self._reformatter)
        except (av.error.FFmpegError, ValueError):
            raise InputError(
                f"{self._name} has the pixel format {picture.format.name}, which cannot be converted to BGR; "
                "convert it to yuv444p16le first."
            ) from None

    def first_time(self) -> Fraction:
        """Time of the clip's first frame, seconds; decodes it. Before the first frame is read."""
        assert self.traits is not None
        return self._reader.next_time() or Fraction(0)

    def skip_to(self, time: Fraction) -> None:
        """Go to the key frame before a time, where the index is to be trusted; not where fields become frames."""
        assert self.traits is not None
        self._reader.skip_to(time)

    def frame_times(self) -> Sequence[Fraction] | None:
        """See `fpsboost.io.RandomAccess.frame_times`; reads all packets, and decodes the first frames."""
        assert self.traits is not None
        times = self._reader.frame_times()
        if times is None and self._info.frame_count is None and self._info.duration is None:
            self._info = replace(self._info, frame_count=self._fields * self._reader.count_packets())
        return times

    @property
    def frame_index(self) -> FrameIndex | None:
        """See `fpsboost.io.SharesIndex.frame_index`."""
        return self._reader.index

    def take_index(self, index: FrameIndex) -> None:
        """See `fpsboost.io.SharesIndex.take_index`."""
        self._reader.index = index

    def begin_at(self, number: int) -> None:
        """See `fpsboost.io.RandomAccess.begin_at`; decodes from the key frame before."""
        times = self.frame_times()
        if times is not None and number >= len(times):
            raise InputError(f"{self._name} has {counted(len(times), 'frame')}, and none has the number {number}.")
        reason = self._reader.begin_at(number) if number else None
        if reason is not None:
            self._remarks.append(f"{self._name} was read from its beginning, because {reason}.")
