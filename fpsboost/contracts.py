"""Contracts of the loop: sources, sinks and observers; the part of an output that a run writes; its summary."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from fpsboost.remarks import Remarks
from fpsboost.timing.options import FrameIntervals

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo, Frame
    from fpsboost.frame_cache import SourcePosition


@runtime_checkable
class FrameSource(AbstractContextManager["FrameSource"], Protocol):
    """Contract: source of the frames of a clip, read once in presentation order.

    Opening reads only headers. Iterating yields frames whose times strictly increase and whose images all have one
    shape and dtype, and raises `InputError` where the material does not allow that. A source is a context manager;
    leaving it closes the file.
    """

    @property
    def info(self) -> ClipInfo: ...

    @property
    def remarks(self) -> Sequence[str]:
        """What was lost or guessed so far (damage, missing duration); complete after the last frame.

        A `fpsboost.Remark` says so as data too; a plain sentence gets the kind ``other``.
        """

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...


@runtime_checkable
class HasPositions(Protocol):
    """Contract: source of a part of a clip, or of a loop."""

    def position_of(self, number: int, seconds: Fraction) -> SourcePosition:
        """Return the position in the clip of a frame, by its number and its time after the first frame, seconds.

        Known when the first frame has been read.
        """


class RandomAccess(FrameSource, Protocol):
    """Contract: source that may know when its frames are shown without decoding them, and can begin at any of them."""

    def frame_times(self) -> Sequence[Fraction] | None:
        """Return the times of all frames in order, seconds; None if only decoding tells. Before the first is read.

        They are exactly those that iterating yields: iterating raises `InputError` at a frame that has another time.
        """

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, counted from 0. Before the first is read.

        Frames are those of reading from the start, bit by bit; where that needs the frames before, they are decoded and
        dropped, and a remark says why. Raises `InputError`, here or while iterating, if there is no such frame.
        """


class ClosesOnExit:
    """Context manager that calls `close` on exit."""

    def close(self) -> None:
        """Release all resources; there are none unless a subclass says how."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class ReadInOrder(ClosesOnExit):
    """Source that reads all frames from the first one on, and whose times only decoding tells; see `RandomAccess`."""

    _begin = 0
    """Number of frames that are read and dropped."""

    def frame_times(self) -> None:
        """Return None."""

    def begin_at(self, number: int) -> None:
        """Drop the frames before the one with a number, counted from 0."""
        self._begin = number


@runtime_checkable
class FrameSink(AbstractContextManager["FrameSink"], Protocol):
    """Contract: sink that writes the whole output or none; only data written to a pipe cannot be undone.

    Frames are written in order, each with its time and duration set; those that are made have their confidence, and the
    first one between two frames their motion, if the sink has an attribute `needs_confidence` or `needs_motion` that is
    True. An attribute `details` says how it writes, for verbose output. A sink is a context manager: leaving it
    normally finishes the output and gives it its final name; leaving it by an exception removes everything except
    finished frames from which a later run can resume. An existing file of the final name stays untouched until then.
    Raises `OutputError`, never a bare OSError.
    """

    holds_last_frame: bool
    """Whether the last frame must be shown for its duration (video), or the clip ends with it (images)."""

    @property
    def remarks(self) -> Sequence[str]:
        """What the target could not hold; see `FrameSource.remarks`."""

    def write(self, frame: Frame) -> None: ...

    def __enter__(self) -> Self: ...


@runtime_checkable
class Cancellable(Protocol):
    """Contract: source or sink that waits for another program, possibly forever."""

    def cancel(self) -> None:
        """Stop waiting: a call in another thread ends with an exception."""


@dataclass(frozen=True)
class Entry:
    """State in which the loop begins in the middle of a clip, and goes on as if it had read the clip from its start."""

    number: int
    """Source frame that is read first, counted from 0."""
    start: Fraction
    """Time of the clip's first frame, seconds."""
    outputs_before: int
    """Number of output frames before that source frame."""
    step: float = math.inf
    """Difference of the frame from the picture before it, for the detector of duplicates; infinite at the start."""


@dataclass(frozen=True)
class OutputRange:
    """Output frames that a run writes, of all that the whole clip gives."""

    first: int = 0
    """Number of the first frame, counted from 0."""
    stop: int | None = None
    """Number of the first frame after the range; None if there is none."""
    skip: int = 0
    """Number of frames, from the first, that the sink has already; see `fpsboost.media.StagedSink`. They are
    counted and passed on in order, but instead of an interpolated image they carry one of the source."""
    entry: Entry | None = None
    """Where reading begins, early enough for the first frame; None for the start of the clip."""
    end: Fraction | None = None
    """Time at which the output ends though the source goes on, as that of a loop does, seconds; None if it does not."""

    def __contains__(self, number: int) -> bool:
        return self.first <= number and not self.is_past(number)

    def count(self, total: int) -> int:
        """Return the number of frames in the range, of `total` that the whole clip gives."""
        return (total if self.stop is None else self.stop) - self.first

    def is_past(self, number: int) -> bool:
        """Return whether an output frame comes after the range."""
        return self.stop is not None and number >= self.stop


