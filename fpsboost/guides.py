"""Guides of a clip: opened, checked beside it, and found by number or by time; see `fpsboost.synthesis.guided`."""

from __future__ import annotations

import os
import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple, Self

from fpsboost.conflicts import check_together
from fpsboost.contracts import FrameSource, RandomAccess, Summary
from fpsboost.edits import OpenedClip
from fpsboost.errors import InputError, OptionError
from fpsboost.frame import ClipInfo
from fpsboost.image import Image
from fpsboost.image_checks import check_guide_size
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource
from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import extension_of
from fpsboost.io.images.layers import contents_of
from fpsboost.io.images.source import find_images
from fpsboost.io.opening import PIPES, TargetRequirements, open_source, stands_for_images
from fpsboost.io.output import Output, StreamInfo
from fpsboost.io.video.capture import ArraySource
from fpsboost.io.video.decode_options import OWN, DecodeOptions
from fpsboost.layered import FrameImage
from fpsboost.media import counted
from fpsboost.options import PathName
from fpsboost.remarks import Remarks
from fpsboost.synthesis.guided import describe_findings
from fpsboost.timeline import FramePlace, positions_of
from fpsboost.timing.position import as_ranges
from fpsboost.timing.schedule import Schedule

TOLERANCE = Fraction(1, 4)
"""Farthest that a guide lies from its frame in time, as a part of the interval between output frames."""

MOST_LISTED = 12
"""Number of ranges of frames that a remark lists."""

PASS = re.compile(r"(?<![a-z])(normals?|albedo|depth)(?![a-z])")
"""Words in the names of passes that are no pictures."""


@dataclass(frozen=True)
class GuidedClip:
    """What a guide must agree with: a clip, and the frames that are made of it."""

    source: RandomAccess
    """The part of the clip that is converted."""
    stream: StreamInfo
    """Files of the clip, and whether they are images."""
    schedule: Schedule
    """Times of the output frames."""
    requirements: TargetRequirements
    """How the clip is read."""
    frames: int | None = None
    """Number of output frames; None if that is not known."""
    numbers: tuple[int, int] = (0, 1)
    """Number of the first output frame, and the step to the next one, where images are numbered."""

    @classmethod
    def of(cls, clip: OpenedClip, schedule: Schedule, output: Output, *, linear: bool) -> Self:
        """Return an opened clip with its output; `linear` is whether the method takes scene-linear colours."""
        stream = clip.whole.stream_info
        target = clip.target
        needs = TargetRequirements(pictures_alone=not target.has_clock, upright=target.has_rate, linear=linear)
        numbers = (0, 1) if stream.images is None else stream.images.output_numbers(output.factor)
        return cls(clip.source, stream, schedule, needs, output.expected_frames, numbers)

    @property
    def rate(self) -> Fraction:
        """Output frames per second of the clip."""
        return self.schedule.rate(self.source.info.rate)

    def goes_by_number(self, path: str) -> bool:
        """Return whether guides go by the numbers of output frames: images for images."""
        return self.stream.images is not None and stands_for_images(path)

    def remark_on_missing(self, remarks: Remarks, guide: str, missing: Sequence[int], made: int) -> None:
        """Add the remark that some output frames, of so many that are made, have no guide, if there are some."""
        if missing and guide != OWN:
            first, step = self.numbers if self.goes_by_number(guide) else (0, 1)
            ranges = as_ranges(first + step * number for number in missing).split(", ")
            numbers = ", ".join(ranges[:MOST_LISTED]) + ", ..." * (len(ranges) > MOST_LISTED)
            remarks.add("guide-missing", name=guide, missing=len(missing), frames=made, numbers=numbers)

    def remarks(self, guide: str, summary: Summary) -> Remarks:
        """Return the remarks on a conversion with a guide."""
        remarks = Remarks()
        count = summary.guided_frames
        self.remark_on_missing(remarks, guide, summary.guides_missing, count + len(summary.guides_missing))
        if count:
            found = describe_findings({name: figure / count for name, figure in summary.guide_figures.items()})
            remarks.add("guide-followed", name=guide, frames=counted(count, "frame"), found=found)
        return remarks

    def made(self) -> list[FramePlace]:
        """Return the places of the frames that are made; none if only decoding tells."""
        times = self.source.frame_times() or [Fraction(0)]
        start = times[0]
        shown = [self.schedule.presentation_time(start, time) for time in times]
        steps = (self.schedule.steps(k, start, *pair) for k, pair in enumerate(pairwise(shown)))
        offset = positions_of(self.source)(0, Fraction(0)).seconds - start
        return [
            FramePlace(Fraction(number), offset + step.time, 1 / self.rate, None)
            for number, step in enumerate(chain.from_iterable(steps))
            if step.t > 0
        ]


