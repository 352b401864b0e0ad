"""Guides of a clip: opened, checked beside it, and found by number or by time; see `fpsboost.synthesis.guided`."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from textwrap import shorten

from fpsboost.contracts import RandomAccess, Summary
from fpsboost.errors import InputError, OptionError
from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.image_checks import check_guide_size
from fpsboost.io import DescribedSource
from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import extension_of
from fpsboost.io.images.layers import contents_of
from fpsboost.io.images.source import find_images
from fpsboost.io.opening import PIPES, TargetRequirements, open_source, stands_for_images
from fpsboost.io.output import StreamInfo
from fpsboost.io.video.capture import ArraySource
from fpsboost.io.video.decode_options import OWN, DecodeOptions
from fpsboost.layered import FrameImage
from fpsboost.media import counted
from fpsboost.options import PathName
from fpsboost.remarks import Remarks
from fpsboost.synthesis.guided import describe_findings
from fpsboost.timeline import FramePlace, Guides
from fpsboost.timing.position import as_ranges

TOLERANCE = Fraction(1, 4)
"""Farthest that a guide lies from its frame in time, as a part of the interval between output frames."""

MOST_LISTED = 60
"""Length of the list of frames in a remark."""

PASS = re.compile(r"(?<![a-z])(normals?|albedo|depth)(?![a-z])")
"""Words in the names of passes that are no pictures."""


@dataclass(frozen=True)
class GuidedClip:
    """What a guide must agree with: a clip, and the frames that are made of it."""

    source: RandomAccess
    """The part of the clip that is converted."""
    stream: StreamInfo
    """Files of the clip, and whether they are images."""
    factor: Fraction | None
    """Output frames per image, where images may keep their numbers."""
    requirements: TargetRequirements
    """How the clip is read."""

    @property
    def numbers(self) -> tuple[int, int]:
        """Number of the first output frame, as the images that are written have it, and the step to the next one."""
        images = self.stream.images
        return (0, 1) if images is None else images.output_numbers(self.factor)

    def remarks(self, guide: PathName | None, summary: Summary) -> Remarks:
        """Return the remarks on a conversion with a guide."""
        remarks = Remarks()
        missing = summary.guides_missing
        count = summary.guided_frames
        if missing and guide != OWN:
            first, step = self.numbers
            numbers = as_ranges(first + step * number for number in missing)
            numbers = shorten(numbers, MOST_LISTED, placeholder=" ...")
            made = count + len(missing)
            remarks.add("guide-missing", name=guide, missing=len(missing), frames=made, numbers=numbers)
        if summary.guide_figures:
            found = describe_findings({name: figure / count for name, figure in summary.guide_figures.items()})
            remarks.add("guide-followed", name=guide, frames=counted(count, "frame"), found=found)
        return remarks


@dataclass
class PlacedGuides:
    """Guides that are the frames of a source, which is read as far as they are asked for."""

    source: DescribedSource
    offset: Fraction = Fraction(0)
    """Time in the source, after its first frame, of output frame 0, or of the clip's first frame."""
    step: int | None = 1
    """Seconds of the source from an output frame to the next; None if guides go by time."""
    frames: Iterator[Frame] | None = None
    """Frames of the source, with times after the first one; by default read when the first is asked for."""
    near: list[Frame] = field(default_factory=list)
    """The last frames that were read, one before the frame that was asked for last and one after it."""

    def picture(self, place: FramePlace) -> FrameImage | None:
        """Return the picture that is nearest to a frame; see `fpsboost.timeline.Guides`."""
        at, tolerance = place.seconds, place.interval * TOLERANCE
        if self.step is not None:
            at, tolerance = place.number * self.step, Fraction(0)
        at += self.offset
        self.frames = self.frames or self._read_from(at)
        while not (self.near and self.near[-1].time >= at) and (following := next(self.frames, None)):
            self.near = [*self.near[-1:], following]
        nearest = min(self.near, key=lambda each: abs(each.time - at))
        return nearest.image if abs(nearest.time - at) <= tolerance else None

    def _read_from(self, at: Fraction) -> Iterator[Frame]:
        """Yield frames with their times after the first one, from the last one before a time on."""
        start = None
        if at > 0 and (times := self.source.frame_times()):
            start = times[0]
            self.source.begin_at(max(0, bisect_left(times, start + at) - 1))
        for frame in self.source:
            start = frame.time if start is None else start
            yield replace(frame, time=frame.time - start)


def own_picture(place: FramePlace) -> FrameImage | None:
    """Return the frame of the source that is to be replaced as the guide of its own repair."""
    return None if place.source is None else place.source.image


def guides_of(images: Iterable[Image] | None) -> Guides | None:
    """Return images as the guides of output frames in order; None without."""
    return None if images is None else PlacedGuides(ArraySource(images, Fraction(1), "`guide`")).picture


@contextmanager
def opened_guides(decoding: DecodeOptions, clip: GuidedClip) -> Iterator[Guides | None]:
    """Open the guide that options name for a clip while the block lasts; None if they name none.

    Raises
    ------
    InputError, OptionError
        It cannot be read, is no picture of the clip, has another shape, or is larger.
    """
    if decoding.guide_path is None:
        yield None if decoding.guide is None else own_picture
        return
    with placed_guides(decoding.guide_path, decoding, clip) as guides:
        yield guides.picture


@contextmanager
def placed_guides(path: str, decoding: DecodeOptions, clip: GuidedClip) -> Iterator[PlacedGuides]:
    """Open the guide of a clip at a path while the block lasts; see `opened_guides`."""
    if path in PIPES:
        raise OptionError("`guide` is read beside the input, which a pipe does not allow; name a file or a folder.")
    offset = Fraction(decoding.guide_offset)
    step = None
    if stands_for_images(path):
        if offset:
            raise OptionError(f"`guide_offset` is for guides by time, and {path} goes by numbers; leave it out.")
        numbers = find_images(path).numbers
        if not numbers:
            raise InputError(f"The images of {path} have no numbers; give them those of the output frames.")
        first, step = clip.numbers
        if clip.stream.images is not None:  # those of a video are taken in order
            offset = Fraction(first - numbers[0])
    reading = DecodeOptions(input_fps=step and Fraction(1))
    with open_source(path, requirements=clip.requirements, decoding=reading, fill_gaps=bool(step)) as source:
        if step is None and clip.stream.images is not None and decoding.input_fps is None:
            raise OptionError(f"{path} goes by time, and images have no frame rate; say it with `input_fps`.")
        _check_file(path, source.stream_info.files[0])
        shown = clip.source.info
        check_guide_size(path, (source.info.height, source.info.width), (shown.height, shown.width))
        yield PlacedGuides(source, offset, step)


def _check_file(path: str, file: Path) -> None:
    """Raise `OptionError` if the first file of a guide is, by its name, no picture."""
    layers = contents_of(read_exr_header(file)).pictures[:1] if extension_of(file.name) == ".exr" else []
    found = PASS.search(" ".join([file.name, *layers]).lower())
    if found:
        raise OptionError(
            f"`guide` {path} holds {found[0]}, and a guide is a picture of the frame; render that with few samples or "
            "at a small size."
        )
