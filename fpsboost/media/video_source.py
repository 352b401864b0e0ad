"""Read a video file: frames in presentation order, exact times, no silent loss.

FFmpeg decodes, through PyAV, because times stay exact ticks, deep formats stay deep, and damage is reported packet by
packet.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import av
import av.container
import av.error
import numpy as np
from av.video.reformatter import VideoReformatter

from fpsboost.errors import InputError
from fpsboost.frame import ClipInfo, Frame, Image
from fpsboost.media.ycc import chroma_location_of, color_space_of, has_alpha, is_full_range, to_bgr, to_bgra

STILL_CODECS = ("png", "mjpeg", "bmp", "gif", "tiff", "webp")
DURATION_IN_HEADER = ("matroska", "mov", "avi", "flv", "asf")
HIGHEST_RATE = 1000
ASSUMED_RATE = Fraction(25)
DEMUX_RETRIES = 10

decoders_of_hidden_alpha = {"vp8": "libvpx", "vp9": "libvpx-vp9"}


@dataclass(frozen=True)
class VideoTraits:
    """What a video's pictures mean beyond their numbers; a sink keeps it.

    Attributes
    ----------
    pixel_format : str
        FFmpeg's name, ``yuv420p``.
    color_space : int
        AVColorSpace that the pictures are converted with: as tagged, otherwise BT.709 from 720 lines, BT.601 below.
    tagged_color_space, color_range, color_primaries, color_transfer : int
        The tags themselves, FFmpeg's numbers, 2 (range: 0) for unspecified.
    full_range : bool
        Black is 0 rather than 16 (in 8 bits).
    chroma_location : str
        Where a subsampled chroma sample sits: ``left``, ``center``, ``topleft``...
    tagged_chroma_location : bool
        False where that is only FFmpeg's guess.
    sample_aspect_ratio : Fraction or None
        Width of a pixel over its height.
    display_matrix : tuple of 9 int or None
        Rotation and flip for display, 16.16 and 2.30 fixed point.
    interlaced : bool
        Two fields in one picture.
    has_mastering_data : bool
        HDR mastering display or content light levels.
    """

    pixel_format: str
    color_space: int
    tagged_color_space: int
    color_range: int
    color_primaries: int
    color_transfer: int
    full_range: bool
    chroma_location: str
    tagged_chroma_location: bool
    sample_aspect_ratio: Fraction | None
    display_matrix: tuple[int, ...] | None
    interlaced: bool
    has_mastering_data: bool


class VideoSource:
    """Frames of a video file's first real video stream.

    Parameters
    ----------
    path : str or path
        A file that FFmpeg can read. Opening reads headers only.
    for_images : bool
        For targets that hold pictures and nothing else: turn them upright as the file's display matrix says, and remark
        what is left behind. Decodes the first picture at once to know the size; frames keep no decoder's picture.
    keeps_alpha : bool
        Yield BGRA where the file has alpha; it is left out otherwise, with a remark.

    Raises
    ------
    InputError
        Missing, not a video, or coded in a way that cannot be decoded; while iterating also: nothing decodes, or the
        picture's size or pixel format changes.
    """

    def __init__(self, path: str | os.PathLike[str], *, for_images: bool = False, keeps_alpha: bool = False) -> None:
        self._name = os.fspath(path)
        self._for_images, self._keeps_alpha = for_images, keeps_alpha
        self.path = Path(path)
        self._container = open_video(self.path, self._name)
        try:
            self._stream = _first_video(self._container, self._name)
            self._rate, rate_is_known = _nominal_rate(self._stream)
        except BaseException:
            self._container.close()
            raise
        self._stream.thread_type = "AUTO"
        self._reformatter = VideoReformatter()
        self._remarks = _left_out(self._container, self._stream, self._name)
        if not rate_is_known:
            self._remarks.append(assumed_rate_remark(self._name))
        self._undecodable = self._damaged = self._misplaced = self._untimed = self._unreadable = 0
        self._furthest = Fraction(0)
        self._ahead: list[av.VideoFrame] = []
        self._pictures = self._decode()
        self._started = False
        self._traits: VideoTraits | None = None
        context = self._stream.codec_context
        self._info = ClipInfo(
            name=self._name,
            height=context.height,
            width=context.width,
            rate=self._rate,
            time_base=_fraction(self._stream.time_base) or 1 / self._rate,
            frame_count=self._stream.frames or None,
        )
        self._coded_size = context.width, context.height
        if for_images:
            self._prepare_for_images()

    @property
    def info(self) -> ClipInfo:
        return self._info

    @property
    def stream_index(self) -> int:
        """Number of the converted stream in its file."""
        return self._stream.index

    @property
    def companions(self) -> list[str]:
        """What the file holds beside its pictures: ``sound``, ``subtitles``, both or neither."""
        streams = self._container.streams
        return ["sound"] * bool(streams.audio) + ["subtitles"] * bool(streams.subtitles)

    @property
    def remarks(self) -> list[str]:
        return list(self._remarks)

    @property
    def traits(self) -> VideoTraits:
        """Colour, pixel shape, orientation; decodes the first frame and keeps it for the iteration.

        Raises
        ------
        InputError
            Nothing decodes, or the colour matrix is one that is not supported.
        """
        if self._traits is None:
            picture = next(self._pictures, None)
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

    def close(self) -> None:
        self._pictures.close()
        self._container.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _frames(self) -> Iterator[Frame]:
        """Yield each frame when the next one is known, because only the last one's duration comes from the header."""
        traits = self.traits
        first = last = None
        count = 0
        for picture in self._in_order():
            self._check_unchanged(picture, traits, count)
            time = self._time_of(picture, last)
            if last is not None and time <= last.time:
                self._misplaced += 1
                continue
            if last is not None:
                yield last
            count += 1
            image = self._convert(picture)
            original: av.VideoFrame | None = picture
            if self._for_images:
                image, original = turned_upright(image, traits.display_matrix), None
            last = Frame(image, time, self._duration_of(picture), original)
            first = time if first is None else first
        assert last is not None  # `traits` has found a frame, and the first one is never left out
        assert first is not None
        yield Frame(last.image, last.time, self._last_duration(last), last.original)
        self._conclude(count, first, last.time + last.duration)

    def _prepare_for_images(self) -> None:
        traits = self.traits
        if is_on_its_side(traits.display_matrix):
            self._info = replace(self._info, width=self._info.height, height=self._info.width)
        if self.companions:
            self._remarks.append(lost_companions_remark(self._name, self.companions, "images"))
        if traits.sample_aspect_ratio not in (None, 1):
            self._remarks.append(lost_shape_remark(self._name, traits.sample_aspect_ratio))

    def _in_order(self) -> Iterator[av.VideoFrame]:
        while self._ahead:
            yield self._ahead.pop(0)
        yield from self._pictures

    def _decode(self) -> Generator[av.VideoFrame, None, None]:
        seeing: av.VideoCodecContext | None = None
        hidden_alpha = self._stream.metadata.get("alpha_mode") == "1"
        if hidden_alpha and not self._keeps_alpha:
            self._remarks.append(lost_alpha_remark(self._name))
        elif hidden_alpha and self._stream.codec_context.name in decoders_of_hidden_alpha:
            # VP8 and VP9 keep alpha beside the picture, where FFmpeg's own decoders do not look
            name = decoders_of_hidden_alpha[self._stream.codec_context.name]
            seeing = cast(av.VideoCodecContext, av.CodecContext.create(name, "r"))
        for packet in self._packets():
            try:
                pictures = packet.decode() if seeing is None else seeing.decode(packet if packet.size else None)
            except av.error.EOFError:
                continue
            except av.error.FFmpegError:
                self._undecodable += 1
                continue
            for picture in cast(list[av.VideoFrame], pictures):
                self._damaged += picture.is_corrupt
                yield picture

    def _packets(self) -> Iterator[av.Packet[av.stream.Stream]]:
        """Yield the stream's packets; read past damage, and note how far every stream reaches."""
        failures = 0
        while failures < DEMUX_RETRIES:
            try:
                for packet in self._container.demux():
                    failures = 0
                    start = packet.pts if packet.pts is not None else packet.dts
                    if start is not None and packet.time_base:
                        end = (start + (packet.duration or 0)) * Fraction(packet.time_base)
                        self._furthest = max(end, self._furthest)
                    if packet.stream.index == self._stream.index:  # the packets that flush have no stream_index
                        yield packet
                return
            except av.error.FFmpegError:
                failures += 1
                self._unreadable += failures == 1

    def _convert(self, picture: av.VideoFrame) -> Image:
        try:
            with_alpha = self._keeps_alpha and has_alpha(picture.format.name)
            return (to_bgra if with_alpha else to_bgr)(picture, self._reformatter)
        except (av.error.FFmpegError, ValueError):
            raise InputError(
                f"{self._name} has the pixel format {picture.format.name}, which cannot be converted to BGR; "
                "convert it to yuv444p16le first."
            ) from None

    def _time_of(self, picture: av.VideoFrame, last: Frame | None) -> Fraction:
        if picture.pts is not None:
            return picture.pts * (_fraction(picture.time_base) or self._info.time_base)
        self._untimed += 1
        if last is None:
            return Fraction(0)
        ticks = max(1, round((last.duration or 1 / self._rate) / self._info.time_base))
        return last.time + ticks * self._info.time_base

    def _duration_of(self, picture: av.VideoFrame) -> Fraction:
        time_base = _fraction(picture.time_base) or self._info.time_base
        return picture.duration * time_base if picture.duration > 0 else 1 / self._rate

    def _last_duration(self, last: Frame) -> Fraction:
        """How long the last frame is shown so that the clip ends where the container says, if that is plausible."""
        if self._stream.duration is not None and self._stream.start_time is not None:
            end = (self._stream.start_time + self._stream.duration) * self._info.time_base
            if 0 < end - last.time <= 4 / self._rate:
                return end - last.time
        return last.duration

    def _check_unchanged(self, picture: av.VideoFrame, traits: VideoTraits, index: int) -> None:
        before = (*self._coded_size, traits.pixel_format)
        now = (picture.width, picture.height, picture.format.name)
        if now != before:
            raise InputError(
                f"{self._name} changes from {before[0]}x{before[1]} {before[2]} to {now[0]}x{now[1]} {now[2]} at frame "
                f"{index}; cut it there and convert the parts one by one."
            )

    def _read_traits(self, picture: av.VideoFrame) -> VideoTraits:
        context = self._stream.codec_context
        # The header may be wrong or silent about the size; the first picture is not.
        self._coded_size = picture.width, picture.height
        self._info = replace(self._info, width=picture.width, height=picture.height)
        sides = {side.type.name: bytes(side) for side in _side_data(picture)}
        matrix = sides.get("DISPLAYMATRIX")
        interlaced = picture.interlaced_frame
        if interlaced:
            self._remarks.append(interlaced_remark(self._name))
        if has_alpha(picture.format.name) and not self._keeps_alpha:
            self._remarks.append(lost_alpha_remark(self._name))
        aspect = _fraction(self._stream.sample_aspect_ratio)
        try:
            color_space = color_space_of(picture)
        except ValueError:
            raise InputError(
                f"{self._name} uses the colour matrix number {picture.colorspace}, which is not supported; convert it "
                "to BT.709 or BT.2020 first."
            ) from None
        location = chroma_location_of(picture, self._reformatter)
        return VideoTraits(
            pixel_format=picture.format.name,
            color_space=color_space,
            tagged_color_space=picture.colorspace,
            color_range=picture.color_range,
            color_primaries=picture.color_primaries,
            color_transfer=picture.color_trc,
            full_range=is_full_range(picture),
            chroma_location=location,
            # FFmpeg takes an unsaid place for the centre; only these two formats always say.
            tagged_chroma_location=location != "center" or context.codec.canonical_name in ("h264", "hevc"),
            sample_aspect_ratio=aspect,
            display_matrix=tuple(np.frombuffer(matrix, np.int32).tolist()) if matrix else None,
            interlaced=interlaced,
            has_mastering_data="MASTERING_DISPLAY_METADATA" in sides or "CONTENT_LIGHT_LEVEL" in sides,
        )

    def _conclude(self, count: int, start: Fraction, end: Fraction) -> None:
        """Say what was wrong with the file, now that all of it was read."""
        damage = []
        if self._undecodable:
            damage.append(f"{_counted(self._undecodable, 'packet')} could not be decoded")
        if self._unreadable:
            damage.append(f"{_counted(self._unreadable, 'place')} could not be read")
        if self._damaged:
            damage.append(f"{_counted(self._damaged, 'frame')} decoded with errors")
        if damage:
            self._remarks.append(
                f"{self._name} is damaged: {' and '.join(damage)}; {_counted(count, 'frame')} were converted."
            )
        if self._misplaced:
            self._remarks.append(
                f"{self._name} shows {_counted(self._misplaced, 'frame')} no later than the one before; left out."
            )
        if self._untimed:
            self._remarks.append(
                f"{self._name} gives no time for {_counted(self._untimed, 'frame')}; the nominal rate was used."
            )
        promised, got = self._promise(start, end)
        if promised - got > max(5 / self._rate, promised / 20):
            self._remarks.append(
                f"{self._name} ends after {float(got):.1f} s of the {float(promised):.1f} s its header promises; what "
                "decodes was converted."
            )

    def _promise(self, start: Fraction, end: Fraction) -> tuple[Fraction, Fraction]:
        """Return the duration that the header declares and the one that was found, from the same clock."""
        promised, got = Fraction(0), Fraction(0)
        if self._stream.duration is not None:
            promised, got = self._stream.duration * self._info.time_base, end - min(start, Fraction(0))
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


