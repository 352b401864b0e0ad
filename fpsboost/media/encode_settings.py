"""What is asked for of an encoder, and which other streams are carried over, as plain data."""

from __future__ import annotations

from dataclasses import dataclass, fields

from fpsboost.media.errors import OptionError


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
    audio, subtitles : bool
        Keep the source's audio and subtitles.
    streams : tuple of int, optional
        Numbers of the streams of audio and subtitles to keep; by default all that can be kept.

    Raises
    ------
    OptionError
        Two options contradict each other.
    """

    codec: str | None = None
    crf: int | None = None
    preset: str | None = None
    bitrate: int | None = None
    lossless: bool = False
    pixel_format: str | None = None
    encoder_options: tuple[tuple[str, str], ...] = ()
    audio_codec: str | None = None
    audio: bool = True
    subtitles: bool = True
    streams: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.crf is not None and self.bitrate is not None:
            raise OptionError("`crf` and `bitrate` contradict each other; give one of them.")
        if self.lossless and (self.crf, self.bitrate) != (None, None):
            other = "`crf`" if self.bitrate is None else "`bitrate`"
            raise OptionError(f"`lossless` and {other} contradict each other; give one of them.")
        if self.audio_codec is not None and not self.audio:
            raise OptionError("`audio_codec` and `audio=False` contradict each other; give one of them.")
        names = [name for name, _ in self.encoder_options]
        for name in names:
            if names.count(name) > 1:
                raise OptionError(f"`encoder_options={name}` is given twice; give it once.")

    @property
    def given(self) -> list[str]:
        """Names of the options that differ from the defaults, without those that leave out streams."""
        asked = [field for field in fields(self) if field.default is not True]
        return [f"`{field.name}`" for field in asked if getattr(self, field.name) != field.default]
