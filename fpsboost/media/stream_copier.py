"""Carry over everything of a video file but its pictures: audio, subtitles, data, cover art, tags and chapters.

Packets are copied unchanged, with three exceptions: text subtitles are converted if the container requires another
format, a timecode is converted to the new rate, and audio is re-encoded if it is stretched or if that is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from heapq import merge
from operator import itemgetter
from pathlib import Path

from av import VideoStream
from av.container import InputContainer, OutputContainer
from av.error import FFmpegError
from av.stream import Discard, Disposition, Stream

from fpsboost.media.clock import Window
from fpsboost.media.containers import containers_by_suffix
from fpsboost.media.demuxer import VideoFile, is_cover_art, is_encrypted, read_packets
from fpsboost.media.encoded_sound import EncodedSound
from fpsboost.media.errors import EncryptedError
from fpsboost.media.pyav import Packet, open_input
from fpsboost.media.remarks import Damage, Remarks, counted, encrypted_stream_sentence
from fpsboost.media.stream_mapping import (
    StreamMapping,
    add_copied,
    codec_of,
    fits,
    is_text,
    is_wanted,
    keeps_data,
    kind_of,
)
from fpsboost.media.tags import (
    copy_labels,
    find_timecode,
    is_timecode,
    lost_labels,
    regional_languages,
    tags_for,
    timecode_at,
    timecode_rate,
    unread_of_chapters,
)
from fpsboost.media.text_subtitles import MAX_INTERLEAVING, TextConverter
from fpsboost.media.window_cuts import chapters_within, packets_within

MAX_PRIMING = Fraction(1, 10)  # hidden sound before the beginning that decoders need to have decoded, at most, seconds

MOVIE_CLOCK = 1000
"""Ticks per second by which mp4 and mov place their streams, where nothing needs finer ones."""


ALL = Window(Fraction(0), None, None)
"""All of a clip, whose packets keep their times, also those before 0."""


class StreamCopier:
    """Copier of audio, subtitles, data, attachments, tags and chapters from a source file to an output.

    The source is opened a second time, so that these packets are read when they are due and memory use stays constant.
    Add it before the output's header is written: it adds streams, and sets tags, chapters and the timecode.

    Parameters
    ----------
    mapping : StreamMapping
        Which streams are copied, encoded or left out, as `fpsboost.media.stream_mapping.map_streams` decides, and the
        part of the source that is written.
    source : VideoFile
        File to copy from.
    output : OutputContainer
        Output whose header is not written yet; it stays the caller's to close.
    video : av.VideoStream
        Video stream of the output, which gets the labels and the timecode of the source's.
    """

    def __init__(self, mapping: StreamMapping, source: VideoFile, output: OutputContainer, video: VideoStream) -> None:
        self._mapping = mapping
        self._source = source
        self._output = output
        self._window = mapping.output.window or ALL
        self._name = mapping.output.path
        self._container = mapping.output.container
        self._curve = self._window.curve
        self._reverses = self._window.reverses
        self.written: dict[int, str] = {}
        """Type of each stream of the source of which packets were muxed, by its number."""
        self._input = source.open()
        self._targets: dict[int, Stream] = {}
        self._labels: dict[int, tuple[str, dict[str, str], Disposition]] = {}
        """Type, tags and flags of each target when all is muxed; PyAV reads none of a file that is closed."""
        self._regional = regional_languages(self._input)
        self._last_dts: dict[int, int] = {}
        self._covers: list[Packet] = []
        self._converters: dict[int, TextConverter] = {}
        self._sounds: dict[int, EncodedSound] = {}
        self.tags = tags_for(self._input.metadata, self._container)
        output.metadata.update(self.tags.values)
        chapters = chapters_within(self._input, self._window, source.start)
        unread = ", ".join(unread_of_chapters(self._input))
        output.set_chapters(chapters)
        self.remarks = Remarks()
        if self.tags.lost:
            self._remark("tags-lost", tags=", ".join(self.tags.lost))
        if chapters and mapping.any_codec:
            self._remark("chapters-lost")
        if unread:
            self._remark("chapter-parts-lost", parts=unread)
        copy_labels(self._input.streams[source.stream_index], video, self._container)
        self._has_timecode = self._copy_timecode(video)
        for stream in self._input.streams:
            if stream.index != source.stream_index:
                self._add(stream)
        times = [Fraction(sound.stream.time_base) for sound in self._sounds.values()]
        times += [
            stream.start_time * Fraction(stream.time_base) - source.start
            for stream in self._input.streams
            if stream.start_time is not None and stream.time_base
        ]
        ticks = math.lcm(MOVIE_CLOCK, *(time.denominator for time in times))
        self.clock = ticks if ticks < 2**31 else MOVIE_CLOCK
        """Ticks per second in which starts, and ends of re-encoded audio, are exact."""
        self._packets = self._moved()
        self._ahead: tuple[Fraction, Packet] | None = None

    def close(self) -> None:
        """Close the source file; the output stays open."""
        self._packets.close()  # type: ignore[attr-defined]
        self._input.close()

    def copy_until(self, time: Fraction | None) -> None:
        """Mux all packets that are due up to an output time, seconds; None for all that are left.

        Times must not decrease from call to call. Packets before the window are left out, and those out of order too,
        with a remark. Raises `EncryptedError` for an encrypted packet before the end of the window.
        """
        while (ahead := self._ahead or next(self._packets, None)) is not None:
            self._ahead = ahead
            due, packet = ahead
            if time is not None and due > time:
                break
            self._ahead = None
            self._copy(packet)
        else:
            for sound in self._sounds.values():
                sound.drain()
        if time is not None:
            for sound in self._sounds.values():
                sound.be_silent_until(time)
        for index, converter in self._converters.items():
            self._mux(index, "subtitle", converter.until(time))
            if time is None and converter.lost_lines:
                self._remark("lines-lost", stream=index)

    def copy_cover(self) -> None:
        """Mux the attached pictures; call it directly after the header is written, as mp4 requires."""
        self._output.mux(self._covers)

    def check_labels(self, path: Path) -> None:
        """Read the finished file back, and remark on languages, titles and flags of streams that it lost."""
        with open_input(str(path.absolute())) as file:
            streams = [stream for stream in file.streams if not is_cover_art(stream)]
            for index, (kind, tags, flags) in self._labels.items():  # streams of each type are in order, but not all
                place = next((n for n, stream in enumerate(streams) if stream.type == kind), None)
                lost = "" if place is None else " and ".join(lost_labels(tags, flags, streams.pop(place)))
                if lost:
                    self._remark("labels-lost", labels=lost, stream=index)

    def _remark(self, kind: str, **values: object) -> None:
        """Add a remark on the output."""
        self.remarks.add(kind, name=self._name, **values)

    def _add(self, stream: Stream) -> None:
        """Add an output stream for a stream of the source as `map_streams` has chosen, or remark on its loss."""
        is_kept = is_wanted(stream, self._mapping.output.encoding)
        is_copied = is_kept or (stream.type == "data" and keeps_data(self._container, stream))
        can_turn = stream.type == "audio" or (
            stream.type == "subtitle" and is_text(stream) and codec_of(stream) != "eia_608"
        )
        if stream.type == "video" and is_cover_art(stream):
            self._add_cover(stream)
        elif stream.discard == Discard.all:
            pass  # chapter track of an mp4, which FFmpeg reads as chapters
        elif stream.index in self._mapping.left_out:
            self.remarks.add("stream-misfits", lost_stream=stream.index, **self._mapping.left_out[stream.index])
        elif is_copied and self._reverses and not can_turn:
            self._remark("stream-not-reversible", lost_stream=stream.index, what=kind_of(stream))
        elif stream.index in self._mapping.encoders:
            self._add_encoded(stream, self._mapping.encoders[stream.index])
        elif is_kept and is_text(stream) and not fits(self._container, stream, None):
            self._add_converted(stream)
        elif is_copied:
            self._add_target(stream, add_copied(self._output, stream, self._container))
        elif stream.type == "attachment" and keeps_data(self._container, stream):
            self._output.add_stream_from_template(stream)
        elif is_timecode(stream):  # the muxer creates a timecode stream itself, or stores a tag
            if not self._has_timecode:
                self._remark("timecode-stream-lost", lost_stream=stream.index)
        elif stream.type in ("data", "attachment", "unknown"):
            keeping = [suffix for suffix, container in containers_by_suffix.items() if keeps_data(container, stream)]
            self._remark_on_lost(stream, f"stream {stream.index} ({kind_of(stream)})", keeping)

    def _remark_on_lost(self, stream: Stream, what: str, keeping: Sequence[str]) -> None:
        """Add a remark on a stream that is left out; `keeping` are the suffixes of containers that keep it."""
        way = f"write {' or '.join(keeping)} to keep it" if keeping else "none of the containers written here does"
        self._remark("stream-not-held", lost_stream=stream.index, what=what, way=way)

    def _add_target(self, stream: Stream, target: Stream) -> None:
        """Register the output stream for the packets of a stream, with its language, title and flags."""
        copy_labels(stream, target, self._container)
        self._targets[stream.index] = target

    def _add_converted(self, stream: Stream) -> None:
        """Add a stream of text subtitles in the container's format; `map_streams` has checked that it fits."""
        converter = self._converters[stream.index] = TextConverter(stream, self._output, self._container)
        self._add_target(stream, converter.stream)
        format = self._container.text_format
        self._remark("subtitles-converted", stream=stream.index, codec=codec_of(stream), format=format)

    def _add_encoded(self, stream: Stream, encoder: str) -> None:
        """Add a stream of audio that is re-encoded; `map_streams` has checked that it can be."""
        sound = self._sounds[stream.index] = EncodedSound(stream, self._output, encoder, self._mapping.output)
        self._add_target(stream, sound.stream)
        stretched = "" if self._curve is None else "fitted to the speeds of its pictures and "
        if self._curve is not None and self._curve.is_steady and (speed := self._curve.sounding[0].slope0):
            stretched = f"stretched to {1 / speed} times its length and "
        encoded = f"{stretched}encoded anew as {codec_of(sound.stream)}{sound.changes}"
        self._remark("sound-encoded-anew", stream=stream.index, codec=codec_of(stream), encoded=encoded)

    def finish(self, end: Fraction) -> None:
        """Mux all remaining packets, add remarks on audio that could not be decoded, and close the source.

        Parameters
        ----------
        end : Fraction
            End of the pictures in the output, seconds; audio of a speed curve is filled with silence up to it.
        """
        for sound in self._sounds.values():  # far behind the pictures only damaged time stamps lead
            sound.silent_until = end + MAX_INTERLEAVING
        self.copy_until(None)
        for index, sound in self._sounds.items():
            if sound.finish(end):
                self.written[index] = "audio"
            if sound.lost_packets:
                packets = counted(sound.lost_packets, "packet")
                self._remark("sound-damaged", source=self._source.name, packets=packets, stream=index)
        for index, target in self._targets.items():
            given = self._regional.get(index)
            tags = {**target.metadata, "language": given} if given else dict(target.metadata)
            self._labels[index] = target.type, tags, target.disposition
        self.close()

    def _copy_timecode(self, video: VideoStream) -> bool:
        """Write the timecode of the first frame, or remark that it is lost; return whether the source has one."""
        timecode = find_timecode(self._input.streams[self._source.stream_index].metadata, self._input.metadata)
        if timecode is None:
            return False
        old = timecode_rate(self._source.path) or self._source.coded_rate
        new = video.codec_context.framerate
        is_counted = self._curve is None or self._curve.is_steady
        skipped = self._window.frames_before(old)
        again = timecode_at(timecode, old, Fraction(new), skipped) if new and is_counted else None
        if again is None:
            cause = "rate" if is_counted else "speed"
            self._remark("timecode-lost", timecode=timecode, cause=cause)
        else:
            video.metadata["timecode"] = again
        return True

    def _add_cover(self, stream: Stream) -> None:
        """Keep a cover picture, as an attachment in Matroska or a stream in mp4; elsewhere remark on its loss."""
        packet = _attached_picture(self._source, stream.index)
        if packet is not None and self._container.keeps_attachments:
            kind = "png" if stream.name == "png" else "jpeg"
            tags = stream.metadata
            name = tags.get("filename", f"cover.{kind}")
            mimetype = tags.get("mimetype", f"image/{kind}")
            self._output.add_attachment(name, mimetype, bytes(packet))
        elif packet is not None and self._container.keeps_covers and stream.name in ("png", "mjpeg"):
            packet.stream = self._output.add_stream_from_template(stream, opaque=True)
            packet.stream.disposition = Disposition.attached_pic
            self._covers.append(packet)
        else:
            keeping = [
                suffix
                for suffix, container in containers_by_suffix.items()
                if container.keeps_attachments or container.keeps_covers
            ]
            self._remark_on_lost(stream, "the cover picture", keeping)

    def _moved(self) -> Iterator[tuple[Fraction, Packet]]:
        """Yield the packets to mux, and when each is due in the output, seconds.

        They are in file order. Where the source plays backwards, all cues are read first and put in the output's order.
        """
        cues = [index for index, stream in self._targets.items() if stream.type == "subtitle" and self._reverses]
        packets = self._due(self._read(self._input, self._targets.keys() - cues))
        if not cues:
            yield from packets
            return
        with self._source.open() as file:
            moved = [
                ((packet.pts or 0) * Fraction(packet.time_base), packet)
                for _, packet in self._due(self._read(file, cues))
            ]
        yield from merge(packets, sorted(moved, key=itemgetter(0)), key=itemgetter(0))

    def _due(self, packets: Iterator[Packet]) -> Iterator[tuple[Fraction, Packet]]:
        """Yield packets, at times in the output but for sound that is encoded, and when that which they hold is due."""
        window = self._window
        for packet in packets:
            index = packet.stream.index
            time = (packet.dts or 0) * Fraction(packet.time_base)
            if is_encrypted(packet) and (window.end is None or time < window.end):
                raise EncryptedError(encrypted_stream_sentence(self._source.name, packet.stream.type, index))
            due = window.output_time(time)
            if window is ALL or index in self._sounds:
                yield due, packet
            else:
                moved = packets_within(
                    window, packet, self._input.streams[index], exact_times=self._container.exact_times
                )
                yield from ((due, part) for part in moved)

    def _read(self, file: InputContainer, streams: Collection[int]) -> Iterator[Packet]:
        """Yield packets of streams of the source, in file order, with times from the start of the clip; text as cues.

        Ends soon after the window does. Damage is remarked once.
        """
        if not streams:
            return
        # where all later packets of any stream are after the window too
        past = None if self._window.end is None else self._window.end + MAX_INTERLEAVING
        damage = Damage()
        for packet in read_packets(file, streams, damage):
            if damage.unreadable:
                self._remark("other-streams-damaged", source=self._source.name)
            if packet.dts is not None and not self._is_hidden(packet):
                later = round(self._source.start / Fraction(packet.time_base))
                packet.dts -= later
                packet.pts = None if packet.pts is None else packet.pts - later
                if past is not None and packet.dts * Fraction(packet.time_base) > past:
                    break
                converter = self._converters.get(packet.stream.index)
                yield from [packet] if converter is None else converter.cues(packet)
        for index, converter in self._converters.items():
            yield from converter.last_cues() if index in streams else ()

    def _is_hidden(self, packet: Packet) -> bool:
        """Return whether the edit list hides a packet that is copied, the output cannot, and no decoder needs it."""
        end = ((packet.pts or 0) + (packet.duration or 0)) * Fraction(packet.time_base)
        is_copied = packet.stream.index not in self._sounds and not self._container.exact_times
        return packet.is_discard and is_copied and end < -MAX_PRIMING

    def _copy(self, packet: Packet) -> None:
        """Mux, convert or encode one packet.

        Packets whose decoding time runs backwards are left out with a remark, because muxers refuse them.
        """
        assert packet.dts is not None
        index = packet.stream.index
        kind = packet.stream.type
        last = self._last_dts.get(index)
        # short audio packets may share a millisecond, and re-encoded audio gets new times
        equal_is_fine = kind == "subtitle" or index in self._sounds or not self._container.exact_times
        if last is not None and (packet.dts < last or (packet.dts == last and not equal_is_fine)):
            self._remark("packets-out-of-order", source=self._source.name)
            return
        self._last_dts[index] = packet.dts
        if index in self._sounds:
            self._sounds[index].take(packet)
        elif index in self._converters:
            self._mux(index, kind, self._converters[index].take(packet))
        else:
            if kind == "audio" and not packet.duration and last is not None:  # without one, mp4 hides the last packet
                packet.duration = packet.dts - last
            packet.stream = self._targets[index]
            self._mux(index, kind, [packet])

    def _mux(self, index: int, kind: str, packets: list[Packet]) -> None:
        """Mux packets of a stream of the source, and record its number and type in `written`."""
        self._output.mux(packets)
        if packets:
            self.written[index] = kind


def _attached_picture(source: VideoFile, index: int) -> Packet | None:
    """Return the packet of an attached picture, by a separate open file, as seeking back would lose audio."""
    with source.open() as file, suppress(FFmpegError):
        return next((packet for packet in file.demux(file.streams[index]) if packet.size), None)
    return None
