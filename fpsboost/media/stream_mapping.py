"""Decide before any work which streams of a file a container holds and how the others are converted, and list them."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any, cast

import av
from av.codec.codec import Properties
from av.container import InputContainer, OutputContainer
from av.error import FFmpegError
from av.stream import Discard, Stream

from fpsboost.media.containers import Container, containers_by_suffix
from fpsboost.media.demuxer import VideoFile
from fpsboost.media.encoded_sound import can_encode
from fpsboost.media.errors import OptionError, OutputError
from fpsboost.media.info import EncodeSettings
from fpsboost.media.output import Output
from fpsboost.media.pyav import REFUSALS, open_input, packet_of, trial_file
from fpsboost.media.sound_formats import choose_sound_encoder, named_layout, sound_encoders

MAX_PROBED_PACKETS = 200  # maximum number of packets that are read to find the first packet of each stream
TEE_SPECIAL_CHARACTERS = re.compile(r"([\\'|\s])")  # characters with a special meaning to the tee muxer in a path


@dataclass(frozen=True)
class Rejected:
    """Stream that can be stored in no way: why, and what a user can do."""

    cause: str
    """Sentence without its end."""
    without: str
    """Way to leave the stream out."""
    ways: Sequence[str] = ()
    """Ways to keep it."""


@dataclass(frozen=True)
class StreamMapping:
    """Plan for storing the streams of a source in a file, as `map_streams` makes it."""

    output: Output
    """The file, its source, the part that is written, and which streams to keep."""
    encoders: Mapping[int, str] = field(default_factory=dict)
    """FFmpeg's encoders for audio that is re-encoded, by the number of its stream."""
    left_out: Mapping[int, dict[str, str]] = field(default_factory=dict)
    """Streams that can neither be copied nor re-encoded, by their numbers: the cause, and a way to keep each."""
    any_codec: bool = False
    """Whether a stream is copied whose codec is missing from the container's list; see `open_muxer`."""


def map_streams(output: Output, encoder: str) -> StreamMapping:
    """Decide how audio and subtitles of an output's source are stored in it, by trials with FFmpeg's muxers.

    Parameters
    ----------
    output : Output
        Output, with its source and the streams to keep.
    encoder : str
        FFmpeg's encoder of the video, which containers that are proposed instead must hold too.

    Returns
    -------
    StreamMapping
        Plan with encoders, and with the streams that are left out beside others of their type.

    Raises
    ------
    OptionError
        Options contradict each other, or name a stream that the source lacks.
    OutputError
        A stream cannot be stored that is the only one of its type, or was asked for by number.
    """
    encoding = output.encoding
    source = output.stream.video
    if source is None:
        if encoding.streams is not None:
            raise OptionError("`streams` chooses among the streams of a video file; leave it out.")
        return StreamMapping(output)
    asked = choose_sound_encoder(output)
    is_stretched = output.curve is not None
    if is_stretched and asked is None and encoding.audio_codec is not None and encoding.audio:
        raise OptionError(
            f"`slow_motion_sound='stretch'` and `audio_codec={encoding.audio_codec!r}` contradict each other; give "
            "one of them."
        )
    encoders: dict[int, str] = {}
    rejected: dict[int, Rejected] = {}
    any_codec = False
    headers = headers_in(source)
    with source.open() as file:
        _check_streams(file, source, encoding)
        streams = [stream for stream in file.streams if is_wanted(stream, encoding)]
        strict = [stream for stream in streams if not is_text(stream)]
        samples = first_packets(file, strict)
        for stream in strict:
            number = stream.index
            sample = samples.get(number)
            is_whole, is_decodable = headers[number]
            is_held = is_whole and fits(output.container, stream, sample)
            chosen = _new_encoder(output, stream, asked, is_held=is_held)
            if chosen is None and is_held:
                any_codec |= not _listed(output.container, stream)
            elif chosen is None:
                others = _others_for(output, encoder, stream, sample) if is_whole else []
                here = output.container.sound_encoder if is_decodable else None
                rejected[number] = _not_held(stream, here, others, output.path, source.name, is_whole=is_whole)
            elif is_decodable and can_encode(stream, chosen):
                encoders[number] = chosen
            else:
                aim = "encoded anew"
                option = "`audio=False`"
                if is_stretched:
                    aim = "stretched"
                    option = "`slow_motion_sound='drop'`"
                cause = f"The {codec_of(stream)} sound of {source.name} cannot be {aim} here"
                rejected[number] = Rejected(cause, f"leave it out with {option}")
        kept = {stream.type for stream in streams if stream.index not in rejected}
        left_out = {}
        for index, rejection in rejected.items():
            cause = rejection.cause
            if encoding.streams is not None:
                raise OutputError(f"{cause}; leave {index} out of `streams`.")
            if file.streams[index].type not in kept:
                raise OutputError(f"{cause}; {_any_of([*rejection.ways, rejection.without])}.")
            way = f"; to keep it, {_any_of(rejection.ways)}" if rejection.ways else ""
            left_out[index] = {"cause": cause, "way": way}
    return StreamMapping(output, encoders, left_out, any_codec)


