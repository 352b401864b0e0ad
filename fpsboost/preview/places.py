"""Passages of a clip that show the effect of a conversion, found by decoding a few frames at places spread over it.

Their frames are stored as a page shows them; see `fpsboost.preview.view`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost import ClipInfo, ConversionJob, Frame, OptionError, Position, RunOptions, Trim
from fpsboost.extension import (
    Findings,
    Remarks,
    TimeMap,
    as_shown,
    open_video,
    opened_clip,
    rounded,
    view,
)
from fpsboost.preview.view import View

PASSAGES = 3
"""Maximum number of passages that are chosen."""

PLACES = 12
"""Number of places at which motion is measured."""
FRAMES_PER_PLACE = 4
"""Number of frames that are decoded at each."""

ENOUGH_PLACES = 4
"""Number of different places below which the clip is read from its beginning instead."""

MAX_READ = 480
"""Maximum number of frames that are read from the beginning instead."""

MIN_FRAMES = 8
"""Minimum number of source frames in a passage, which otherwise lasts a second."""
MAX_FRAMES = 30
"""Maximum number of source frames in a passage."""

MAX_PIXELS = 33_000_000
"""Number of pixels in the frames of a passage above which it is shorter, so that large frames do not take minutes."""

THUMBNAIL_SIDE = 160  # longer side of the images on which motion is measured, pixels
SHORTEST_SIDE = 32  # shortest side of an image that DIS takes, pixels


class Place(NamedTuple):
    """Time at which a passage may begin, and the motion there."""

    start: Fraction
    """Seconds after the clip's first frame."""
    motion: float
    """Mean length of the motion from frame to frame, as a fraction of the longer side."""


class Passage(NamedTuple):
    """Part of a clip that was read."""

    start: Fraction
    """Seconds after the clip's first frame."""
    trim: Trim
    """The same as an option of a conversion."""
    before: View
    """Its frames as they are in the source."""
    cuts: list[Fraction]
    """Times of frames that begin a scene, seconds in the clip."""
    duplicates: list[Fraction]
    """Times of frames that repeat the one before, seconds in the clip."""
    retimed: dict[int, Fraction] | None = None
    """Time in the passage that each output frame shows by a curve, seconds, by the frame's number."""
    number: int = 0
    """Number of its first frame in the clip, counted from 0."""

    @property
    def end(self) -> Fraction:
        """End, seconds after the clip's first frame."""
        return self.start + self.before.end

    def in_clip(self, time: Fraction) -> Fraction:
        """Return the time in the clip that is shown some time after the passage begins, seconds."""
        return self.start + (list(self.retimed.values())[self.before.place_at(time)] if self.retimed else time)

    def by_curve(self, curve: TimeMap, begin: Fraction, rate: Fraction, middle: int) -> Passage:
        """Return the passage with the frames of the output around one, as a curve retimes them.

        Parameters
        ----------
        curve : TimeMap
            Curve of the whole conversion.
        begin : Fraction
            Time of the clip at which the curve begins, seconds.
        rate : Fraction
            Frames per second of the output.
        middle : int
            Number of the output frame.
        """
        view = self.before
        last = self.before.times[-1]
        stop = math.ceil(curve.length * rate)

        def time_of(number: int) -> Fraction:
            return curve.source(number / rate) + begin - self.start

        def is_inside(number: int) -> bool:
            return 0 <= time_of(number) <= last

        earlier = takewhile(is_inside, range(middle - 1, max(0, middle - MAX_FRAMES) - 1, -1))
        later = takewhile(is_inside, range(middle + 1, min(middle + 3 * MAX_FRAMES, stop)))
        retimed = {number: min(time_of(number), last) for number in sorted([*earlier, middle, *later])}
        pictures = [view.pictures[view.place_at(time)] for time in retimed.values()]
        shown = [number / rate for number in range(len(retimed) + 1)]
        return self._replace(before=View(view.traits, shown[:-1], pictures, shown[-1]), retimed=retimed)


class Selection(NamedTuple):
    """Result of the choice of passages."""

    passages: list[Passage]
    """Passages that are shown, in the order of their times."""
    examined: list[Passage]
    """All passages that were read."""
    remarks: Remarks
    """Sentences about how they were chosen."""

    @property
    def parts(self) -> list[tuple[Fraction, Fraction]]:
        """Beginnings and ends of the passages that were read, without overlap, seconds in the clip."""
        parts = list[tuple[Fraction, Fraction]]()
        for passage in sorted(self.examined, key=lambda passage: passage.start):
            if parts and passage.start <= parts[-1][1]:
                parts[-1] = parts[-1][0], max(parts[-1][1], passage.end)
            else:
                parts.append((passage.start, passage.end))
        return parts

    @property
    def cuts(self) -> list[Fraction]:
        """Times of all cuts that were found, seconds in the clip."""
        return sorted({cut for passage in self.examined for cut in passage.cuts})

    @property
    def duplicates(self) -> list[Fraction]:
        """Times of all duplicates that were found, seconds in the clip."""
        return sorted({duplicate for passage in self.examined for duplicate in passage.duplicates})


