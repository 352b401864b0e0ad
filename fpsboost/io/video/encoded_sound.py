"""Encode audio anew: which encoder and format, at its own duration or time-stretched at its own pitch.

Audio is decoded, passed through FFmpeg's filters, and encoded. Each run of audio without a gap has its own filter
graph. After a gap, or where packets are lost, a new run begins at the source's timestamp, so that no drift accumulates
in long clips. Samples decoded beyond the end of the last packet are encoder padding and are cut off.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from operator import attrgetter
from typing import Any, get_args

import av
import av.container
import av.error
import av.filter
import numpy as np
from av.codec.codec import UnknownCodecError
from av.packet import PacketSideData, PktSideDataT
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.io.output import Window
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import check_holds, find_encoder
from fpsboost.timing.time_map import Segment

COPY = "copy"  # value of ``--audio-codec`` that copies audio without re-encoding it

sound_encoders = {
    **{"aac": "aac", "opus": "libopus", "mp3": "libmp3lame", "ac3": "ac3", "eac3": "eac3"},
    **{"flac": "flac", "alac": "alac", "pcm": "pcm_s16le"},
}
"""FFmpeg's encoders by the common name of their format."""

defaults = {"mp4": "aac", "mov": "aac", "matroska": "libopus", "webm": "libopus"}
"""Encoder that is proposed for a container, and used for stretched audio: its format is the one all players support."""

BITRATE_PER_CHANNEL = 96_000
"""Bit rate per channel, bits per second, at which AAC and Opus are hard to distinguish from the source."""
OPUS_SAMPLE_RATE = 48_000  # output sample rate of Opus decoders, which does not depend on the encoded rate, Hz
STANDARD_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")
"""Standard channel layouts for one channel, two, ..."""
MIN_GAP = Fraction(1, 50)
"""Minimum distance of audio from the end of its run that is a gap, seconds: above jitter, and a lost packet."""
PREROLL = Fraction(1, 2)  # duration that is decoded before the start of the window, since decoders need it, seconds
FLUSH_SILENCE = Fraction(1, 4)
"""Duration in the output of the silence appended to a run to flush the filters, at least, seconds."""
SKIP_SAMPLES_STRUCT = struct.Struct("<IIBB")
"""Layout of FFmpeg's AV_PKT_DATA_SKIP_SAMPLES: samples to skip at the start and at the end, and a reason for each."""
SKIP_SAMPLES_TYPE = get_args(PktSideDataT).index("skip_samples")
MIN_TIME = Fraction(-(2**40))  # time before the start of any file, seconds
WHOLE = Segment(MIN_TIME, -MIN_TIME, MIN_TIME, -MIN_TIME, Fraction(1), Fraction(1))

Traits = tuple[int, str, str]
"""Sample rate, sample format and channel layout of audio."""


def choose_sound_encoder(encoding: Encoding, container: str, name: str) -> str | None:
    """Return FFmpeg's encoder for the audio codec that was asked for, or None if audio is to be copied."""
    asked = encoding.audio_codec
    if asked is None or asked.lower() == COPY:
        return None
    encoder = sound_encoders.get(asked.lower(), asked)
    if find_encoder(encoder, "audio") is None:
        raise OptionError(
            f"`audio_codec={asked!r}` is unknown here; use {', '.join(sound_encoders)}, {COPY}, or the exact name of "
            "an FFmpeg sound encoder."
        )
    check_holds(container, encoder, name, f"`audio_codec={asked!r}`", sound_encoders)
    return encoder


def traits_for(encoder: str, source: Traits, channels: int) -> Traits:
    """Return the source's sample rate, format and layout if the encoder supports them, else those that lose least.

    These are the next higher rate, the standard layout of as many channels or else stereo, and a format with at least
    the source's bits, or floats for a lossy encoder, which do not clip.
    """
    codec = av.Codec(encoder, "w")
    rates: Collection[int] = codec.audio_rates or ()
    rate = min((higher for higher in rates if higher >= source[0]), default=max(rates, default=source[0]))
    offered = codec.audio_formats or [av.AudioFormat(source[1])]
    if codec.lossy:
        offered = [format for format in offered if format.name.startswith("flt")] or offered
    size = attrgetter("bytes")
    enough = [format for format in offered if format.bytes >= av.AudioFormat(source[1]).bytes]
    format = str((min(enough, key=size) if enough else max(offered, key=size)).name)
    target = OPUS_SAMPLE_RATE if codec.canonical_name == "opus" else rate, format
    layouts = (source[2], *STANDARD_LAYOUTS[channels - 1 : channels])
    return *target, next((name for name in layouts if _takes(encoder, (*target, name))), "stereo")