def _new_encoder(output: Output, stream: Stream, asked: str | None, *, is_held: bool) -> str | None:
    """Return the encoder for sound that is encoded anew; None for a stream that is copied, or left out."""
    is_stretched = output.curve is not None
    if stream.type != "audio":
        return None
    if asked is not None:
        is_same = av.Codec(asked, "w").canonical_name == codec_of(stream) and output.encoding.audio_bitrate is None
        return None if is_same and is_held and not is_stretched else asked
    if output.encoding.audio_codec is not None:  # to be copied
        return None
    container = output.container
    if codec_of(stream) == "tta" and container.holds("tta"):
        # FFmpeg takes the length of TTA from that of the whole Matroska, and loses its end where they differ
        return "flac"
    is_needed = is_stretched or (container.replaces_sound and not is_held)
    return container.sound_encoder if is_needed else None


def _others_for(output: Output, encoder: str, stream: Stream, sample: bytes | None) -> list[str]:
    """Return the suffixes of other containers that hold a stream, and the video if its encoder was asked for."""
    asked = output.encoding.codec
    return [
        suffix
        for suffix, other in containers_by_suffix.items()
        if other != output.container and (not asked or other.holds(encoder)) and fits(other, stream, sample)
    ]


def _check_streams(file: InputContainer, source: VideoFile, encoding: EncodeSettings) -> None:
    """Raise `OptionError` if a stream is wanted that is neither sound nor subtitles nor the video."""
    offered = {stream.index: stream for stream in file.streams if stream.type in ("audio", "subtitle")}
    for number in set(encoding.streams or ()) - offered.keys() - {source.stream_index}:
        listed = ", ".join(f"{index} ({codec_of(stream)} {stream.type})" for index, stream in offered.items())
        raise OptionError(
            f"`streams={number}` is no sound and no subtitles of {source.name}, which has {listed or 'none'}; choose "
            "others, or leave it out."
        )


def _any_of(ways: Sequence[str]) -> str:
    """Join ways to go on with commas and a final or."""
    return ", or ".join([", ".join(ways[:-1]), ways[-1]]) if len(ways) > 1 else "".join(ways)


def _not_held(
    stream: Stream, encoder: str | None, others: Sequence[str], name: str, source: str, *, is_whole: bool
) -> Rejected:
    """Return that the container does not hold a stream, with other containers and an encoder as ways to keep it."""
    what, option = ("sound", "`audio=False`") if stream.type == "audio" else ("subtitles", "`subtitles=False`")
    ways = [f"write {' or '.join(others)}"] if others else []
    if stream.type == "audio" and encoder is not None and can_encode(stream, encoder):
        common = next(common for common, other in sound_encoders.items() if other == encoder)
        ways.insert(0, f"encode it anew with `audio_codec={common!r}`")
    # raw AAC, which its container describes; that of transport streams describes itself, and .mp4 and .mkv hold it
    is_unknown = codec_of(stream) == "aac" and not others and not cast(Any, stream.codec_context).extradata
    reason = ", whose headers are missing" if is_unknown or not is_whole else ""
    cause = f"{name} cannot hold the {codec_of(stream)} {what} of {source}{reason}"
    return Rejected(cause, f"leave the {what} out with {option}", ways)


def is_wanted(stream: Stream, encoding: EncodeSettings) -> bool:
    """Return whether a stream is audio or subtitles that are to be kept."""
    is_chosen = encoding.streams is None or stream.index in encoding.streams
    return is_chosen and {"audio": encoding.audio, "subtitle": encoding.subtitles}.get(stream.type, False)


def first_packets(file: InputContainer, streams: Sequence[Stream]) -> dict[int, bytes]:
    """Return the first packet of each stream by its number, if it is among the first of the file."""
    packets: dict[int, bytes] = {}
    with suppress(FFmpegError):
        for packet in islice(file.demux(streams), MAX_PROBED_PACKETS) if streams else ():
            if packet.size:
                packets.setdefault(packet.stream.index, bytes(packet))
    return packets


def check_readable(path: Path, written: Counter[str], name: str) -> None:
    """Raise `OutputError` unless a file opens and as many streams of each type as `written` have packets and headers.

    A stream is discarded after its first packet, so that one that begins late is found without reading all others.
    """
    with suppress(*REFUSALS), open_input(str(path.absolute())) as file:
        missing = written.copy()
        for packet in file.demux():
            if packet.size and packet.stream.discard != Discard.all:
                packet.stream.discard = Discard.all
                missing[packet.stream.type] -= _headers_of(packet.stream)[0]
            if not +missing:
                return
        written = missing
    what = " and ".join(kind if kind != "audio" else "sound" for kind in +written)
    raise OutputError(
        f"{name} was not written because its {what} cannot be read from it; try another `codec` or container, or leave "
        "other streams out with `audio=False` and `subtitles=False`."
    )


