"""Encoders of sound: what they are called, which containers take them, and the sound that they take."""

from __future__ import annotations

from collections.abc import Collection
from fractions import Fraction
from typing import Any

import av
import av.error
from av.codec.codec import UnknownCodecError

from fpsboost.errors import OptionError
from fpsboost.io.video.encoding import Encoding, containers, holds

COPY = "copy"
"""Value of ``--audio-codec`` that encodes nothing anew."""

sound_encoders = {
    **{"aac": "aac", "opus": "libopus", "mp3": "libmp3lame", "ac3": "ac3", "eac3": "eac3"},
    **{"flac": "flac", "alac": "alac", "pcm": "pcm_s16le"},
}
"""FFmpeg's encoders by the name people use for the format."""

defaults = {"mp4": "aac", "mov": "aac", "matroska": "libopus", "webm": "libopus"}
"""The encoder that is proposed for a container, and stretches its sound: the one that its players are sure to have."""

BITRATE = 96_000
"""Bits per second for each channel, with which AAC and Opus are hard to tell from the source."""
RATE_OF_OPUS = 48_000
"""Decoders of Opus give this rate whatever was encoded."""
STANDARD_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")
"""The usual speakers for one channel, two, ..."""

Traits = tuple[int, str, str]
"""Rate, sample format and channel layout of sound."""


def choose_sound_encoder(encoding: Encoding, container: str, name: str) -> str | None:
    """Find FFmpeg's encoder for the sound that was asked for; None where sound is to be copied.

    Raises
    ------
    OptionError
        Unknown, or not allowed in this container.
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
            f"--audio-codec {asked} is unknown here; use {', '.join(sound_encoders)}, {COPY}, or the exact name of an "
            "FFmpeg sound encoder."
        )
    if not holds(container, encoder):
        fitting = [friendly for friendly, each in sound_encoders.items() if holds(container, each)]
        others = [suffix for suffix, each in containers.items() if each != container and holds(each, encoder)]
        instead = f", or write {' or '.join(others)}" if others else ""
        raise OptionError(f"--audio-codec {asked} cannot go into {name}; use {' or '.join(fitting)}{instead}.")
    return encoder


def friendly_name(encoder: str) -> str:
    """What ``--audio-codec`` calls an encoder."""
    return next((friendly for friendly, each in sound_encoders.items() if each == encoder), encoder)


def traits_for(encoder: str, source: Traits, channels: int) -> Traits:
    """The source's rate, precision and layout where the encoder takes them, else the nearest that lose least.

    That is the next higher rate, the usual layout of as many channels, or stereo. Lossless encoders keep 16 bits and
    get all the bits they can hold for more; the others get floats, which nothing clips.

    Parameters
    ----------
    encoder : str
    source : (int, str, str)
        Rate, sample format and layout; see `named_layout`.
    channels : int

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
    """A layout with names of speakers, where the file gives only their number."""
    says_nothing = layout.endswith("channels") or layout.endswith("channel")
    return STANDARD_LAYOUTS[channels - 1] if says_nothing and channels <= len(STANDARD_LAYOUTS) else layout


def is_lossless(encoder: str) -> bool:
    """Whether decoding gives back what was encoded."""
    codec = av.Codec(encoder, "w")
    return codec.lossless and not codec.lossy


def _rate_for(codec: av.Codec, rate: int) -> int:
    rates: Collection[int] = codec.audio_rates or ()
    if codec.canonical_name == "opus":
        return RATE_OF_OPUS
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