def named_layout(layout: str, channels: int) -> str:
    """Return the standard channel layout if `layout` gives only the number of channels, else `layout`."""
    says_nothing = layout.endswith("channels") or layout.endswith("channel")
    return STANDARD_LAYOUTS[channels - 1] if says_nothing and channels <= len(STANDARD_LAYOUTS) else layout


def is_lossless(encoder: str) -> bool:
    """Return whether an encoder has no lossy mode."""
    codec = av.Codec(encoder, "w")
    return codec.lossless and not codec.lossy


def _takes(encoder: str, traits: Traits) -> bool:
    context: Any = av.CodecContext.create(encoder, "w")
    try:
        context.sample_rate, context.format, context.layout = traits
        context.time_base = Fraction(1, traits[0])
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True


def can_encode(stream: av.stream.Stream, encoder: str) -> bool:
    """Return whether a stream can be decoded here, stretched and encoded by an encoder."""
    context: Any = stream.codec_context
    if context is None or context.sample_rate <= 0:
        return False
    traits, channels = _traits_of_stream(stream)
    try:
        _graph(traits, Fraction(2), traits_for(encoder, traits, channels))
    except (UnknownCodecError, av.error.FFmpegError, ValueError):
        return False
    return True


class EncodedSound:
    """Audio stream that is re-encoded in another format, or at another duration.

    It is added to an output whose header is not written yet. The window is read when packets arrive; without one, all
    of the source is taken at its own duration. The output is silent where `lost_packets` could not be decoded.
    `changes` end a sentence about what the encoder does not support: ``, its 7.1.4 as stereo``.
    """

    def __init__(
        self, stream: av.stream.Stream, output: av.container.OutputContainer, encoder: str, window: Window | None
    ) -> None:
        self.lost_packets = 0
        self._output, self._window = output, window
        self._source: Any = stream.codec_context
        traits, channels = _traits_of_stream(stream)
        self._target = traits_for(encoder, traits, channels)
        self._rate, format, layout = self._target
        self.changes = "" if layout == traits[2] else f", its {traits[2]} as {layout}"
        if self._rate != traits[0]:
            self.changes += f", at {self._rate} instead of {traits[0]} Hz"
        depths = [8 * av.AudioFormat(name).bytes for name in (format, traits[1])]
        if is_lossless(encoder) and self._source.codec.lossless and depths[0] < depths[1]:
            self.changes += f", in {depths[0]} bits"
        target: Any = output.add_stream(encoder, rate=self._rate, layout=layout)
        target.codec_context.format = format
        if not is_lossless(encoder):
            target.bit_rate = BITRATE_PER_CHANNEL * target.codec_context.layout.nb_channels
        target.time_base = Fraction(1, self._rate)
        self.stream: Any = target
        self._run: _Run | None = None
        self._next_pts: int | None = None
        self._latest: tuple[av.AudioFrame, Fraction | None] | None = None
        self._packets_end = Fraction(0)
        self._tick = Fraction(0)

    @property
    def is_empty(self) -> bool:
        return self._next_pts is None

    def take(self, packet: av.Packet[Any]) -> None:
        assert packet.dts is not None
        self._tick = tick = Fraction(packet.time_base)
        pts = packet.dts if packet.pts is None else packet.pts
        begin, end = pts * tick, (pts + (packet.duration or 0)) * tick
        first, last = self._span
        if end < first - PREROLL or (last is not None and begin >= last):
            return
        self._packets_end = end if packet.duration else Fraction(0)
        try:
            frames: list[Any] = packet.decode()
        except av.error.FFmpegError:
            self.lost_packets += end > first
            return
        for frame in frames:
            self._wait(frame, begin)

    def finish(self) -> None:
        try:
            frames: list[Any] = self._source.decode(None)
        except av.error.FFmpegError:
            frames, self.lost_packets = [], self.lost_packets + 1
        for frame in frames:
            self._wait(frame, None)
        self._take_latest(self._packets_end)
        self._end_run()
        if self._next_pts is not None:
            self._output.mux(self._with_padding_marked(self.stream.encode(None)))

    def _with_padding_marked(self, packets: list[av.Packet[Any]]) -> list[av.Packet[Any]]:
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

    @property
    def _span(self) -> tuple[Fraction, Fraction | None]:
        return (MIN_TIME, None) if self._window is None else (self._window.begin, self._window.end)

    def _wait(self, frame: av.AudioFrame, begin: Fraction | None) -> None:
        """Process the frame before, which is not the last one, and let this one wait."""
        self._take_latest(None)
        self._latest = frame, begin

    def _take_latest(self, end: Fraction | None) -> None:
        """Process the waiting frame up to `end`, where the source's packets end; None for all of it, 0 if unknown.

        A packet's time and duration may both be rounded to the file's time base, and are then not exact to the sample.
        """
        if self._latest is None:
            return
        (frame, begin), self._latest = self._latest, None
        if end and frame.pts is not None and frame.time_base:
            beyond = frame.pts * frame.time_base + Fraction(frame.samples, frame.sample_rate) - end
            padding = math.floor(beyond * frame.sample_rate)
            if beyond > 2 * self._tick and 0 < padding < frame.samples:
                time, base = frame.pts, frame.time_base
                frame = _slice_samples(frame, 0, frame.samples - padding)
                frame.pts, frame.time_base = time, base
        self._take(frame, begin)

    def _take(self, frame: av.AudioFrame, begin: Fraction | None) -> None:
        """Stretch and encode new samples in the window; `begin`, of the packet, is the time of a frame without one."""
        run = self._run
        time = begin if frame.pts is None else frame.pts * Fraction(frame.time_base or 1)
        if time is None or (run is not None and abs(time - run.end) < MIN_GAP):
            if run is None:
                return
            time = run.end
        earliest, end = self._span
        earliest = earliest if run is None else max(earliest, run.end)
        first = max(0, math.ceil((earliest - time) * frame.sample_rate))
        last = frame.samples if end is None else min(frame.samples, math.ceil((end - time) * frame.sample_rate))
        for piece in self._pieces:
            since, until = (math.ceil((each - time) * frame.sample_rate) for each in (piece.source0, piece.source1))
            if max(first, since) < min(last, until):
                self._stretch(frame, time, max(first, since), min(last, until), piece)
            if first <= until < last:
                self._end_run()

    @cached_property
    def _pieces(self) -> list[Segment]:
        """Parts of the source that are heard, at its own times."""
        curve, begin = (None, Fraction(0)) if self._window is None else (self._window.curve, self._window.begin)
        kept = [WHOLE] if curve is None else curve.sounding
        return [replace(each, source0=begin + each.source0, source1=begin + each.source1) for each in kept]

    def _stretch(self, frame: av.AudioFrame, time: Fraction, first: int, last: int, piece: Segment) -> None:
        """Stretch and encode some samples of a frame that begins at a time."""
        run, stretch = self._run, 1 / piece.slope0
        time += Fraction(first, frame.sample_rate)
        if run is None or time > run.end or not run.fits(frame, stretch):
            self._end_run()
            try:
                run = self._run = _Run(frame, time, stretch, self._target)
            except (av.error.FFmpegError, ValueError):  # a channel layout decoded from damaged data
                self.lost_packets += 1
                return
            pts = round((piece.begin + (time - piece.source0) * stretch) * self._rate)
            self._next_pts = pts if self._next_pts is None else max(pts, self._next_pts)
        self._encode(run.stretched(_slice_samples(frame, first, last)))

    def _end_run(self) -> None:
        run, self._run = self._run, None
        if run is not None:
            self._encode(run.finish())

    def _encode(self, frames: Iterator[av.AudioFrame]) -> None:
        for frame in frames:
            assert self._next_pts is not None
            frame.pts, frame.time_base = self._next_pts, Fraction(1, self._rate)
            self._next_pts += frame.samples
            self._output.mux(self.stream.encode(frame))


