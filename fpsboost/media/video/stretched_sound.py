"""Sound that lasts longer or shorter at its own pitch: decoded, stretched by FFmpeg's atempo, and encoded anew.

Sound without a gap is one run through a filter graph. Where it pauses, or where packets are lost, a new run begins at
the time that the source says, so that nothing drifts however long the clip is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import av
import av.container
import av.error
import av.filter
import numpy as np
from av.codec.codec import UnknownCodecError
from numpy.typing import NDArray

from fpsboost.media.excerpt import Window
from fpsboost.media.video.damage import counted

encoders = {"mp4": "aac", "mov": "aac", "matroska": "libopus", "webm": "libopus"}
"""FFmpeg's encoder of sound by its name of the container."""

BITRATE = 96_000
"""Bits per second for each channel, with which both encoders are hard to tell from the source."""
RATE_OF_OPUS = 48_000
RATES_OF_AAC = (*(96000, 88200, 64000, 48000, 44100, 32000, 24000), *(22050, 16000, 12000, 11025, 8000, 7350))
STANDARD_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")
"""The usual speakers for one channel, two, ..."""

SLACK = Fraction(1, 50)
"""Seconds by which sound misses its time when it counts as interrupted: more than jitter, as much as a lost packet."""
PREROLL = Fraction(1, 2)
"""Seconds that are decoded before those that are wanted, since decoders need them."""
TAIL = Fraction(1, 4)
"""Seconds of silence behind a run, which push out what the filters still hold."""

Traits = tuple[int, str, str]
"""Rate, sample format and channel layout of sound."""


def can_stretch(stream: av.stream.Stream, container: str) -> bool:
    """Whether a stream can be decoded here, and encoded for the container."""
    context: Any = stream.codec_context
    if context is None or context.sample_rate <= 0:
        return False
    codec, channels = encoders[container], context.layout.nb_channels
    source = _named(context.layout.name, channels)
    try:
        target = _target_for(codec, context.sample_rate, source, channels)
        _graph((context.sample_rate, "fltp", source), Fraction(2), target)
    except (UnknownCodecError, av.error.FFmpegError, ValueError):
        return False
    return True


