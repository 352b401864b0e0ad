"""How a video is encoded: the encoders and what their options are called, the containers and what they take."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO

import av
from av.codec.codec import Capabilities, UnknownCodecError
from av.codec.context import OptionFlags

from fpsboost.errors import OptionError
from fpsboost.io.video.x264 import repeatable_parameters
from fpsboost.io.video.ycc import has_alpha

containers = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}
"""FFmpeg's name of the container by suffix."""

VIDEO_SUFFIXES = tuple(containers)
"""Suffixes of the video files that can be written."""

CLOCK_OF_MATROSKA = Fraction(1, 1000)
LOWEST_BITRATE, MAX_BITRATE = 1000, 2_000_000_000
EXACT_CLOCKS = ("mp4", "mov")
"""Containers that count in the ticks asked for; the others count milliseconds."""


x26x_presets = (
    *("ultrafast", "superfast", "veryfast", "faster", "fast"),
    *("medium", "slow", "slower", "veryslow", "placebo"),
)


@dataclass(frozen=True)
class Encoder:
    """What an encoder's quality and speed are called, and which values they take."""

    name: str
    crf: int
    largest_crf: int
    preset: str
    presets: tuple[str, ...]
    preset_option: str
    fixed_options: tuple[tuple[str, str], ...] = ()
    needs_whole_chroma: bool = False
    """An odd width or height cannot be halved for chroma."""
    lossless: tuple[tuple[str, str], ...] = ()
    """Options with which decoding gives back what was encoded; none where nothing does so dependably."""


encoders = {
    "h264": Encoder(
        *("libx264", 18, 51, "medium", x26x_presets, "preset"),
        tuple(("x264-params", each) for each in repeatable_parameters),
        needs_whole_chroma=True,
        lossless=(("qp", "0"),),  # and not crf 0, which loses a little beyond 8 bits
    ),
    # x265 prints on its own, past FFmpeg's log.
    "hevc": Encoder(
        "libx265",
        20,
        51,
        "medium",
        x26x_presets,
        "preset",
        (("x265-params", "log-level=none"),),
        needs_whole_chroma=True,
        lossless=(("x265-params", "lossless=1"),),
    ),
    "vp9": Encoder(
        *("libvpx-vp9", 30, 63, "4"),
        *(tuple(map(str, range(9))), "cpu-used"),
        (("b", "0"), ("row-mt", "1"), ("deadline", "good")),
        lossless=(("lossless", "1"),),
    ),
    # SVT-AV1 has a lossless mode, but 10 bits come back off by one, and what its fast presets write does not decode.
    "av1": Encoder("libsvtav1", 30, 63, "8", tuple(map(str, range(14))), "preset"),
}
"""Encoders by the name people use for the format."""


