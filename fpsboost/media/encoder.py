"""Encode frames into packets with an encoder that is configured once per clip and reopened for every chunk.

A video of luma and chroma keeps its pixel format if the encoder supports it, and otherwise gets the one that loses
least. 8-bit images and RGB video become 4:2:0, which every player shows. For lossless encoding, and for images deeper
than 8 bits with a codec given, the format with the greatest bit depth and chroma resolution of the source that the
encoder supports is chosen.
"""

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping
from fractions import Fraction
from io import BytesIO
from pathlib import Path

import av
from av import Codec, VideoCodecContext, VideoFormat, VideoFrame, VideoStream
from av.codec.codec import Capabilities
from av.container import OutputContainer
from av.error import FFmpegError
from av.video.frame import PictureType

from fpsboost.media.encoding import choose_encoder
from fpsboost.media.errors import OutputError
from fpsboost.media.output import Output
from fpsboost.media.pixel_choice import choose_pixel_format
from fpsboost.media.pixels import FULL_RANGE, LIMITED_RANGE, NO_COLOUR_TAG, RGB, has_alpha, is_gray, is_rgb
from fpsboost.media.pyav import Packet
from fpsboost.media.remarks import Remarks
from fpsboost.media.side_data import CAPTIONS, filtered, stereo_modes
from fpsboost.media.traits import LightLevel, MasteringDisplay, VideoTraits

CAPTIONED = ("libx264", "libx264rgb")
"""Encoders into whose packets closed captions are written."""

MIN_CUTREE_WIDTH = 64
"""Minimum width for x265's "cutree", pixels; in narrower pictures it writes out of bounds (seen up to 48)."""


