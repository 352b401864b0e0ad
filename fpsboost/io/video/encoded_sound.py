"""Sound that is encoded anew, at its own length or stretched to another at its own pitch.

It is decoded, led through FFmpeg's filters, and encoded. Sound without a gap is one run through a filter graph. Where
it pauses, or where packets are lost, a new run begins at the time that the source says, so that nothing drifts however
long the clip is. What decoders give beyond the end of the last packet is an encoder's padding, and cut off.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, get_args

import av
import av.container
import av.error
import av.filter
import numpy as np
from av.codec.codec import UnknownCodecError
from av.packet import PacketSideData, PktSideDataT
from numpy.typing import NDArray

from fpsboost.io.trim import Window
from fpsboost.io.video.damage import counted
from fpsboost.io.video.sound_encoders import BITRATE, Traits, is_lossless, named_layout, traits_for

SLACK = Fraction(1, 50)
"""Seconds by which sound misses its time when it counts as interrupted: more than jitter, as much as a lost packet."""
PREROLL = Fraction(1, 2)
"""Seconds that are decoded before those that are wanted, since decoders need them."""
TAIL = Fraction(1, 4)
"""Seconds of silence behind a run, which push out what the filters still hold."""
DISCARD = struct.Struct("<IIBB")
"""FFmpeg's AV_PKT_DATA_SKIP_SAMPLES: samples to leave out at the start and at the end, and a reason for each."""
SKIP_SAMPLES = get_args(PktSideDataT).index("skip_samples")
EARLIEST = Fraction(-(2**40))
"""Seconds; before the beginning of any file."""

sample_types = {"u8": np.uint8, "s16": np.int16, "s32": np.int32, "s64": np.int64, "flt": np.float32, "dbl": np.float64}
"""Type of a sample by FFmpeg's name of the format."""


def can_encode(stream: av.stream.Stream, encoder: str, stretch: Fraction = Fraction(1)) -> bool:
    """Whether a stream can be decoded here, and encoded by an encoder so many times as long."""
    context: Any = stream.codec_context
    if context is None or context.sample_rate <= 0:
        return False
    traits, channels = _traits_of_stream(stream)
    try:
        _graph(traits, stretch, traits_for(encoder, traits, channels))
    except (UnknownCodecError, av.error.FFmpegError, ValueError):
        return False
    return True