class OwnGuides:
    """Frames of the source as guides of those that replace them."""

    def picture(self, place: FramePlace) -> FrameImage | None:
        """Return the source's own frame of a time."""
        return None if place.source is None else place.source.image


@dataclass
class PlacedGuides:
    """Guides that are the frames of a source, which is read as far as they are asked for."""

    source: RandomAccess
    by_number: bool = True
    """Whether their places are numbers of output frames, counted from 0, and not seconds after the clip's first one."""
    first: Fraction = Fraction(0)
    """Place of the first guide."""
    step: int = 1
    """Seconds of the source for a number."""

    def __post_init__(self) -> None:
        self._arriving: Iterator[_Placed] = iter(())
        self._nearest: _Placed | None = None
        self._following: _Placed | None = None

    def _wanted(self, place: FramePlace) -> tuple[Fraction | None, Fraction]:
        """Return where the guide of a frame is, None if there is none, and how far it may be from there."""
        return (place.number, Fraction(0)) if self.by_number else (place.seconds, place.interval * TOLERANCE)

    def missing(self, places: Sequence[FramePlace]) -> list[int] | None:
        """Return the numbers of those frames that have no guide; None if only decoding tells."""
        times = self.source.frame_times()
        if not times or not places:
            return None
        there = [self.first + (time - times[0]) / self.step for time in times]
        missing = list[int]()
        for place in places:
            at, tolerance = self._wanted(place)
            assert at is not None, "known of frames that are made"
            after = bisect_left(there, at - tolerance)
            if after == len(there) or there[after] > at + tolerance:
                missing.append(int(place.number or 0))
        return missing

    def picture(self, place: FramePlace) -> FrameImage | None:
        """Return the picture that is nearest to a frame; see `fpsboost.timeline.Guides`."""
        at, tolerance = self._wanted(place)
        if at is None:
            return None
        if self._nearest is None:
            self._arriving = self._read_from(at)
            self._nearest = next(self._arriving)
            self._following = next(self._arriving, None)
        while self._following is not None and abs(self._following.place - at) < abs(self._nearest.place - at):
            self._nearest = self._following
            self._following = next(self._arriving, None)
        return self._nearest.image if abs(self._nearest.place - at) <= tolerance else None

    def _read_from(self, at: Fraction) -> Iterator[_Placed]:
        """Yield guides, from the last one before a place on."""
        start = None
        if at > self.first and (times := self.source.frame_times()):
            start = times[0]
            seconds = start + (at - self.first) * self.step
            self.source.begin_at(max(0, bisect_left(times, seconds) - 1))
        for frame in self.source:
            start = frame.time if start is None else start
            yield _Placed(self.first + (frame.time - start) / self.step, frame.image)


class _Placed(NamedTuple):
    place: Fraction
    image: FrameImage


@contextmanager
def opened_guides(decoding: DecodeOptions, clip: GuidedClip) -> Iterator[OwnGuides | PlacedGuides]:
    """Open the guide that options name for a clip while the block lasts.

    Raises
    ------
    InputError, OptionError
        It cannot be read, is no picture of the clip, has another shape, is larger, or shows none of the frames.
    """
    path = os.fspath(decoding.guide or OWN)
    if path == OWN:
        yield OwnGuides()
        return
    if path in PIPES:
        raise OptionError("`guide` is read beside the input, which a pipe does not allow; name a file or a folder.")
    by_number = clip.goes_by_number(path)
    numbers = find_images(path).numbers if stands_for_images(path) else []
    first, step = clip.numbers
    place = -Fraction(decoding.guide_offset)
    rate = clip.rate if numbers else None
    if by_number:
        if not numbers:
            raise InputError(f"The images of {path} have no numbers; give them those of the output frames.")
        if place:
            raise OptionError(f"`guide_offset` is for guides by time, and {path} goes by numbers; leave it out.")
        place = Fraction(numbers[0] - first, step)
        rate = Fraction(1)
    elif clip.stream.images is not None and decoding.input_fps is None and os.path.exists(path):
        raise OptionError(f"{path} goes by time, and images have no frame rate; say it with `input_fps`.")
    reading = DecodeOptions(input_fps=rate)
    with open_source(path, requirements=clip.requirements, decoding=reading, fill_gaps=bool(numbers)) as source:
        _check_files(path, source.stream_info.files[0], clip.stream.files)
        _check_size(source, clip.source.info)
        guides = PlacedGuides(source, by_number, place, step if by_number else 1)
        if decoding.trim.is_whole:
            _check_overlap(path, guides, clip)
        yield guides


