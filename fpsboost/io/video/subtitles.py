"""Text subtitles in the format of another container: decoded and encoded again, words and times kept."""

from __future__ import annotations

from typing import Any, cast

import av
import av.container
import av.error
from av.codec.codec import Properties
from av.subtitles.subtitle import AssSubtitle, SubtitleSet

formats = {"mp4": "mov_text", "mov": "mov_text", "matroska": "subrip", "webm": "webvtt"}
"""FFmpeg's name of the text format that each container is sure to hold."""


def is_text(stream: av.stream.Stream) -> bool:
    """Whether subtitles are text and no pictures of it."""
    context: Any = stream.codec_context
    if stream.type != "subtitle" or context is None:
        return False
    return Properties.TEXT_SUB in Properties(context.codec.properties)


class TextConverter:
    """Subtitles on their way into a stream of another text format.

    Parameters
    ----------
    stream : av.stream.Stream
        Subtitles that are text.
    output : av.container.OutputContainer
        Not started yet; gets a stream in the format of its container.
    container : str
        FFmpeg's name of it, a key of `formats`.
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
        """One packet in the other format; None where nothing is shown, or where it cannot be read."""
        try:
            lines: list[bytes] = [line.ass for line in cast(list[AssSubtitle], packet.decode())]
        except av.error.FFmpegError:
            return None
        if not lines:
            return None
        first, *more = lines
        # nine fields to a line, of which the last is the text
        text = b"\\N".join([first, *(line.split(b",", 8)[-1] for line in more)])
        result: av.Packet[Any] = self._encoder.encode_subtitle(SubtitleSet.create(text, 0, packet.duration or 0))
        result.stream, result.time_base = self.stream, packet.time_base
        result.pts, result.dts, result.duration = packet.pts, packet.dts, packet.duration
        return result
