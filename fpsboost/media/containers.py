"""Containers that are written: a record of each, with what FFmpeg does not tell of it, and which codecs it holds."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from typing import Literal

import av

from fpsboost.media.errors import OptionError
from fpsboost.media.pyav import REFUSALS, trial_file

MATROSKA_TICK = Fraction(1, 1000)
"""Time base of Matroska and WebM, seconds per tick."""


@dataclass(frozen=True)
class Container:
    """Container that is written: FFmpeg's muxer, and what that does not tell of the files it makes."""

    name: str
    """FFmpeg's name of the muxer."""
    suffixes: tuple[str, ...]
    """Suffixes of its files."""
    sound_encoder: str
    """FFmpeg's encoder that is proposed for sound, and used for stretched sound: one that all players support."""
    text_format: str
    """FFmpeg's name of the format in which text subtitles are stored."""
    exact_times: bool = False
    """Whether its time base can be chosen, and edit lists place its streams; elsewhere a tick is `MATROSKA_TICK`."""
    matroska_elements: bool = False
    """Whether it has Matroska's elements for alpha, for stereo modes, and for languages with a region."""
    codec_list: Literal["right", "incomplete", "too long"] = "right"
    """Whether FFmpeg's list of its codecs is right, lacks some, or has some that the muxer rejects, as that of .mov."""
    replaces_sound: bool = False
    """Whether sound that it does not hold is encoded anew unasked, as it holds none of what films usually have."""
    needs_named_layouts: bool = False
    """Whether PCM needs a named channel layout."""
    keeps_attachments: bool = False
    """Whether it keeps attached files, such as fonts, and cover pictures among them."""
    keeps_covers: bool = False
    """Whether it keeps cover pictures as streams."""

    def holds(self, codec: str) -> bool:
        """Return whether the container holds the codec of an encoder or decoder."""
        with av.open(BytesIO(), "w", format=self.name) as probe:
            listed = codec in probe.supported_codecs
        # the header of DV cannot be written without a picture
        if not listed or self.codec_list != "too long" or codec == "dvvideo":
            return listed
        with suppress(*REFUSALS), trial_file() as path, av.open(str(path), "w", format=self.name) as probe:
            probe.add_mux_stream(codec, rate=48000, width=64, height=64, time_base=Fraction(1, 48000))
            probe.start_encoding()
            return True
        return False

    def check_holds(self, codec: str, name: str, option: str, others: Mapping[str, str]) -> None:
        """Raise `OptionError` unless the container holds a codec that an option names.

        The message names the file, and those of `others`, codecs by their common names, that it holds.
        """
        if self.holds(codec):
            return
        fitting = [common for common, encoder in others.items() if self.holds(encoder)]
        suffixes = [suffix for suffix, other in containers_by_suffix.items() if other.holds(codec)]
        instead = f", or write {' or '.join(suffixes)}" if suffixes else ""
        raise OptionError(f"{option} cannot go into {name}; use {' or '.join(fitting)}{instead}.")


MP4 = Container(
    "mp4", (".mp4", ".m4v"), "aac", "mov_text", exact_times=True, needs_named_layouts=True, keeps_covers=True
)
MOV = Container("mov", (".mov",), "aac", "mov_text", exact_times=True, codec_list="too long")
MATROSKA = Container(
    "matroska", (".mkv",), "libopus", "subrip", matroska_elements=True, codec_list="incomplete", keeps_attachments=True
)
WEBM = Container("webm", (".webm",), "libopus", "webvtt", matroska_elements=True, replaces_sound=True)

containers_by_suffix = {suffix: container for container in (MP4, MOV, MATROSKA, WEBM) for suffix in container.suffixes}
"""Containers by the suffixes of their files."""

VIDEO_SUFFIXES = tuple(containers_by_suffix)
"""Suffixes of the video files that can be written."""
