"""Sources and sinks of frames.

Two contracts, `FrameSource` and `FrameSink`. `fpsboost.io.opening` chooses an implementation by the path, which names a
video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``, ``shot_####.png``), or a pipe
(``-``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo, Frame
    from fpsboost.io.stream_info import StreamInfo
    from fpsboost.io.video.frame_index import FrameIndex


class FrameSource(Protocol):
    """Contract: source of the frames of a clip, read once in presentation order.

    Opening reads only headers. Iterating yields frames whose times strictly increase and whose images all have one
    shape and dtype, and raises `InputError` where the material does not allow that. A source is a context manager;
    leaving it closes the file.
    """

    @property
    def info(self) -> ClipInfo: ...

    @property
    def remarks(self) -> list[str]:
        """Sentences about what was lost or guessed so far (damage, missing duration); complete after the last frame."""
        ...

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class DescribedSource(FrameSource, Protocol):
    """Contract: source that knows what its clip has beside the frames."""

    @property
    def stream_info(self) -> StreamInfo:
        """What a sink can keep besides the frames; may read the first frame."""
        ...


class ClosesOnExit:
    """Context manager that calls `close` on exit."""

    def close(self) -> None:
        """Release all resources."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class FrameSink(Protocol):
    """Contract: sink that writes the whole output or none; only data written to a pipe cannot be undone.

    Frames are written in order, each with its time and duration set. A sink is a context manager: leaving it normally
    finishes the output and gives it its final name; leaving it by an exception removes everything except finished
    frames from which a later run can resume. An existing file of the final name stays untouched until then. Raises
    `OutputError`, never a bare OSError.
    """

    holds_last_frame: bool
    """Whether the last frame must be shown for its duration (video), or the clip ends with it (images)."""

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the target could not hold."""
        ...

    def write(self, frame: Frame) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@runtime_checkable
class Resumable(Protocol):
    """Contract: sink that can resume an earlier run of the same job.

    Frames that the earlier run finished are written again in order, with their times and durations; only their pixels
    are ignored, so that they need not be made.
    """

    @property
    def completed_frames(self) -> int:
        """Number of frames, from the first, that an earlier run has finished; known when the sink is entered."""
        ...


@runtime_checkable
class TakesSideData(Protocol):
    """Contract: sink that takes what is known of frames beside their pixels; see `fpsboost.frame.Frame`."""

    needs_confidence: bool
    """Whether frames that are made are to have their confidence."""
    needs_motion: bool
    """Whether frames are to have the motion between the frames of the source around them."""


@runtime_checkable
class RandomAccess(Protocol):
    """Contract: source that knows when its frames are shown without decoding them, and can begin at any of them."""

    def frame_times(self) -> Sequence[Fraction] | None:
        """Return the times of all frames in order, seconds; None if only decoding tells. Before the first is read.

        They are exactly those that iterating yields: iterating raises `InputError` at a frame that has another time.
        """
        ...

    def begin_at(self, number: int) -> None:
        """Begin reading at a frame, counted from 0. Before the first is read.

        Images, times and durations are those of reading from the start, bit by bit. Where that cannot be had without
        decoding the frames before, they are decoded and dropped, and a remark says why.

        Raises
        ------
        InputError
            There is no such frame, as far as that is known; otherwise while iterating.
        """
        ...


@runtime_checkable
class SharesIndex(Protocol):
    """Contract: source that reads a file to list its frames, and can take that list from another source of the file."""

    @property
    def frame_index(self) -> FrameIndex | None:
        """The list; None if there is none, or `RandomAccess.frame_times` was not called yet."""
        ...

    def take_index(self, index: FrameIndex) -> None:
        """Take the list of a source of the same file; must be called before `RandomAccess.frame_times`."""
        ...


@runtime_checkable
class Stoppable(Protocol):
    """Contract: source that may end where its clip changes in a way that a conversion refuses."""

    @property
    def stopped_by(self) -> str | None:
        """Sentence about the first such change among the frames read so far; None if there was none."""
        ...


@runtime_checkable
class Cancellable(Protocol):
    """Contract: source or sink that waits for another program, possibly forever."""

    def cancel(self) -> None:
        """Stop waiting: a call in another thread ends with an exception."""
        ...
