"""Audio encoders: their names, the containers that hold their formats, and the audio that they accept."""

from __future__ import annotations

from collections.abc import Collection
from fractions import Fraction
from typing import Any

import av
import av.error
from av.codec.codec import UnknownCodecError

from fpsboost.errors import OptionError
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import containers, holds

COPY = "copy"
"""Value of ``--audio-codec`` that copies audio without re-encoding it."""

sound_encoders = {
    **{"aac": "aac", "opus": "libopus", "mp3": "libmp3lame", "ac3": "ac3", "eac3": "eac3"},
    **{"flac": "flac", "alac": "alac", "pcm": "pcm_s16le"},
}
"""FFmpeg's encoders by the common name of their format."""

defaults = {"mp4": "aac", "mov": "aac", "matroska": "libopus", "webm": "libopus"}
"""Encoder that is proposed for a container, and used for stretched audio: its format is the one all players support."""

BITRATE_PER_CHANNEL = 96_000
"""Bit rate per channel, bits per second, at which AAC and Opus are hard to distinguish from the source."""
OPUS_SAMPLE_RATE = 48_000
"""Output sample rate of Opus decoders, which does not depend on the encoded rate, Hz."""
STANDARD_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")
"""Standard channel layouts for one channel, two, ..."""

Traits = tuple[int, str, str]
"""Sample rate, sample format and channel layout of audio."""


def choose_sound_encoder(encoding: Encoding, container: str, name: str) -> str | None:
    """Return FFmpeg's encoder for the audio codec that was asked for, or None if audio is to be copied.

    Raises
    ------
    OptionError
        The codec is unknown, or not allowed in this container.
    """
    asked = encoding.audio_codec
    if asked is None or asked.lower() == COPY:
        return None
    encoder = sound_encoders.get(asked.lower(), asked)
    try:
        codec = av.Codec(encoder, "w")
    except UnknownCodecError:
        codec = None
    if codec is None or codec.type != "audio" or codec.name != encoder:
        raise OptionError(
            f"`audio_codec={asked!r}` is unknown here; use {', '.join(sound_encoders)}, {COPY}, or the exact name of "
            "an FFmpeg sound encoder."
        )
    if not holds(container, encoder):
        fitting = [friendly for friendly, each in sound_encoders.items() if holds(container, each)]
        others = [suffix for suffix, each in containers.items() if each != container and holds(each, encoder)]
        instead = f", or write {' or '.join(others)}" if others else ""
        raise OptionError(f"`audio_codec={asked!r}` cannot go into {name}; use {' or '.join(fitting)}{instead}.")
    return encoder


def friendly_name(encoder: str) -> str:
    """Return the name of an encoder as a value of ``--audio-codec``."""
    return next((friendly for friendly, each in sound_encoders.items() if each == encoder), encoder)


def traits_for(encoder: str, source: Traits, channels: int) -> Traits:
    """Return the source's sample rate, format and layout if the encoder supports them, else those that lose least.

    These are the next higher rate, and the standard layout of as many channels or else stereo. Lossless encoders get a
    format with at least the source's bits, or the most bits that they support; lossy ones get floats, which do not
    clip.

    Parameters
    ----------
    encoder : str
    source : (int, str, str)
        Sample rate, sample format and channel layout; see `named_layout`.
    channels : int
        Number of channels of the source.

    Raises
    ------
    UnknownCodecError
        There is no such encoder here.
    """
    codec = av.Codec(encoder, "w")
    rate, layout = _rate_for(codec, source[0]), source[2]
    target = rate, _format_for(codec, source[1])
    layouts = (layout, *STANDARD_LAYOUTS[channels - 1 : channels])
    return *target, next((each for each in layouts if _takes(encoder, (*target, each))), "stereo")


def named_layout(layout: str, channels: int) -> str:
    """Return the standard channel layout if `layout` gives only the number of channels, else `layout`."""
    says_nothing = layout.endswith("channels") or layout.endswith("channel")
    return STANDARD_LAYOUTS[channels - 1] if says_nothing and channels <= len(STANDARD_LAYOUTS) else layout


def is_lossless(encoder: str) -> bool:
    """Return whether an encoder is lossless."""
    codec = av.Codec(encoder, "w")
    return codec.lossless and not codec.lossy


def _rate_for(codec: av.Codec, rate: int) -> int:
    rates: Collection[int] = codec.audio_rates or ()
    if codec.canonical_name == "opus":
        return OPUS_SAMPLE_RATE
    return min((each for each in rates if each >= rate), default=max(rates, default=rate))


def _format_for(codec: av.Codec, source: str) -> str:
    offered = codec.audio_formats or [av.AudioFormat(source)]
    if codec.lossy:
        offered = [each for each in offered if each.name.startswith("flt")] or offered
    wanted = av.AudioFormat(source).bytes
    enough = [each for each in offered if each.bytes >= wanted]
    chosen = min(enough, key=_bytes) if enough else max(offered, key=_bytes)
    return chosen.name


def _bytes(format: av.AudioFormat) -> int:
    return format.bytes


def _takes(encoder: str, traits: Traits) -> bool:
    context: Any = av.CodecContext.create(encoder, "w")
    try:
        context.sample_rate, context.format, context.layout = traits
        context.time_base = Fraction(1, traits[0])
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