def assumed_rate_remark(name: str) -> str:
    """What to say of a clip that does not tell its rate."""
    return f"{name} does not say its frame rate; {ASSUMED_RATE} frames per second assumed."


def interlaced_remark(name: str) -> str:
    """What to say of a clip with two fields in one picture."""
    return f"{name} is interlaced and its fields were taken as whole pictures; deinterlace it first for smooth motion."


def lost_alpha_remark(name: str) -> str:
    """What to say of alpha that the target cannot hold, and what can."""
    return (
        f"{name} has an alpha channel, which was left out; a .webm, images as .png, or --codec prores_ks in a .mov "
        "keep it."
    )


def lost_companions_remark(name: str, companions: Sequence[str], target: str) -> str:
    """What to say of sound and subtitles that do not fit into a kind of target."""
    return f"{name} has {' and '.join(companions)}, which {target} cannot hold; left out."


def lost_shape_remark(name: str, aspect: Fraction | None) -> str:
    """What to say of pixels that are not square, where images are written."""
    return f"{name} has pixels of the shape {aspect}, which images cannot say; they come out unscaled."


def is_on_its_side(matrix: tuple[int, ...] | None) -> bool:
    """Whether a display matrix exchanges width and height; only quarter turns and flips are looked at."""
    return matrix is not None and matrix[0] == 0 and matrix[4] == 0


