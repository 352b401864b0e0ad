"""Which of a file's streams another container takes, asked before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import islice
from typing import Any

import av
import av.container
import av.error

from fpsboost.errors import OutputError
from fpsboost.media.excerpt import Window
from fpsboost.media.video.encoding import Encoding, containers, holds, suffixes_holding
from fpsboost.media.video.source import VideoSource, open_video
from fpsboost.media.video.stretched_sound import can_stretch
from fpsboost.media.video.subtitles import is_text

SOON = 200
"""Packets among which each stream's first is looked for."""


def check_streams(
    source: VideoSource, encoding: Encoding, encoder: str, container: str, name: str, window: Window | None = None
) -> None:
    """Raise `OutputError` where the container cannot hold the source's sound or subtitles."""
    with open_video(source.path, source.info.name) as file:
        streams = [stream for stream in file.streams if is_wanted(stream, encoding)]
        if stretches(window):
            for stream in streams:
                if stream.type == "audio" and not can_stretch(stream, container):
                    raise OutputError(
                        f"The {codec_of(stream)} sound of {source.info.name} cannot be stretched here; leave it out "
                        "with --slow-motion-sound drop."
                    )
            streams = [stream for stream in streams if stream.type != "audio"]
        strict = [stream for stream in streams if not is_text(stream)]
        samples = first_packets(file, strict)
        codecs = [stream.codec_context.codec.name if stream.codec_context else "" for stream in strict]
        for stream in strict:
            if fits(container, stream, samples.get(stream.index)):
                continue
            what, option = ("sound", "--no-audio") if stream.type == "audio" else ("subtitles", "--no-subtitles")
            holding = suffixes_holding([*codecs, encoder] if encoding.codec else codecs)
            others = [suffix for suffix in holding if containers[suffix] != container]
            instead = f"write {' or '.join(others)}, or " if others else ""
            raise OutputError(
                f"{name} cannot hold the {codec_of(stream)} {what} of {source.info.name}; {instead}leave the {what} "
                f"out with {option}."
            )


def is_wanted(stream: av.stream.Stream, encoding: Encoding) -> bool:
    """Whether a stream is sound or subtitles that are to be kept."""
    return (stream.type == "audio" and encoding.audio) or (stream.type == "subtitle" and encoding.subtitles)


def stretches(window: Window | None) -> bool:
    """Whether sound has to last longer or shorter than it does."""
    return window is not None and window.stretch != 1


def first_packets(file: av.container.InputContainer, streams: Sequence[av.stream.Stream]) -> dict[int, bytes]:
    """A packet of each stream by its number, where one comes soon; subtitles may come late."""
    found: dict[int, bytes] = {}
    if not streams:
        return found
    with suppress(av.error.FFmpegError):
        for packet in islice(file.demux(streams), SOON):
            if packet.size:
                found.setdefault(packet.stream.index, bytes(packet))
            if len(found) == len(streams):
                break
    return found


def fits(container: str, stream: av.stream.Stream, sample: bytes | None) -> bool:
    """Whether a container holds a stream as it is."""
    context: Any = stream.codec_context
    return context is not None and holds(container, context.codec.name) and _takes(container, stream, sample)


def codec_of(stream: av.stream.Stream) -> str:
    """FFmpeg's name of a stream's format."""
    context: Any = stream.codec_context
    return str(context.codec.canonical_name) if context is not None else "unknown"


def kind_of(stream: av.stream.Stream) -> str:
    """Say what a stream is that has no codec: ``data, klv``, ``attachment, font.ttf``."""
    tags = {key.lower(): value for key, value in stream.metadata.items()}
    name = tags.get("filename") if stream.type == "attachment" else getattr(stream, "name", None)
    more = name or tags.get("handler_name")
    return f"{stream.type}, {more}" if more else stream.type


def keeps_data(container: str, stream: av.stream.Stream) -> bool:
    """Whether a container holds a data stream so that it is known again: tried, since lists of formats say too much."""
    kind = getattr(stream, "name", None)
    if kind is None:
        return False
    file = BytesIO()
    try:
        with av.open(file, "w", format=container) as probe:
            target = probe.add_stream_from_template(stream)
            probe.start_encoding()
            packet = av.Packet(bytes(64))
            packet.stream, packet.pts, packet.dts, packet.duration = target, 0, 0, 1
            packet.time_base = target.time_base or Fraction(1)
            probe.mux(packet)
        file.seek(0)
        with av.open(file, "r") as again:
            return [each.name for each in again.streams.data] == [kind]
    except (av.error.FFmpegError, ValueError):
        return False


def _takes(container: str, stream: av.stream.Stream, sample: bytes | None) -> bool:
    """Whether a container takes this very stream: some names are in its list and still refused.

    Tried with a packet of the stream, since a muxer may have to rewrite it: sound in MPEG transport streams, say.
    """
    try:
        with av.open(BytesIO(), "w", format=container) as probe:
            target = probe.add_stream_from_template(stream)
            probe.start_encoding()
            packet = av.Packet(sample or bytes(64))
            packet.stream, packet.pts, packet.dts, packet.duration = target, 0, 0, 1
            packet.time_base = target.time_base or Fraction(1)
            probe.mux(packet)
    except (av.error.FFmpegError, ValueError):
        return False
    return True
