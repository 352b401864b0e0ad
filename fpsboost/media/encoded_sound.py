"""Re-encode audio in a format that fits its container, at its own duration or time-stretched without change of pitch.

Audio is decoded, passed through FFmpeg's filters, and encoded. Each run of audio without a gap has its own filter
graph. After a gap, or where packets are lost, a new run begins at the source's timestamp, so that no drift accumulates
in long clips. Samples decoded beyond the end of the last packet are encoder padding and are cut off.

Whatever lies before, between and behind the runs is encoded as silence. A jump of the timestamps would not do:
browsers, and every program that reads samples one after the other, play what follows too early.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, get_args

import av.container
import av.filter
import numpy as np
from av import AudioFrame
from av.container import OutputContainer
from av.error import FFmpegError
from av.filter import Graph
from av.packet import PacketSideData, PktSideDataT
from av.stream import Stream

from fpsboost.media.encoding import is_lossless
from fpsboost.media.info import FOREVER
from fpsboost.media.output import Output
from fpsboost.media.pyav import REFUSALS, Packet, pulled
from fpsboost.media.sound_formats import BITRATE_PER_CHANNEL, Traits, named_layout, traits_for
from fpsboost.media.time_map import Segment

MIN_GAP = Fraction(1, 50)
"""Minimum distance of audio from the end of its run that is a gap, seconds: above jitter, and a lost packet."""
MAX_PADDING = Fraction(1, 5)  # duration of padding at the end of a source, at most, seconds: a long packet
MAX_DELAY = 1  # duration after the end of a part of a curve in which its last samples are certainly decoded, seconds
PREROLL = Fraction(1, 2)  # duration that is decoded before the start of the window, since decoders need it, seconds
FLUSH_SILENCE = Fraction(1, 4)
"""Duration in the output of the silence appended to a run to flush the filters, at least, seconds."""
SKIP_SAMPLES_STRUCT = struct.Struct("<IIBB")
"""Layout of FFmpeg's AV_PKT_DATA_SKIP_SAMPLES: samples to skip at the start and at the end, and a reason for each."""
SKIP_SAMPLES_TYPE = get_args(PktSideDataT).index("skip_samples")
WHOLE = Segment(-FOREVER, FOREVER, -FOREVER, FOREVER)
"""All of a source, with what lies before time 0."""
FROM_START = Segment(Fraction(0), FOREVER, Fraction(0), FOREVER)
"""All of a part at its own speed."""


def can_encode(stream: Stream, encoder: str) -> bool:
    """Return whether a stream can be decoded here, stretched and encoded by an encoder."""
    context: Any = stream.codec_context
    if context is None or context.sample_rate <= 0:
        return False
    traits = _traits_of(context)
    try:
        _graph(traits, Fraction(2), traits_for(encoder, traits))
    except REFUSALS:
        return False
    return True


