"""Convert text subtitles to the format of another container; their text and times are kept."""

from __future__ import annotations

from typing import Any, cast

import av
import av.container
import av.error
from av.codec.codec import Properties
from av.subtitles.subtitle import AssSubtitle, SubtitleSet

formats = {"mp4": "mov_text", "mov": "mov_text", "matroska": "subrip", "webm": "webvtt"}
"""FFmpeg's name of a text subtitle format that each container supports."""


def is_text(stream: av.stream.Stream) -> bool:
    """Return whether a stream is text subtitles rather than bitmap subtitles."""
    context: Any = stream.codec_context
    if stream.type != "subtitle" or context is None:
        return False
    return Properties.TEXT_SUB in Properties(context.codec.properties)


class TextConverter:
    """Converter of subtitles into a stream of another text format.

    Parameters
    ----------
    stream : av.stream.Stream
        Text subtitles.
    output : av.container.OutputContainer
        Output whose header is not written yet; a stream in the container's format is added to it.
    container : str
        FFmpeg's name of the output's container, a key of `formats`.
    """

    def __init__(self, stream: av.stream.Stream, output: av.container.OutputContainer, container: str) -> None:
        source: Any = stream.codec_context
        source.open(strict=False)
        target: Any = output.add_stream(formats[container])
        self.stream: av.stream.Stream = target
        target.time_base = stream.time_base
        self._encoder = target.codec_context
        self._encoder.time_base = stream.time_base
        self._encoder.subtitle_header = source.subtitle_header

    def converted(self, packet: av.Packet[Any]) -> av.Packet[Any] | None:
        """Return one packet in the other format, or None if it shows nothing or cannot be decoded."""
        try:
            lines: list[bytes] = [line.ass for line in cast(list[AssSubtitle], packet.decode())]
        except av.error.FFmpegError:
            return None
        if not lines:
            return None
        first, *more = lines
        # an ASS line has nine fields, of which the last is the text
        text = b"\\N".join([first, *(line.split(b",", 8)[-1] for line in more)])
        result: av.Packet[Any] = self._encoder.encode_subtitle(SubtitleSet.create(text, 0, packet.duration or 0))
        result.stream, result.time_base = self.stream, packet.time_base
        result.pts, result.dts, result.duration = packet.pts, packet.dts, packet.duration
        return result
