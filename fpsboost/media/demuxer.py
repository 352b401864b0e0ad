"""Demux a video file: open it, choose its video stream, and read packets past damage and across joined recordings."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import av
from av import VideoStream
from av.container import InputContainer
from av.error import FFmpegError
from av.format import Flags
from av.stream import Disposition, Stream

from fpsboost.media.errors import EncryptedError, InputError, OptionError, undone_by
from fpsboost.media.info import Reading
from fpsboost.media.opening import boxes_of, open_video
from fpsboost.media.pixels import NO_COLOUR_TAG
from fpsboost.media.pyav import Packet
from fpsboost.media.remarks import Damage, Remarks, encrypted_sentence
from fpsboost.media.transport_streams import clock_jumps, is_scrambled

STILL_CODECS = ("png", "mjpeg", "bmp", "gif", "tiff", "webp")

DEFAULT_STREAM_SCORE = 5_000_000  # score of the default stream's flag, pixels, as in FFmpeg

MAX_FAILURES = 10
"""Number of consecutive read errors without a packet after which the rest of a file counts as unreadable."""

MAX_LOST_SAMPLES = 1000
"""Maximum number of consecutive samples beyond the end of a file; each costs one attempt of a few microseconds."""

SAMPLE_INDEX_FORMATS = ("mov", "avi")
"""Containers with an index of every sample, where a truncated sample ends one demuxing pass but not other streams."""

MAX_STEP_BACK = Fraction(1, 10)
"""Maximum backward step of decoding times, as in damaged streams, that is not taken for a new recording, seconds."""

MAX_GAP = Fraction(10)
"""Maximum gap between packets that is no new recording, seconds; both values are those of FFmpeg's programs."""


UNTIMED_FORMAT = "avi"
"""Container that stores no times, only packets in order; FFmpeg guesses presentation times from picture types."""

TIMED_BY_CODEC = ("m4v", "jpegxl_anim")
"""Formats without a container whose codecs store presentation times: MPEG-4 Part 2, animated JPEG XL."""


@dataclass(frozen=True)
class VideoFile:
    """Video file whose streams besides the converted one may be carried over; messages call it `name`."""

    path: Path
    name: str
    stream_index: int
    """Number of the converted stream."""
    start: Fraction
    """Time of the file's own clock from which all times are counted, seconds."""
    coded_rate: Fraction
    """Nominal frames per second of the coded pictures; fields made into frames double the source's rate."""
    auxiliary_streams: Sequence[str]
    """Kinds of streams beside the pictures: ``sound``, ``subtitles``, both or neither."""
    playlists: bool = False
    """Whether it may be a playlist, for which other files are read."""

    def open(self) -> InputContainer:
        """Open the file once more, from its beginning."""
        return open_video(self.path, self.name, playlists=self.playlists)


class Demuxer:
    """Video file with one of its video streams chosen, which can be read again from its beginning.

    Attributes that reading updates, in seconds on the file's own clock: `furthest` is the end of all packets of video,
    audio and subtitles so far, `last_start` the presentation time of the last video packet. Reading ends at an
    encrypted video packet; `clear` is then the duration of the pictures before it, otherwise None. `colour_tags` are
    the container's, by their names in PyAV; see `fpsboost.media.pixels.add_colour_tags`.

    Parameters
    ----------
    name : str
        File to open; messages name it so.
    reading : Reading
        Which of its streams is chosen, by default that of `choose_video`, whether it may be a playlist, for which other
        files are read, and the threads of the decoder.

    Raises
    ------
    InputError
        The file cannot be read, or has no video that can be decoded.
    EncryptedError
        The video is encrypted.
    OptionError
        `reading` names a stream that is no video.
    """

    def __init__(self, name: str, reading: Reading) -> None:
        self.path = Path(name)
        self.name = name
        self.reading = reading
        self.furthest = self.last_start = Fraction(0)
        self.clear: Fraction | None = None
        self._first: Fraction | None = None
        self._open()
        if self.container.format.name == "mpegts" and is_scrambled(self.path, self.stream.id):
            self.container.close()
            raise EncryptedError(encrypted_sentence(name))

    def _open(self) -> None:
        """Open the file, choose its stream, and set the threads of the decoder; sets `container` and `stream`."""
        self.container = self.open_again()
        with undone_by(self.container.close):
            self.stream = choose_video(self.container, self.name, self.reading.stream)
        # read before decoding: the first picture overwrites them with the tags of the coded stream, even if unspecified
        self.colour_tags = {name: int(getattr(self.stream.codec_context, name)) for name in NO_COLOUR_TAG}
        self.stream.thread_type = "AUTO"
        self.stream.thread_count = self.reading.threads

    def open_again(self) -> InputContainer:
        """Open the file once more, from its beginning."""
        return open_video(self.path, self.name, playlists=self.reading.allow_playlists)

    @cached_property
    def duration(self) -> int | None:
        """Duration in ticks, unless unknown, or wrong because a sample shows that the clock jumps.

        For a raw stream FFmpeg guesses it, from the size or a time code of the day. For fragments that begin later than
        0, by their own times and not by an edit list, it gives the end for the duration.
        """
        duration = self.stream.duration or 0
        if is_raw(self.container) or duration <= 0:
            return None
        if is_fragmented(self.stream):
            first, last = (self.stream.index_entries[place].timestamp for place in (0, -1))
            if 0 < first <= last < duration:  # else no entry of the index would be within the duration
                return duration - first if (duration - last) * Fraction(self.stream.time_base or 1) < 1 else None
        return None if clock_may_jump(self.container) and clock_jumps(self.path) else duration

    def packets(self, damage: Damage) -> Iterator[Packet]:
        """Yield the video packets from the current position on; update `damage`, `clear` and the positions read."""
        video = self.stream.index
        streams = self.container.streams
        self.clear = None
        auxiliary = {stream.index for stream in (*streams.audio, *streams.subtitles)}
        for packet in read_packets(self.container, {video, *auxiliary}, damage):
            time = packet.dts if packet.pts is None else packet.pts
            start, length = ((ticks or 0) * Fraction(packet.time_base or 0) for ticks in (time, packet.duration))
            self.furthest = max(start + length, self.furthest)
            if packet.stream.index != video:
                continue
            self._first = start if self._first is None else self._first
            if is_encrypted(packet):
                self.clear = start - self._first
                return
            self.last_start = max(start, self.last_start)
            yield packet

    def seek(self, ticks: int) -> bool:
        """Seek to the key frame at or before a time in ticks of the stream; return whether the container can."""
        try:
            self.container.seek(ticks, stream=self.stream, backward=True)
        except FFmpegError:
            return False
        return True

    def reopen(self) -> None:
        """Return to the beginning of the file, with a new container and decoder."""
        self.container.close()
        self._open()

    def close(self) -> None:
        """Close the file."""
        self.container.close()