def _check_files(path: str, file: Path, of_clip: Sequence[Path]) -> None:
    """Raise `OptionError` if the first file of a guide is one of the clip itself, or by its name no picture of it."""
    if os.path.realpath(file) in map(os.path.realpath, of_clip):
        raise OptionError(f"`guide` {path} is the input itself; name a cheap clip of the frames to be made.")
    layers = contents_of(read_exr_header(file)).pictures[:1] if extension_of(file.name) == ".exr" else []
    found = PASS.search(" ".join([file.name, *layers]).lower())
    if found:
        raise OptionError(
            f"`guide` {path} holds {found[0]}, and a guide is a picture of the frame; render that with few samples or "
            "at a small size."
        )


def guides_of(images: Iterable[Image], clip: ClipInfo) -> PlacedGuides:
    """Return images as the guides of output frames in order; raise `InputError` if they have no size for a guide."""
    source = ArraySource(images, Fraction(1), "`guide`")
    _check_size(source, clip)
    return PlacedGuides(source)


@contextmanager
def guides_of_stream(
    guide: PathName | Iterable[Image], clip: DescribedSource, schedule: Schedule, method: Interpolator
) -> Iterator[OwnGuides | PlacedGuides]:
    """Open the guide of a source that is streamed while the block lasts, or take images; see `opened_guides`."""
    path = os.fspath(guide) if isinstance(guide, str | os.PathLike) else ""
    check_together(method.names_given() | {"guide", f"guide={path!r}"})
    if not isinstance(guide, str | os.PathLike):
        yield guides_of(guide, clip.info)
        return
    images = clip.stream_info.images
    numbers = (0, 1) if images is None else images.output_numbers(schedule.rate(clip.info.rate) / clip.info.rate)
    needs = TargetRequirements(linear=method.takes_layers)
    decoding = DecodeOptions(guide=path, input_fps=clip.info.rate)
    with opened_guides(decoding, GuidedClip(clip, clip.stream_info, schedule, needs, None, numbers)) as guides:
        yield guides


def _check_size(guide: FrameSource, clip: ClipInfo) -> None:
    """Raise `InputError` if the pictures of a guide have another shape than a clip, or are larger."""
    size = guide.info.height, guide.info.width
    check_guide_size(guide.info.name, size, (clip.height, clip.width))


def _check_overlap(path: str, guides: PlacedGuides, clip: GuidedClip) -> None:
    """Raise `InputError` if a guide surely shows none of the frames, by the lengths of both."""
    end = clip.frames if guides.by_number else clip.source.info.duration
    length = guides.source.info.duration
    last = None if length is None else guides.first + length / guides.step
    if (end is None or guides.first < end) and (last is None or last > 0):
        return
    if guides.by_number:
        numbers = as_ranges(find_images(path).numbers)
        first, step = clip.numbers
        whole = f"{first} to {first + step * ((clip.frames or 1) - 1)}"
        raise InputError(f"{path} has the numbers {numbers}, and the output has {whole}; number the guides like that.")
    raise InputError(
        f"{path} begins {float(guides.first):.3f} s after the clip and shows none of it; correct `guide_offset`."
    )


def coverage(decoding: DecodeOptions, clip: GuidedClip) -> tuple[str, Remarks]:
    """Return of how many frames a guide has pictures, in words, and a remark on the others; see `opened_guides`."""
    remarks = Remarks()
    with opened_guides(decoding, clip) as guides:
        made = clip.made()
        missing = None if isinstance(guides, OwnGuides) else guides.missing(made)
        if missing is None:
            return "known when the frames are read", remarks
        clip.remark_on_missing(remarks, os.fspath(decoding.guide or OWN), missing, len(made))
        return f"{len(made) - len(missing)} of the {counted(len(made), 'frame')} to be made", remarks.expected
