"""Properties of a clip, and of a conversion of it with the default options, as plain data."""

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np

from fpsboost.analysis.cadence import Repeats
from fpsboost.analysis.duplicates import SourceFrame, detector_of
from fpsboost.contracts import FrameSource, OutputRange, Summary
from fpsboost.errors import FpsboostError
from fpsboost.frame import Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.guides import placed_guides
from fpsboost.interpolator import Interpolator
from fpsboost.io.animation.source import is_animation
from fpsboost.io.opening import TargetRequirements, open_source
from fpsboost.io.output import Output
from fpsboost.io.video.decode_options import DecodeOptions, SizeChange
from fpsboost.io.video.source import VideoSource
from fpsboost.media import Look, OutputTiming, StreamFacts, look_of, try_out
from fpsboost.method_table import methods
from fpsboost.options import AnyDuplicates
from fpsboost.pair import Pair, with_neighbours
from fpsboost.preparation import ConversionJob, Preparation, prepared
from fpsboost.remarks import Remarks
from fpsboost.repair import find_damaged
from fpsboost.run_options import RunOptions
from fpsboost.timeline import Timeline, positions_of
from fpsboost.timing.options import Timing
from fpsboost.timing.schedule import count_frames

SEAM_LIMIT = 1.25
"""Dissimilarity of the last and the first frame of a loop, at most, as a multiple of that of the frames beside them. It
is 1 with turntables, and above 2.2 in 22 clips that are no loops."""


NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


@dataclass(frozen=True)
class Conversion:
    """Result that a conversion with the default options would have."""

    frames: int
    rate: float
    """Nominal frames per second of the output."""
    refused: str | None
    """Reason why a conversion to an .mp4 would be refused; None if it would not."""
    remarks: Remarks
    """What would be lost."""


@dataclass(frozen=True)
class Probe:
    """Properties of a clip that was read once from its first frame to its last."""

    name: str
    width: int
    height: int
    """Pixels, as stored."""
    look: Look | None
    """Format and colour tags of video; None otherwise."""
    streams: list[StreamFacts]
    rate: float
    exact_rate: str
    """Nominal frames per second."""
    varies: bool
    """Whether the intervals between frames differ by more than a clock's rounding."""
    shortest: float
    median: float
    longest: float
    """Intervals between frames, seconds."""
    start: float
    duration: float
    """Seconds."""
    number_step: int | None
    """Step between the numbers of images; None without numbers."""
    frames: int
    """Number of frames that could be read."""
    declared_frames: int | None
    """Number of frames by the header; None if it does not say."""
    duplicates: int
    """Number of duplicate frames, stills not counted."""
    cadence: str | None
    """Cadence that most frames follow, such as ``3:2``; None if they follow none; see `fpsboost.analysis.cadence`."""
    cadence_share: float
    """Share of the clip that follows it, of the parts in which motion shows it; 0 without a cadence."""
    picture_rate: float | None
    """Pictures per second where the whole clip follows it, so that `duplicates="drop"` gives this constant rate."""
    cuts: list[float]
    """Times of the first frames of new scenes."""
    loops: bool
    """Whether the last frame leads to the first one as frames of one scene do; see `Findings.loops`."""
    damaged: list[int]
    """Numbers of single frames that no neighbour explains, from 0; see `fpsboost.repair.find_damaged`."""
    interlaced: int
    """Number of frames flagged as interlaced."""
    remarks: Remarks
    """What a conversion would lose or assume when it reads the clip, and what is damaged."""
    conversion: Conversion


