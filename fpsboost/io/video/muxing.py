"""FFmpeg's muxers, opened so that they take every codec that they really hold.

PyAV looks a codec up in a list before it makes a stream. Matroska's list names only what has a Matroska name of its
own, and leaves out what Matroska holds by its name in Windows (Windows Media Audio, mu-law, ADPCM). FFmpeg's tee muxer
has no list; led to one file, it hands everything on to the muxer of that file, which takes it or refuses.
"""

from __future__ import annotations

import re
from pathlib import Path

import av
import av.container

WITH_SHORT_LISTS = ("matroska",)
"""Containers that hold more than their list says."""

NEEDS_ESCAPE = re.compile(r"([\\'|\s])")
"""What means something to the tee muxer in a path."""


def open_muxer(path: Path, container: str, *, any_codec: bool = False) -> av.container.OutputContainer:
    """Open a file for muxing.

    Parameters
    ----------
    path : Path
    container : str
        FFmpeg's name.
    any_codec : bool
        Leave it to the container's muxer alone which codecs it takes. Chapters are lost on this way.

    Raises
    ------
    av.error.FFmpegError, OSError
        It cannot be written.
    """
    # FFmpeg would take a colon in a relative path for a protocol
    place = str(path.absolute())
    if any_codec:
        escaped = NEEDS_ESCAPE.sub(r"\\\1", place)
        return av.open(f"[f={container}]{escaped}", "w", format="tee")
    options = {"movflags": "+faststart"} if container in ("mp4", "mov") else {}
    return av.open(place, "w", format=container, container_options=options)