class EncodedSound:
    """Audio stream that is re-encoded in another format, or at another duration.

    The output begins at time 0 and has no gap: it is silent where the source has no sound, where its speed curve leaves
    sound out, and where `lost_packets` could not be decoded. Only behind `silent_until`, seconds, time stamps jump
    instead. `changes` is the end of a sentence about properties that the encoder does not support: ``, its 7.1.4 as
    stereo``.

    Parameters
    ----------
    stream : Stream
        Audio stream of the source.
    container : OutputContainer
        File whose header is not written yet, to which a stream is added.
    encoder : str
        FFmpeg's name of the encoder.
    output : Output
        What is written: its bit rate of audio, and its window, which is read when the first packet arrives.
    """

    def __init__(self, stream: Stream, container: OutputContainer, encoder: str, output: Output) -> None:
        self.lost_packets = 0
        self._output = container
        self._window = output.window
        self._source: Any = stream.codec_context
        traits = _traits_of(self._source)
        self._target = traits_for(encoder, traits)
        self._rate, format, layout = self._target
        self.changes = "" if layout == traits[2] else f", its {traits[2]} as {layout}"
        if self._rate != traits[0]:
            self.changes += f", at {self._rate} instead of {traits[0]} Hz"
        depths = [8 * av.AudioFormat(name).bytes for name in (format, traits[1])]
        if is_lossless(encoder) and self._source.codec.lossless and depths[0] < depths[1]:
            self.changes += f", in {depths[0]} bits"
        target: Any = container.add_stream(encoder, rate=self._rate, layout=layout)
        target.codec_context.format = format
        if not is_lossless(encoder):
            usual = BITRATE_PER_CHANNEL * target.codec_context.layout.nb_channels
            target.bit_rate = output.encoding.audio_bitrate or usual
        target.time_base = Fraction(1, self._rate)
        self.stream: Any = target
        self._run: _Run | None = None
        self._next_pts: int | None = None
        self._latest: AudioFrame | None = None
        self._packets_end = self._tick = Fraction(0)
        self.silent_until = FOREVER

    def take(self, packet: Packet) -> None:
        """Decode a packet, and encode what is complete with it; packets far outside the audible parts are ignored."""
        self._tick = tick = Fraction(packet.time_base)
        pts = packet.dts or 0 if packet.pts is None else packet.pts
        begin = pts * tick
        end = (pts + (packet.duration or 0)) * tick
        needing = [piece for piece in self._pieces if piece.source0 - PREROLL <= end and begin < piece.source1]
        if not needing:
            return
        self._packets_end = end if packet.duration else Fraction(0)
        self._decode(packet, begin, is_heard=end > needing[0].source0)

    def drain(self) -> None:
        """Encode what the decoder and the filters still hold, after the last packet; may be called again."""
        self._decode(None, self._packets_end, is_heard=True)
        self._end_run(self._packets_end)
        self._pieces = []

    def _decode(self, packet: Packet | None, begin: Fraction, *, is_heard: bool) -> None:
        """Decode a packet, or what the decoder still holds, and encode what is complete with it."""
        try:
            frames: list[Any] = self._source.decode(packet)
        except av.error.EOFError:  # all was decoded before
            return
        except FFmpegError:
            self.lost_packets += is_heard
            return
        for frame in frames:
            self._take(frame, begin)

    def be_silent_until(self, time: Fraction) -> None:
        """Encode the silence of a curve that is certain when pictures are shown up to an output time, seconds.

        So silence lies beside its pictures in the file, although no packet of the source is due while it lasts.
        """
        curve = None if self._window is None else self._window.curve
        later = [piece for piece in self._pieces if piece.end + MAX_DELAY >= time]
        is_ahead = self._next_pts is not None and self._next_pts >= time * self._rate
        if curve is None or curve.is_steady or is_ahead or (later and later[0].begin < time):
            return
        self._end_run()
        self._fill(time)

    def finish(self, end: Fraction) -> bool:
        """Encode the rest, by a curve up to the end of the pictures, seconds; return whether there was any sound."""
        self.drain()
        self.be_silent_until(end)
        if self._latest is None:
            return False
        self._output.mux(self.stream.encode(self._latest))
        self._output.mux(self._with_padding_marked(self.stream.encode(None)))
        return True

    def _with_padding_marked(self, packets: list[Packet]) -> list[Packet]:
        """Return the last packets with padding marked, as not all encoders do, by duration or samples to skip."""
        last = next((packet for packet in reversed(packets) if packet.size), None)
        if last is None or last.pts is None or self._next_pts is None:
            return packets
        tick = Fraction(last.time_base)
        left = self._next_pts - round(last.pts * tick * self._rate)
        context: Any = self.stream.codec_context
        padding = 0 if is_lossless(context.codec.name) else context.frame_size - left
        if left > 0 and padding > 0:
            last.duration = min(last.duration or left, round(Fraction(left, self._rate) / tick))
            if not any(item.data_type == "skip_samples" for item in last.iter_sidedata()):
                discarded = PacketSideData(SKIP_SAMPLES_TYPE, SKIP_SAMPLES_STRUCT.size)  # type: ignore[call-arg]
                discarded.update(SKIP_SAMPLES_STRUCT.pack(0, padding, 0, 0))
                last.set_sidedata(discarded)
        return packets

    def _take(self, frame: AudioFrame, begin: Fraction) -> None:
        """Stretch and encode new samples in the window; `begin`, of the packet, is the time of a frame without one."""
        run = self._run
        time = begin if frame.pts is None else frame.pts * Fraction(frame.time_base or 1)
        if run is not None and abs(time - run.end) < MIN_GAP:
            time = run.end
        first = 0 if run is None else max(0, math.ceil((run.end - time) * frame.sample_rate))
        for piece in self._pieces:
            since, until = (math.ceil((each - time) * frame.sample_rate) for each in (piece.source0, piece.source1))
            if max(first, since) < min(frame.samples, until):
                self._stretch(frame, time, max(first, since), min(frame.samples, until), piece)
            if first <= until < frame.samples:
                self._end_run()

    @cached_property
    def _pieces(self) -> list[Segment]:
        """Parts of the source that are heard, at its own times; none after its end."""
        if self._window is None:
            return [WHOLE]
        begin = self._window.begin
        curve = self._window.curve
        last = begin + FOREVER if self._window.end is None else self._window.end
        heard = [FROM_START] if curve is None else curve.sounding
        return [replace(x, source0=begin + x.source0, source1=min(begin + x.source1, last)) for x in heard]

    def _stretch(self, frame: AudioFrame, time: Fraction, first: int, last: int, piece: Segment) -> None:
        """Stretch and encode some samples of a frame that begins at a time."""
        run = self._run
        stretch = 1 / piece.slope0
        traits = _traits_of(frame)
        time += Fraction(first, frame.sample_rate)
        if run is None or time > run.end or (run.traits, run.stretch) != (traits, stretch):
            self._end_run()
            try:
                graph = _graph(traits, stretch, self._target)
            except REFUSALS:  # a channel layout decoded from damaged data
                self.lost_packets += 1
                return
            run = self._run = _Run(
                graph, traits, stretch, time, self._fill(piece.begin + (time - piece.source0) * stretch)
            )
        part = _slice_samples(frame, first, last)
        part.pts = run.taken
        part.time_base = Fraction(1, traits[0])
        run.taken += part.samples
        run.graph.push(part)
        self._encode(pulled(run.graph))

    def _end_run(self, end: Fraction | None = None) -> None:
        """Encode what the filters still hold, cut so that the run has its exact duration.

        What was decoded beyond `end`, where the source's packets end, is padding; 0 if unknown. A packet's time and
        duration may both be rounded to the file's time base, and are then not exact to the sample.
        """
        run = self._run
        self._run = None
        if run is not None:
            padding = run.end - end if end else Fraction(0)
            padding = padding if 2 * self._tick < padding < MAX_PADDING else Fraction(0)
            samples = run.taken - math.floor(padding * run.traits[0])
            run.graph.push(None)
            self._encode(pulled(run.graph), run.pts + round(samples * run.stretch * self._rate / run.traits[0]))

    def _fill(self, time: Fraction) -> int:
        """Encode silence from where the output has come to, or else from its start, up to an output time, seconds.

        After `silent_until` the output's time stamps jump instead. Returns the number of the sample that comes next.
        """
        end = round(time * self._rate)
        if self._next_pts is None:
            self._next_pts = min(0, end)
        if time > self.silent_until:
            self._next_pts = max(self._next_pts, end)
        if self._next_pts < end:
            self._encode(_silence(end - self._next_pts, self._target))
        return self._next_pts

    def _encode(self, frames: Iterator[AudioFrame], end: int | None = None) -> None:
        """Encode frames behind those before them, up to a sample of the output; the latest one waits.

        It may be the last one, and have padding, which is cut off then.
        """
        for frame in frames:
            assert self._next_pts is not None
            left = frame.samples if end is None else end - self._next_pts
            if left > 0:
                latest = self._latest
                self._latest = _slice_samples(frame, 0, min(left, frame.samples))
                self._latest.pts = self._next_pts
                self._latest.time_base = Fraction(1, self._rate)
                self._next_pts += self._latest.samples
                self._output.mux([] if latest is None else self.stream.encode(latest))
        if end is not None and self._latest is not None and self._next_pts is not None and self._next_pts > end:
            kept = max(1, self._latest.samples - (self._next_pts - end))
            self._latest = _slice_samples(self._latest, 0, kept)
            self._next_pts = end