class _Run:
    """Filter graph for one run of audio without a gap, which starts at `start` seconds of the source."""

    def __init__(self, frame: av.AudioFrame, start: Fraction, stretch: Fraction, target: Traits) -> None:
        self._start, self._stretch, self._target = start, stretch, target
        self._traits = _traits_of(frame)
        self._rate_in = frame.sample_rate
        self._taken = self._given = 0
        self._graph = _graph(self._traits, stretch, target)

    @property
    def end(self) -> Fraction:
        """End of the samples taken so far, as a time in the source, seconds."""
        return self._start + Fraction(self._taken, self._rate_in)

    def fits(self, frame: av.AudioFrame, stretch: Fraction) -> bool:
        return (_traits_of(frame), stretch) == (self._traits, self._stretch)

    def stretched(self, frame: av.AudioFrame) -> Iterator[av.AudioFrame]:
        frame.pts, frame.time_base = self._taken, Fraction(1, self._rate_in)
        self._taken += frame.samples
        self._graph.push(frame)
        for ready in self._ready():
            self._given += ready.samples
            yield ready

    def finish(self) -> Iterator[av.AudioFrame]:
        """Yield the remaining frames, cut so that the run has its exact duration."""
        missing = round(self._taken * self._stretch * self._target[0] / self._rate_in) - self._given
        self._graph.push(None)
        for ready in self._ready():
            if missing > 0:
                yield _slice_samples(ready, 0, min(missing, ready.samples))
            missing -= ready.samples

    def _ready(self) -> Iterator[av.AudioFrame]:
        while True:
            try:
                frame: Any = self._graph.pull()
            except (av.error.BlockingIOError, av.error.EOFError):
                return
            yield frame


