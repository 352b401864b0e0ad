"""Encoders, the names of their options, and what makes them repeatable."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass

import cv2
from av import Codec, VideoFormat
from av.codec.context import OptionFlags

from fpsboost.media.containers import Container
from fpsboost.media.errors import OptionError, choose_one
from fpsboost.media.info import ClipInfo, EncoderOptions, EncodeSettings
from fpsboost.media.output import Output
from fpsboost.media.pixels import has_alpha
from fpsboost.media.pyav import find_codec
from fpsboost.media.traits import VideoTraits

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

X264_OPTIONS = (
    ("thread_type", "frame"),
    *(("x264-params", entry) for entry in (*repeatable_parameters, "sync-lookahead=0")),
)
"""Options of x264 that make its packets the same on any number of cores.

Threads that share a picture, PyAV's default, cost bits by their slices. Without a thread of its own for the look-ahead,
x264 keeps 5 pictures less, 100 MB at 3840x2160, and makes the same stream but with a bounded rate.
"""

X26X_PRESETS: tuple[str, ...] = ("ultrafast", "superfast", "veryfast", "faster", "fast")
X26X_PRESETS += ("medium", "slow", "slower", "veryslow", "placebo")


@dataclass(frozen=True)
class Encoder:
    """Encoder of FFmpeg: its options for quality and speed, and what else it needs to be given."""

    name: str
    """FFmpeg's name."""
    crf: int = 0
    """Default quality."""
    largest_crf: int = 0
    preset: str = ""
    """Default preset."""
    presets: tuple[str, ...] = ()
    preset_option: str = "preset"
    """FFmpeg's option for the preset."""
    fixed_options: EncoderOptions = ()
    """Options that are always given."""
    lossless: EncoderOptions = ()
    """Options for lossless encoding; empty where none is reliably lossless."""
    needs_whole_chroma: bool = False
    """Whether subsampled chroma requires an even width or height."""
    alpha_formats: tuple[str, ...] | None = None
    """Pixel formats with alpha that it opens, where it lists others; None where it opens all that it lists."""
    threads: int | None = None
    """Threads for pictures of any size; None for the usual number."""
    repeatable_options: EncoderOptions = ()
    """Options that, beside the number of threads, make its packets the same on any number of cores."""


H264 = Encoder(
    name="libx264",
    crf=18,
    largest_crf=51,
    preset="medium",
    presets=X26X_PRESETS,
    lossless=(("qp", "0"),),  # not crf 0, which is lossy beyond 8 bits
    needs_whole_chroma=True,
    repeatable_options=X264_OPTIONS,
)
HEVC = Encoder(
    name="libx265",
    crf=20,
    largest_crf=51,
    preset="medium",
    presets=X26X_PRESETS,
    fixed_options=(("x265-params", "log-level=none"),),  # x265 prints past FFmpeg's log
    lossless=(("x265-params", "lossless=1"),),
    needs_whole_chroma=True,
    alpha_formats=(),  # it stores alpha in a second layer, which few players and none of FFmpeg's containers support
    threads=4,
    # As on 16 cores, where it encodes 4 pictures at once: its lookahead decides differently with a pool of less than 4
    # threads. Its note of its own options names the features of the processor.
    repeatable_options=(("x265-params", "info=0"), ("x265-params", f"pools={ENCODER_THREADS}")),
)
VP9 = Encoder(
    name="libvpx-vp9",
    crf=30,
    largest_crf=63,
    preset="4",
    presets=tuple(map(str, range(9))),
    preset_option="cpu-used",
    fixed_options=(("b", "0"), ("row-mt", "1"), ("deadline", "good")),
    lossless=(("lossless", "1"),),
    alpha_formats=("yuva420p",),
)
# SVT-AV1 has a lossless mode, but 10-bit values come back off by one, and streams of fast presets do not decode.
AV1 = Encoder(name="libsvtav1", crf=30, largest_crf=63, preset="8", presets=tuple(map(str, range(14))))

encoders = {"h264": H264, "hevc": HEVC, "vp9": VP9, "av1": AV1}
"""Encoders by the common name of their format."""

X264_RGB = Encoder("libx264rgb", lossless=H264.lossless, repeatable_options=X264_OPTIONS)
VP8 = Encoder("libvpx", alpha_formats=VP9.alpha_formats, threads=1)  # it takes no more threads than there are cores
MJPEG = Encoder("mjpeg", threads=1)  # with more it cannot choose the codes of a picture, and files grow by 15 %