def first_packet_size(path: Path) -> int:
    """Return the size of the first picture of a video, bytes."""
    with open_video(path, path.name) as container:
        return next(container.demux(video=0)).size


def find_passages(
    job: ConversionJob, run: RunOptions, at: Iterable[Position] = (), length: int | None = None
) -> Selection:
    """Choose the passages with the most motion without cuts, or those at given positions, whatever they show.

    Parameters
    ----------
    job : ConversionJob
        The whole conversion.
    run : RunOptions
        Options of the run.
    at : iterable of Position
        Beginnings of the passages; by default they are chosen by motion.
    length : int, optional
        Length in source frames; by default about a second.

    Raises
    ------
    OptionError
        A position lies behind the end of the clip.
    """
    span, reader = _opened(job, run, length)
    starts = [position.seconds(span.info.rate) for position in at]
    for start in starts:
        if span.end is not None and start >= span.end:
            end = f"the end of {span.info.name}, {float(span.end):g} s"
            raise OptionError(f"`at={float(start):g}` is after {end}; give an earlier position.")
    if starts:
        passages = [reader.examine(span.latest(start), span.duration) for start in starts]
        return Selection(passages, passages, Remarks())
    places = reader.measure(span.spread(PLACES))
    examined = list[Passage]()
    remarks = Remarks()
    if len(places) < ENOUGH_PLACES:
        longest = MAX_READ / span.info.rate
        read_for = longest if span.end is None else min(longest, span.end - span.begin)
        passage, places = reader.read(span.begin, read_for, span.count)
        examined.append(passage)
        if span.end is None or span.end - span.begin > longest:
            seconds = rounded(float(passage.before.end), 3)
            remarks.add("passages-looked-at", name=span.info.name, seconds=seconds)
    passages = _with_most_motion(places, span, reader, examined)
    return Selection(sorted(passages or examined[-1:], key=lambda passage: passage.start), examined, remarks)


