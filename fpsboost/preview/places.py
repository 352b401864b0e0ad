"""Passages of a clip that show what a conversion would do, found by decoding a few frames at places all over it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.errors import OptionError
from fpsboost.frame import Frame
from fpsboost.frame_cache import FrameCache
from fpsboost.io import FrameSource
from fpsboost.io.trim import Seekable, Sliceable, beginning
from fpsboost.motion.colour import small_copy
from fpsboost.motion.opencv import Dis
from fpsboost.preparation import ConversionJob, opened_clip
from fpsboost.preview.views import View
from fpsboost.probing import Findings
from fpsboost.run_options import RunOptions
from fpsboost.timing.position import Position
from fpsboost.timing.trim import Trim

PASSAGES = 3
"""Maximum number of passages that are chosen."""

PLACES, FRAMES_PER_PLACE = 12, 4
"""Number of places at which motion is measured, and of frames that are decoded at each."""

ENOUGH_PLACES = 4
"""Number of different places below which the clip is read from its beginning instead."""

MAX_READ = 480
"""Maximum number of frames that are read then."""

MIN_FRAMES, MAX_FRAMES = 8, 30
"""Number of source frames in a passage, which lasts a second if it can."""

THUMBNAIL_SIDE = 160
"""Longer side of the images on which motion is measured, pixels."""


class Place(NamedTuple):
    """Time at which a passage may begin, seconds after the clip's first frame, and the mean motion there."""

    start: Fraction
    motion: float


class Passage(NamedTuple):
    """Part of a clip that is shown.

    Attributes
    ----------
    start : Fraction
        Seconds after the clip's first frame.
    trim : Trim
        The part as an option.
    before : View
        Frames of the source.
    cuts, duplicates : list of Fraction
        Times of the frames that begin a scene, and of those that show the same as the one before; seconds in the clip.
    """

    start: Fraction
    trim: Trim
    before: View
    cuts: list[Fraction]
    duplicates: list[Fraction]

    @property
    def end(self) -> Fraction:
        """Seconds after the clip's first frame."""
        return self.start + self.before.end


class Found(NamedTuple):
    """Passages in the order of their times; those that cuts divide, for their cuts; and remarks."""

    shown: list[Passage]
    divided: list[Passage]
    remarks: list[str]


def find_passages(job: ConversionJob, run: RunOptions, at: Iterable[Position] = ()) -> Found:
    """Choose the passages with the most motion that no cut divides, or those at given positions.

    Parameters
    ----------
    job : ConversionJob
    run : RunOptions
    at : iterable of Position
        Beginnings of the passages that are shown, whatever is there; by default they are chosen.

    Raises
    ------
    OptionError
        A position lies behind the end of the clip.
    InputError
        See `fpsboost.preparation.opened_clip`.
    """
    with opened_clip(job, run) as clip:
        info, images = clip.whole.info, clip.whole.stream_info.images
        begin, end = job.decoding.trim.seconds(info)
    declared = info.duration or (None if info.frame_count is None else info.frame_count / info.rate)
    end = min((each for each in (end, declared) if each is not None), default=None)
    step = images.step if images is not None and images.fills_gaps else 1
    count = min(max(round(info.rate), MIN_FRAMES), MAX_FRAMES)
    lasts = step * count / info.rate

    def examined(start: Fraction, stop: Fraction | None = None) -> Passage:
        latest = start if end is None else max(begin, min(start, end - lasts))
        return _examine(job, run, latest, latest + lasts) if stop is None else _examine(job, run, start, stop)

    given = [position.seconds(info.rate) for position in at]
    for start in given:
        if end is not None and start >= end:
            raise OptionError(f"`at={float(start):g}` lies behind the end of {info.name}, {float(end):g} s; name less.")
    if given:
        return Found([examined(start) for start in given], [], [])
    places, remarks = _measure(job, run, info.name, begin, end, count)
    shown, divided = list[Passage](), list[Passage]()
    for place in sorted(places, key=lambda place: -place.motion):
        if len(shown) == PASSAGES or len(divided) == 2 * PASSAGES:
            break
        if any(place.start < other.end and other.start < place.start + lasts for other in [*shown, *divided]):
            continue
        passage = examined(place.start)
        if passage.cuts:
            divided.append(passage)
            longest = max(pairwise([passage.start, *passage.cuts, passage.end]), key=lambda piece: piece[1] - piece[0])
            if longest[1] - longest[0] < lasts / 3:
                continue
            passage = examined(*longest)
        shown.append(passage)
    return Found(sorted(shown or divided[:1], key=lambda passage: passage.start), divided, remarks)