_by_name = {encoder.name: encoder for encoder in (*encoders.values(), X264_RGB, VP8, MJPEG)}


def encoder_of(name: str) -> Encoder:
    """Return the encoder with FFmpeg's name, or of the format with a common name; others need nothing."""
    by_format = {**encoders, "h265": HEVC}
    return by_format.get(name.lower()) or _by_name.get(name, Encoder(name))


def default_codec(container: Container, pixel_format: str = "yuv420p", source_codec: str = "") -> str:
    """Return the codec of an output if none is given: the one that most players show at the source's bit depth.

    8-bit video becomes H.264, or VP9 in .webm. Deeper pictures become HEVC, since few players show such H.264, and in
    .webm AV1, since VP9's encoder has 8 bits only, or VP9 for alpha. Deep H.264 and deep 4:2:0 AV1 stay what they are,
    since a player that shows the source shows the output too.
    """
    is_deep = depth_of(pixel_format) > 8
    if not container.holds("h264"):
        return "av1" if is_deep and not has_alpha(pixel_format) else "vp9"
    if not is_deep or source_codec == "h264":
        return "h264"
    if source_codec == "av1" and container.holds("av1") and pixel_format.startswith("yuv420p"):
        return "av1"
    return "hevc"


def depth_of(pixel_format: str) -> int:
    """Return the bits per sample of a pixel format, or 8 if FFmpeg does not know it."""
    with suppress(ValueError):
        return max((component.bits for component in VideoFormat(pixel_format).components), default=8)
    return 8


def is_lossless(encoder: str) -> bool:
    """Return whether an encoder has no lossy mode."""
    codec = Codec(encoder, "w")
    return codec.lossless and not codec.lossy


def find_encoder(name: str, kind: str) -> Codec | None:
    """Return the encoder with this very name for ``video`` or ``audio``, or None if FFmpeg has none here."""
    codec = find_codec(name, "w")
    return codec if codec is not None and (codec.type, codec.name) == (kind, name) else None


def choose_encoder(output: Output, traits: VideoTraits | None = None) -> tuple[str, dict[str, str]]:
    """Return FFmpeg's encoder and its options for the encoding that was asked for.

    Parameters
    ----------
    output : Output
        Output with the options of the user; without a codec, `default_codec` chooses it. The size of its pictures
        limits the number of threads.
    traits : VideoTraits, optional
        Pixel format and codec of the source; without them, those of 8-bit pictures.

    Returns
    -------
    tuple
        Name of the encoder, and its options, with those that make it repeatable.

    Raises
    ------
    OptionError
        FFmpeg lacks the encoder, the container does not hold its codec, or it does not know an option.
    """
    traits = traits or VideoTraits()
    encoding = output.encoding
    pixel_format = encoding.pixel_format or traits.pixel_format
    asked = encoding.codec or default_codec(output.container, pixel_format, traits.codec)
    encoder = encoder_of(asked)
    codec = find_encoder(encoder.name, "video")
    if codec is None:
        raise OptionError(
            f"`codec={asked!r}` is neither known here nor the exact name of an FFmpeg encoder; "
            + choose_one(asked, encoders)
        )
    output.container.check_holds(
        encoder.name, output.path, f"`codec={asked!r}`", {common: each.name for common, each in encoders.items()}
    )
    _check_pixel_format(codec, encoding.pixel_format)
    options = _options_of_known(encoder, asked, encoding) if encoder.presets else _options_of_other(codec, encoding)
    _check_encoder_options(codec, encoding)
    more = repeatable_options(encoder, {*options, *dict(encoding.encoder_options)}, output.info)
    return encoder.name, _merged_options(options, (*more, *encoding.encoder_options))


def _check_encoder_options(codec: Codec, encoding: EncodeSettings) -> None:
    """Raise `OptionError` unless an encoder knows the options of its own that were asked for."""
    if not encoding.encoder_options:  # listing them takes milliseconds
        return
    generic = OptionFlags.ENCODING_PARAM | OptionFlags.VIDEO_PARAM
    common = {o.name for o in codec.create("video").supported_options.generic if o.flags & generic == generic}
    for option, _ in encoding.encoder_options:
        if option not in private_options(codec) | common:
            name = codec.name
            raise OptionError(
                f"`encoder_options={option}` is unknown to {name}; look it up with ffmpeg -h encoder={name}."
            )