def find_retimed(
    job: ConversionJob, run: RunOptions, curve: TimeMap, rate: Fraction, at: Iterable[Position] = ()
) -> Selection:
    """Choose the passages around the points of a curve, or around times of the output; `job` is without the curve.

    `rate` is that of the output, frames per second. Raises `OptionError` for a time behind the end of the output.
    """
    span, _ = _opened(job, run)
    end = curve.top + 1 if span.end is None else span.end - span.begin
    given = [position.seconds(rate) for position in at]
    points = given or [segment.begin for segment in curve.segments[1:]]
    shown = [time for time in points if time < curve.length and curve.source(time) < end] or [Fraction(0)]
    if given and shown != given:
        raise OptionError("`at` is after the end of the retimed output; give an earlier position.")
    times = given or shown[:: -(-len(shown) // PASSAGES)]
    starts = (span.begin + max(Fraction(0), curve.source(time) - span.duration / 2) for time in times)
    selection = find_passages(job, run, map(Position, starts))
    passages = list[Passage]()
    for passage, middle in zip(selection.passages, (math.floor(time * rate) for time in times), strict=True):
        if given or not passages or middle not in (passages[-1].retimed or ()):
            passages.append(passage.by_curve(curve, span.begin, rate, middle))
    return selection._replace(passages=passages)


@dataclass(frozen=True)
class _Span:
    """Part of a clip in which passages are chosen."""

    info: ClipInfo
    """Properties of the clip."""
    begin: Fraction
    """Seconds after the clip's first frame."""
    end: Fraction | None
    """Seconds after the clip's first frame; None if unknown."""
    count: int
    """Length of a passage in source frames."""
    duration: Fraction
    """Length of a passage, seconds."""

    def latest(self, start: Fraction) -> Fraction:
        """Return a time, or an earlier one from which a whole passage remains."""
        return start if self.end is None else max(self.begin, min(start, self.end - self.duration))

    def spread(self, count: int) -> list[Fraction]:
        """Return times at equal distances, from the beginning on; none if the end is not known."""
        if self.end is None:
            return []
        return [self.begin + (self.end - self.begin) * number / count for number in range(count)]


def _opened(job: ConversionJob, run: RunOptions, length: int | None = None) -> tuple[_Span, _Reader]:
    """Return the part of a job's clip in which passages are chosen, and its reader."""
    with opened_clip(job, run) as clip:
        info = clip.whole.info
        images = clip.whole.stream_info.images
        reader = _Reader(job, run, info.rate, images is not None)
    begin, end = job.decoding.trim.seconds(info)
    end = min((each for each in (end, info.nominal_duration) if each is not None), default=None)
    step = images.step if images is not None and images.fills_gaps else 1
    count = length or max(min(round(info.rate), MAX_FRAMES, MAX_PIXELS // (info.width * info.height)), MIN_FRAMES)
    return _Span(info, begin, end, count, step * count / info.rate), reader


def _with_most_motion(places: list[Place], span: _Span, reader: _Reader, examined: list[Passage]) -> list[Passage]:
    """Return the passages with the most motion that neither overlap nor contain a cut.

    All passages that are read for this are appended to `examined`.
    """
    passages = list[Passage]()
    for place in sorted(places, key=lambda place: -place.motion):
        if len(passages) == PASSAGES or len(examined) == 3 * PASSAGES:
            break
        start = span.latest(max(span.begin, place.start))
        if any(start < other.end and other.start < start + span.duration for other in passages):
            continue
        passage = reader.examine(start, span.duration)
        examined.append(passage)
        longest = max(pairwise([passage.start, *passage.cuts, passage.end]), key=lambda piece: piece[1] - piece[0])
        if passage.cuts and longest[1] - longest[0] >= span.duration / 3:
            passage = reader.examine(longest[0], longest[1] - longest[0])
        if not passage.cuts:
            passages.append(passage)
    return passages


@dataclass(frozen=True)
class _Reader:
    """Reader of parts of a job's clip, which is opened again for each."""

    job: ConversionJob
    run: RunOptions
    rate: Fraction
    """Frames per second of the clip."""
    is_images: bool
    """Whether the clip is a sequence of images, whose positions are frame numbers."""

    def examine(
        self, start: Fraction, duration: Fraction, seen: Callable[[Frame, Fraction], None] | None = None
    ) -> Passage:
        """Read a part, and find its cuts and duplicates as a conversion does.

        Its frames are kept, unless they go to the function `seen` instead, with their times in the part, seconds.
        """
        # images count frames, so that they need no rate; videos can seek to times
        ends = [Fraction(round(each * self.rate)) if self.is_images else each for each in (start, start + duration)]
        trim = Trim(*(Position(each, is_frame=self.is_images) for each in ends))
        with opened_clip(self.job.of_part(trim), self.run) as clip:
            image_view = View(clip.whole.stream_info.traits)
            findings = Findings(seen or image_view.add, self.job.timing.duplicates)
            cuts = findings.cuts(clip.source, self.job.method)
        image_view.end = findings.end - findings.times[0]
        cuts = [findings.in_clip(time) for time in cuts]
        duplicates = [findings.in_clip(time) for time in findings.duplicates]
        origin = findings.origin
        return Passage(origin.seconds, trim, image_view, cuts, duplicates, number=origin.number)

    def read(self, start: Fraction, duration: Fraction, count: int) -> tuple[Passage, list[Place]]:
        """Read a part, and measure the motion of passages of `count` frames in it."""
        small = list[tuple[Fraction, np.ndarray]]()
        passage = self.examine(start, duration, lambda frame, time: small.append((time, _thumbnail(frame))))
        motions = [Place(passage.start + each.start, each.motion) for each in _motions(small)]
        groups = [motions[number : number + count] for number in range(0, len(motions), max(1, count // 3))]
        return passage, [Place(group[0].start, _mean(group)) for group in groups] or [Place(passage.start, 0.0)]

    def measure(self, starts: Iterable[Fraction]) -> list[Place]:
        """Measure motion at the nearest places to some times from which reading can begin."""
        places = dict[Fraction, Place]()
        for start in starts:
            with opened_clip(self.job.of_part(Trim()), self.run) as clip:
                origin = clip.begin_near(start)
                few = islice(clip.whole, 0 if origin is None else FRAMES_PER_PLACE)
                motions = list(_motions((frame.time, _thumbnail(frame)) for frame in few))
            if origin is not None and motions:
                place = Place(motions[0].start - origin, _mean(motions))
                places[place.start] = place
        return list(places.values())


def _thumbnail(frame: Frame) -> np.ndarray:
    """Return a small copy of a frame as it is shown, (h, w, 3) uint8."""
    image = view(frame.image).to_bgr()
    height, width = image.shape[:2]
    scale = THUMBNAIL_SIDE / max(height, width)
    size = max(SHORTEST_SIDE, round(width * scale)), max(SHORTEST_SIDE, round(height * scale))
    return as_shown(cv2.resize(image, size, interpolation=cv2.INTER_AREA).reshape(*size[::-1], -1))


def _mean(motions: list[Place]) -> float:
    """Return the mean motion of some places."""
    return float(np.mean([each.motion for each in motions]))


def _motions(images: Iterable[tuple[Fraction, np.ndarray]]) -> Iterator[Place]:
    """Yield the mean length of the motion from every image to the next, as a fraction of the longer side.

    It is that of the colour channel that moves most.
    """
    estimator = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    for (time, image0), (_, image1) in pairwise(images):
        channels = zip(cv2.split(image0), cv2.split(image1), strict=True)
        flows = [estimator.calc(*planes, np.zeros((*planes[0].shape, 2), np.float32)) for planes in channels]
        yield Place(time, float(np.linalg.norm(flows, axis=-1).mean(axis=(1, 2)).max()) / THUMBNAIL_SIDE)
