"""Everything of a video file but its pictures: sound, subtitles, data, cover, titles and chapters, carried over.

Packets pass untouched; only text subtitles become another text where the container asks for it, a timecode counts at
the new rate, and sound is encoded anew where it lasts longer or where that is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.container
import av.error

from fpsboost.io.trim import Window
from fpsboost.io.video.damage import Damage
from fpsboost.io.video.encoded_sound import EncodedSound, remark_on
from fpsboost.io.video.encoding import EXACT_CLOCKS, Encoding, containers
from fpsboost.io.video.fitting import Fitting, codec_of, fits, is_wanted, keeps_data, kind_of
from fpsboost.io.video.losses import not_held_remark
from fpsboost.io.video.packets import read_packets
from fpsboost.io.video.source import VideoSource, open_video
from fpsboost.io.video.stream_choice import is_cover_art
from fpsboost.io.video.subtitles import TextConverter, formats, is_text
from fpsboost.io.video.tags import copy_labels, lost_labels, tags_for
from fpsboost.io.video.timecode import at_rate, find_timecode, frames_later

WOVEN = 10
"""Seconds by which packets of one file may lie out of order between streams."""


class OtherStreams:
    """Sound, subtitles, data, attachments and titles on their way from the source file to the output.

    The source is opened a second time, so that these packets are read when they are due and memory stays flat.

    Parameters
    ----------
    source : VideoSource
    output : av.container.OutputContainer
        Not started yet.
    video : av.VideoStream
        The output's video stream.
    encoding : Encoding
    container, name : str
        FFmpeg's name of the output's container, and the path for messages.
    fitting : Fitting
        How the streams come into the container.
    window : Window, optional
        Which part of the source is written. What overlaps it is copied, and moved in time as the pictures are.
    """

    def __init__(
        self,
        source: VideoSource,
        output: av.container.OutputContainer,
        video: av.VideoStream,
        *,
        encoding: Encoding,
        container: str,
        name: str,
        fitting: Fitting,
        window: Window | None = None,
    ) -> None:
        self._window, self._fitting = window, fitting
        self.remarks: list[str] = []
        self._output, self._name, self._container, self._source = output, name, container, source
        self._input = open_video(source.path, source.info.name)
        self._targets: dict[int, av.stream.Stream] = {}
        self._last_dts: dict[int, int] = {}
        self._covers: list[av.stream.Stream] = []
        self._converters: dict[int, TextConverter] = {}
        self._sounds: dict[int, EncodedSound] = {}
        self.tags = tags_for(self._input.metadata, container)
        output.metadata.update(self.tags.values)
        if self.tags.lost:
            names = ", ".join(self.tags.lost)
            self.remarks.append(f"{name} lost tags of its source, which its container has no place for: {names}.")
        chapters = _chapters_within(self._input, window, source.start)
        output.set_chapters(chapters)
        if chapters and fitting.any_codec:
            self.remarks.append(f"{name} lost the chapters of its source, which its kind of sound rules out here.")
        copy_labels(self._input.streams[source.stream_index], video, container)
        self._has_timecode = self._copy_timecode(video)
        for stream in self._input.streams:
            if stream.index != source.stream_index:
                self._add(stream, encoding)
        self.clock = _clock_of_starts(
            self._input, source.start, [Fraction(sound.stream.time_base) for sound in self._sounds.values()]
        )
        self._packets = self._read()
        self._ahead: av.Packet[av.stream.Stream] | None = None

    def close(self) -> None:
        self._packets.close()  # type: ignore[attr-defined]
        self._input.close()

    def copy_until(self, time: Fraction | None) -> None:
        """Write what is due before `time` in seconds; everything for None."""
        while True:
            packet, self._ahead = self._ahead or next(self._packets, None), None
            if packet is None or (time is None and self._is_past(packet)):
                self._finish_sounds()
                return
            if (
                time is not None
                and packet.dts is not None
                and self._due(packet.dts * Fraction(packet.time_base)) > time
            ):
                self._ahead = packet
                return
            self._copy(packet)

    def copy_cover(self) -> None:
        """Write pictures attached to the file, which mp4 wants right after its header."""
        for stream in self._covers:
            packet = _attached_picture(self._source, stream.index)
            if packet is not None:
                packet.stream = self._targets[stream.index]
                self._output.mux(packet)

    def check_labels(self, path: Path) -> None:
        """Say what the streams of the finished file do not say of their sources."""
        with av.open(str(path.absolute()), metadata_errors="replace") as file:
            for index, target in self._targets.items():
                if target.type == "video" or target.index >= len(file.streams):
                    continue  # a cover
                lost = lost_labels(target, file.streams[target.index])
                if lost:
                    self.remarks.append(f"{self._name} lost of stream {index} of its source: {', '.join(lost)}.")

    def _add(self, stream: av.stream.Stream, encoding: Encoding) -> None:
        """Give a stream its counterpart in the output, or remark that there is none."""
        if stream.type == "video" and is_cover_art(stream):
            self._add_cover(stream)
        elif stream.discard == av.stream.Discard.all:
            pass  # chapters as an mp4 keeps them, which FFmpeg reads by itself
        elif stream.index in self._fitting.encoders:
            self._add_encoded(stream, self._fitting.encoders[stream.index])
        elif is_wanted(stream, encoding) and is_text(stream) and not fits(self._container, stream, None):
            self._add_converted(stream)
        elif is_wanted(stream, encoding) or (stream.type == "data" and keeps_data(self._container, stream)):
            self._add_target(stream, self._output.add_stream_from_template(stream))
        elif stream.type == "attachment" and _keeps(self._container, stream):
            self._output.add_stream_from_template(stream)
        elif stream.type == "data" and find_timecode(stream.metadata) and self._has_timecode:
            pass  # the container makes a stream of it by itself, or keeps it as a tag
        elif stream.type in ("data", "attachment", "unknown"):
            keeping = [suffix for suffix, container in containers.items() if _keeps(container, stream)]
            what = f"stream {stream.index} ({kind_of(stream)})"
            self.remarks.append(not_held_remark(self._name, what, keeping))

    def _add_target(self, stream: av.stream.Stream, target: av.stream.Stream) -> None:
        copy_labels(stream, target, self._container)
        self._targets[stream.index] = target

    def _add_converted(self, stream: av.stream.Stream) -> None:
        """Give subtitles a counterpart in a text format of the container; `fit_streams` has seen that it can be."""
        converter = TextConverter(stream, self._output, self._container)
        self._converters[stream.index] = converter
        self._add_target(stream, converter.stream)
        self.remarks.append(
            f"{self._name} holds stream {stream.index} ({codec_of(stream)} subtitles) of its source as "
            f"{formats[self._container]}; styles may differ."
        )

    def _add_encoded(self, stream: av.stream.Stream, encoder: str) -> None:
        """Give sound a counterpart of another format or length; `fit_streams` has seen that it can be."""
        sound = EncodedSound(stream, self._output, encoder, self._window)
        self._sounds[stream.index] = sound
        self._add_target(stream, sound.stream)
        stretch = 1 if self._window is None else self._window.stretch
        stretched = "" if stretch == 1 else f"stretched to {stretch} times its length and "
        self.remarks.append(
            f"{self._name} holds stream {stream.index} ({codec_of(stream)} sound) of its source {stretched}encoded "
            f"anew as {codec_of(sound.stream)}{sound.changes}."
        )

    def _finish_sounds(self) -> None:
        """Write what stretched sound has left, and say what it lost."""
        for index, sound in self._sounds.items():
            self._output.mux(sound.finish())
            if sound.lost_packets:
                self.remarks.append(remark_on(sound.lost_packets, index, self._source.info.name, self._name))
        self._sounds = {}

    def _copy_timecode(self, video: av.VideoStream) -> bool:
        """Say at which timecode the video starts; whether that succeeds, or there is nothing to say."""
        source: Any = self._input.streams[self._source.stream_index]
        timecode = find_timecode(source.metadata, self._input.metadata)
        if timecode is None:
            return False
        old, new = self._source.coded_rate, video.codec_context.framerate
        again = None
        if new:
            skipped = 0 if self._window is None else self._window.frames_before(old)
            again = at_rate(frames_later(timecode, old, skipped), old, Fraction(new))
        if again is None:
            self.remarks.append(
                f"{self._name} lost the timecode {timecode} of its source, which its rate cannot count."
            )
        else:
            video.metadata["timecode"] = again
        return True

    def _add_cover(self, stream: av.stream.Stream) -> None:
        picture = stream.metadata
        if self._container == "matroska":
            packet = _attached_picture(self._source, stream.index)
            if packet is not None:
                kind = "png" if stream.name == "png" else "jpeg"
                self._output.add_attachment(
                    picture.get("filename", f"cover.{kind}"), picture.get("mimetype", f"image/{kind}"), bytes(packet)
                )
                return
        elif self._container == "mp4" and stream.name in ("png", "mjpeg"):
            target = self._output.add_stream_from_template(stream, opaque=True)
            target.disposition = av.stream.Disposition.attached_pic
            self._targets[stream.index] = target
            self._covers.append(stream)
            return
        keeping = [suffix for suffix, container in containers.items() if container in ("mp4", "matroska")]
        self.remarks.append(not_held_remark(self._name, "the cover picture", keeping))

    def _read(self) -> Iterator[av.Packet[av.stream.Stream]]:
        covers = {stream.index for stream in self._covers}
        wanted = {index for index in self._targets if index not in covers}
        if not wanted:
            return
        damage = Damage()
        sentence = (
            f"{self._source.info.name} is damaged where sound, subtitles or data lie, so some may be missing in "
            f"{self._name}; listen to it."
        )
        for packet in read_packets(self._input, wanted, damage):
            if damage.unreadable and sentence not in self.remarks:
                self.remarks.append(sentence)
            if packet.dts is not None:
                later = round(self._source.start / Fraction(packet.time_base))
                packet.dts -= later
                packet.pts = None if packet.pts is None else packet.pts - later
                yield packet

    def _due(self, time: Fraction) -> Fraction:
        """When something of the source happens in the output."""
        window = self._window
        return time if window is None else (time - window.begin) * window.stretch

    def _is_past(self, packet: av.Packet[av.stream.Stream]) -> bool:
        """Whether everything from here on lies far behind the window, however the streams are woven together."""
        end = None if self._window is None else self._window.end
        return end is not None and packet.dts is not None and packet.dts * Fraction(packet.time_base) > end + WOVEN

    def _move(self, packet: av.Packet[av.stream.Stream], window: Window) -> bool:
        """Move a packet in time as the pictures are; whether any of it falls into the window."""
        assert packet.dts is not None
        tick = Fraction(packet.time_base)
        pts = packet.dts if packet.pts is None else packet.pts
        begin, end = pts * tick, (pts + max(packet.duration or 0, 1)) * tick
        if end <= window.begin or (window.end is not None and begin >= window.end):
            return False
        moved = round(window.begin / tick)
        packet.pts, packet.dts = pts - moved, packet.dts - moved
        if packet.stream.type == "subtitle":
            begin, end = max(begin, window.begin), end if window.end is None else min(end, window.end)
            packet.pts = packet.dts = round(self._due(begin) / tick)
            if packet.duration:
                packet.duration = round(self._due(end) / tick) - packet.pts
        # Matroska has no time before 0, and would move everything else instead
        return packet.pts >= 0 or self._container in EXACT_CLOCKS

    def _copy(self, packet: av.Packet[av.stream.Stream]) -> None:
        """Mux one packet, unless its time runs backwards, which no container takes."""
        assert packet.dts is not None
        index, kind = packet.stream.index, packet.stream.type
        if index not in self._sounds and self._window is not None and not self._move(packet, self._window):
            return
        last = self._last_dts.get(index)
        # short packets of sound may share a millisecond, and what is encoded anew gets times of its own
        equal_is_fine = kind == "subtitle" or index in self._sounds or self._container not in EXACT_CLOCKS
        if last is not None and (packet.dts < last or (packet.dts == last and not equal_is_fine)):
            sentence = f"{self._source.info.name} has sound or subtitle packets out of order, which were left out."
            if sentence not in self.remarks:
                self.remarks.append(sentence)
            return
        self._last_dts[index] = packet.dts
        if index in self._sounds:
            self._output.mux(self._sounds[index].converted(packet))
            return
        if index in self._converters:
            converted = self._converters[index].converted(packet)
            if converted is not None:
                self._output.mux(converted)
            return
        packet.stream = self._targets[index]
        self._output.mux(packet)


def _keeps(container: str, stream: av.stream.Stream) -> bool:
    """Whether a container holds a stream that is neither pictures, sound nor subtitles."""
    if stream.type == "attachment":
        return container == "matroska"
    return stream.type == "data" and keeps_data(container, stream)


def _chapters_within(file: av.container.InputContainer, window: Window | None, start: Fraction) -> list[Any]:
    """The chapters that overlap a window, as far as they do, counted from where the file starts."""
    window = window or Window(Fraction(0), None, None)
    kept = []
    for chapter in file.chapters():
        tick = Fraction(chapter["time_base"] or 1)
        begin, end = max(chapter["start"] * tick - start, window.begin), chapter["end"] * tick - start
        end = end if window.planned_end is None else min(end, window.planned_end)
        if begin < end:
            times = {
                name: round((time - window.begin) * window.stretch / tick)
                for name, time in (("start", begin), ("end", end))
            }
            kept.append({**chapter, **times})
    return kept


def _clock_of_starts(file: av.container.InputContainer, start: Fraction, ticks_of_sounds: Sequence[Fraction]) -> int:
    """Ticks per second that tell exactly when each stream starts, which mp4 otherwise rounds to milliseconds.

    Of sound that is encoded anew, also when it ends, since its last packet holds more than the sound.
    """
    starts = [
        stream.start_time * Fraction(stream.time_base) - start
        for stream in file.streams
        if stream.start_time is not None and stream.time_base
    ]
    ticks = math.lcm(1000, *(time.denominator for time in (*starts, *ticks_of_sounds)))
    return ticks if ticks < 2**31 else 1000


def _attached_picture(source: VideoSource, index: int) -> av.Packet[Any] | None:
    """Read a picture attached to the file, which FFmpeg delivers as the first packet of a stream of its own.

    The file is opened for it alone: going back to the start afterwards would lose sound from before time 0.
    """
    with open_video(source.path, source.info.name) as file:
        try:
            packet = next(iter(file.demux(file.streams[index])), None)
        except av.error.FFmpegError:
            return None
    return packet if packet is not None and packet.size else None