def choose_video(container: InputContainer, name: str, wanted: int | None) -> VideoStream:
    """Choose a video stream: the one with the number `wanted`, or the one that FFmpeg considers the best.

    That is the largest one, where the default flag outweighs all but very large sizes; among equals, the first that is
    not gray, as alpha is in an AVIF. A single frame, as its still picture, is taken only where nothing else is.
    """
    videos = {stream.index: stream for stream in container.streams.video if not is_cover_art(stream)}
    if not videos:
        raise InputError(f"{name} has no video stream; name a file that has one.")
    if wanted is not None and wanted not in videos:
        listed = ", ".join(_described(stream) for stream in videos.values())
        raise OptionError(f"`stream={wanted}` is no video stream of {name}; choose one of {listed}.")
    moving = [stream for stream in videos.values() if stream.frames != 1] or list(videos.values())
    chosen = max(moving, key=_score) if wanted is None else videos[wanted]
    is_protected = "ASF_Protection_Type" in container.metadata
    if chosen.codec_context is None:  # MP4 names a format that encryption hides in a box, as FairPlay does
        is_protected = any(b"\0\0\0\x0cfrma" in content for _, content in boxes_of(Path(container.name)))
        if not is_protected:
            raise InputError(f"{name} uses a video codec that cannot be decoded here; convert it to H.264 first.")
    if is_protected:
        raise EncryptedError(encrypted_sentence(name))
    return chosen


def is_encrypted(packet: Packet) -> bool:
    """Return whether a packet is encrypted, by itself (MP4), or with its whole stream (Matroska, FairPlay)."""
    with suppress(AttributeError, UnicodeDecodeError):  # data has no codec, and some tags are no text
        if packet.stream.codec_context.codec_tag == "drms":
            return True
    return bool(packet.has_sidedata("encryption_info")) or "enc_key_id" in packet.stream.metadata


def remark_on_others(remarks: Remarks, container: InputContainer, chosen: VideoStream, name: str) -> None:
    """Add a remark on the video streams that are not read, if there are any."""
    videos = [stream for stream in container.streams.video if not is_cover_art(stream) and stream.index != chosen.index]
    if videos:
        others = ", ".join(f"stream {_described(stream)}" for stream in videos)
        remarks.add("videos-left-out", name=name, chosen=_described(chosen), others=others)


def is_cover_art(stream: Stream) -> bool:
    """Return whether a video stream is only a picture attached to the file."""
    if stream.disposition & (Disposition.attached_pic | Disposition.timed_thumbnails):
        return True
    return bool(
        stream.codec_context is not None
        and stream.codec_context.codec.canonical_name in STILL_CODECS
        and (stream.frames == 1 or "mimetype" in stream.metadata)
    )


def _described(stream: VideoStream) -> str:
    """Describe a video stream by its number, format and size: ``0 (h264 1280x720)``."""
    context = stream.codec_context
    coded = "unknown format" if context is None else f"{stream.name or 'unknown'} {context.width}x{context.height}"
    return f"{stream.index} ({coded}{', one frame' if stream.frames == 1 else ''})"