class VideoEncoder:
    """Encoder of a clip in chunks that can be decoded independently of each other.

    It is opened by the first use of `stream` or `encode`, and again after `finish`.

    Parameters
    ----------
    output : Output
        Size, times and options of the frames to come; its path is in messages.
    traits : VideoTraits
        Pixel format, colours and shape of the source, or those to write for images.

    Raises
    ------
    OptionError
        The pixel format that was asked for does not suit the encoder or the size.
    OutputError
        The encoder takes no pixel format like the source's; on opening also: it refuses this size, rate or format.
    """

    def __init__(self, output: Output, traits: VideoTraits) -> None:
        encoder, self._options = choose_encoder(output, traits)
        self._encoder = encoder
        self._output = output
        self.traits = traits
        self.full_range = traits.full_range
        is_default = traits.chroma_location == "left" and encoder in ("libx264", "libx265")  # needs no tag
        if traits.tagged_chroma_location and not is_default:
            self._options["chroma_sample_location"] = traits.chroma_location
        self.remarks = Remarks()
        self.pixel_format = choose_pixel_format(self.remarks, output, encoder, traits.pixel_format)
        if has_alpha(self.pixel_format) and encoder.startswith("libvpx"):
            self._options["auto-alt-ref"] = "0"  # libvpx does not support hidden frames with alpha
        if encoder == "libx265" and output.info.width < MIN_CUTREE_WIDTH:
            self._options["x265-params"] = ":".join(filter(None, [self._options.get("x265-params"), "cutree=0"]))
        # PyAV cannot set the field of Matroska's container, so there the coded stream must hold it
        keeps_shape = output.container.exact_times or encoder in ("libx264", "libx265")
        self._options, is_whole = with_hdr(self._options, encoder, traits.mastering_display, traits.light_level)
        of_hdr = {"MASTERING_DISPLAY_METADATA", "CONTENT_LIGHT_LEVEL"} if is_whole else set[str]()
        kept = self._kept_side_data(traits) | of_hdr
        lost = dict.fromkeys(said for kind, said in traits.side_data.items() if kind not in kept)
        shape = traits.sample_aspect_ratio
        if shape not in (None, 1) and not keeps_shape:
            self.remarks.add("shape-lost", name=output.path, shape=shape, encoder=encoder)
        if lost:
            self.remarks.add("side-data-lost", name=output.path, what=" and the ".join(lost))
        self.keeps_captions = CAPTIONS in kept
        self._null_output: OutputContainer | None = None
        self._stream: VideoStream | None = None

    @property
    def details(self) -> str:
        """Encoder, pixel format and options, for verbose output."""
        options = " ".join(f"{name}={value}" for name, value in self._options.items())
        return f"{self._encoder}, {self.pixel_format}, {options}"

    def _kept_side_data(self, traits: VideoTraits) -> set[str]:
        """Return the types of side data that the output keeps; x264 writes the stereo mode of pictures."""
        is_passed = self._encoder == "libx264" and not is_rgb(traits.pixel_format)
        window = self._output.window
        plays_backwards = window is not None and window.reverses
        kept = {CAPTIONS} if self._encoder in CAPTIONED and not plays_backwards else set()
        if traits.stereo_mode and self._output.container.matroska_elements:
            kept.add("STEREO3D")
        elif is_passed and any(traits.stereo_mode == left_first for left_first, _ in stereo_modes.values()):
            kept.add("STEREO3D")
            self.remarks.add("stereo-mode-in-stream", name=self._output.path)
        return kept

    @property
    def stream(self) -> VideoStream:
        """Stream of the open encoder, which the first use opens; its container goes to memory and is never used."""
        if self._stream is None:
            self._stream = self._open()
        return self._stream

    def encode(self, picture: VideoFrame, pts: int, duration: int, *, is_original: bool) -> list[Packet]:
        """Encode the next picture, and return the packets that are ready, often those of earlier pictures.

        Parameters
        ----------
        picture : av.VideoFrame
            Picture in the encoder's pixel format; its times and type are as before when this returns.
        pts, duration : int
            Presentation time and duration, ticks of the output's time base.
        is_original : bool
            Whether it is a decoded picture of the source, whose own colour tags stay; others get the encoder's.

        Returns
        -------
        list of av.Packet
            Packets in decoding order, whose times are in the same ticks; empty if none is ready.
        """
        stream = self.stream
        time_base = self._output.timing.time_base
        if not is_original:  # the ProRes encoder reads these and not its context
            context = stream.codec_context
            for tag in NO_COLOUR_TAG:
                setattr(picture, tag, getattr(context, tag))
        if "VIEW_ID" in self.traits.side_data:  # of two views, one is left, which x264 must not call stereo
            picture = filtered(picture, ["mode=delete:type=STEREO3D"]) or picture
        # The same decoded picture may be written again at another time, so its properties are restored. The encoder
        # holds a reference of its own, with the properties as set here.
        before = picture.pts, picture.duration, picture.time_base or time_base, picture.pict_type
        picture.pts = pts
        picture.duration = duration
        picture.time_base = time_base
        picture.pict_type = PictureType.NONE  # else x264 repeats the source's choice of keyframes
        try:
            return stream.encode(picture)
        finally:
            picture.pts, picture.duration, picture.time_base, picture.pict_type = before

    def finish(self) -> list[Packet]:
        """Flush and close the encoder, and return its remaining packets; the next picture begins a new chunk."""
        packets = self.stream.encode(None)
        self.close()
        return packets

    def close(self) -> None:
        """Close the encoder, and drop the pictures that it still holds; may be called again."""
        self._stream = None
        if self._null_output is not None:
            container = self._null_output
            self._null_output = None
            with contextlib.suppress(FFmpegError):
                container.close()

    def _open(self) -> VideoStream:
        """Open the encoder, in a container in memory, because PyAV copies its parameters to a stream only there."""
        self._null_output = av.open(BytesIO(), "w", format=self._output.container.name)
        rate = self._output.timing.rate  # only a tag here, since times are exact; FFmpeg has two 32-bit numbers for it
        rate = rate if rate.numerator < 2**31 else rate.limit_denominator(1000)
        stream: VideoStream = self._null_output.add_stream(  # type: ignore[assignment]
            self._encoder, rate=rate, width=self._output.info.width, height=self._output.info.height
        )
        context = stream.codec_context
        stream.time_base = context.time_base = self._output.timing.time_base
        context.pix_fmt = self.pixel_format
        self._tag_colours(context, self.traits)
        if self.traits.sample_aspect_ratio is not None:
            context.sample_aspect_ratio = self.traits.sample_aspect_ratio
        if Codec(self._encoder, "w").canonical_name == "hevc" and self._output.container.exact_times:
            context.codec_tag = "hvc1"  # the only tag of HEVC that Apple's players accept
        context.options = {**self._options, "a53cc": "0"}  # the writer writes captions
        self._open_encoder(context)
        self._null_output.start_encoding()  # only this copies the encoder's parameters to the stream
        return stream

    def _tag_colours(self, context: VideoCodecContext, traits: VideoTraits) -> None:
        """Set the colour tags to those of the source, or to those that the pixel format requires."""
        context.color_primaries = traits.color_primaries
        context.color_trc = traits.color_transfer
        context.color_range = traits.color_range
        context.colorspace = traits.tagged_color_space
        if is_rgb(traits.pixel_format) and not is_rgb(self.pixel_format):
            # RGB has neither matrix nor range; the matrix is chosen by the size.
            self.full_range = False
            context.colorspace = traits.color_space
            context.color_range = LIMITED_RANGE
        elif is_rgb(self.pixel_format):
            context.colorspace = RGB
            context.color_range = FULL_RANGE
        elif is_gray(VideoFormat(self.pixel_format)):  # else decoders that give yuv420p for it take it for limited
            context.color_range = FULL_RANGE
        elif self.pixel_format.startswith("yuvj"):
            self.full_range = True
            context.color_range = FULL_RANGE
        if context.colorspace == RGB and not is_rgb(self.pixel_format):  # as decoders of gray PNG tag it
            context.colorspace = traits.color_space

    def _open_encoder(self, context: VideoCodecContext) -> None:
        """Open the encoder; if FFmpeg refuses, raise `OutputError` with size, rate and pixel format."""
        try:
            with undisturbed():
                context.open()
        except FFmpegError:
            given = " ".join(f"{name}={value}" for name, value in self._output.encoding.encoder_options)
            check = f"check `encoder_options={given}`, or " if given else ""
            is_hardware = Codec(self._encoder, "w").capabilities & (Capabilities.hardware | Capabilities.hybrid)
            missing = ", and its device or driver may be missing here" if is_hardware else ""
            info = self._output.info
            raise OutputError(
                f"{self._output.path} cannot be encoded by {self._encoder} at {info.width}x{info.height}, "
                f"{float(self._output.timing.rate):g} frames per second, {self.pixel_format}{missing}; {check}choose "
                "another `codec`."
            ) from None


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Keep SVT-AV1, which may be opened in the block, from printing and from taking real-time priority.

    It prints past FFmpeg's log, unless an environment variable forbids it when it is first opened. It gives its
    threads and the one that opens it real-time priority, if the user may do that, which keeps a machine from all other
    work: so all threads of the process get the priority of the current one.
    """
    is_free = "SVT_LOG" not in os.environ
    os.environ.setdefault("SVT_LOG", "1")
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if sys.platform == "linux" else None
    try:
        yield
    finally:
        if is_free:
            os.environ.pop("SVT_LOG", None)
        for task in Path("/proc/self/task").iterdir() if before else ():
            with contextlib.suppress(OSError):  # a thread has ended meanwhile
                if before and os.sched_getscheduler(int(task.name)) != before[0]:
                    os.sched_setscheduler(int(task.name), *before)


def with_hdr(
    options: Mapping[str, str], encoder: str, display: MasteringDisplay | None, light: LightLevel | None
) -> tuple[dict[str, str], bool]:
    """Add mastering display and light to an encoder's options, unless given; return whether these hold all of both."""
    if encoder not in _parameters:
        return dict(options), display is None and light is None
    name, name_of_display, name_of_light, whole_units = _parameters[encoder]
    parameters = []
    if display is not None and None not in (display.colours, display.brightest):
        parameters.append(f"{name_of_display}={_display_text(display, whole_units)}")
    if light is not None:
        parameters.append(f"{name_of_light}={light.brightest_pixel},{light.brightest_frame}")
    is_whole = len(parameters) == (display is not None) + (light is not None)
    if parameters:
        options = {**options, name: ":".join(filter(None, [*parameters, options.get(name)]))}
    return dict(options), is_whole


_parameters = {
    "libx264": ("x264-params", "mastering-display", "cll", True),
    "libx265": ("x265-params", "master-display", "max-cll", True),
    "libsvtav1": ("svtav1-params", "mastering-display", "content-light", False),
}
"""By encoder: its parameter list, its parameters for display and light level, and whether these are whole numbers of
the standard's units (0.00002 for chromaticities, 0.0001 cd/m2)."""


def _display_text(display: MasteringDisplay, whole_units: bool) -> str:
    """Format a display as ``G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)``."""

    def text(value: Fraction | None, unit: int) -> str:
        assert value is not None
        return str(round(value * unit)) if whole_units else f"{float(value):.6f}"

    assert display.colours is not None
    red, green, blue, white = (f"({text(x, 50_000)},{text(y, 50_000)})" for x, y in display.colours)
    colours = f"G{green}B{blue}R{red}WP{white}"
    return f"{colours}L({text(display.brightest, 10_000)},{text(display.darkest, 10_000)})"