class EncodedSound:
    """A stream of sound on its way into one of another format, or of another length.

    Parameters
    ----------
    stream : av.stream.Stream
        Sound for which `can_encode` holds.
    output : av.container.OutputContainer
        Not started yet; gets a stream that its container holds.
    encoder : str
        FFmpeg's name.
    window : Window, optional
        Which part of the source is wanted, and how many times as long it lasts; looked at when packets come. All of it
        and as long without one.

    Attributes
    ----------
    stream : av.stream.Stream
        The output's.
    lost_packets : int
        How many could not be decoded; their time stays silent.
    changes : str
        What the encoder does not take of the source's sound, as the end of a sentence: ``, its 7.1.4 as stereo``.
    """

    def __init__(
        self, stream: av.stream.Stream, output: av.container.OutputContainer, encoder: str, window: Window | None
    ) -> None:
        self.lost_packets = 0
        self._window = window
        self._source: Any = stream.codec_context
        traits, channels = _traits_of_stream(stream)
        self._target = traits_for(encoder, traits, channels)
        self._rate, format, layout = self._target
        self.changes = "" if layout == traits[2] else f", its {traits[2]} as {layout}"
        if self._rate != traits[0]:
            self.changes += f", at {self._rate} instead of {traits[0]} Hz"
        if is_lossless(encoder) and self._source.codec.lossless and _bits(format) < _bits(traits[1]):
            self.changes += f", in {_bits(format)} bits"
        target: Any = output.add_stream(encoder, rate=self._rate, layout=layout)
        target.codec_context.format = format
        if not is_lossless(encoder):
            target.bit_rate = BITRATE * target.codec_context.layout.nb_channels
        target.time_base = Fraction(1, self._rate)
        self.stream: Any = target
        self._run: _Run | None = None
        self._next_pts: int | None = None
        self._held: tuple[av.AudioFrame, Fraction | None] | None = None
        self._packets_end = Fraction(0)
        self._tick = Fraction(0)

    def converted(self, packet: av.Packet[Any]) -> list[av.Packet[Any]]:
        """What has become ready after one packet of the source, in order."""
        assert packet.dts is not None
        self._tick = tick = Fraction(packet.time_base)
        pts = packet.dts if packet.pts is None else packet.pts
        begin, end = pts * tick, (pts + (packet.duration or 0)) * tick
        if end < self._begin - PREROLL or (self._end is not None and begin >= self._end):
            return []
        self._packets_end = end if packet.duration else Fraction(0)
        try:
            frames: list[Any] = packet.decode()
        except av.error.FFmpegError:
            self.lost_packets += end > self._begin
            return []
        return [ready for frame in frames for ready in self._hold(frame, begin)]

    def finish(self) -> list[av.Packet[Any]]:
        """What is left when the source has ended."""
        ready = []
        try:
            for frame in self._source.decode(None):
                ready += self._hold(frame, None)
        except av.error.FFmpegError:
            self.lost_packets += 1
        ready += self._let_go(self._packets_end)
        ready += self._end_run()
        return ready if self._next_pts is None else [*ready, *self._trimmed(self.stream.encode(None))]

    def _trimmed(self, packets: list[av.Packet[Any]]) -> list[av.Packet[Any]]:
        """The encoder's last packets, of which the last one says where the sound ends and its padding begins.

        As its length, which mp4 and mov keep, and as samples to discard, which Matroska keeps; not all encoders do.
        """
        last = next((each for each in reversed(packets) if each.size), None)
        if last is None or last.pts is None or self._next_pts is None:
            return packets
        tick = Fraction(last.time_base)
        left = self._next_pts - round(last.pts * tick * self._rate)
        padding = self._frame_size - left
        if left > 0 and padding > 0:
            last.duration = min(last.duration or left, round(Fraction(left, self._rate) / tick))
            if not any(each.data_type == "skip_samples" for each in last.iter_sidedata()):
                discarded = PacketSideData(SKIP_SAMPLES, DISCARD.size)  # type: ignore[call-arg]
                discarded.update(DISCARD.pack(0, padding, 0, 0))
                last.set_sidedata(discarded)
        return packets

    @property
    def _frame_size(self) -> int:
        """Samples that each packet decodes to; 0 where the last one may be shorter."""
        context: Any = self.stream.codec_context
        return 0 if is_lossless(context.codec.name) else int(context.frame_size)

    @property
    def _begin(self) -> Fraction:
        """Where what is wanted begins in the source: before anything is, where all of it is wanted."""
        return EARLIEST if self._window is None else self._window.begin

    @property
    def _end(self) -> Fraction | None:
        return None if self._window is None else self._window.end

    @property
    def _stretch(self) -> Fraction:
        return Fraction(1) if self._window is None else self._window.stretch

    def _due(self, time: Fraction) -> Fraction:
        """When something of the source is heard in the output."""
        return time if self._window is None else (time - self._window.begin) * self._window.stretch

    def _hold(self, frame: av.AudioFrame, begin: Fraction | None) -> list[av.Packet[Any]]:
        """Take the frame before this one, which thereby is not the last."""
        ready = self._let_go(None)
        self._held = frame, begin
        return ready

    def _let_go(self, end: Fraction | None) -> list[av.Packet[Any]]:
        """Take what is held, as far as the end of the source's packets; `end` is None for all, 0 where unknown.

        A packet's time and length may both be rounded to the file's clock, and then say nothing about single samples.
        """
        if self._held is None:
            return []
        (frame, begin), self._held = self._held, None
        if end and frame.pts is not None and frame.time_base:
            beyond = frame.pts * frame.time_base + Fraction(frame.samples, frame.sample_rate) - end
            padding = math.floor(beyond * frame.sample_rate)
            if beyond > 2 * self._tick and 0 < padding < frame.samples:
                time, base = frame.pts, frame.time_base
                frame = _part(frame, 0, frame.samples - padding)
                frame.pts, frame.time_base = time, base
        return self._take(frame, begin)

    def _take(self, frame: av.AudioFrame, begin: Fraction | None) -> list[av.Packet[Any]]:
        """Stretch what of a decoded frame lies in the window and behind what has been taken; `begin` is a guess."""
        run = self._run
        time = begin if frame.pts is None else frame.pts * Fraction(frame.time_base or 1)
        if time is None or (run is not None and abs(time - run.end) < SLACK):
            if run is None:
                return []
            time = run.end
        earliest = self._begin if run is None else max(self._begin, run.end)
        first = max(0, math.ceil((earliest - time) * frame.sample_rate))
        last = frame.samples
        if self._end is not None:
            last = min(last, math.ceil((self._end - time) * frame.sample_rate))
        if first >= last:
            return []
        time += Fraction(first, frame.sample_rate)
        ready = []
        if run is None or time > run.end or not run.fits(frame):
            ready = self._end_run()
            try:
                run = self._run = _Run(frame, time, self._stretch, self._target)
            except (av.error.FFmpegError, ValueError):  # channels that damage has made up
                self.lost_packets += 1
                return ready
            pts = round(self._due(time) * self._rate)
            self._next_pts = pts if self._next_pts is None else max(pts, self._next_pts)
        return [*ready, *self._encode(run.stretched(_part(frame, first, last)))]

    def _end_run(self) -> list[av.Packet[Any]]:
        run, self._run = self._run, None
        return [] if run is None else self._encode(run.finish())

    def _encode(self, frames: Iterator[av.AudioFrame]) -> list[av.Packet[Any]]:
        ready = []
        for frame in frames:
            assert self._next_pts is not None
            frame.pts, frame.time_base = self._next_pts, Fraction(1, self._rate)
            self._next_pts += frame.samples
            ready += self.stream.encode(frame)
        return ready