@dataclass(frozen=True)
class Encoding:
    """How to encode, and what to carry over.

    Parameters
    ----------
    codec : str, optional
        ``h264``, ``hevc``, ``vp9``, ``av1`` or the exact name of an FFmpeg encoder; by default see `default_codec`.
    crf : int, optional
        Quality, 0 (best) to 51 or 63; by default one that is hard to tell from the source.
    preset : str, optional
        Speed: ``ultrafast`` ... ``placebo`` for h264 and hevc, a number for vp9 (0-8) and av1 (0-13, larger is faster).
    audio, subtitles : bool
        Keep the source's sound and subtitles.
    audio_codec : str, optional
        Format that sound is encoded anew in, where it is in another one: ``aac``, ``opus``, ``mp3``, ``ac3``, ``eac3``,
        ``flac``, ``alac``, ``pcm`` or the exact name of an FFmpeg encoder. By default, and with ``copy``, sound is
        copied packet by packet.
    pixel_format : str, optional
        FFmpeg's name, ``yuv420p10le``; by default the source's, or the encoder's that loses least.
    bitrate : int, optional
        Bits per second to aim at, instead of a quality.
    lossless : bool
        Decoding gives back exactly what was encoded.
    encoder_options : tuple of (str, str)
        FFmpeg's own options of the encoder; they win over everything above.

    Raises
    ------
    OptionError
        Two of them contradict each other, or a value can never work.
    """

    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    audio: bool = True
    subtitles: bool = True
    audio_codec: str | None = None
    pixel_format: str | None = None
    bitrate: int | None = None
    lossless: bool = False
    encoder_options: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.crf is not None and self.bitrate is not None:
            raise OptionError("--crf and --bitrate contradict each other; give one of them.")
        if self.lossless and (self.crf, self.bitrate) != (None, None):
            other = "--crf" if self.bitrate is None else "--bitrate"
            raise OptionError(f"--lossless and {other} contradict each other; give one of them.")
        if self.audio_codec is not None and not self.audio:
            raise OptionError("--audio-codec and --no-audio contradict each other; give one of them.")
        if self.bitrate is not None and not LOWEST_BITRATE <= self.bitrate <= MAX_BITRATE:
            raise OptionError(f"--bitrate must be 1k to 2000M, not {self.bitrate}.")
        names = [name for name, _ in self.encoder_options]
        for name in names:
            if names.count(name) > 1:
                raise OptionError(f"--encoder-option {name} is given twice; give it once.")

    @property
    def given(self) -> list[str]:
        """The options on how to encode that were given, as the command line calls them."""
        values = {
            "--codec": self.codec,
            "--crf": self.crf,
            "--preset": self.preset,
            "--bitrate": self.bitrate,
            "--lossless": self.lossless or None,
            "--pix-fmt": self.pixel_format,
            "--audio-codec": self.audio_codec,
            "--encoder-option": self.encoder_options or None,
        }
        return [option for option, value in values.items() if value is not None]


def parse_bitrate(text: str) -> int:
    """Read bits per second as people write them.

    Raises
    ------
    OptionError
        Not a number, or another suffix than k and M.

    Examples
    --------
    >>> parse_bitrate("8M"), parse_bitrate("1.5M"), parse_bitrate("800k")
    (8000000, 1500000, 800000)
    """
    found = re.fullmatch(r"([0-9]{1,12}(?:\.[0-9]{1,12})?)([kKmM]?)", text.strip())
    if found is None:
        raise OptionError(f"--bitrate {text!r} is no number of bits per second; write it like 8M, 1.5M or 800k.")
    return round(Fraction(found[1]) * {"": 1, "k": 1000, "m": 1_000_000}[found[2].lower()])


