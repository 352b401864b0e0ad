"""Held-out frames: true frames hidden between those that are shown, read as a stream, and samples of them.

A clip is read as a conversion reads it. Frames that repeat another are no truth: where a picture is held between moves,
they are grouped with the first of their kind, and stills do not count.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, pairwise
from typing import Any, NamedTuple

import numpy as np

from fpsboost.analysis.duplicates import DuplicateDetector, PictureRun, SourceFrame, find_pictures
from fpsboost.contracts import FrameSource
from fpsboost.derived_sources import trim_source
from fpsboost.errors import InputError, OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.guides import GuidedClip, opened_guides
from fpsboost.image import Image
from fpsboost.io.opening import PIPES, TargetRequirements, open_source
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.options import Checked, Duplicates, PositiveInt, words_of_options
from fpsboost.timeline import FramePlace, Guides, positions_of
from fpsboost.timing.schedule import ByRate, rising_time

WHOLE = "0:"
"""Range of the whole clip."""


class HeldOutFrame(NamedTuple):
    """Held-out frame, which methods do not see."""

    source: SourceFrame
    """The frame, with its guide, which methods may see."""
    t: Fraction  # place in time between the shown frames, 0 to 1

    @property
    def number(self) -> int:
        """Number of the frame in the clip, counted from 0."""
        return self.source.position.number

    @property
    def truth(self) -> Image:
        """The frame itself, (H, W, C)."""
        return self.source.frame.array


class Interval(NamedTuple):
    """Two shown frames, and the hidden ones between them."""

    shown0: SourceFrame
    """First shown frame."""
    shown1: SourceFrame
    """Second shown frame."""
    hidden: tuple[HeldOutFrame, ...]
    """Hidden frames in order."""
    repeats: tuple[int, ...]
    """Numbers of frames, from the first shown one to the second, that repeat the one before."""
    is_known: bool
    """Whether the pictures at the times of the hidden frames are known; see `HoldOut`."""

    def prepared(self, *, with_layers: bool = False) -> tuple[FrameCache, FrameCache]:
        """Return the shown frames, as arrays or with layers, with empty caches."""
        shown = self.shown0, self.shown1
        first, second = (each.with_image(each.image if with_layers else each.frame.array) for each in shown)
        return first, second

    def prepared_truths(self) -> list[FrameCache]:
        """Return the hidden frames with empty caches."""
        return [hidden.source.with_image(hidden.truth) for hidden in self.hidden]


class _Truth(NamedTuple):
    """A frame, and which frames repeat it or which one it repeats."""

    source: SourceFrame
    repeats: tuple[int, ...]  # numbers of the frames after it that show the same and are grouped with it
    is_repeat: bool  # whether it repeats the one before, in a still


@dataclass(frozen=True)
class HoldOut(Checked):
    """Choice of the frames of a clip that are hidden, and options for reading the clip.

    Where a picture is held for several frames between moves (see `fpsboost.analysis.duplicates`), its first frame
    stands for it. Some intervals do not count, because the pictures at the times of their hidden frames are unknown:
    where pictures are held unevenly long (where every 25th frame is a repeat, was a picture missed, or were all of them
    slowed down?), where two frames show the same because a still begins, lasts or ends, and across a pause in which
    conversions interpolate nothing.

    A hidden frame has its time in the clip between the shown ones; it divides their interval evenly if the difference
    is no more than what conversions take for the rounding and jitter of a clock.

    Parameters
    ----------
    skip : int
        Number of frames that are hidden between two shown ones.
    first, last : int
        Range of frames, counted from 0, without the last; None is the end of the clip.
    decoding : DecodeOptions
        Options for reading the clip.
    duplicates : {'interpolate', 'keep'}
        Whether repeated frames are grouped or kept.
    counts_frames : bool
        Whether the numbers of frames matter, so that none may be left unread.

    Raises
    ------
    OptionError
        The range is too short, or contradicts `decoding`.
    """

    skip: PositiveInt = 1
    first: int = 0
    last: int | None = None
    decoding: DecodeOptions = DecodeOptions()
    duplicates: Duplicates = "interpolate"
    counts_frames: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.first < 0 or (self.last is not None and self.last - self.first < self.skip + 2):
            raise OptionError(
                f"`range={self._range}` leaves nothing to hide; with `skip={self.skip}` give at least {self.skip + 2} "
                "frames."
            )

    def names_given(self) -> set[str]:
        """Return the names of the options that are given; see `fpsboost.options.Checked`."""
        return super().names_given() | ({"range"} if self._range != WHOLE else set())

    @property
    def _range(self) -> str:
        """The range as text, as the option has it."""
        return f"{self.first}:{'' if self.last is None else self.last}"

    def as_options(self) -> list[str]:
        """Return options that differ from the defaults, as words of the command line."""
        words = words_of_options(self.decoding)
        if self.duplicates != "interpolate":
            words = ["--duplicates", self.duplicates, *words]
        if self._range != WHOLE:
            words = ["--range", self._range, *words]
        return words if self.skip == 1 else ["--skip", str(self.skip), *words]

    def as_json(self) -> dict[str, Any]:
        """Return plain data by the names of the options; a range as its two ends."""
        start = self.decoding.trim.start
        end = self.decoding.trim.end
        return {
            "skip": self.skip,
            "first": self.first,
            "last": self.last,
            "start": start and start.as_option(),
            "end": end and end.as_option(),
            "stream": self.decoding.stream,
            "deinterlace": self.decoding.deinterlace,
            "size_change": self.decoding.size_change,
            "duplicates": self.duplicates,
        }

    def intervals(self, path: str) -> Iterator[Interval]:
        """Read a clip and yield its intervals; remaining frames at the end that do not fill one are left out.

        Raises `InputError` if the clip cannot be read, has no complete interval, or holds NaN or infinity.
        """
        if path in PIPES:
            raise InputError("Standard input can be read only once, and every method needs it; name a file.")
        needs_rate = self.decoding.trim.needs_rate
        requirements = TargetRequirements(pictures_alone=True, upright=True, needs_rate=needs_rate, linear=True)
        count = repeats = 0
        with (
            open_source(path, requirements=requirements, decoding=self.decoding) as whole,
            opened_guides(self.decoding, GuidedClip(whole, whole.stream_info, Fraction(1), requirements)) as guides,
        ):
            info = whole.info
            clock = ByRate.forgiving(2 * info.rate, info.rate, info.time_base)  # as in a conversion to twice the rate
            source, _ = trim_source(whole, self.decoding.trim, may_skip=not self.counts_frames)
            row: list[_Truth] = []
            for truth in self._truths(self._shown(source, clock, path, guides)):
                row.append(truth)
                repeats += len(truth.repeats)
                if len(row) == self.skip + 2:
                    count += 1
                    yield _interval(row, clock)
                    row = row[-1:]
        if not count:
            beside = f" beside the {repeats} that repeat another (`duplicates='keep'` takes them too)"
            raise InputError(
                f"{path} has too few frames to hide {'one' if self.skip == 1 else self.skip} between two others; "
                f"{self.skip + 2} are needed in the range{beside if repeats else ''}."
            )

    def _shown(self, source: FrameSource, clock: ByRate, path: str, guides: Guides | None) -> Iterator[SourceFrame]:
        """Yield the frames of the range, at the times that a conversion gives them, with their guides."""
        start = Fraction(0)
        last: Fraction | None = None
        for number, frame in islice(enumerate(source), self.last):
            if number == 0:
                start = frame.time
            if number < self.first:
                continue
            position = positions_of(source)(number, frame.time - start)
            if frame.array.dtype == np.float32 and not np.isfinite(frame.array).all():
                raise InputError(
                    f"Frame {position.number} of {path} contains NaN or infinity, so that nothing can "
                    "be compared with it; repair it, or leave it out with `range`."
                )
            time = rising_time(clock, start, frame.time, last)
            if time is not None:
                last = time
                # frames, and their guides, are those of an output at the clip's own times
                shown = SourceFrame(replace(frame, time=time), None, Fraction(position.number), position)
                if guides is not None:
                    shown.guide = guides(
                        FramePlace(Fraction(position.number), position.seconds, 1 / source.info.rate, None)
                    )
                yield shown

    def _truths(self, frames: Iterator[SourceFrame]) -> Iterator[_Truth]:
        """Yield the frames with their repeats, grouped or kept."""
        if self.duplicates == "keep":
            pictures: Iterator[PictureRun] = (PictureRun((each,), is_still=False, repeats=0) for each in frames)
        else:
            pictures = find_pictures(frames, DuplicateDetector())
        for picture in pictures:
            if picture.is_still:
                first_repeat = len(picture.frames) - picture.repeats
                for index, each in enumerate(picture.frames):
                    yield _Truth(each, (), is_repeat=index >= first_repeat)
            else:
                first, *repeats = picture.frames
                yield _Truth(first, tuple(each.position.number for each in repeats), is_repeat=False)


def _interval(row: Sequence[_Truth], clock: ByRate) -> Interval:
    """Return the interval of a row of frames: the first and the last are shown, those between are hidden."""
    before, *between, after = row
    begin = before.source.time
    end = after.source.time
    hidden = []
    for k, truth in enumerate(between, start=1):
        even = Fraction(k, len(between) + 1)
        t = (truth.source.time - begin) / (end - begin)
        is_even = abs(t - even) * (end - begin) <= clock.tolerance
        hidden.append(HeldOutFrame(truth.source, even if is_even else t))
    repeats = [number for truth in row[:-1] for number in truth.repeats]
    repeats += [truth.source.position.number for truth in row[1:] if truth.is_repeat]
    is_known = (
        len({len(truth.repeats) for truth in row[:-1]}) == 1
        and not any(truth.is_repeat for truth in row[1:])
        and not any(later.source.time - earlier.source.time > clock.longest for earlier, later in pairwise(row))
    )
    return Interval(
        before.source,
        after.source,
        tuple(hidden),
        tuple(sorted(repeats)),
        is_known,
    )


class Sample(NamedTuple):
    """A hidden frame, and the interval that it lies in."""

    hidden: HeldOutFrame
    interval: Interval


def read_samples(path: str, hold_out: HoldOut, numbers: Collection[int]) -> dict[int, Sample]:
    """Return some of the hidden frames by their numbers."""
    samples = (Sample(hidden, interval) for interval in hold_out.intervals(path) for hidden in interval.hidden)
    return {sample.hidden.number: sample for sample in samples if sample.hidden.number in numbers}


def parse_range(text: str) -> tuple[int, int | None]:
    """Parse ``A:B``, frames with or without an ``f``, either of which may be left out; else raises `OptionError`.

    Examples
    --------
    >>> parse_range("100:"), parse_range("0:24f")
    ((100, None), (0, 24))
    """
    found = re.fullmatch(r"(?:([0-9]{1,15})f?)?:(?:([0-9]{1,15})f?)?", text)
    if found is None:
        raise OptionError(
            f"`range` {text!r} is not a range of frames; write it like 0:50, 100: or :50, and times with `start` "
            "and `end`."
        )
    return int(found[1] or 0), int(found[2]) if found[2] else None