@dataclass
class Findings:
    """Facts collected while frames are read."""

    seen: Callable[[Frame, Fraction], None] = lambda frame, time: None
    """Function that is given every frame, and its time after the first one, seconds."""
    treatment: AnyDuplicates = "interpolate"
    """What a conversion does with duplicates; they are looked for only where they are interpolated across."""
    times: list[Fraction] = field(default_factory=list)
    origin: SourcePosition = field(default=SourcePosition(0, Fraction(0)))
    """Position of the first frame in its clip; with its time, it tells that of any other."""
    end: Fraction = Fraction(0)
    """End of the last frame, seconds."""
    interlaced: int = 0
    duplicates: list[Fraction] = field(default_factory=list)
    """Times of the duplicate frames that are interpolated across, as `Summary.duplicates` counts them."""
    repeats: Repeats | None = None
    """Repeated frames, in stills too; None if they are not looked for."""
    damaged: list[int] = field(default_factory=list)
    pictures: list[list[Fraction]] = field(default_factory=list)
    """Times of the frames that show each picture, nearly always of one."""
    loops: bool = False
    """Whether the first frame matches the last one as well as frames match their neighbours there."""

    def in_clip(self, time: Fraction) -> Fraction:
        """Return the seconds from the clip's first frame to a time of the frames that were read."""
        return self.origin.seconds + time - self.times[0]

    def cuts(self, frames: FrameSource, interpolator: Interpolator) -> list[Fraction]:
        """Read frames and return the times of those that begin a scene; find duplicates as a conversion counts them."""
        cuts = list[Fraction]()
        first = None
        # `pictures` runs ahead of the current pair: the pair's index tells which of them it is made of
        for place, pair in enumerate(with_neighbours(self.pairs(frames, interpolator))):
            first = first or pair
            if not pair.is_discontinuous:  # what is held until a cut stays as it is
                self.duplicates += self.pictures[place][1:]
            elif pair.is_cut:
                cuts.append(self.pictures[place + 1][0])
        if first is not None and first is not pair:  # two frames lead back and forth
            seam = interpolator.pair(pair.image1, first.image0)
            self.loops = 1 - seam.match_score <= SEAM_LIMIT * (1 - min(pair.match_score, first.match_score))
        return cuts

    def shown(self, frames: FrameSource) -> Iterator[SourceFrame]:
        for number, (frame, is_damaged) in enumerate(find_damaged(self._read(frames))):
            self.damaged += [number] * is_damaged
            yield frame

    def _read(self, frames: FrameSource) -> Iterator[SourceFrame]:
        for frame in frames:
            self.times.append(frame.time)
            self.end = frame.time + (frame.duration or 1 / frames.info.rate)
            self.interlaced += bool(getattr(frame.original, "interlaced_frame", False))
            self.seen(frame, frame.time - self.times[0])
            position_of = positions_of(frames)
            self.origin = position_of(0, Fraction(0))
            place = position_of(len(self.times) - 1, frame.time - self.times[0])
            yield SourceFrame(frame, source_position=place)

    def pairs(self, frames: FrameSource, interpolator: Interpolator) -> Iterator[Pair]:
        """Yield the pairs between which a conversion would make frames."""
        last: SourceFrame | None = None
        shown = self.shown(frames)
        detector = detector_of(self.treatment)
        self.repeats = None if detector is None else Repeats(detector)
        for group in zip(shown) if self.repeats is None else self.repeats.groups(shown):
            self.pictures.append([each.time for each in group])
            if last is not None:
                yield interpolator.pair(last, group[0])
            last = group[0]