@dataclass
class _FindingsWithView(Findings):
    """Facts collected while frames are read, and the frames as a page shows them."""

    view: View = field(default_factory=View)

    def shown(self, frames: FrameSource) -> Iterator[SourceFrame]:
        """See `Findings.shown`."""
        for each in super().shown(frames):
            self.view.add(each.frame, each.frame.time - self.times[0])
            yield each


def _examine(job: ConversionJob, run: RunOptions, start: Fraction, end: Fraction) -> Passage:
    """Read a passage, and find what a conversion would find."""
    with opened_clip(job, run) as clip:
        is_images, rate = isinstance(clip.whole, Sliceable), clip.whole.info.rate
    # images count frames, so that they need no rate; videos can seek to times
    ends = [Fraction(round(each * rate)) if is_images else each for each in (start, end)]
    trim = Trim(*(Position(each, is_frame=is_images) for each in ends))
    with opened_clip(of_part(job, trim), run) as clip:
        findings = _FindingsWithView(view=View(clip.whole.stream_info.traits))
        cuts = findings.cuts(clip.source, job.method)
        begins, first = beginning(clip.source).seconds, findings.times[0]
    findings.view.end = findings.end - first
    of_clip = [[begins + time - first for time in times] for times in (cuts, findings.duplicates)]
    return Passage(begins, trim, findings.view, *of_clip)


def of_part(job: ConversionJob, trim: Trim) -> ConversionJob:
    """Return the same job for a part of the clip."""
    return replace(job, decoding=replace(job.decoding, trim=trim))


def _measure(
    job: ConversionJob, run: RunOptions, name: str, begin: Fraction, end: Fraction | None, count: int
) -> tuple[list[Place], list[str]]:
    """Measure motion at places spread over the clip, or over its beginning if it can be entered nowhere else."""
    if end is not None:
        starts = [begin + (end - begin) * k / PLACES for k in range(PLACES)]
        found = (_measure_at(job, run, start, begin) for start in starts)
        places = {place.start: place for place in found if place is not None}
        if len(places) >= ENOUGH_PLACES:
            return list(places.values()), []
    with opened_clip(job, run) as clip:
        arriving = iter(clip.source)
        motions = list(_motions(islice(arriving, MAX_READ)))
        is_whole = next(arriving, None) is None
    starts_at = range(0, max(len(motions) - count + 2, 1), max(1, count // 3))
    groups = [motions[place : place + count] for place in starts_at if motions]
    places_read = [Place(begin + group[0].start - motions[0].start, _mean(group)) for group in groups]
    remark = f"{name} can be entered at few places; the passages are from its first {MAX_READ} frames."
    return places_read or [Place(begin, 0.0)], [] if is_whole else [remark]


def _measure_at(job: ConversionJob, run: RunOptions, start: Fraction, begin: Fraction) -> Place | None:
    """Measure motion where reading can begin next to a time; None if it can begin at the start only."""
    with opened_clip(of_part(job, Trim()), run) as clip:
        source, origin = clip.whole, Fraction(0)
        if isinstance(source, Sliceable):
            source.keep(round(start * source.info.rate), None)
            origin = -beginning(source).seconds
        elif isinstance(source, Seekable):
            origin = source.first_time()
            source.skip_to(origin + start)
        else:
            return None
        motions = list(_motions(islice(source, FRAMES_PER_PLACE)))
    return Place(max(begin, motions[0].start - origin), _mean(motions)) if motions else None


def _mean(motions: list[Place]) -> float:
    return float(np.mean([each.motion for each in motions]))


def _motions(frames: Iterable[Frame]) -> Iterator[Place]:
    """Yield the mean length of the motion from every frame to the next, as a fraction of the longer side."""
    small = ((frame.time, FrameCache(small_copy(frame.pixels, THUMBNAIL_SIDE))) for frame in frames)
    for (time, image0), (_, image1) in pairwise(small):
        field01, _ = Dis("fast").estimate(image0, image1)
        yield Place(time, float(np.linalg.norm(field01.flow, axis=2).mean()) / THUMBNAIL_SIDE)