def _graph(source: Traits, stretch: Fraction, target: Traits) -> av.filter.Graph:
    """Build a filter graph that converts audio to other traits and another duration, and appends silence."""
    rate = source[0]
    # atempo outputs everything too early, by half a window for each multiple of the duration beyond the first: silence
    # of that length is prepended, and cut off again; a window is the first power of two of at least 1/24 s
    lead = (1 << (max(1, rate // 24) - 1).bit_length()) // 2 if stretch > 1 else 0
    stages = math.ceil(abs(math.log2(stretch)) - 1e-9)
    tempo = min(2.0, max(0.5, float(1 / stretch) ** (1 / max(1, stages))))
    graph = av.filter.Graph()
    nodes = [
        graph.add_abuffer(sample_rate=rate, format=source[1], layout=source[2], time_base=Fraction(1, rate)),
        *([graph.add("adelay", f"delays={lead}S:all=1")] if lead else []),
        graph.add("apad", f"pad_len={round(FLUSH_SILENCE * max(Fraction(1), 1 / stretch) * rate)}"),
        *(graph.add("atempo", repr(tempo)) for _ in range(stages)),
        # downmixing must not clip
        graph.add("aresample", "osr={}:osf={}:ochl={}:rematrix_maxval=1".format(*target)),
        graph.add("atrim", f"start_sample={round(Fraction(lead * target[0], rate))}"),
        graph.add("abuffersink"),
    ]
    graph.link_nodes(*nodes).configure()
    return graph


def _slice_samples(frame: av.AudioFrame, first: int, last: int) -> av.AudioFrame:
    if (first, last) == (0, frame.samples):
        return frame
    width = 1 if frame.format.is_planar else frame.layout.nb_channels
    samples: NDArray[Any] = np.ascontiguousarray(frame.to_ndarray()[:, first * width : last * width])
    part = av.AudioFrame.from_ndarray(samples, format=frame.format.name, layout=frame.layout.name)
    part.sample_rate = frame.sample_rate
    return part


def _traits_of_stream(stream: av.stream.Stream) -> tuple[Traits, int]:
    """Return the traits of an audio stream and its number of channels; the sample format is fltp if not known yet."""
    context: Any = stream.codec_context
    channels = context.layout.nb_channels
    format = context.format.name if context.format is not None else "fltp"
    return (context.sample_rate, format, named_layout(context.layout.name, channels)), channels


def _traits_of(frame: av.AudioFrame) -> Traits:
    return frame.sample_rate, frame.format.name, named_layout(frame.layout.name, frame.layout.nb_channels)


def output_time(time: Fraction, window: Window | None, begin: Fraction | None = None) -> Fraction:
    """Return when a time of the source is shown, seconds; of the end of what begins at `begin`, when that ends."""
    if window is None:
        return time
    at = time - window.begin
    if window.curve is None:
        return at
    return window.curve.time_of(at) if begin is None else window.curve.end_of(begin - window.begin, at)
