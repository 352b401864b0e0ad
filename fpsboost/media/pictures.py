"""Pictures of a video stream: decoded, in presentation order, deinterlaced, upright, and all like the first one."""

from collections.abc import Generator, Iterator
from fractions import Fraction
from itertools import chain
from typing import cast

import av.filter
from av import VideoFormat, VideoFrame
from av.error import FFmpegError
from av.video.reformatter import VideoReformatter

from fpsboost.media.clock import VideoClock
from fpsboost.media.errors import InputError
from fpsboost.media.picture_filters import FilterGraphs, cropped, frames_of_fields
from fpsboost.media.pixels import (
    SCALER_FLAGS,
    add_colour_tags,
    color_space_of,
    full_chroma,
    has_alpha,
    is_full_range,
)
from fpsboost.media.pyav import REFUSALS, as_fraction
from fpsboost.media.remarks import Damage, Remarks, counted
from fpsboost.media.reorder_buffer import ReorderBuffer
from fpsboost.media.side_data import Crop
from fpsboost.media.traits import VideoTraits, primaries, tag_name, transfers

MAX_SQUEEZE = Fraction(1, 50)
"""Relative difference in aspect ratio that is treated as equal: 1088 rows and 1080, pixels of 59:54 and 16:15."""

REPEATED_HALVES = (3, 4, 6)
"""Length of a picture, in halves of a frame, of which a field is repeated, or which is shown two or three times."""

REPEATING_CODECS = {"mpeg1video", "mpeg2video", "h264", "hevc", "vc1", "cavs"}
"""Codecs with repeated fields in a picture's header; for others, FFmpeg gives 1/25 s where it knows no duration."""

WIDE_COLOURS = {8, 9, 10, 11, 12, 16, 17, 18, 22}
"""FFmpeg's numbers of transfers and primaries that look wrong where BT.709's are expected: HDR, BT.2020, cinema."""


decoders_of_hidden_alpha = {"vp8": "libvpx", "vp9": "libvpx-vp9"}