def fits(container: Container, stream: Stream, sample: bytes | None) -> bool:
    """Return whether a container holds a stream as it is, by a trial with its muxer.

    The trial uses a packet of the stream, since a muxer may have to rewrite packets, such as audio of MPEG transport
    streams.
    """
    if _listed(container, stream):
        return _muxed(container, stream, sample) is not None
    is_possible = container.codec_list == "incomplete" and stream.type == "audio" and stream.codec_context is not None
    return is_possible and _muxed(container, stream, sample, any_codec=True) == [codec_of(stream)]


def _headers_of(stream: Stream) -> tuple[bool, bool]:
    """Return whether a stream has what its codec needs beside packets, as Vorbis of OGM has not, and a decoder opens.

    Nothing else may be done with the stream: FFmpeg forgets its codec where a decoder does not open, and may crash.
    """
    context = stream.codec_context
    if stream.type != "audio" or context is None:
        return True, context is not None
    try:
        context.open(strict=False)
    except REFUSALS:
        return bool(context.extradata), False
    return True, True


def headers_in(source: VideoFile) -> dict[int, tuple[bool, bool]]:
    """Return the result of `_headers_of` for each stream of a file by its number."""
    with source.open() as file:
        return {stream.index: _headers_of(stream) for stream in file.streams}


def add_copied(output: OutputContainer, stream: Stream, container: Container) -> Stream:
    """Add a stream for the packets of another one to an output.

    FFmpeg's mp4 takes PCM only with a named channel layout, which AVI, Matroska and MXF do not give: there two channels
    are taken for stereo and one for mono, as players do. More channels have no such usual order, and stay as they are.
    """
    target = output.add_stream_from_template(stream)
    context: Any = target.codec_context if container.needs_named_layouts and stream.type == "audio" else None
    if context is not None and context.layout.nb_channels in (1, 2):
        context.layout = named_layout(context.layout)
    return target


def is_text(stream: Stream) -> bool:
    """Return whether a stream is text subtitles rather than bitmap subtitles."""
    context = stream.codec_context
    return context is not None and Properties.TEXT_SUB in Properties(context.codec.properties)


def codec_of(stream: Stream) -> str:
    """Return FFmpeg's name of a stream's format."""
    context = stream.codec_context
    return str(context.codec.canonical_name) if context is not None else "unknown"


def kind_of(stream: Stream) -> str:
    """Describe a stream that has no codec: ``data, klv``, ``attachment, font.ttf``."""
    tags = {key.lower(): value for key, value in stream.metadata.items()}
    name = tags.get("filename") if stream.type == "attachment" else getattr(stream, "name", None)
    more = name or tags.get("handler_name")
    return f"{stream.type}, {more}" if more else stream.type


def keeps_data(container: Container, stream: Stream) -> bool:
    """Return whether data is recognized after muxing, by a trial, as codec lists are too permissive, or a font kept."""
    if stream.type != "data":
        return stream.type == "attachment" and container.keeps_attachments
    return _muxed(container, stream, None) == [getattr(stream, "name", "")]


def _listed(container: Container, stream: Stream) -> bool:
    """Return whether the codec of a stream is in the container's list."""
    context = stream.codec_context
    return context is not None and container.holds(context.codec.name)


def _muxed(container: Container, stream: Stream, sample: bytes | None, *, any_codec: bool = False) -> list[str] | None:
    """Return the formats of the streams in a file with one packet of a stream; None if the muxer refuses it.

    None also if the file lacks the headers of AAC, with which FFmpeg's mp4 and mov do without and players do not.
    """
    with trial_file() as path:
        try:
            with open_muxer(path, container, any_codec=any_codec) as output:
                target = add_copied(output, stream, container)
                output.start_encoding()
                output.mux(packet_of(sample or bytes(64), target, target.time_base or Fraction(1), 0, 1))
        except REFUSALS:
            return None
        with suppress(*REFUSALS), av.open(str(path)) as file:
            names = [str(again.name) if again.type == "data" else codec_of(again) for again in file.streams]
            lacks_headers = "aac" in names and not cast(Any, file.streams[0].codec_context).extradata
            return None if lacks_headers and sample else names
    return None if sample else []


def open_muxer(path: Path, container: Container, *, any_codec: bool = False) -> OutputContainer:
    """Open a file for muxing; with `any_codec`, only the container's muxer decides which codecs it accepts.

    PyAV looks a codec up in the muxer's list before it adds a stream. Matroska's omits what it holds by a Windows codec
    tag (Windows Media Audio, mu-law, ADPCM). FFmpeg's tee muxer has no list and passes all packets on to the muxers of
    its files, here one. It drops chapters.
    """
    # FFmpeg would parse the part of a relative path before a colon as a protocol
    place = str(path.absolute())
    if any_codec:
        escaped = TEE_SPECIAL_CHARACTERS.sub(r"\\\1", place)
        return av.open(f"[f={container.name}]{escaped}", "w", format="tee")
    options = {"movflags": "+faststart"} if container.exact_times else {}
    return av.open(place, "w", format=container.name, container_options=options)