def probe(
    path: str, input_fps: Fraction | None = None, stream: int | None = None, *, allow_playlists: bool = False
) -> Probe:
    """Read a clip to its end and return its properties; see `fpsboost.io.opening.open_source` about errors.

    `input_fps` is the rate of images, 24 by default, or of a raw stream; `stream` is the number of a video's stream,
    and `allow_playlists` reads playlists and the files that they name.
    """
    # A size that changes or wrong colours are to be reported, though a conversion would stop there.
    is_file = Path(path).is_file()  # a pipe is not to be waited for
    is_animated = is_file and is_animation(Path(path))
    may_change = is_file and not is_animated
    size_change: SizeChange = "scale" if may_change else "stop"
    decoding = DecodeOptions(input_fps=input_fps, stream=stream, allow_playlists=allow_playlists)
    decoding = replace(decoding, size_change=size_change, force_colours=may_change)
    with open_source(path, requirements=TargetRequirements(layers=True, planes=True), decoding=decoding) as source:
        beside = source.stream_info
        has_clock = beside.images is None
        refused: str | None = None
        try:
            schedule = Timing().schedule(source.info, has_clock=has_clock)
        except FpsboostError as error:
            schedule = Timing(keep_timing=True).schedule(source.info, has_clock=has_clock)
            refused = str(error)
        losses = Remarks()
        if beside.video is not None and refused is None:
            timing = OutputTiming(schedule.rate(source.info.rate), schedule.time_base(source.info.time_base))
            try:
                losses.take(try_out(Output("out.mp4", source.info, timing, beside))[1])
            except FpsboostError as error:
                refused = str(error)
        findings = Findings()
        cuts = findings.cuts(source, methods["nlm"])
        if isinstance(source, VideoSource):
            refused = refused or source.stopped_by
        info = source.info
        times = findings.times
        counted = replace(info, frame_count=len(times), duration=findings.end - times[0])
        # that of the last frame is its own in an animation; in a video, some headers are a few frames off
        last = findings.end - times[-1]
        ends = [findings.end] if is_animated or last > 4 / info.rate else []
        intervals = [later - earlier for earlier, later in pairwise([*times, *ends])] or [1 / info.rate]
        cadence = None if findings.repeats is None else findings.repeats.cadence(info.rate)
        median = statistics.median(intervals)
        spread = max(intervals) - min(intervals)
        return Probe(
            name=info.name,
            width=info.width,
            height=info.height,
            look=None if beside.traits is None else look_of(beside.traits),
            streams=beside.streams,
            rate=float(info.rate),
            exact_rate=str(info.rate),
            varies=spread > max(2 * info.time_base, median / 20),
            shortest=float(min(intervals)),
            median=float(median),
            longest=float(max(intervals)),
            start=float(times[0]),
            duration=float(findings.end - times[0]),
            number_step=beside.images.step if beside.images is not None and beside.images.numbers else None,
            frames=len(times),
            declared_frames=info.frame_count,
            duplicates=len(findings.duplicates),
            cadence=None if cadence is None else cadence.name,
            cadence_share=0.0 if cadence is None else cadence.share,
            picture_rate=float(cadence.rate) if cadence is not None and cadence.is_certain else None,
            cuts=[float(cut) for cut in cuts],
            loops=findings.loops,
            damaged=findings.damaged,
            interlaced=findings.interlaced,
            remarks=Remarks(source.remarks).expected,
            conversion=Conversion(
                count_frames(schedule, counted, holds_last_frame=has_clock) or 0,
                float(schedule.rate(info.rate)),
                refused,
                losses.expected,
            ),
        )


def probe_guide(path: str, decoding: DecodeOptions) -> Remarks:
    """Return what a conversion with the default options would find in a guide; see `find_guides`."""
    with prepared(ConversionJob(path, None, Timing(), methods["nlm"], decoding), RunOptions()) as ready:
        return find_guides(ready)


def find_guides(ready: Preparation) -> Remarks:
    """Return the remark on frames that a conversion will make without guide, if files tell it and there are some."""
    decoding = ready.job.decoding
    source = ready.clip.source
    path = decoding.guide_path
    if path is None:
        return Remarks()
    with placed_guides(path, decoding, ready.guided) as guides:
        times = source.frame_times()
        times_of_guide = guides.source.frame_times()
    if not (times and times_of_guide):
        return Remarks()
    guides.frames = _without_pictures(times_of_guide)
    options = replace(ready.timeline, duplicates=None, guides=guides.picture)
    timeline = Timeline(source, ready.schedule, ready.interpolator, Summary(), OutputRange(), options)
    intervals = timeline.intervals(_without_pictures(times))
    made = [output for interval in intervals for output in interval.interpolated]
    missing = [output.number for output in made if output.guide is None]
    found = Summary(guided_frames=len(made) - len(missing), guides_missing=missing)
    return ready.guided.remarks(path, found).expected


def _without_pictures(times: Sequence[Fraction]) -> Iterator[Frame]:
    """Yield frames of one pixel with the times of others, from the first one on."""
    return (Frame(NO_PICTURE, time - times[0]) for time in times)
