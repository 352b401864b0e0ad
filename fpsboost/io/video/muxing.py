"""Open FFmpeg's muxers so that they accept every codec that their container can hold.

PyAV looks a codec up in the muxer's list before it adds a stream. Matroska's list names only codecs with a Matroska
codec ID of their own, and omits those that Matroska holds by their Windows codec tag (Windows Media Audio, mu-law,
ADPCM). FFmpeg's tee muxer has no list; with one file as its output, it passes all packets on to the muxer of that file,
which accepts or rejects the codec.
"""

from __future__ import annotations

import re
from pathlib import Path

import av
import av.container

INCOMPLETE_LIST_CONTAINERS = ("matroska",)
"""Containers that hold more codecs than their list names."""

TEE_SPECIAL_CHARACTERS = re.compile(r"([\\'|\s])")
"""Characters with a special meaning to the tee muxer in a path."""


def open_muxer(path: Path, container: str, *, any_codec: bool = False) -> av.container.OutputContainer:
    """Open a file for muxing.

    Parameters
    ----------
    path : Path
    container : str
        FFmpeg's name.
    any_codec : bool
        Let only the container's muxer decide which codecs it accepts, through the tee muxer, which drops chapters.

    Raises
    ------
    av.error.FFmpegError, OSError
        The file cannot be written.
    """
    # FFmpeg would parse the part of a relative path before a colon as a protocol
    place = str(path.absolute())
    if any_codec:
        escaped = TEE_SPECIAL_CHARACTERS.sub(r"\\\1", place)
        return av.open(f"[f={container}]{escaped}", "w", format="tee")
    options = {"movflags": "+faststart"} if container in ("mp4", "mov") else {}
    return av.open(place, "w", format=container, container_options=options)