@dataclass
class _Run:
    """One run of audio without a gap: its filter graph, where it starts, and how much of it was taken so far."""

    graph: Graph
    traits: Traits
    stretch: Fraction
    start: Fraction
    """Time in the source, seconds."""
    pts: int
    """Number of the output's first sample of the run."""
    taken: int = 0
    """Samples of the source."""

    @property
    def end(self) -> Fraction:
        """End of the samples taken so far, as a time in the source, seconds."""
        return self.start + Fraction(self.taken, self.traits[0])


def _silence(samples: int, target: Traits) -> Iterator[AudioFrame]:
    """Yield frames of silence, few samples at a time."""
    graph = Graph()
    nodes = [
        graph.add("anullsrc", "sample_rate={0}:channel_layout={2}".format(*target)),
        graph.add("aformat", f"sample_fmts={target[1]}"),
        graph.add("atrim", f"end_sample={samples}"),
        graph.add("abuffersink"),
    ]
    graph.link_nodes(*nodes).configure()
    return pulled(graph)


def _graph(source: Traits, stretch: Fraction, target: Traits) -> Graph:
    """Build a filter graph that converts audio to other traits and another duration, and appends silence."""
    rate = source[0]
    # atempo outputs everything too early, by half a window for each multiple of the duration beyond the first: silence
    # of that length is prepended, and cut off again; a window is the first power of two of at least 1/24 s
    lead = (1 << (max(1, rate // 24) - 1).bit_length()) // 2 if stretch > 1 else 0
    stages = math.ceil(abs(math.log2(stretch)) - 1e-9)
    tempo = min(2.0, max(0.5, float(1 / stretch) ** (1 / max(1, stages))))
    graph = Graph()
    nodes = [graph.add_abuffer(sample_rate=rate, format=source[1], layout=source[2], time_base=Fraction(1, rate))]
    if lead:
        nodes.append(graph.add("adelay", f"delays={lead}S:all=1"))
    nodes.append(graph.add("apad", f"pad_len={round(FLUSH_SILENCE * max(Fraction(1), 1 / stretch) * rate)}"))
    nodes += [graph.add("atempo", repr(tempo)) for _ in range(stages)]
    nodes += [
        graph.add("aresample", "osr={}:osf={}:ochl={}:rematrix_maxval=1".format(*target)),  # downmixing must not clip
        graph.add("atrim", f"start_sample={round(Fraction(lead * target[0], rate))}"),
    ]
    graph.link_nodes(*nodes, graph.add("abuffersink")).configure()
    return graph


def _slice_samples(frame: AudioFrame, first: int, last: int) -> AudioFrame:
    """Return some samples of a frame; the time is that of the whole frame."""
    if (first, last) == (0, frame.samples):
        return frame
    width = 1 if frame.format.is_planar else frame.layout.nb_channels
    samples: np.ndarray = np.ascontiguousarray(frame.to_ndarray()[:, first * width : last * width])
    part = AudioFrame.from_ndarray(samples, format=frame.format.name, layout=frame.layout.name)
    part.sample_rate = frame.sample_rate
    part.pts = frame.pts
    part.time_base = frame.time_base
    return part


def _traits_of(sound: Any) -> Traits:
    """Return the traits of a frame, or of a decoder, whose sample format is taken for fltp if it is not known yet."""
    format = "fltp" if sound.format is None else sound.format.name
    return sound.sample_rate, format, named_layout(sound.layout)