def turned_upright(image: Image, matrix: tuple[int, ...] | None) -> Image:
    """Turn and flip a picture as its display matrix says.

    Parameters
    ----------
    image : (H, W, C)
    matrix : tuple of 9 int or None
        x' = a x + c y, y' = b x + d y, with (a, b, c, d) at places 0, 1, 3 and 4. Other angles than quarter turns are
        left as they are.

    Returns
    -------
    (H, W, C) or (W, H, C), contiguous
    """
    if matrix is None:
        return image
    if is_on_its_side(matrix):
        image = image.transpose(1, 0, 2)
        left, down = matrix[3], matrix[1]
    else:
        left, down = matrix[0], matrix[4]
    return np.ascontiguousarray(image[:: -1 if down < 0 else 1, :: -1 if left < 0 else 1])


def is_cover_art(stream: av.stream.Stream) -> bool:
    """Whether a video stream is only a picture attached to the file."""
    if stream.disposition & (av.stream.Disposition.attached_pic | av.stream.Disposition.timed_thumbnails):
        return True
    return bool(
        stream.codec_context is not None
        and stream.codec_context.codec.canonical_name in STILL_CODECS
        and (stream.frames == 1 or "mimetype" in stream.metadata)
    )


def _first_video(container: av.container.InputContainer, name: str) -> av.VideoStream:
    videos = [stream for stream in container.streams.video if not is_cover_art(stream)]
    if not videos:
        raise InputError(f"{name} has no video stream; name a file that has one.")
    stream = videos[0]
    if stream.codec_context is None:
        raise InputError(f"{name} uses a video codec that cannot be decoded here; convert it to H.264 first.")
    return stream