def _score(stream: VideoStream) -> tuple[int, bool]:
    """Return the size of a stream, pixels, with a bonus for the default flag, and whether it has colour."""
    context = stream.codec_context
    if context is None:
        return -1, False
    is_default = bool(stream.disposition & Disposition.default)
    is_gray = (context.pix_fmt or "").startswith("gray")
    return context.width * context.height + DEFAULT_STREAM_SCORE * is_default, not is_gray


def clock_may_jump(container: InputContainer) -> bool:
    """Return whether a container's clock may start at any time and may jump, as in transport and program streams."""
    return bool(Flags(container.format.flags) & Flags.ts_discont)


def is_raw(container: InputContainer) -> bool:
    """Return whether a file is a raw stream, such as ``.264``, ``.m2v`` or ``.obu``, or images one after the other.

    It stores no presentation times; those that FFmpeg gives its packets are guesses, and partly wrong.
    """
    has_no_times = Flags.no_timestamps in Flags(container.format.flags) or container.format.name.endswith("_pipe")
    return has_no_times and container.format.name not in TIMED_BY_CODEC


def is_fragmented(stream: Stream) -> bool:
    """Return whether a stream of an MP4 lies in fragments, whose samples its header (moov) does not count."""
    return stream.container.format.name.startswith("mov") and stream.frames < len(stream.index_entries)


def read_packets(container: InputContainer, wanted: Collection[int], damage: Damage) -> Iterator[Packet]:
    """Yield the non-empty packets of the wanted streams, past damaged places and with clock jumps removed.

    All other streams are discarded from now on, so that damage to them has no effect. If a container has no
    presentation times, they are set from the decoding times; `ReorderBuffer` corrects them. Unreadable places and clock
    jumps are counted in `damage`.
    """
    clock = ContinuousClock() if clock_may_jump(container) else None
    for stream in container.streams:
        tells_time = clock is not None and stream.type in ("video", "audio")  # all readers must see the same jumps
        if stream.index not in wanted and not tells_time:
            stream.discard = av.stream.Discard.all
    for packet in _demux_past_damage(container, damage):
        if clock is not None:
            clock.move(packet)
            damage.joints = clock.jumps
        if packet.stream.index in wanted:
            yield packet


def _demux_past_damage(container: InputContainer, damage: Damage) -> Iterator[Packet]:
    """Yield the packets with data of a container, and go on after read errors.

    Gives up after `MAX_FAILURES` errors in a row, or at the end of the file; containers that list their samples are
    read on after a sample that is missing.
    """
    delays: dict[int, int] = {}
    is_timed_by_decoding = container.format.name == UNTIMED_FORMAT
    is_listed = container.format.name.startswith(SAMPLE_INDEX_FORMATS)
    failures = ends = 0
    while failures < MAX_FAILURES and ends < (MAX_LOST_SAMPLES if is_listed else 1):
        try:
            for packet in container.demux():
                if not packet.size:
                    continue
                failures = ends = 0
                if is_timed_by_decoding and packet.dts is not None:
                    first = packet.dts if packet.pts is None else packet.pts
                    packet.pts = packet.dts + delays.setdefault(packet.stream.index, first - packet.dts)
                yield packet
            ends += 1
        except FFmpegError:
            failures += 1
            damage.unreadable += failures == 1


class ContinuousClock:
    """Offsets for the times of packets, read in file order, that make video and audio continuous across jumps.

    Streams jump at different places of the file because their packets are interleaved. The first stream to jump
    determines the offset of everything after it, so that video and audio keep the distance that they have in each
    recording. `jumps` counts them.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._moves = [Fraction(0)]
        """Time offset of each recording, seconds."""
        self._places: dict[int, int] = {}
        """Index of the current recording of each stream."""
        self._ends: dict[int, Fraction] = {}
        """End of the last packet of each stream after its offset, seconds."""

    def move(self, packet: Packet) -> None:
        """Add the offset of its recording to the times of a packet of any stream."""
        time = packet.pts if packet.dts is None else packet.dts
        if time is None:
            return
        tick = Fraction(packet.time_base)
        index = packet.stream.index
        if packet.stream.type in ("video", "audio"):
            place = self._recording_of(index, time * tick)
            self._places[index] = place
            self._ends[index] = (time + (packet.duration or 0)) * tick + self._moves[place]
        else:
            place = max(self._places.values(), default=0)
        ticks = round(self._moves[place] / tick)
        if ticks:
            packet.dts = None if packet.dts is None else packet.dts + ticks
            packet.pts = None if packet.pts is None else packet.pts + ticks

    def _recording_of(self, index: int, time: Fraction) -> int:
        """Return the recording that a time of a stream belongs to: the current one, a later one, or a new one."""
        place = self._places.get(index, 0)
        end = self._ends.get(index)
        if end is None or end - MAX_STEP_BACK <= time + self._moves[place] <= max(self._ends.values()) + MAX_GAP:
            return place
        for later in range(place + 1, len(self._moves)):
            if abs(time + self._moves[later] - end) <= MAX_GAP:
                return later
        self._moves.append(end - time)
        self.jumps += 1
        return len(self._moves) - 1
