"""Sound encoders, and the sample rates, formats and layouts that they take."""

from fractions import Fraction
from operator import attrgetter
from typing import Any

from av import AudioFormat, AudioLayout, Codec, CodecContext

from fpsboost.media.encoding import find_encoder, is_lossless
from fpsboost.media.errors import OptionError
from fpsboost.media.output import Output
from fpsboost.media.pyav import REFUSALS

sound_encoders = {"aac": "aac", "opus": "libopus", "mp3": "libmp3lame", "ac3": "ac3", "eac3": "eac3"}


sound_encoders |= {"flac": "flac", "alac": "alac", "pcm": "pcm_s16le"}
"""FFmpeg's encoders by the common name of their format."""


BITRATE_PER_CHANNEL = 96_000
"""Bit rate per channel, bits per second, at which AAC and Opus are hard to distinguish from the source."""


OPUS_SAMPLE_RATE = 48_000  # output sample rate of Opus decoders, which does not depend on the encoded rate, Hz


STANDARD_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")
"""Standard channel layouts for one channel, two, ..."""


Traits = tuple[int, str, str]
"""Sample rate, sample format and channel layout of audio."""


def choose_sound_encoder(output: Output) -> str | None:
    """Return FFmpeg's encoder for the audio codec that was asked for, or None if audio is to be copied."""
    asked = output.encoding.audio_codec
    if asked is None or asked.lower() == "copy":
        return None
    encoder = sound_encoders.get(asked.lower(), asked)
    if find_encoder(encoder, "audio") is None:
        raise OptionError(
            f"`audio_codec={asked!r}` is unknown here; use {', '.join(sound_encoders)}, copy, or the exact name of an "
            "FFmpeg sound encoder."
        )
    if output.encoding.audio_bitrate is not None and is_lossless(encoder):
        raise OptionError(f"`audio_codec={asked!r}` is lossless and takes no `audio_bitrate`; leave one of them out.")
    output.container.check_holds(encoder, output.path, f"`audio_codec={asked!r}`", sound_encoders)
    return encoder


def traits_for(encoder: str, source: Traits) -> Traits:
    """Return the source's sample rate, format and layout if the encoder supports them, else those that lose least.

    These are the next higher rate, the standard layout of as many channels or else stereo, and a format with at least
    the source's bits, or floats for a lossy encoder, which do not clip.
    """
    codec = Codec(encoder, "w")
    rates = codec.audio_rates or ()
    rate = min((higher for higher in rates if higher >= source[0]), default=max(rates, default=source[0]))
    offered = codec.audio_formats or [AudioFormat(source[1])]
    if codec.lossy:
        offered = [format for format in offered if format.name.startswith("flt")] or offered
    size = attrgetter("bytes")
    enough = [format for format in offered if format.bytes >= AudioFormat(source[1]).bytes]
    format = str((min(enough, key=size) if enough else max(offered, key=size)).name)
    target = OPUS_SAMPLE_RATE if codec.canonical_name == "opus" else rate, format
    channels = AudioLayout(source[2]).nb_channels
    layouts = (source[2], *STANDARD_LAYOUTS[channels - 1 : channels])
    return *target, next((name for name in layouts if _takes(encoder, (*target, name))), "stereo")


def named_layout(layout: AudioLayout) -> str:
    """Return the name of a layout; of one that gives only the number of channels, that of the standard layout."""
    says_nothing = layout.name.endswith(("channels", "channel")) and layout.nb_channels <= len(STANDARD_LAYOUTS)
    return STANDARD_LAYOUTS[layout.nb_channels - 1] if says_nothing else layout.name


def _takes(encoder: str, traits: Traits) -> bool:
    """Return whether an encoder opens with this sample rate, format and layout."""
    context: Any = CodecContext.create(encoder, "w")
    try:
        context.sample_rate, context.format, context.layout = traits
        context.time_base = Fraction(1, traits[0])
        context.open()
    except REFUSALS:
        return False
    return True