class Pictures(Iterator[VideoFrame]):
    """Iterator over the pictures of a video stream in presentation order, from the current position of its file.

    Pictures with a palette become RGB, or RGBA if the first one has transparent colours. `damage` counts faults so far.

    Parameters
    ----------
    clock : VideoClock
        Clock and file of the stream. The file's `Reading` tells whether two pictures are made of each, and whether
        alpha that is stored beside the pictures (VP8, VP9) is decoded; otherwise it is left out, with a remark.
    crop : Crop or None
        Margins to cut off, as the container asks for.
    remarks : Remarks
        Those of the caller, to which remarks are added while reading.
    """

    def __init__(self, clock: VideoClock, crop: Crop | None, remarks: Remarks) -> None:
        name = clock.file.name
        reading = clock.file.reading
        self.damage = Damage()
        self._file = clock.file
        self._tick = clock.tick
        self._raw_rate = clock.raw_rate
        self._name = name
        self._remarks = remarks
        self._deinterlaced = reading.deinterlace
        stream = clock.file.stream
        self._says_alpha = stream.metadata.get("alpha_mode") == "1"  # as every recording by a browser does
        self._decoder = stream.codec_context
        if self._says_alpha and reading.keeps_alpha and self._decoder.name in decoders_of_hidden_alpha:
            self._says_alpha = False
            hidden = decoders_of_hidden_alpha[self._decoder.name]
            self._decoder = cast(av.VideoCodecContext, av.CodecContext.create(hidden, "r"))
        reorders = self._decoder.codec.reorder and clock.raw_rate is None
        self._buffer = ReorderBuffer(float(1 / (clock.rate * clock.tick)), reorders=reorders)
        self._count = self._interlaced_count = self._end_of_raw = 0
        self._reformatter = VideoReformatter()
        self._palette_format = ""
        self._coded = self._decode()
        self._presented: Iterator[VideoFrame] = self._coded
        if reading.deinterlace:
            self._presented = frames_of_fields(self._presented, clock.tick, name)
        if crop is not None:
            self._presented = cropped(self._presented, crop, clock.tick, name)
        self._next: VideoFrame | None = None
        self._aspects: list[Fraction] = []
        """Pixel aspect ratios by the decoder, which is ahead of the pictures."""
        self._graphs = FilterGraphs(self._tick)

    def __next__(self) -> VideoFrame:
        picture = self._next
        self._next = None
        return next(self._presented) if picture is None else picture

    def peek(self) -> VideoFrame | None:
        """Return the next picture without consuming it; None at the end."""
        self._next = next(self, None)
        return self._next

    def forget_earlier(self, next_picture: VideoFrame) -> None:
        """Make a picture that was just taken the next one again, and reset the counts to begin with it."""
        self._next = next_picture
        self.damage.corrupt = 0
        self._count = 1
        self._interlaced_count = int(next_picture.interlaced_frame)

    def aspect_of(self, picture: VideoFrame) -> Fraction:
        """Return the pixel aspect ratio of a picture, which PyAV lacks: a filter scales by it, and is measured."""
        if len(self._aspects) > 1:
            width = self._graphs.passed(picture, ("scale", "16+1000*sar:16:neighbor:eval=frame")).width
            return min(self._aspects, key=lambda aspect: abs(16 + 1000 * aspect - width))
        return self._aspects[0] if self._aspects else Fraction(1)

    def unified(self, unifier: "FormatUnifier", first: int) -> Iterator[VideoFrame]:
        """Yield the pictures, counted from `first`, in the format of the clip's first one."""
        for number, picture in enumerate(self, first):
            yield unifier.unified(picture, number, self.aspect_of(picture))

    @property
    def differ_from_packets(self) -> bool:
        """Whether damage or interchanged times have shown that not every packet is a picture at its time."""
        return self._buffer.has_interchanged or self.damage != Damage(corrupt=self.damage.corrupt)

    def close(self) -> None:
        """End decoding; the file stays open."""
        self._coded.close()

    def remark_on_interlacing(self) -> None:
        """Add a remark on interlaced pictures that stayed whole, or on progressive ones that were halved."""
        interlaced = self._interlaced_count
        count = self._count
        if self._deinterlaced and interlaced < count:
            which = "no frame" if not interlaced else f"only {interlaced} of {counted(count, 'frame')}"
            self._remarks.add("hardly-interlaced", name=self._name, which=which)
        elif interlaced and not self._deinterlaced:
            which = "" if interlaced == count else f" in {interlaced} of {counted(count, 'frame')}"
            self._remarks.add("interlaced", name=self._name, which=which, advice="pass `deinterlace=True`")

    def _decode(self) -> Generator[VideoFrame, None, None]:
        """Yield the decoded pictures in presentation order, past packets that cannot be decoded."""
        for packet in chain(self._file.packets(self.damage), [None]):
            pts = None if packet is None else packet.pts
            if packet is not None and self._says_alpha and packet.has_sidedata("matroska_block_additional"):
                self._says_alpha = False
                self._remarks.add("alpha-left-out", name=self._name)
            self._buffer.expect(pts)
            try:
                pictures = self._decoder.decode(packet)
            except FFmpegError:
                self.damage.undecodable += 1
                self._buffer.drop(pts)
                continue
            aspect = as_fraction(self._decoder.sample_aspect_ratio) or Fraction(1)
            if pictures and aspect not in self._aspects:
                self._aspects.append(aspect)
            for picture in pictures:
                if self._raw_rate is not None:
                    self._set_time(picture, self._raw_rate)
                if not picture.time_base:  # of the last ones, which no packet brought out
                    picture.time_base = self._tick
                shown = self._without_palette(picture) if picture.format.has_palette else picture
                add_colour_tags(shown, self._file.colour_tags)
                yield from self._counted(self._buffer.push(shown))
        yield from self._counted(self._buffer.flush())

    def _set_time(self, picture: VideoFrame, rate: Fraction) -> None:
        """Let a picture of a raw stream begin where the one before it ends, counted in halves of a frame.

        FFmpeg's durations at this rate are right where they say that fields or frames are repeated (pulldown).
        """
        halves = 2 * picture.duration * Fraction(self._file.stream.time_base or 0) * rate
        repeats = self._decoder.codec.canonical_name in REPEATING_CODECS and halves in REPEATED_HALVES
        picture.duration = int(halves) if repeats else 2
        picture.pts = self._end_of_raw
        picture.time_base = self._tick
        self._end_of_raw += picture.duration

    def _without_palette(self, picture: VideoFrame) -> VideoFrame:
        """Convert a picture with a palette to RGB or RGBA, the same format for the whole clip."""
        whole = self._reformatter.reformat(picture, format="rgba", interpolation=SCALER_FLAGS)
        is_opaque = whole.to_ndarray()[..., 3].min() == 255
        self._palette_format = self._palette_format or ("rgb24" if is_opaque else "rgba")
        if not is_opaque and self._palette_format == "rgb24":
            self._remarks.add("alpha-left-out", name=self._name)
        return self._reformatter.reformat(whole, format=self._palette_format, interpolation=SCALER_FLAGS)

    def _counted(self, pictures: list[VideoFrame]) -> Iterator[VideoFrame]:
        """Yield pictures, and count them, interlaced ones and corrupt ones."""
        for picture in pictures:
            self.damage.corrupt += picture.is_corrupt
            self._count += 1
            self._interlaced_count += picture.interlaced_frame
            yield picture


