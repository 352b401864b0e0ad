"""Text subtitles, converted to the format of another container."""

import math
from fractions import Fraction
from typing import Any, cast

import av
from av.codec.codec import Capabilities
from av.container import OutputContainer
from av.error import FFmpegError
from av.stream import Stream
from av.subtitles.subtitle import SubtitleSet

from fpsboost.media.containers import MATROSKA_TICK, Container
from fpsboost.media.demuxer import is_encrypted
from fpsboost.media.pyav import Packet, packet_of

MAX_INTERLEAVING = 10  # maximum time by which packets of different streams in one file may be out of order, seconds


MIN_TEXT_TICK = Fraction(1, 90_000)
"""Shortest tick of subtitles in mp4 and mov, seconds: their muxer refuses two cues that are 2**31 ticks apart."""


ERASE_CAPTIONS = b"\xfc\x94\x2c\xfd\x15\x2c"
"""Command of CEA-608 that empties the screen, in the first and in the second field of a picture, with parity."""


class TextConverter:
    """Converter of text subtitles to the format of another container; text and times are kept, styles may be lost.

    mp4 and mov show one text at a time, so cues that overlap are joined to one text while they do. `lost_lines` is set
    if more lines overlap than one text can hold.

    Parameters
    ----------
    stream : Stream
        Stream of text subtitles of the source.
    output : OutputContainer
        Output, whose header is not written yet, to which a stream is added.
    container : Container
        Container of the output.
    """

    def __init__(self, stream: Stream, output: OutputContainer, container: Container) -> None:
        self._source: Any = stream
        self._decoder = cast(Any, stream.codec_context)
        self._decoder.open(strict=False)
        self.stream: Stream = output.add_stream(container.text_format)
        self.lost_lines = False
        self._shows_one = container.exact_times
        tick = Fraction(stream.time_base or MATROSKA_TICK)
        self._tick = MATROSKA_TICK if self._shows_one and tick < MIN_TEXT_TICK else tick
        self._encoder = cast(Any, self.stream.codec_context)
        self.stream.time_base = self._encoder.time_base = self._tick
        self._encoder.subtitle_header = self._decoder.subtitle_header
        self._cues: list[tuple[int, list[bytes]]] = []
        """End and lines of cues; those that end after `_begin` are not shown to their end yet."""
        self._begin: int | None = None
        self._is_late = bool(Capabilities(self._decoder.codec.capabilities) & Capabilities.delay)
        self._end = 0
        """End of the last packet that was decoded, in ticks of the stream."""

    def cues(self, packet: Packet) -> list[Packet]:
        """Decode a packet of the source to a packet of ASS lines at its time; empty if it shows nothing.

        The decoder of closed captions (CEA-608), which are commands to a screen, returns the previous text when the
        screen changes: that text begins at the decoder's time and ends at the time of the packet that completed it.
        """
        pts: Any = packet.dts if packet.pts is None else packet.pts
        packet.pts = pts
        self._end = pts + (packet.duration or 0)
        if is_encrypted(packet):
            return [packet]
        try:
            shown = self._decoder.decode2(packet)
        except FFmpegError:
            return []
        if not shown:
            return []
        begin = round(Fraction(shown.pts, av.time_base) / Fraction(packet.time_base)) if self._is_late else pts
        lines = b"\n".join(line.ass for line in shown)
        end = pts if self._is_late else self._end
        return [packet_of(lines, packet.stream, packet.time_base, begin, end - begin)]

    def last_cues(self) -> list[Packet]:
        """Return the closed captions still on screen after the last packet, by decoding an erase command."""
        if not self._is_late:
            return []
        return self.cues(packet_of(ERASE_CAPTIONS, self._source, self._source.time_base, self._end, 0))

    def take(self, packet: Packet) -> list[Packet]:
        """Add a cue of `cues`; return the packets in the target format that are complete with it."""
        lines = bytes(packet).split(b"\n")
        start = packet.pts or 0
        tick = Fraction(packet.time_base)
        begin, end = (round(time * tick / self._tick) for time in (start, start + (packet.duration or 0)))
        if not self._shows_one:
            return self._packets(lines, begin, end)
        complete = self._shown(begin, cut=True)
        self._begin = begin if self._begin is None else max(begin, self._begin)
        self._cues.append((max(end, begin + 1), lines))
        return complete

    def until(self, time: Fraction | None) -> list[Packet]:
        """Return the packets that are complete once all streams are read up to `time`, seconds; None for all."""
        return self._shown(None if time is None else math.floor(time / self._tick), cut=False)

    def _shown(self, time: int | None, *, cut: bool) -> list[Packet]:
        """Return the texts up to `time` that no later cue can change; with `cut`, end the current one at `time`."""
        packets: list[Packet] = []
        late = 0 if cut else math.ceil(MAX_INTERLEAVING / self._tick)  # a packet may come so late
        while self._begin is not None and (cues := [cue for cue in self._cues if cue[0] > self._begin]):
            end = min(end for end, _ in cues)
            if time is not None and cut:
                end = min(end, time)
            if time is not None and not (self._begin < end <= time and self._begin <= time - late):
                break
            packets += self._packets([line for _, lines in cues for line in lines], self._begin, end)
            self._cues = cues
            self._begin = end
        return packets

    def _packets(self, lines: list[bytes], begin: int, end: int) -> list[Packet]:
        """Encode lines as one packet from `begin` to `end`, ticks; drop lines from the first until it fits."""
        # an ASS line has nine fields, of which the last is the text; layers repeat it
        texts = list(dict.fromkeys(line.split(b",", 8)[-1] for line in lines))
        text = b",".join([*lines[0].split(b",", 8)[:-1], b"\\N".join(texts)])
        try:
            cue = self._encoder.encode_subtitle(SubtitleSet.create(text, 0, end - begin))
        except FFmpegError:
            self.lost_lines = True
            return self._packets(lines[1:], begin, end) if lines[1:] else []
        return [packet_of(bytes(cue), self.stream, self._tick, begin, end - begin)]
