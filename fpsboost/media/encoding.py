"""Encoders, the names of their options and what makes them repeatable, and containers with the codecs they hold."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO

import av
import cv2
from av.codec.codec import UnknownCodecError
from av.codec.context import OptionFlags

from fpsboost.media.errors import OptionError, choose_one, refuse
from fpsboost.media.info import EncodeSettings
from fpsboost.media.pixels import has_alpha
from fpsboost.media.pyav import trial_file

containers = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}
"""FFmpeg's name of the container by suffix."""

VIDEO_SUFFIXES = tuple(containers)
"""Suffixes of the video files that can be written."""

MATROSKA_TICK = Fraction(1, 1000)
"""Time base of Matroska and WebM, seconds per tick."""
EXACT_TIME_BASE_CONTAINERS = ("mp4", "mov")
"""Containers whose time base can be chosen; that of the others is a millisecond."""

CPU_AVX_512F = 13  # OpenCV's number of the CPU feature, which has no name in Python
repeatable_parameters = ("asm=avx2",) if cv2.checkHardwareSupport(CPU_AVX_512F) else ()
"""Entries of ``x264-params`` that make x264 repeat itself; empty where none is needed.

With AVX-512, decisions of x264 (core 165) depend on memory next to its tables, so two runs rarely make the same stream.
"""

ENCODER_THREADS = 8
"""Threads of an encoder, on any number of cores.

With x264 at 1920x1080 they take no more processor time on 1, 2 or 4 cores than the number that x264 chooses there, and
each costs about 20 MB. Packets depend on their number, even where ``mvrange-thread`` and ``lookahead-threads`` are set.
"""
LARGE_PICTURE = 2560 * 1440
"""Pixels beyond which an encoder has fewer threads."""
THREADS_FOR_LARGE_PICTURES = 6
"""Threads of an encoder of large pictures: at 3840x2160, x264 keeps 170 of 1040 MB less than with 8."""

threads_of_encoders = {
    "libx265": 4,
    "libvpx": 1,  # it takes no more than there are cores
    "mjpeg": 1,  # with more it cannot choose the codes of a picture, and files grow by 15 %
}
"""Threads of the encoders that have another number, for pictures of any size."""

# Threads that share a picture, PyAV's default, cost bits by their slices. Without a thread of its own for the
# look-ahead, x264 keeps 5 pictures less, 100 MB at 3840x2160, and makes the same stream but with a bounded rate.
_x264_options = (
    ("thread_type", "frame"),
    *(("x264-params", entry) for entry in (*repeatable_parameters, "sync-lookahead=0")),
)

_further_options = {
    "libx264": _x264_options,
    "libx264rgb": _x264_options,
    # As on 16 cores, where it encodes 4 pictures at once: its lookahead decides differently with a pool of less than 4
    # threads. Its note of its own options names the features of the processor.
    "libx265": (("x265-params", "info=0"), ("x265-params", f"pools={ENCODER_THREADS}")),
}
x26x_presets = (
    *("ultrafast", "superfast", "veryfast", "faster", "fast"),
    *("medium", "slow", "slower", "veryslow", "placebo"),
)


@dataclass(frozen=True)
class Encoder:
    """Quality and speed options of an encoder, and the values that they accept."""

    name: str
    """FFmpeg's name."""
    crf: int
    """Default quality."""
    largest_crf: int
    preset: str
    """Default preset."""
    presets: tuple[str, ...]
    preset_option: str
    """FFmpeg's option for the preset."""
    fixed_options: tuple[tuple[str, str], ...] = ()
    """Options that are always given."""
    needs_whole_chroma: bool = False
    """Whether subsampled chroma requires an even width or height."""
    lossless: tuple[tuple[str, str], ...] = ()
    """Options for lossless encoding; empty where none is reliably lossless."""


encoders = {
    "h264": Encoder(
        *("libx264", 18, 51, "medium", x26x_presets, "preset"),
        needs_whole_chroma=True,
        lossless=(("qp", "0"),),  # not crf 0, which is lossy beyond 8 bits
    ),
    # x265 prints past FFmpeg's log
    "hevc": Encoder(
        *("libx265", 20, 51, "medium", x26x_presets, "preset", (("x265-params", "log-level=none"),)),
        needs_whole_chroma=True,
        lossless=(("x265-params", "lossless=1"),),
    ),
    "vp9": Encoder(
        *("libvpx-vp9", 30, 63, "4"),
        *(tuple(map(str, range(9))), "cpu-used"),
        (("b", "0"), ("row-mt", "1"), ("deadline", "good")),
        lossless=(("lossless", "1"),),
    ),
    # SVT-AV1 has a lossless mode, but 10-bit values come back off by one, and streams of fast presets do not decode.
    "av1": Encoder("libsvtav1", 30, 63, "8", tuple(map(str, range(14))), "preset"),
}
"""Encoders by the common name of their format."""