class FormatUnifier:
    """Converter of every picture to size, pixel format and colour coding of the first one, with counts for remarks.

    Pictures are scaled into the frame of the first, with black beside them where their shape is another. Transfer
    function and primaries are not converted.

    Parameters
    ----------
    name : str
        The file in messages.
    size : (int, int)
        Width and height of the first picture.
    traits : VideoTraits
        Pixel format and colour coding of the first picture.
    stops : bool
        Raise `InputError` at a change of size, pixel format, pixel aspect ratio, or to or from HDR or cinema colours.
    aspect : Fraction
        Pixel aspect ratio of the first picture.
    """

    def __init__(
        self, name: str, size: tuple[int, int], traits: VideoTraits, stops: bool, aspect: Fraction = Fraction(1)
    ) -> None:
        self._name = name
        self.traits = traits
        self._stops = stops
        self._width, self._height = size
        self._aspect = aspect
        self._graphs = FilterGraphs(Fraction(1, 1000))
        self._reshaped = self._recoded = self._retagged = 0
        self._change = self._new_colours = self._recoding = ""
        """First change of size, format or shape: ``from 64x48 yuv420p to 96x64 yuv420p at frame 12``."""

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first change that `stops` refuses; None without one."""
        if not self._change:
            return None
        return (
            f"{self._name} changes {self._change}; convert it with `size_change='scale'` to make all frames like "
            "the first, or cut it there and convert the parts one by one."
        )

    def unified(self, picture: VideoFrame, number: int, aspect: Fraction = Fraction(1)) -> VideoFrame:
        """Return a picture in the first one's format; unchanged, not copied, if it has that already.

        `number` counts frames from 0, for messages; `aspect` is the pixel aspect ratio. Raises `InputError` if the
        picture cannot be converted, or if changes are refused.
        """
        traits = self.traits
        before, now = self._described(picture, aspect)
        old = (traits.color_transfer, traits.color_primaries)
        new = (picture.color_trc, picture.color_primaries)
        try:
            coding = picture.format.is_rgb, color_space_of(picture), is_full_range(picture)
            recodes = coding != (VideoFormat(traits.pixel_format).is_rgb, traits.color_space, traits.full_range)
            if now == before and old == new and not recodes:
                return picture
            if now != before:
                self._reshaped += 1
                self._change = self._change or f"from {before} to {now} at frame {number}"
            elif recodes:
                self._recoded += 1
                self._recoding = self._recoding or f"at frame {number}"
            if old != new:
                self._retagged += 1
                self._new_colours = self._new_colours or f"from {_colours(*old)} to {_colours(*new)} at frame {number}"
                if not WIDE_COLOURS.isdisjoint(set(old) ^ set(new)):
                    self._change = self._change or self._new_colours
            unified = self._like_first(picture, aspect, recodes=recodes)
        except REFUSALS:
            raise InputError(
                f"{self._name} changes to {picture.format.name} at frame {number}, which cannot be converted; cut it "
                "there and convert the parts one by one."
            ) from None
        if self._stops and self._change:
            raise InputError(self.stopped_by or "")
        return unified

    def _described(self, picture: VideoFrame, aspect: Fraction) -> tuple[str, str]:
        """Return size and pixel format of the first picture and of this one; with pixel shapes if these differ."""
        before = f"{self._width}x{self._height} {self.traits.pixel_format}"
        now = f"{picture.width}x{picture.height} {picture.format.name}"
        if aspect == self._aspect:
            return before, now
        old, new = (f"{ratio.numerator}:{ratio.denominator}" for ratio in (self._aspect, aspect))
        return f"{before} with pixels of {old}", f"{now} with pixels of {new}"

    def _like_first(self, picture: VideoFrame, aspect: Fraction, *, recodes: bool) -> VideoFrame:
        """Return a picture scaled and padded by FFmpeg, in the first one's format, and its coding if it `recodes`."""
        traits = self.traits
        width = self._width
        height = self._height
        wider = Fraction(picture.width, picture.height) * aspect / (Fraction(width, height) * self._aspect)
        if wider > 1 + MAX_SQUEEZE:
            height = min(height, 4 * max(1, round(height / wider / 4)))  # whole samples of chroma
        elif wider < 1 - MAX_SQUEEZE:
            width = min(width, 4 * max(1, round(width * wider / 4)))
        full = is_full_range(picture)
        wanted = VideoFormat(traits.pixel_format)
        options = f"{width}:{height}:flags={SCALER_FLAGS}:in_range={1 + full}:out_range={1 + traits.full_range}"
        options += "" if picture.format.is_rgb else f":in_color_matrix={color_space_of(picture)}"
        options += "" if wanted.is_rgb else f":out_color_matrix={traits.color_space}"
        margins = f"{self._width}:{self._height}:(ow-iw)/2:(oh-ih)/2"
        # with 8 bits only, the scaler is off by a level where matrix or range changes
        deep = full_chroma(16).replace("yuv", "yuva" if has_alpha(wanted.name) else "yuv")
        middle, last = (("format", name) for name in (deep if recodes else wanted.name, wanted.name))
        alike = self._graphs.passed(picture, ("scale", options), middle, ("pad", margins), last)
        alike.pts = picture.pts
        alike.duration = picture.duration
        alike.time_base = picture.time_base or Fraction(1, 1000)
        alike.colorspace = traits.tagged_color_space
        alike.color_range = traits.color_range
        alike.color_primaries = traits.color_primaries
        alike.color_trc = traits.color_transfer
        return alike

    def remarks(self) -> Remarks:
        """Return the remarks on changes of size, format, coding and colours so far."""
        remarks = Remarks()
        for kind, count, change in (
            ("size-changes", self._reshaped, self._change),
            ("coding-changes", self._recoded, self._recoding),
        ):
            if count:
                remarks.add(kind + "-once" * (count == 1), name=self._name, change=change, count=count)
        if self._retagged:
            frames = counted(self._retagged, "frame")
            remarks.add("colours-change", name=self._name, change=self._new_colours, frames=frames)
        return remarks


def _colours(transfer: int, primary: int) -> str:
    """Describe transfer function and primaries by their names."""
    names = tag_name(transfers, transfer), tag_name(primaries, primary)
    return ", ".join(
        f"{kind} {name or 'untagged'}" for kind, name in zip(("transfer", "primaries"), names, strict=True)
    )