def parse_encoder_options(texts: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Split options of the form ``key=value``.

    Raises
    ------
    OptionError
        One has no name or no value.

    Examples
    --------
    >>> parse_encoder_options(["tune=film", "x264-params=keyint=48:min-keyint=1"])
    (('tune', 'film'), ('x264-params', 'keyint=48:min-keyint=1'))
    """
    pairs = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, pairs, strict=True):
        if not name.strip() or not value:
            raise OptionError(f"--encoder-option {text!r} is not of the form key=value; write it like tune=film.")
    return tuple((name.strip(), value) for name, _, value in pairs)


def default_codec(container: str, pixel_format: str = "yuv420p", source_codec: str = "") -> str:
    """The codec of an output where none is asked for: what most players show at the source's depth.

    8 bits become H.264, in .webm VP9. Few players show H.264 beyond 8 bits, and what records or delivers such video is
    HEVC nearly always, so deeper pictures become HEVC; in .webm AV1, as VP9's encoder has 8 bits only, unless they have
    alpha, which only VP9 keeps. Deep H.264 stays H.264 and deep 4:2:0 in AV1 stays AV1: what shows the source shows the
    output.

    Parameters
    ----------
    container : str
        FFmpeg's name.
    pixel_format : str
        Of the source, or the one that was asked for.
    source_codec : str
        FFmpeg's name of the source's format; empty where there is none.
    """
    is_deep = depth_of(pixel_format) > 8
    if container == "webm":
        return "av1" if is_deep and not has_alpha(pixel_format) else "vp9"
    if not is_deep or source_codec == "h264":
        return "h264"
    if source_codec == "av1" and container != "mov" and pixel_format.startswith("yuv420p"):
        return "av1"
    return "hevc"


def depth_of(pixel_format: str) -> int:
    """Bits of a sample; 8 for what FFmpeg does not know."""
    try:
        return max((component.bits for component in av.VideoFormat(pixel_format).components), default=8)
    except ValueError:
        return 8


def choose_encoder(
    encoding: Encoding, container: str, name: str, pixel_format: str = "yuv420p", source_codec: str = ""
) -> tuple[str, dict[str, str]]:
    """Find FFmpeg's encoder and its options for what was asked; see `default_codec` where no codec was.

    Returns
    -------
    str, dict of str
        Encoder name and options.

    Raises
    ------
    OptionError
        Unknown codec, not allowed in this container, or a quality, preset, pixel format or option that it
        does not know.
    """
    default = default_codec(container, encoding.pixel_format or pixel_format, source_codec)
    asked = encoding.codec or default
    known = encoders.get(asked.lower()) or next((e for e in encoders.values() if e.name == asked), None)
    encoder = known.name if known else asked
    try:
        codec = av.Codec(encoder, "w")
    except UnknownCodecError:
        codec = None
    if codec is None or codec.type != "video" or codec.name != encoder:
        raise OptionError(
            f"--codec {asked} is unknown here; use {', '.join(encoders)}, or the exact name of an FFmpeg video encoder."
        )
    if not holds(container, encoder):
        fitting = [friendly for friendly, e in encoders.items() if holds(container, e.name)]
        others = [suffix for suffix, each in containers.items() if holds(each, encoder)]
        instead = f", or write {' or '.join(others)}" if others else ""
        raise OptionError(f"--codec {asked} cannot go into {name}; use {' or '.join(fitting)}{instead}.")
    _check_pixel_format(codec, encoding.pixel_format)
    options = _options_of_other(codec, encoding) if known is None else _options_of_known(known, asked, encoding)
    _check_encoder_options(codec, encoding.encoder_options)
    return encoder, _joined(options, encoding.encoder_options)


def encodes_alpha(encoding: Encoding, container: str) -> bool:
    """Whether what is asked for can hold alpha: encoder, pixel format and container.

    Parameters
    ----------
    encoding : Encoding
        Of a codec that `choose_encoder` accepts; nothing else holds alpha.
    container : str
    """
    asked = encoding.codec or default_codec(container, encoding.pixel_format or "yuv420p")
    encoder = encoders[asked.lower()].name if asked.lower() in encoders else asked
    try:
        offered = pixel_formats(av.Codec(encoder, "w"))
    except UnknownCodecError:
        return False
    if encoder.startswith("libvpx") and container not in ("webm", "matroska"):
        return False  # there it stands beside the picture, where only these two look
    if encoding.pixel_format is not None:
        return encoding.pixel_format in offered and has_alpha(encoding.pixel_format)
    # of HEVC's second layer few players and not even FFmpeg's containers know
    return encoder != "libx265" and any(has_alpha(each) for each in offered)


def _options_of_known(known: Encoder, asked: str, encoding: Encoding) -> dict[str, str]:
    """Options for an encoder of the table."""
    crf = known.crf if encoding.crf is None else encoding.crf
    if not 0 <= crf <= known.largest_crf:
        raise OptionError(f"--crf must be 0 to {known.largest_crf} for {asked}, not {crf}.")
    preset = encoding.preset or known.preset
    if preset not in known.presets:
        raise OptionError(f"--preset {preset} is unknown to {asked}; use one of {', '.join(known.presets)}.")
    options = {known.preset_option: preset, **dict(known.fixed_options)}
    if encoding.lossless:
        _check_lossless(asked, bool(known.lossless))
        return _joined(options, known.lossless)
    if encoding.bitrate is not None:
        return {**options, "b": str(encoding.bitrate)}
    # an encoder that is told a quality does not look at these two
    says_another_aim = encoding.crf is None and {"b", "qp"} & dict(encoding.encoder_options).keys()
    return options if says_another_aim else {**options, "crf": str(crf)}


def _options_of_other(codec: av.Codec, encoding: Encoding) -> dict[str, str]:
    """Options for an encoder without an entry in the table, if it knows them."""
    known = private_options(codec)
    options = {}
    for option, value in (("crf", encoding.crf), ("preset", encoding.preset)):
        if value is None:
            continue
        if option not in known:
            raise OptionError(f"--{option} means nothing to {codec.name}; leave it out.")
        options[option] = str(value)
    if encoding.bitrate is not None:
        if not codec.lossy:
            raise OptionError(f"--bitrate means nothing to {codec.name}, which is lossless; leave it out.")
        options["b"] = str(encoding.bitrate)
    if encoding.lossless:
        options.update(_lossless_options_of_other(codec, known))
    return options


def _lossless_options_of_other(codec: av.Codec, known: Collection[str]) -> dict[str, str]:
    if codec.lossless and not codec.lossy:
        return {}
    if "lossless" in known:
        return {"lossless": "1"}
    if codec.name.startswith("libx264"):
        return {"qp": "0"}
    is_nvenc = codec.name.endswith("_nvenc")
    _check_lossless(codec.name, is_nvenc)
    return {"tune": "lossless"}


def _check_lossless(asked: str, can: bool) -> None:
    """Raise `OptionError` for an encoder that cannot be lossless."""
    if not can:
        able = [friendly for friendly, each in encoders.items() if each.lossless]
        raise OptionError(f"--lossless is nothing that {asked} can do; use {', '.join(able)} or ffv1.")


def _joined(options: dict[str, str], more: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Options with more of them; a list of parameters (``x265-params``) grows instead of being replaced."""
    result = dict(options)
    for name, value in more:
        grows = name.endswith("-params") and name in result
        result[name] = f"{result[name]}:{value}" if grows else value
    return result


def private_options(codec: av.Codec) -> set[str]:
    """Names of the options that only this encoder has."""
    return {option.name for option in codec.create("video").supported_options.private}


def _check_encoder_options(codec: av.Codec, options: Sequence[tuple[str, str]]) -> None:
    generic = OptionFlags.ENCODING_PARAM | OptionFlags.VIDEO_PARAM
    common = {o.name for o in codec.create("video").supported_options.generic if o.flags & generic == generic}
    known = private_options(codec) | common
    for name, _ in options:
        if name not in known:
            raise OptionError(
                f"--encoder-option {name} is unknown to {codec.name}; look it up with ffmpeg -h encoder={codec.name}."
            )


def pixel_formats(codec: av.Codec) -> list[str]:
    """Pixel formats that an encoder takes from memory; none where it does not say."""
    names = [item.name for item in codec.video_formats or () if item.components]  # those of a GPU have no components
    if codec.name.startswith("libvpx"):  # it lists more formats with alpha than it opens
        return [name for name in names if name == "yuva420p" or not has_alpha(name)]
    return names


def _check_pixel_format(codec: av.Codec, asked: str | None) -> None:
    """Raise `OptionError` unless the encoder takes the format."""
    if asked is None:
        return
    taken = pixel_formats(codec)
    if taken and asked not in taken:
        raise OptionError(f"--pix-fmt {asked} is nothing that {codec.name} takes; use one of {', '.join(taken)}.")
    try:
        av.VideoFormat(asked)
    except ValueError:
        raise OptionError(f"--pix-fmt {asked} is no pixel format of FFmpeg; use one such as yuv420p.") from None


def needs_hardware(encoder: str) -> bool:
    """Whether an encoder works only where a device and its driver are there."""
    return bool(av.Codec(encoder, "w").capabilities & (Capabilities.hardware | Capabilities.hybrid))


def holds(container: str, codec: str) -> bool:
    """Whether a container takes a codec.

    Parameters
    ----------
    container : str
        FFmpeg's name, ``matroska``.
    codec : str
        Name of its encoder or decoder; no container takes an empty one.
    """
    with av.open(BytesIO(), "w", format=container) as probe:
        listed = codec in probe.supported_codecs
    return listed and (container != "mov" or codec in ASK_MORE or _begins(container, codec))


ASK_MORE = ("dvvideo",)
"""Codecs whose header cannot be tried without a picture."""


def _begins(container: str, codec: str) -> bool:
    """Whether a muxer writes a header for a codec: that of .mov lists what it shares with .mp4 and then refuses."""
    try:
        with av.open(BytesIO(), "w", format=container) as probe:
            probe.add_mux_stream(codec, rate=48000, width=64, height=64, time_base=Fraction(1, 48000))
            probe.start_encoding()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