def default_codec(container: str, pixel_format: str = "yuv420p", source_codec: str = "") -> str:
    """Return the codec of an output if none is given: the one that most players show at the source's bit depth.

    8-bit video becomes H.264, or VP9 in .webm. Deeper pictures become HEVC, since few players show such H.264, and in
    .webm AV1, since VP9's encoder has 8 bits only, or VP9 for alpha. Deep H.264 and deep 4:2:0 AV1 stay what they are,
    since a player that shows the source shows the output too.
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
    """Return the bits per sample of a pixel format, or 8 if FFmpeg does not know it."""
    with suppress(ValueError):
        return max((component.bits for component in av.VideoFormat(pixel_format).components), default=8)
    return 8


def find_encoder(name: str, kind: str) -> av.Codec | None:
    """Return the encoder with this very name for ``video`` or ``audio``, or None if FFmpeg has none here."""
    with suppress(UnknownCodecError):
        codec = av.Codec(name, "w")
        return codec if (codec.type, codec.name) == (kind, name) else None
    return None


def choose_encoder(
    encoding: EncodeSettings,
    container: str,
    name: str,
    pixel_format: str = "yuv420p",
    source_codec: str = "",
    *,
    pixels: int,
) -> tuple[str, dict[str, str]]:
    """Return FFmpeg's encoder and its options for the encoding that was asked for.

    Parameters
    ----------
    encoding : EncodeSettings
        Options of the user; without a codec, `default_codec` chooses it.
    container : str
        FFmpeg's name of the output's container.
    name : str
        The output in messages.
    pixel_format, source_codec : str
        Pixel format of the source, and FFmpeg's name of its codec.
    pixels : int
        Pixels per picture, which limit the number of threads.

    Returns
    -------
    tuple
        Name of the encoder, and its options, with those that make it repeatable.

    Raises
    ------
    OptionError
        FFmpeg lacks the encoder, the container does not hold its codec, or it does not know an option.
    """
    asked = encoding.codec or default_codec(container, encoding.pixel_format or pixel_format, source_codec)
    known = encoders.get("hevc" if asked.lower() == "h265" else asked.lower()) or next(
        (entry for entry in encoders.values() if entry.name == asked), None
    )
    encoder = known.name if known else asked
    codec = find_encoder(encoder, "video")
    if codec is None:
        raise OptionError(
            f"`codec={asked!r}` is unknown here, also as the exact name of an FFmpeg encoder; "
            + choose_one(asked, encoders)
        )
    check_holds(container, encoder, name, f"`codec={asked!r}`", {common: e.name for common, e in encoders.items()})
    _check_pixel_format(codec, encoding.pixel_format)
    options = _options_of_other(codec, encoding) if known is None else _options_of_known(known, asked, encoding)
    for option, _ in encoding.encoder_options:
        generic = OptionFlags.ENCODING_PARAM | OptionFlags.VIDEO_PARAM  # milliseconds, for the few who give options
        common = {o.name for o in codec.create("video").supported_options.generic if o.flags & generic == generic}
        if option not in private_options(codec) | common:
            raise OptionError(
                f"`encoder_options={option}` is unknown to {encoder}; look it up with ffmpeg -h encoder={encoder}."
            )
    given = {*options, *dict(encoding.encoder_options)}
    return encoder, _merged_options(options, (*repeatable_options(encoder, given, pixels), *encoding.encoder_options))


def encodes_alpha(encoding: EncodeSettings, container: str) -> bool:
    """Return whether the encoder, pixel format and container that were asked for can hold alpha; False if unknown."""
    asked = encoding.codec or default_codec(container, encoding.pixel_format or "yuv420p")
    encoder = encoders[asked.lower()].name if asked.lower() in encoders else asked
    codec = find_encoder(encoder, "video")
    # libvpx stores alpha beside the picture
    if codec is None or (encoder.startswith("libvpx") and container not in ("webm", "matroska")):
        return False
    offered = pixel_formats(codec)
    if encoding.pixel_format is not None:
        return encoding.pixel_format in offered and has_alpha(encoding.pixel_format)
    return any(has_alpha(name) for name in offered)


def _options_of_known(known: Encoder, asked: str, encoding: EncodeSettings) -> dict[str, str]:
    """Return the options for an encoder of the table; raise `OptionError` for values that it does not accept."""
    crf = known.crf if encoding.crf is None else encoding.crf
    preset = encoding.preset or known.preset
    unknown = f"`preset={preset!r}` is unknown to {asked}; {choose_one(preset, known.presets)}"
    refuse(
        {
            f"`crf` must be 0 to {known.largest_crf} for {asked}, not {crf}.": not 0 <= crf <= known.largest_crf,
            unknown: preset not in known.presets,
        }
    )
    options = {known.preset_option: preset, **dict(known.fixed_options)}
    if encoding.lossless:
        _check_lossless(asked, bool(known.lossless))
        return _merged_options(options, known.lossless)
    if encoding.bitrate is not None:
        return {**options, "b": str(encoding.bitrate)}
    # an encoder that is given a quality ignores these two
    says_another_aim = encoding.crf is None and {"b", "qp"} & dict(encoding.encoder_options).keys()
    return options if says_another_aim else {**options, "crf": str(crf)}


def _options_of_other(codec: av.Codec, encoding: EncodeSettings) -> dict[str, str]:
    """Return the options for an encoder outside the table; raise `OptionError` if it does not know one."""
    known = private_options(codec)
    options = {}
    for option, value in (("crf", encoding.crf), ("preset", encoding.preset)):
        if value is None:
            continue
        if option not in known:
            raise OptionError(f"`{option}` means nothing to {codec.name}; leave it out.")
        options[option] = str(value)
    if encoding.bitrate is not None:
        if not codec.lossy:
            raise OptionError(f"`bitrate` means nothing to {codec.name}, which is lossless; leave it out.")
        options["b"] = str(encoding.bitrate)
    if encoding.lossless and (codec.lossy or not codec.lossless):
        if "lossless" in known:
            options["lossless"] = "1"
        elif codec.name.startswith("libx264"):
            options["qp"] = "0"
        else:
            _check_lossless(codec.name, codec.name.endswith("_nvenc"))
            options["tune"] = "lossless"
    return options


def _check_lossless(asked: str, can: bool) -> None:
    """Raise `OptionError` unless an encoder can encode losslessly."""
    if not can:
        able = [common for common, encoder in encoders.items() if encoder.lossless]
        raise OptionError(f"`lossless` is nothing that {asked} can do; use {', '.join(able)} or ffv1.")


def _merged_options(options: dict[str, str], more: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return options updated with more; parameter lists (``x265-params``) are extended instead of replaced."""
    result = dict(options)
    for name, value in more:
        result[name] = f"{result[name]}:{value}" if name.endswith("-params") and name in result else value
    return result


