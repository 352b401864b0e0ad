"""FFmpeg as it is installed here: its version, and the codecs that it was built with."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import av
from av.codec.codec import UnknownCodecError


def pyav_version() -> str:
    """Return the version of PyAV."""
    return av.__version__


def ffmpeg_version() -> str:
    """Return the version of the FFmpeg that PyAV brings."""
    return av.ffmpeg_version_info


def missing_codecs(names: Iterable[str], mode: Literal["r", "w"]) -> list[str]:
    """Return those of some decoders (``r``) or encoders (``w``) that FFmpeg was built without.

    Examples
    --------
    >>> missing_codecs(["ffv1", "none-such"], "w")
    ['none-such']
    """
    return [name for name in names if not _exists(name, mode)]


def _exists(name: str, mode: Literal["r", "w"]) -> bool:
    try:
        av.Codec(name, mode)
    except UnknownCodecError:
        return False
    return True