def encodes_alpha(encoding: EncodeSettings, container: Container) -> bool:
    """Return whether the encoder, pixel format and container that were asked for can hold alpha; False if unknown."""
    asked = encoding.codec or default_codec(container, encoding.pixel_format or "yuv420p")
    encoder = encoder_of(asked)
    codec = find_encoder(encoder.name, "video")
    # libvpx stores alpha beside the picture
    if codec is None or (encoder in (VP8, VP9) and not container.matroska_elements):
        return False
    offered = pixel_formats(codec)
    if encoding.pixel_format is not None:
        return encoding.pixel_format in offered and has_alpha(encoding.pixel_format)
    return any(has_alpha(name) for name in offered)


def _options_of_known(known: Encoder, asked: str, encoding: EncodeSettings) -> dict[str, str]:
    """Return the options for an encoder of the table; raise `OptionError` for values that it does not accept."""
    crf = known.crf if encoding.crf is None else encoding.crf
    preset = encoding.preset or known.preset
    if not 0 <= crf <= known.largest_crf:
        raise OptionError(f"`crf` must be 0 to {known.largest_crf} for {asked}, not {crf}.")
    if preset not in known.presets:
        raise OptionError(f"`preset={preset!r}` is unknown to {asked}; {choose_one(preset, known.presets)}")
    options = {known.preset_option: preset, **dict(known.fixed_options)}
    if encoding.lossless:
        _check_lossless(asked, bool(known.lossless))
        return _merged_options(options, known.lossless)
    if encoding.bitrate is not None:
        return {**options, "b": str(encoding.bitrate)}
    # an encoder that is given a quality ignores these two
    says_another_aim = encoding.crf is None and {"b", "qp"} & dict(encoding.encoder_options).keys()
    return options if says_another_aim else {**options, "crf": str(crf)}


def _options_of_other(codec: Codec, encoding: EncodeSettings) -> dict[str, str]:
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
    if encoding.lossless and not is_lossless(codec.name):
        if "lossless" in known:
            options["lossless"] = "1"
        elif codec.name == X264_RGB.name:
            options.update(X264_RGB.lossless)
        else:
            _check_lossless(codec.name, codec.name.endswith("_nvenc"))
            options["tune"] = "lossless"
    return options


def _check_lossless(asked: str, can: bool) -> None:
    """Raise `OptionError` unless an encoder can encode losslessly."""
    if not can:
        able = [common for common, encoder in encoders.items() if encoder.lossless]
        raise OptionError(f"{asked} has no lossless mode for `lossless`; use {', '.join(able)} or ffv1.")


def _merged_options(options: dict[str, str], more: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return options updated with more; parameter lists (``x265-params``) are extended instead of replaced."""
    result = dict(options)
    for name, value in more:
        result[name] = f"{result[name]}:{value}" if name.endswith("-params") and name in result else value
    return result


def private_options(codec: Codec) -> set[str]:
    """Return the names of the private options of an encoder."""
    return {option.name for option in codec.create("video").supported_options.private}


def pixel_formats(codec: Codec) -> list[str]:
    """Return the pixel formats in memory that an encoder accepts, or an empty list if it does not list any."""
    names = [item.name for item in codec.video_formats or () if item.components]  # those of a GPU have no components
    opened = encoder_of(codec.name).alpha_formats
    return names if opened is None else [name for name in names if name in opened or not has_alpha(name)]


def _check_pixel_format(codec: Codec, asked: str | None) -> None:
    """Raise `OptionError` unless an encoder accepts a pixel format, if one was asked for."""
    if asked is None:
        return
    taken = pixel_formats(codec)
    if taken and asked not in taken:
        raise OptionError(f"{codec.name} does not take `pixel_format={asked!r}`; {choose_one(asked, taken)}")
    try:
        VideoFormat(asked)
    except ValueError:
        raise OptionError(f"`pixel_format={asked!r}` is no pixel format of FFmpeg; use one such as yuv420p.") from None


def repeatable_options(encoder: Encoder, given: Collection[str], info: ClipInfo) -> EncoderOptions:
    """Return the options with which an encoder makes the same packets on any number of cores, beside those `given`.

    The number of cores would decide how many threads an encoder has, and many cut pictures into other slices, search
    motion within other limits, or name the number in the stream.
    """
    usual = THREADS_FOR_LARGE_PICTURES if info.width * info.height > LARGE_PICTURE else ENCODER_THREADS
    threads = ("threads", str(encoder.threads or usual))
    if encoder == AV1 and not {"b", "maxrate"}.isdisjoint(given):
        return threads, ("svtav1-params", "lp=1")  # with more threads, it aims at a rate differently in every run
    return threads, *encoder.repeatable_options