def private_options(codec: av.Codec) -> set[str]:
    """Return the names of the private options of an encoder."""
    return {option.name for option in codec.create("video").supported_options.private}


def pixel_formats(codec: av.Codec) -> list[str]:
    """Return the pixel formats in memory that an encoder accepts, or an empty list if it does not list any."""
    names = [item.name for item in codec.video_formats or () if item.components]  # those of a GPU have no components
    opened = _opened_with_alpha.get(codec.name)  # some list more formats with alpha than they open
    return names if opened is None else [name for name in names if name in opened or not has_alpha(name)]


# HEVC stores alpha in a second layer, which few players and none of FFmpeg's containers support
_opened_with_alpha = {"libvpx": ["yuva420p"], "libvpx-vp9": ["yuva420p"], "libx265": []}


def _check_pixel_format(codec: av.Codec, asked: str | None) -> None:
    """Raise `OptionError` unless an encoder accepts a pixel format, if one was asked for."""
    if asked is None:
        return
    taken = pixel_formats(codec)
    if taken and asked not in taken:
        raise OptionError(f"`pixel_format={asked!r}` is nothing that {codec.name} takes; {choose_one(asked, taken)}")
    try:
        av.VideoFormat(asked)
    except ValueError:
        raise OptionError(f"`pixel_format={asked!r}` is no pixel format of FFmpeg; use one such as yuv420p.") from None


def check_holds(container: str, codec: str, name: str, option: str, others: Mapping[str, str]) -> None:
    """Raise `OptionError` unless the container of a file holds a codec that an option names; `others` may be named."""
    if holds(container, codec):
        return
    fitting = [common for common, encoder in others.items() if holds(container, encoder)]
    suffixes = [suffix for suffix, other in containers.items() if holds(other, codec)]
    instead = f", or write {' or '.join(suffixes)}" if suffixes else ""
    raise OptionError(f"{option} cannot go into {name}; use {' or '.join(fitting)}{instead}.")


def holds(container: str, codec: str) -> bool:
    """Return whether a container (FFmpeg's name, ``matroska``) holds the codec of an encoder or decoder."""
    with av.open(BytesIO(), "w", format=container) as probe:
        listed = codec in probe.supported_codecs
    # the header of DV cannot be written without a picture
    return listed and (container != "mov" or codec == "dvvideo" or _writes_header(codec))


def _writes_header(codec: str) -> bool:
    """Return whether the .mov muxer, which lists codecs of .mp4 that it then rejects, writes a header for a codec."""
    try:
        with trial_file() as path, av.open(str(path), "w", format="mov") as probe:
            probe.add_mux_stream(codec, rate=48000, width=64, height=64, time_base=Fraction(1, 48000))
            probe.start_encoding()
    except (av.error.FFmpegError, ValueError):
        return False
    return True


def repeatable_options(encoder: str, given: Collection[str], pixels: int) -> tuple[tuple[str, str], ...]:
    """Return the options with which an encoder makes the same packets on any number of cores, beside those `given`.

    The number of cores would decide how many threads an encoder has, and many cut pictures into other slices, search
    motion within other limits, or name the number in the stream.
    """
    usual = THREADS_FOR_LARGE_PICTURES if pixels > LARGE_PICTURE else ENCODER_THREADS
    # with more threads, SVT-AV1 aims at a rate differently in every run
    is_unsteady = encoder == "libsvtav1" and not {"b", "maxrate"}.isdisjoint(given)
    further = [("svtav1-params", "lp=1")] if is_unsteady else _further_options.get(encoder, ())
    return ("threads", str(threads_of_encoders.get(encoder, usual))), *further
