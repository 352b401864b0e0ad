"""Properties of a clip and of an output, how one is read and the other encoded, as plain data that needs no FFmpeg."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Literal

from fpsboost.media.errors import OptionError

MAX_DISPLAY_RATE = 300
"""Frame rate above which no display shows frames, and no camera films without keeping its rate; frames per second."""
MAX_RATE_RATIO = 10
"""Ratio of the nominal to the mean rate above which nearly all frames would be made where nothing moves."""

EncoderOptions = tuple[tuple[str, str], ...]
"""Names and values of options that an encoder has of its own."""


@dataclass(frozen=True, slots=True)
class ClipInfo:
    """Properties of a clip that are known before its first frame is read."""

    name: str
    """The path or pattern as the user gave it."""
    height: int
    """Rows of pixels, as stored (a rotation tag is not applied)."""
    width: int
    """Columns of pixels, likewise."""
    rate: Fraction
    """Nominal frames per second."""
    time_base: Fraction
    """Seconds per tick: every frame time is a multiple of it."""
    frame_count: int | None
    """Number of frames that the source declares; None if it does not."""
    duration: Fraction | None = None
    """Duration in seconds that the source declares; None if it does not."""
    mean_rate: Fraction | None = None
    """Frames per second over all frames whose times are known beforehand, pauses included; None if none are."""

    @property
    def nominal_duration(self) -> Fraction | None:
        """Declared duration, or that of the declared frames at the nominal rate, seconds; None if unknown."""
        return self.duration or (self.frame_count / self.rate if self.frame_count else None)


FOREVER = Fraction(10**9)
"""Length of what has no end of its own, seconds; any clip is shorter."""


@dataclass(frozen=True)
class OutputTiming:
    """Rate and time base of an output, which encoders and containers are set to."""

    rate: Fraction
    """Nominal frames per second."""
    time_base: Fraction
    """Seconds per tick; frame times are multiples of it (or rounded to it where the container is coarser)."""


@dataclass(frozen=True)
class Reading:
    """How a video file is read.

    Parameters
    ----------
    stream : int, optional
        Number of the video stream in its file; by default the one that FFmpeg considers the best.
    input_fps : Fraction, optional
        Frames per second of a raw stream, which says none or a wrong one.
    deinterlace : bool
        Make two pictures of each, one per field.
    size_change : {'stop', 'scale'}
        Where pictures change their size, pixel format or pixel shape, or to or from HDR: raise `InputError`, or make
        all of them like the first one.
    keeps_alpha : bool
        Decode alpha that is stored beside the pictures; otherwise alpha is left out, with a remark.
    allow_playlists : bool
        Read playlists, and the files that they name.
    force_colours : bool
        Take pictures of Dolby Vision that are no ordinary video for ordinary ones, in wrong colours.
    end : callable, optional
        Returns the end of the part that is read, seconds, for a frame rate; what is encrypted behind it is no error.
    threads : int
        Threads of the decoder, each of which holds pictures of its own.
    check_size : callable, optional
        Called with the name of the file, and width and height of its pictures, before they are decoded; it may raise.
    """

    stream: int | None = None
    input_fps: Fraction | None = None
    deinterlace: bool = False
    size_change: Literal["stop", "scale"] = "stop"
    keeps_alpha: bool = True
    allow_playlists: bool = False
    force_colours: bool = False
    end: Callable[[Fraction], Fraction] | None = None
    threads: int = 1
    check_size: Callable[[str, int, int], None] = lambda name, width, height: None


@dataclass(frozen=True)
class EncodeSettings:
    """What is asked for of an encoder, and which streams are carried over.

    Parameters
    ----------
    codec : str, optional
        ``h264``, ``hevc``, ``vp9``, ``av1`` or the exact name of an FFmpeg encoder; by default see `default_codec`.
    crf : int, optional
        Quality, 0 (best) to 51 or 63; by default one that is hard to distinguish from the source.
    preset : str, optional
        Speed: ``ultrafast`` ... ``placebo`` for h264 and hevc, a number for vp9 (0-8) and av1 (0-13, larger is faster).
    bitrate : int, optional
        Target bit rate instead of a quality, bits per second.
    lossless : bool
        Encode so that decoding gives back exactly the pictures that were encoded.
    pixel_format : str, optional
        FFmpeg's name, ``yuv420p10le``; by default the source's, or the encoder's that loses least.
    encoder_options : tuple of (str, str)
        FFmpeg's own options of the encoder; they override everything above.
    audio_codec : str, optional
        Format that audio in another format is re-encoded in: ``aac``, ``opus``, ``mp3``, ``ac3``, ``eac3``, ``flac``,
        ``alac``, ``pcm`` or the exact name of an FFmpeg encoder. By default audio is copied packet by packet, unless a
        .webm cannot hold it, which gets Opus; with ``copy`` always.
    audio_bitrate : int, optional
        Target bit rate of each audio stream that is encoded, bits per second; by default 96,000 for every channel.
    audio, subtitles : bool
        Keep the source's audio and subtitles.
    streams : tuple of int, optional
        Numbers of the streams of audio and subtitles to keep; by default all that can be kept.

    Raises
    ------
    OptionError
        One of `encoder_options` is given twice.
    """

    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    bitrate: int | None = None
    lossless: bool = False
    pixel_format: str | None = None
    encoder_options: EncoderOptions = ()
    audio_codec: str | None = None
    audio_bitrate: int | None = None
    audio: bool = True
    subtitles: bool = True
    streams: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        names = [name for name, _ in self.encoder_options]
        for name in names:
            if names.count(name) > 1:
                raise OptionError(f"`encoder_options={name}` is given twice; give it once.")

    @property
    def given(self) -> list[str]:
        """Names of the options that differ from the defaults, without those that leave out streams."""
        asked = [field for field in fields(self) if field.default is not True]
        return [f"`{field.name}`" for field in asked if getattr(self, field.name) != field.default]


def is_implausible(rate: Fraction, mean_rate: Fraction) -> bool:
    """Return whether a rate is higher than that of any display, and far higher than the mean rate of the frames."""
    return rate > MAX_DISPLAY_RATE and rate > MAX_RATE_RATIO * mean_rate
