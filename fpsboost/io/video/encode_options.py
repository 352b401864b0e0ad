"""Options of the user for encoding, and for the streams that are carried over."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Annotated, Self

from fpsboost.errors import OptionError
from fpsboost.media import EncoderOptions, EncodeSettings
from fpsboost.options import Checked, Range, option

BitRate = Annotated[int, Range(1000, 2_000_000_000, unit=" bits per second")]


def parse_bitrate(text: str, option: str = "`bitrate`") -> int:
    """Parse a bit rate in bits per second, with an optional suffix k or M; messages name it by `option`."""
    match = re.fullmatch(r"([0-9]{1,12}(?:\.[0-9]{1,12})?)([kKmM]?)", text.strip())
    if match is None:
        raise OptionError(f"{option} {text!r} is no number of bits per second; write it like 8M, 1.5M or 800k.")
    return round(Fraction(match[1]) * {"": 1, "k": 1000, "m": 1_000_000}[match[2].lower()])


def parse_encoder_options(texts: Sequence[str], option: str = "`encoder_options`") -> EncoderOptions:
    """Split options of the form ``key=value``; messages name them by `option`."""
    texts = [texts] if isinstance(texts, str) else texts
    pairs: list[tuple[str, str]] = []
    for text in texts:
        name, _, value = text.partition("=")
        if not name.strip() or not value:
            raise OptionError(f"{option} {text!r} is not of the form key=value; write it like tune=film.")
        pairs.append((name.strip(), value))
    return tuple(pairs)


def parse_streams(text: str, option: str = "`streams`") -> tuple[int, ...]:
    """Parse numbers of streams with commas between; messages name them by `option`."""
    if re.fullmatch(r"\s*[0-9]{1,9}\s*(,\s*[0-9]{1,9}\s*)*", text) is None:
        raise OptionError(f"{option} {text!r} is no list of numbers; write it like 1,3.")
    return tuple(int(number) for number in text.split(","))


@dataclass(frozen=True)
class Encoding(Checked, EncodeSettings):
    """Options for encoding, and for the streams that are carried over.

    Values are checked, and texts read, as on the command line; `EncodeSettings` describes them.

    Raises
    ------
    OptionError
        Two options contradict each other, or a value is never valid.
    """

    codec: str | None = option(None, "h264, hevc, vp9, av1 or any FFmpeg encoder.")
    crf: int | None = option(None, "Constant rate factor; lower is better.")
    preset: str | None = option(None, "Encoder speed, for example slow or veryfast.")
    bitrate: BitRate | None = option(None, "Bits per second instead of `crf`: 8M, 800k.", parse=parse_bitrate)
    lossless: bool = option(False, "Encode without loss.")
    pixel_format: str | None = option(None, "Pixel format: yuv420p10le...; else the input's.", flag="pix-fmt")
    encoder_options: EncoderOptions = option(
        (),
        "Option of the encoder itself; repeatable.",
        flag="encoder-option",
        metavar="KEY=VALUE",
        parse=parse_encoder_options,
    )
    audio_codec: str | None = option(None, "Audio encoder: aac, opus...; else copy; opus in .webm.", group="Streams")
    audio_bitrate: BitRate | None = option(
        None, "Bits per second of encoded audio: 192k.", parse=parse_bitrate, group="Streams"
    )
    audio: bool = option(True, "Drop the audio.", flag="no-audio", group="Streams")
    subtitles: bool = option(True, "Drop the subtitles.", flag="no-subtitles", group="Streams")
    streams: tuple[int, ...] | None = option(
        None, "Audio and subtitles kept, as probe counts: 1,3.", metavar="NUMBERS", parse=parse_streams, group="Streams"
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        EncodeSettings.__post_init__(self)

    def without_audio(self) -> Self:
        """Return the options of the same output without audio."""
        return replace(self, audio=False, audio_codec=None, audio_bitrate=None)
