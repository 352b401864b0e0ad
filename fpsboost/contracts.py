"""Contracts of the loop with what it reads from and writes to; `fpsboost.io` has those that implement them."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo, Frame
    from fpsboost.frame_cache import SourcePosition


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


@runtime_checkable
class HasBeginning(Protocol):
    """Contract: source of a part of a clip."""

    @property
    def beginning(self) -> SourcePosition:
        """Position of the part's first frame in its clip; valid when that has been read."""
        ...


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
class TakesSideData(Protocol):
    """Contract: sink that takes what is known of frames beside their pixels; see `fpsboost.frame.Frame`."""

    needs_confidence: bool
    """Whether frames that are made are to have their confidence."""
    needs_motion: bool
    """Whether frames are to have the motion between the frames of the source around them."""


@runtime_checkable
class Cancellable(Protocol):
    """Contract: source or sink that waits for another program, possibly forever."""

    def cancel(self) -> None:
        """Stop waiting: a call in another thread ends with an exception."""
        ...