def _nominal_rate(stream: av.VideoStream) -> tuple[Fraction, bool]:
    average, guessed = _fraction(stream.average_rate), _fraction(stream.guessed_rate)
    sane = [rate for rate in (average, guessed) if rate is not None and 0 < rate <= HIGHEST_RATE]
    if len(sane) == 2 and abs(sane[0] - sane[1]) * 100 < sane[1]:
        return sane[1], True
    return (sane[0], True) if sane else (ASSUMED_RATE, False)


def _left_out(container: av.container.InputContainer, chosen: av.VideoStream, name: str) -> list[str]:
    others = [
        f"stream {stream.index} ({stream.name or 'unknown'} {stream.codec_context.width}x{stream.codec_context.height})"
        for stream in container.streams.video
        if stream.index != chosen.index and not is_cover_art(stream) and stream.codec_context is not None
    ]
    return [f"{name} has more than one video stream; left out: {', '.join(others)}."] if others else []


def _side_data(picture: av.VideoFrame) -> list[Any]:
    held: Any = picture.side_data
    return [held[index] for index in range(len(held))]


def _fraction(value: Any) -> Fraction | None:
    """An exact Fraction of FFmpeg's rational, which may also be absent, 0/1 or 1/0."""
    if not value:
        return None
    return Fraction(value.numerator, value.denominator)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
