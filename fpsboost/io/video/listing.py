"""List the streams of a file with their properties."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import av

from fpsboost.io.stream_info import VideoFile
from fpsboost.io.video.demuxer import is_cover_art, open_video
from fpsboost.io.video.fitting import first_packets, fits, is_text, keeps_data
from fpsboost.io.video.tags import find_timecode


@dataclass(frozen=True)
class StreamFacts:
    """Properties of one stream of a file.

    Attributes
    ----------
    index : int
        Number of the stream in the file.
    kind : str
        ``video``, ``audio``, ``subtitle``, ``cover``, ``data`` or ``attachment``.
    codec : str or None
        FFmpeg's name of the format.
    language, title : str or None
        Language and title tags.
    details : str
        Frame size, or sample rate and channel layout.
    carries_over : bool
        Whether an .mp4 made of the video stream that is read holds this stream.
    """

    index: int
    kind: str
    codec: str | None
    language: str | None
    title: str | None
    details: str
    carries_over: bool


def list_streams(file: VideoFile) -> list[StreamFacts]:
    """Return the properties of all streams in a file."""
    with open_video(file.path, file.name) as container:
        streams = list(container.streams)
        samples = first_packets(container, [each for each in streams if each.type in ("audio", "subtitle")])
        return [_facts_of(each, file.stream_index, samples.get(each.index)) for each in streams]


def _facts_of(stream: av.stream.Stream, converted: int, sample: bytes | None) -> StreamFacts:
    context: Any = stream.codec_context
    kind: str = "cover" if stream.type == "video" and is_cover_art(stream) else stream.type
    details = ""
    if stream.type == "video" and context:
        details = f"{context.width}x{context.height}"
    elif stream.type == "audio" and context:
        details = f"{context.sample_rate} Hz, {context.layout.name}"
    if kind in ("audio", "subtitle"):
        carries_over = fits("mp4", stream, sample) or is_text(stream)
    elif kind == "cover":
        carries_over = stream.name in ("png", "mjpeg")
    elif kind == "data":
        carries_over = bool(find_timecode(stream.metadata)) or keeps_data("mp4", stream)
    else:
        carries_over = stream.index == converted
    return StreamFacts(
        stream.index,
        kind,
        context.codec.canonical_name if context else None,
        stream.metadata.get("language"),
        stream.metadata.get("title", stream.metadata.get("name")),
        details,
        carries_over,
    )