class _Run:
    """Sound without a gap on its way through a filter graph.

    Parameters
    ----------
    frame : av.AudioFrame
        Like those to come.
    start : Fraction
        When it begins in the source, seconds.
    stretch : Fraction
    target : (int, str, str)
        Traits of what comes out.
    """

    def __init__(self, frame: av.AudioFrame, start: Fraction, stretch: Fraction, target: Traits) -> None:
        self._start, self._stretch, self._target = start, stretch, target
        self._traits = _traits_of(frame)
        self._rate_in = frame.sample_rate
        self._taken = self._given = 0
        self._graph = _graph(self._traits, stretch, target)

    @property
    def end(self) -> Fraction:
        """Where in the source it has got to, seconds."""
        return self._start + Fraction(self._taken, self._rate_in)

    def fits(self, frame: av.AudioFrame) -> bool:
        """Whether a frame can go on with it."""
        return _traits_of(frame) == self._traits

    def stretched(self, frame: av.AudioFrame) -> Iterator[av.AudioFrame]:
        """Take the next frame, and give what is ready."""
        frame.pts, frame.time_base = self._taken, Fraction(1, self._rate_in)
        self._taken += frame.samples
        self._graph.push(frame)
        for ready in self._ready():
            self._given += ready.samples
            yield ready

    def finish(self) -> Iterator[av.AudioFrame]:
        """Give the rest, so that it lasts exactly as long as it should."""
        missing = round(self._taken * self._stretch * self._target[0] / self._rate_in) - self._given
        self._graph.push(None)
        for ready in self._ready():
            if missing > 0:
                yield _part(ready, 0, min(missing, ready.samples))
            missing -= ready.samples
        if missing > 0:
            rate, format, layout = self._target
            channels = av.AudioLayout(layout).nb_channels
            shape = (channels, missing) if av.AudioFormat(format).is_planar else (1, missing * channels)
            kind = av.AudioFormat(format).packed.name
            samples = np.full(shape, 128 if kind == "u8" else 0, sample_types[kind])
            silence = av.AudioFrame.from_ndarray(samples, format=format, layout=layout)
            silence.sample_rate = rate
            yield silence

    def _ready(self) -> Iterator[av.AudioFrame]:
        while True:
            try:
                frame: Any = self._graph.pull()
            except (av.error.BlockingIOError, av.error.EOFError):
                return
            yield frame


