"""Facts on a video file for people: how it looks, which streams it has, and which of these an .mp4 takes over."""

import math
import os
from dataclasses import dataclass
from typing import Any

from fpsboost.media.clip import Clip
from fpsboost.media.containers import MP4
from fpsboost.media.demuxer import VideoFile, is_cover_art
from fpsboost.media.info import ClipInfo, Reading
from fpsboost.media.remarks import Remarks
from fpsboost.media.stream_mapping import first_packets, fits, headers_in, is_text, keeps_data
from fpsboost.media.tags import find_timecode
from fpsboost.media.traits import VideoTraits, matrices, primaries, tag_name, transfers


@dataclass(frozen=True)
class Look:
    """Format and colour tags of a video."""

    pixel_format: str
    """FFmpeg's name."""
    pixel_aspect: str
    """Width of a pixel over its height."""
    rotation: float
    """Degrees clockwise for display."""
    matrix: str | None
    primaries: str | None
    transfer: str | None
    """Colour tags, None if unspecified."""
    full_range: bool
    """Black is 0 rather than 16 (in 8 bits)."""


@dataclass(frozen=True)
class StreamFacts:
    """Properties of one stream of a file; details are its frame size or its sound format.

    The kind is ``video``, ``audio``, ``subtitle``, ``cover``, ``data`` or ``attachment``. `carries_over` says whether
    an .mp4 holds it too.
    """

    index: int
    kind: str
    codec: str | None
    language: str | None
    title: str | None
    details: str
    carries_over: bool


@dataclass(frozen=True)
class Facts:
    """What a video file holds, by its headers and its first picture."""

    info: ClipInfo
    """Size, frame rate and length."""
    look: Look
    """Format and colour tags of the pictures."""
    streams: list[StreamFacts]
    """All streams of the file."""
    remarks: Remarks
    """What reading it loses or assumes."""


def inspect(path: str | os.PathLike[str], reading: Reading | None = None) -> Facts:
    """Return what a video file holds, after decoding its first picture.

    Parameters
    ----------
    path : str or os.PathLike
        Video file.
    reading : Reading, optional
        How it is read.

    Returns
    -------
    Facts
        Its properties, and those of all its streams.

    Raises
    ------
    InputError
        The file cannot be read, holds no video, or is encrypted from its beginning.
    OptionError
        `reading` names a stream that is no video.
    """
    with Clip(path, reading or Reading()) as clip:
        return Facts(clip.info, look_of(clip.traits), list_streams(clip.file), clip.remarks)


def look_of(traits: VideoTraits) -> Look:
    """Describe format and colour tags by their names."""
    matrix = traits.display_matrix
    rotation = 0.0 if matrix is None else round(math.degrees(math.atan2(matrix[1], matrix[0])), 1) % 360
    return Look(
        pixel_format=traits.pixel_format,
        pixel_aspect=str(traits.sample_aspect_ratio or 1).replace("/", ":"),
        rotation=rotation,
        matrix=tag_name(matrices, traits.tagged_color_space),
        primaries=tag_name(primaries, traits.color_primaries),
        transfer=tag_name(transfers, traits.color_transfer),
        full_range=traits.full_range,
    )


def list_streams(file: VideoFile) -> list[StreamFacts]:
    """Return the properties of all streams in a file."""
    whole = headers_in(file)
    listed = list[StreamFacts]()
    with file.open() as container:
        streams: list[Any] = list(container.streams)
        samples = first_packets(container, [stream for stream in streams if stream.type in ("audio", "subtitle")])
        for stream in streams:
            context = stream.codec_context
            tags = stream.metadata
            number = stream.index
            kind: str = "cover" if stream.type == "video" and is_cover_art(stream) else stream.type
            details = ""
            carries_over = number == file.stream_index
            if stream.type == "video" and context:
                details = f"{context.width}x{context.height}"
            elif stream.type == "audio" and context:
                details = f"{context.sample_rate} Hz, {context.layout.name}"
            if kind in ("audio", "subtitle"):
                carries_over = (whole[number][0] and fits(MP4, stream, samples.get(number))) or is_text(stream)
            elif kind == "cover":
                carries_over = stream.name in ("png", "mjpeg")
            elif kind == "data":
                carries_over = bool(find_timecode(tags)) or keeps_data(MP4, stream)
            codec = context.codec.canonical_name if context else None
            title = tags.get("title", tags.get("name"))
            listed.append(StreamFacts(number, kind, codec, tags.get("language"), title, details, carries_over))
    return listed