@dataclass(frozen=True)
class SourceMoment:
    """Frame of the source: its number, counted from 0, and its presentation time, seconds."""

    number: int
    time: Fraction


@dataclass(frozen=True)
class LowestMatch:
    """Frame of the output that was made of the two frames that match least, across no scene cut."""

    match_score: float
    """How well the two frames match, 0 to 1; see `fpsboost.pair.Pair.detected_match_score`."""
    number: int
    """Number of the frame, counted from 0."""
    time: Fraction
    """Presentation time of the frame, seconds after the output's first frame."""


@dataclass
class Summary:
    """Counts and remarks of a conversion."""

    frames_in: int = 0
    """Frames read."""
    frames_out: int = 0
    """Frames written."""
    frames_made: int = 0
    """Frames written that are not from the source: interpolated, or repeated across a cut."""
    scene_cuts: int = 0
    """Pairs in which a scene ends; they were not interpolated across."""
    duplicates: int = 0
    """Duplicate frames that were interpolated across."""
    replaced: list[int] = field(default_factory=list)
    """Numbers of the frames that were replaced because they are damaged, counted from 0 in the source."""
    unsure_frames: int = 0
    """Interpolated frames with places where motion is unsure, so that something else is shown there."""
    unsure_pixels: float = 0.0
    """Their unsure pixels, in frames."""
    guided_frames: int = 0
    """Interpolated frames that were made with a guide."""
    guides_missing: list[int] = field(default_factory=list)
    """Numbers of the interpolated frames without a guide, counted from 0 in the output; empty if none have one."""
    guide_figures: dict[str, float] = field(default_factory=dict)
    """Sums over `guided_frames` of what their guides told; see `fpsboost.synthesis.guided.GuideFindings`."""
    completed_frames: int = 0
    """Frames of `frames_out` that an earlier run had finished."""
    seconds: float = 0.0
    """Wall time of the loop."""
    remarks: Remarks = field(default_factory=Remarks)
    """Everything that was lost or guessed: sentences, each with its kind and values, see `fpsboost.Remark`."""
    details: str = ""
    """How the target was written, for verbose output; empty if there was no choice."""
    frame_intervals: FrameIntervals = field(default_factory=FrameIntervals)
    """Intervals between the frames of the source."""
    search_radii: set[int] = field(default_factory=set)
    """Search radii that were chosen for pairs of frames, pixels; empty if the method has none."""
    lowest_match: LowestMatch | None = None
    """Where the result is least certain; None if nothing was made between two frames of a scene."""
    lowest_match_file: str = ""
    """File name of that image; empty in a video."""
    boundaries: dict[int, SourceMoment] = field(default_factory=dict)
    """The frame of the source at or before the first output frame of a part of a conversion, and before the first one
    after it, by the numbers of these output frames."""

    def note_match(self, match: LowestMatch | None) -> None:
        """Keep a match if it is the lowest so far; must be called in the order of the frames."""
        if match is not None and (self.lowest_match is None or match.match_score < self.lowest_match.match_score):
            self.lowest_match = match

    def note_guides(self, count: int, figures: Mapping[str, float]) -> None:
        """Add sums of figures over so many frames that were made with a guide."""
        self.guided_frames += count
        for name, figure in figures.items():
            self.guide_figures[name] = self.guide_figures.get(name, 0.0) + figure


@runtime_checkable
class Observer(Protocol):
    """Contract: is informed of the progress of a conversion."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """Handle the opening of source and target; `expected_frames` follow if the source's header is right."""

    def ready(self) -> None:
        """Handle that kernels are compiled, or loaded from the cache; the first frame comes next."""

    def wrote(self, summary: Summary) -> None:
        """Handle another frame that was passed on to the target."""


@runtime_checkable
class FrameWatcher(Protocol):
    """Contract: sees the frames of an output as they are written."""

    needs_confidence: bool
    """Whether frames that are made are to have their confidence; see `fpsboost.Frame`."""

    def watch(self, frame: Frame) -> None:
        """Take notice of the next frame, whose image must not be changed."""


class SilentObserver:
    """Observer that does nothing, as a base of those that need some of the methods."""

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None: ...
    def ready(self) -> None: ...
    def wrote(self, summary: Summary) -> None: ...