def _graph(source: Traits, stretch: Fraction, target: Traits) -> av.filter.Graph:
    """Filters that turn sound into other traits and another length, its beginning in place and some silence behind it.

    Raises
    ------
    av.error.FFmpegError
        The source's layout cannot become the target's.
    """
    rate = source[0]
    # atempo shows everything early, by half a piece for each further time that the sound lasts: so much silence goes
    # before it, and is cut off again
    lead = _piece(rate) // 2 if stretch > 1 else 0
    stages = math.ceil(abs(math.log2(stretch)) - 1e-9)
    tempo = min(2.0, max(0.5, float(1 / stretch) ** (1 / max(1, stages))))
    graph = av.filter.Graph()
    nodes = [
        graph.add_abuffer(sample_rate=rate, format=source[1], layout=source[2], time_base=Fraction(1, rate)),
        *([graph.add("adelay", f"delays={lead}S:all=1")] if lead else []),
        graph.add("apad", f"pad_len={round(TAIL * rate)}"),
        *(graph.add("atempo", repr(tempo)) for _ in range(stages)),
        # mixed to fewer channels, nothing gets louder than it may be
        graph.add("aresample", "osr={}:osf={}:ochl={}:rematrix_maxval=1".format(*target)),
        graph.add("atrim", f"start_sample={round(Fraction(lead * target[0], rate))}"),
        graph.add("abuffersink"),
    ]
    graph.link_nodes(*nodes).configure()
    return graph


def _part(frame: av.AudioFrame, first: int, last: int) -> av.AudioFrame:
    """Samples `first` to before `last`."""
    if (first, last) == (0, frame.samples):
        return frame
    width = 1 if frame.format.is_planar else frame.layout.nb_channels
    samples: NDArray[Any] = np.ascontiguousarray(frame.to_ndarray()[:, first * width : last * width])
    part = av.AudioFrame.from_ndarray(samples, format=frame.format.name, layout=frame.layout.name)
    part.sample_rate = frame.sample_rate
    return part


def _bits(format: str) -> int:
    return 8 * av.AudioFormat(format).bytes


def _traits_of_stream(stream: av.stream.Stream) -> tuple[Traits, int]:
    """Traits of sound by its file, and how many channels it has; FFmpeg's usual format where that is not known yet."""
    context: Any = stream.codec_context
    channels = context.layout.nb_channels
    format = context.format.name if context.format is not None else "fltp"
    return (context.sample_rate, format, named_layout(context.layout.name, channels)), channels


def _traits_of(frame: av.AudioFrame) -> Traits:
    return frame.sample_rate, frame.format.name, named_layout(frame.layout.name, frame.layout.nb_channels)


def _piece(rate: int) -> int:
    """Samples of the pieces that atempo overlaps: the power of two from a 24th of a second on."""
    return 1 << (max(1, rate // 24) - 1).bit_length()


def remark_on(lost_packets: int, stream: int, source: str, name: str) -> str:
    """What to say of sound that could not be decoded."""
    return (
        f"{source} is damaged: {counted(lost_packets, 'packet')} of sound in stream {stream} could not be decoded, "
        f"where {name} is silent; listen to it."
    )
