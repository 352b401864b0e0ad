"""Choose the video stream of a file that is read."""

from __future__ import annotations

import av
import av.container
import av.stream

from fpsboost.errors import InputError, OptionError

STILL_CODECS = ("png", "mjpeg", "bmp", "gif", "tiff", "webp")

DEFAULT_STREAM_SCORE = 5_000_000
"""Score of the default stream's flag, pixels, as in FFmpeg."""


def choose_video(container: av.container.InputContainer, name: str, wanted: int | None) -> av.VideoStream:
    """Choose a video stream: the one asked for, or the one that FFmpeg considers the best.

    That is the largest one, where the default flag outweighs all but very large sizes; among equals, the first.

    Parameters
    ----------
    container : av.container.InputContainer
    name : str
        Name of the file in messages.
    wanted : int or None
        Number of a stream in the file.

    Raises
    ------
    InputError
        There is no video stream, or it cannot be decoded here.
    OptionError
        There is no video stream with that number.
    """
    videos = [stream for stream in container.streams.video if not is_cover_art(stream)]
    if not videos:
        raise InputError(f"{name} has no video stream; name a file that has one.")
    if wanted is not None:
        stream = next((stream for stream in videos if stream.index == wanted), None)
        if stream is None:
            listed = ", ".join(f"{each.index} ({described(each)})" for each in videos)
            raise OptionError(f"`stream={wanted}` is no video stream of {name}; choose one of {listed}.")
    else:
        stream = max(videos, key=_score)
    if stream.codec_context is None:
        raise InputError(f"{name} uses a video codec that cannot be decoded here; convert it to H.264 first.")
    return stream


def left_out_remarks(container: av.container.InputContainer, chosen: av.VideoStream, name: str) -> list[str]:
    """Return the remarks on the video streams that are not read."""
    others = [
        f"stream {stream.index} ({described(stream)})"
        for stream in container.streams.video
        if stream.index != chosen.index and not is_cover_art(stream)
    ]
    if not others:
        return []
    return [
        f"{name} has more than one video stream; stream {chosen.index} ({described(chosen)}) was taken, left out: "
        f"{', '.join(others)}."
    ]


def is_cover_art(stream: av.stream.Stream) -> bool:
    """Return whether a video stream is only a picture attached to the file."""
    if stream.disposition & (av.stream.Disposition.attached_pic | av.stream.Disposition.timed_thumbnails):
        return True
    return bool(
        stream.codec_context is not None
        and stream.codec_context.codec.canonical_name in STILL_CODECS
        and (stream.frames == 1 or "mimetype" in stream.metadata)
    )


def described(stream: av.VideoStream) -> str:
    """Describe a video stream by its format and size: ``h264 1280x720``."""
    context = stream.codec_context
    return "unknown format" if context is None else f"{stream.name or 'unknown'} {context.width}x{context.height}"


def _score(stream: av.VideoStream) -> int:
    context = stream.codec_context
    if context is None:
        return -1
    is_default = bool(stream.disposition & av.stream.Disposition.default)
    return context.width * context.height + DEFAULT_STREAM_SCORE * is_default