class StretchedSound:
    """A stream of sound on its way into one that lasts longer or shorter.

    Parameters
    ----------
    stream : av.stream.Stream
        Sound for which `can_stretch` holds.
    output : av.container.OutputContainer
        Not started yet; gets a stream that its container holds.
    container : str
        FFmpeg's name of it.
    window : Window
        Which part of the source is wanted, and how many times as long it lasts; looked at when packets come.

    Attributes
    ----------
    stream : av.stream.Stream
        The output's.
    lost_packets : int
        How many could not be decoded; their time stays silent.
    """

    def __init__(
        self, stream: av.stream.Stream, output: av.container.OutputContainer, container: str, window: Window
    ) -> None:
        source: Any = stream.codec_context
        codec = encoders[container]
        self.lost_packets = 0
        self._window, self._source = window, source
        channels = source.layout.nb_channels
        self.source_layout = _named(source.layout.name, channels)
        self._target = _target_for(codec, source.sample_rate, self.source_layout, channels)
        self._rate, format, self.layout = self._target
        target: Any = output.add_stream(codec, rate=self._rate, layout=self.layout)
        target.codec_context.format = format
        target.bit_rate = BITRATE * target.codec_context.layout.nb_channels
        target.time_base = Fraction(1, self._rate)
        self.stream: Any = target
        self._run: _Run | None = None
        self._next_pts: int | None = None

    def converted(self, packet: av.Packet[Any]) -> list[av.Packet[Any]]:
        """What has become ready after one packet of the source, in order."""
        assert packet.dts is not None
        tick = Fraction(packet.time_base)
        pts = packet.dts if packet.pts is None else packet.pts
        begin, end = pts * tick, (pts + (packet.duration or 0)) * tick
        window = self._window
        if end < window.begin - PREROLL or (window.end is not None and begin >= window.end):
            return []
        try:
            frames: list[Any] = packet.decode()
        except av.error.FFmpegError:
            self.lost_packets += end > window.begin
            return []
        return [ready for frame in frames for ready in self._take(frame, begin)]

    def finish(self) -> list[av.Packet[Any]]:
        """What is left when the source has ended."""
        ready = []
        try:
            for frame in self._source.decode(None):
                ready += self._take(frame, None)
        except av.error.FFmpegError:
            self.lost_packets += 1
        ready += self._end_run()
        return ready if self._next_pts is None else [*ready, *self.stream.encode(None)]

    def _take(self, frame: av.AudioFrame, begin: Fraction | None) -> list[av.Packet[Any]]:
        """Stretch what of a decoded frame lies in the window and behind what has been taken; `begin` is a guess."""
        run, window = self._run, self._window
        time = begin if frame.pts is None else frame.pts * Fraction(frame.time_base or 1)
        if time is None or (run is not None and abs(time - run.end) < SLACK):
            if run is None:
                return []
            time = run.end
        earliest = window.begin if run is None else max(window.begin, run.end)
        first = max(0, math.ceil((earliest - time) * frame.sample_rate))
        last = frame.samples
        if window.end is not None:
            last = min(last, math.ceil((window.end - time) * frame.sample_rate))
        if first >= last:
            return []
        time += Fraction(first, frame.sample_rate)
        ready = []
        if run is None or time > run.end or not run.fits(frame):
            ready = self._end_run()
            try:
                run = self._run = _Run(frame, time, window.stretch, self._target)
            except (av.error.FFmpegError, ValueError):  # channels that damage has made up
                self.lost_packets += 1
                return ready
            pts = round((time - window.begin) * window.stretch * self._rate)
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
            silence = av.AudioFrame.from_ndarray(np.zeros(shape, np.float32), format=format, layout=layout)
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
    """Filters that make sound last longer or shorter, its beginning in place and some silence behind it.

    Raises
    ------
    av.error.FFmpegError
        The source's layout cannot become the target's.
    """
    rate = source[0]
    # atempo shows everything early, by half a piece for each further time that the sound lasts: so much silence goes
    # before it, and is cut off again
    lead = _piece(rate) // 2 if stretch > 1 else 0
    stages = max(1, math.ceil(abs(math.log2(stretch)) - 1e-9))
    tempo = min(2.0, max(0.5, float(1 / stretch) ** (1 / stages)))
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


def _traits_of(frame: av.AudioFrame) -> Traits:
    return frame.sample_rate, frame.format.name, _named(frame.layout.name, frame.layout.nb_channels)


def _piece(rate: int) -> int:
    """Samples of the pieces that atempo overlaps: the power of two from a 24th of a second on."""
    return 1 << (max(1, rate // 24) - 1).bit_length()


def _rate_for(codec: str, rate: int) -> int:
    """The source's rate where the encoder takes it, else the next higher one."""
    if codec == "libopus":
        return RATE_OF_OPUS
    return min((each for each in RATES_OF_AAC if each >= rate), default=RATES_OF_AAC[0])


def _named(layout: str, channels: int) -> str:
    """A layout with names of speakers, where the file gives only their number."""
    says_nothing = layout.endswith("channels") or layout.endswith("channel")
    return STANDARD_LAYOUTS[channels - 1] if says_nothing and channels <= len(STANDARD_LAYOUTS) else layout


def _target_for(codec: str, rate: int, layout: str, channels: int) -> Traits:
    """The source's rate and layout where the encoder takes them, else the next rate, the usual layout, or stereo."""
    target = _rate_for(codec, rate), "flt" if codec == "libopus" else "fltp"
    layouts = (layout, *STANDARD_LAYOUTS[channels - 1 : channels])
    return *target, next((each for each in layouts if _takes(codec, (*target, each))), "stereo")


def _takes(codec: str, traits: Traits) -> bool:
    context: Any = av.CodecContext.create(codec, "w")
    try:
        context.sample_rate, context.format, context.layout = traits
        context.time_base = Fraction(1, traits[0])
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True


def remark_on(lost_packets: int, stream: int, source: str, name: str) -> str:
    """What to say of sound that could not be decoded."""
    return (
        f"{source} is damaged: {counted(lost_packets, 'packet')} of sound in stream {stream} could not be decoded, "
        f"where {name} is silent; listen to it."
    )
